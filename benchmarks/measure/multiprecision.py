"""Errors of methods and structural defects of their steps, measured in multiprecision, so without round-off.

Each measurement runs every method of the registry on the test systems of `battery` that the method can integrate,
uncompiled, with 40 digits or more.  The reference is Gragg's extrapolated explicit midpoint rule, which shares only the
vector field with the methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import cache, wraps
from typing import Any

import mpmath
import numpy as np

from phasebench.integrators.compile.codegen import MULTIPRECISION, epsilon, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.values.kinds import Number

from .battery import (
    LATER,
    LOW_ORDER,
    SYSTEMS,
    by_label,
    high_order_variants,
    keeps_a_form,
    magnetic,
    systems,
    variants,
)
from .metrics import Order, order
from .step_map import jacobian, pair_defect, restricted, return_distance, symplecticity_defect, volume

DIGITS = 40
SPAN = Fraction(1, 256)
LADDER = (1, 2, 3, 4)
#: Ladder for methods whose step depends on the vector field: the last step before a row is cut, so steps must be many.
FIELD_LADDER = (24, 32, 48)
#: Ladder for methods that need earlier states, as multiples of their number: the first steps are another method's.
MULTISTEP_LADDER = (64, 96, 128)
STEP = Fraction(1, 40)
#: Step for the defects of methods with variable steps, whose defect is as small as their error.
VARIABLE_STEP = Fraction(3, 10)
COLUMNS = 14


#: Amplification of round-off: the sum of the absolute weights (which add up to 1) of the extrapolated results.
AMPLIFIED = sum(
    abs(math.prod(Fraction(n**2, n**2 - m**2) for m in range(2, 2 * COLUMNS + 1, 2) if m != n))
    for n in range(2, 2 * COLUMNS + 1, 2)
)


def extrapolate(f: Callable[[np.ndarray], np.ndarray], y: np.ndarray, T: Number) -> tuple[np.ndarray, Number]:
    """Solve y' = f(y) by extrapolation of the explicit midpoint rule (W. B. Gragg 1965): (y(T), uncertainty).

    The uncertainty, in the max norm, is the difference between the last two entries in the last row of the table, plus
    a bound of round-off.
    """
    rows: list = []
    for j in range(COLUMNS):
        n = 2 * (j + 1)
        h = T / n
        a, b = y, y + h * f(y)
        for _ in range(n - 1):
            a, b = b, a + 2 * h * f(b)
        row = [(a + b + h * f(b)) / 2]
        for k in range(1, j + 1):
            m = 2 * (j + 1 - k)
            row.append(row[k - 1] + (row[k - 1] - rows[j - 1][k - 1]) * m**2 / (n**2 - m**2))
        rows.append(row)
    end = rows[-1][-1]
    round_off = int(AMPLIFIED) * epsilon(MULTIPRECISION) * max(abs(end))
    return end, max(abs(end - rows[-1][-2])) + round_off


def flow(
    system: PartitionedSystem, y: np.ndarray | Sequence[Number], T: Fraction | Number, pieces: int = 8
) -> tuple[np.ndarray, Number]:
    """Return (y(T), its uncertainty) of a system's flow from y = (q, p), by `extrapolate` on ``pieces`` parts of T."""
    f = system.vector_field(MULTIPRECISION)
    y, T, doubt = vector(y), to_number(T, MULTIPRECISION), 0
    for _ in range(pieces):
        y, more = extrapolate(lambda x: f(0, x), y, T / pieces)
        doubt += more
    return y, doubt


def digits(record: Method) -> int:
    """Return the decimal digits in which a method is measured, so many that its errors are far above round-off."""
    return max(DIGITS, 8 * record.order)


def _of_precision(function: Callable) -> Callable:
    """Cache a function of a name for each working precision."""
    kept = cache(lambda name, digits: function(name))
    return wraps(function)(lambda name: kept(name, mpmath.mp.dps))


@_of_precision
def start(name: str) -> tuple[PartitionedSystem, np.ndarray]:
    """Return (system, state (q, p)) of a test system in working precision, on its orbit away from turning points."""
    system, q, p = SYSTEMS[name]()
    y = vector([*q, *p])
    if name not in ("tao", "coupled", "two-frequencies"):
        y = flow(system, y, LATER)[0]
    return system, y


@_of_precision
def reference(name: str) -> tuple[PartitionedSystem, np.ndarray, np.ndarray, Number]:
    """Return (system, initial state, state at time `SPAN`, its uncertainty) of a test system, in working precision."""
    system, y = start(name)
    return system, y, *flow(system, y, SPAN)


def displacement() -> Number:
    """Return the displacement for a Jacobian by fourth-order differences: the working round-off to the power 1/5."""
    return epsilon(MULTIPRECISION) ** 0.2


def advance(
    system: PartitionedSystem, record: Method, y: np.ndarray, h: Fraction | Number, steps: int = 1
) -> np.ndarray:
    """Return the state after ``steps`` steps h of a method from y = (q, p), array (2 d,), in multiprecision.

    Raises ArithmeticError if the integration fails.
    """
    d = system.d
    s = integrate(system, record, h=h, steps=steps, q0=y[:d], p0=y[d:], arithmetic=MULTIPRECISION, save_every=0)
    if s.status != "ok":
        raise ArithmeticError(f"{record.label}: {s.reason}")
    return np.concatenate([s.q[-1], s.p[-1]])


def errors(record: Method, name: str) -> dict:
    """Return errors on a test system at `SPAN`: lists h and error; the reference's uncertainty ``doubt``."""
    system, y, end, doubt = reference(name)
    steps = ladder(record)
    error = [max(abs(advance(system, record, y, SPAN / n, n) - end)) for n in steps]
    return {"h": [float(SPAN / n) for n in steps], "error": [float(e) for e in error], "doubt": float(doubt)}


def ladder(record: Method) -> tuple[int, ...]:
    """Return the numbers of steps to time `SPAN` with which a method is run to measure its order."""
    if not record.one_step:
        return tuple(n * record.earlier for n in MULTISTEP_LADDER)
    return FIELD_LADDER if record.family == "field" else LADDER


def retraction(system: PartitionedSystem) -> Callable[[np.ndarray], np.ndarray] | None:
    """Make the map from states (2 d,) near a system's constraint manifold to states on it; None without constraints."""
    if not system.constrained:
        return None
    d = system.d
    return lambda y: np.concatenate(system.retract(y[:d], y[d:], MULTIPRECISION))


def step_of(record: Method) -> Fraction:
    """Return the step size at which a method's defects of symplecticity, symmetry and volume are measured."""
    return VARIABLE_STEP if record.family in ("adaptive", "field") else STEP


def defect(record: Method, name: str) -> float:
    """Return the symplecticity defect max |M^T J M - J| of a method's step on a test system, M its Jacobian.

    With constraints it is that of the two-form on the manifold; above `LOW_ORDER` that of one pair of vectors.
    """
    system, y = start(name)
    h = step_of(record)
    retract = retraction(system)
    if record.order > LOW_ORDER:
        return float(pair_defect(lambda x: advance(system, record, x, h), y, retract))
    if retract is not None:
        return float(np.max(np.abs(restricted(lambda x: advance(system, record, x, h), retract, y, displacement()))))
    return float(symplecticity_defect(jacobian(lambda x: advance(system, record, x, h), y, displacement())))


def distance(record: Method, name: str, back: Method | None = None) -> float:
    """Return the distance from the start after a step h with ``record`` and a step -h with ``back``, on a test system.

    ``back`` is by default ``record`` itself: the distance is then the defect of symmetry.
    """
    system, y = start(name)
    h = step_of(record)
    there, again = (lambda x: advance(system, record, x, h)), (lambda x: advance(system, back or record, x, -h))
    return float(return_distance(there, again, y))


def volume_defect(record: Method, name: str) -> float:
    """Return |det M - 1| for the Jacobian M of one step of a method on a test system, a key of `battery.SYSTEMS`."""
    system, y = start(name)
    return volume(lambda x: advance(system, record, x, step_of(record)), y, displacement())[0]


#: Measurement -> (function of a method and a system, systems for a method).
CELLS = {
    "orders": (errors, systems),
    "symplecticity": (defect, lambda m: [n for n in systems(m, few=True) if m.one_step and keeps_a_form(n)]),
    "symmetry": (distance, lambda m: systems(m, few=True) if m.one_step else []),
    "volume": (volume_defect, magnetic),
}


def cells(what: str) -> list[tuple[str, str]]:
    """Return the pairs (method's label, test system) on which the measurement ``what``, a key of `CELLS`, is made."""
    return [(m.label, n) for m in methods().values() for n in CELLS[what][1](m)]


def measure(what: str, label: str, name: str) -> dict | float | str:
    """Make a measurement of `CELLS`: its result or, if it fails, the error's text."""
    record = methods()[label]
    with precision(digits(record)):
        try:
            return CELLS[what][0](record, name)
        except Exception as error:  # a method that fails must not break the measurement of the others
            return f"{type(error).__name__}: {error}"


@cache
def methods() -> dict[str, Method]:
    """Return the dict label -> method of all methods, with parameter values, that are measured."""
    return by_label(variants() + high_order_variants())


def observed_order(row: Mapping[str, Any]) -> Order:
    """Return the observed order from a result of `errors`, without errors up to ten times the uncertainty."""
    return order(row["h"], row["error"], noise=10 * row["doubt"])
