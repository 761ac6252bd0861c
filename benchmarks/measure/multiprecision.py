"""Errors of methods and structural defects of their steps, measured in multiprecision, so without round-off.

Each measurement runs every method of the registry on the test systems of `battery` that the method can integrate,
uncompiled, with 40 digits or more.  The reference is Gragg's extrapolated explicit midpoint rule, which shares only the
vector field with the methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import mpmath
import numpy as np

from phasebench.integrators.compile.codegen import MULTIPRECISION, epsilon, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method

from .battery import (
    FEW,
    LATER,
    LOW_ORDER,
    SYSTEMS,
    by_label,
    high_order_variants,
    keeps_a_form,
    magnetic,
    runs_on,
    systems,
    variants,
)
from .metrics import order
from .step_map import jacobian, pair_defect, restricted, return_distance, symplecticity_defect, volume

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem
    from phasebench.integrators.values.kinds import Number

    from .metrics import Order

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
#: Relative perturbation of a coefficient that must be detected, and the step for it.
SLIP, SHORT_STEP = Fraction(1, 10**6), SPAN / 16
#: Methods with more coefficients are left out: their tables are checked by the order conditions.
MOST = 12
COLUMNS = 14


#: Amplification of round-off: the sum of the absolute weights (which add up to 1) of the extrapolated results.
AMPLIFIED = sum(
    abs(math.prod(Fraction(n**2, n**2 - m**2) for m in range(2, 2 * COLUMNS + 1, 2) if m != n))
    for n in range(2, 2 * COLUMNS + 1, 2)
)


def extrapolate(f: Callable[[np.ndarray], np.ndarray], y: np.ndarray, T: Number) -> tuple[np.ndarray, Number]:
    """Solve y' = f(y) from y over a time T, by extrapolation of the explicit midpoint rule (W. B. Gragg 1965).

    Returns (y(T), its uncertainty in the max norm), y being an array of multiprecision numbers.

    The uncertainty is the difference between the last two entries in the last row of the extrapolation table, plus a
    bound of round-off.
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


def start(name: str) -> tuple[PartitionedSystem, np.ndarray]:
    """Return (system, state (q, p)) of a test system, ``name`` in `battery.SYSTEMS`, in the working precision.

    The state is on the system's orbit away from turning points, at which symmetry would raise the observed order.
    """
    return _start(name, mpmath.mp.dps)


@cache
def _start(name: str, digits: int) -> tuple[PartitionedSystem, np.ndarray]:
    system, q, p = SYSTEMS[name]()
    y = vector([*q, *p])
    if name not in ("tao", "coupled", "two-frequencies"):
        y = flow(system, y, LATER)[0]
    return system, y


def reference(name: str) -> tuple[PartitionedSystem, np.ndarray, np.ndarray, Number]:
    """Return (system, initial state, state at time `SPAN`, its uncertainty) of a test system, in working precision.

    ``name`` is a key of `battery.SYSTEMS`; the later state is computed by extrapolation (`flow`).
    """
    return _reference(name, mpmath.mp.dps)


@cache
def _reference(name: str, digits: int) -> tuple[PartitionedSystem, np.ndarray, np.ndarray, Number]:
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
    """Return a method's errors on a test system at time `SPAN` for several steps: {h, error, doubt}.

    ``h`` and ``error`` are lists, the errors in the max norm; ``doubt`` is the uncertainty of the reference.
    """
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

    With constraints it is that of the two-form on the manifold.  For an order above `LOW_ORDER` it is the change of the
    two-form of one pair of vectors only.
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

    ``back`` is a method, by default ``record`` itself: the distance is then the defect of symmetry.  h is the step of
    `step_of`, and ``name`` a key of `battery.SYSTEMS`.
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
    """Return the pairs (method's label, test system's name) on which the measurement ``what`` is made.

    ``what`` is "orders", "symplecticity", "symmetry" or "volume".
    """
    return [(m.label, n) for m in methods().values() for n in CELLS[what][1](m)]


def measure(what: str, label: str, name: str) -> dict | float | str:
    """Make the measurement ``what`` of the method with a label on the test system ``name``, and return its result.

    ``what`` is "orders", "symplecticity", "symmetry" or "volume".  The result is the dict of `errors` for "orders",
    else a defect; if the measurement fails, it is the error's text.
    """
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


def everywhere(what: str) -> dict:
    """Make the measurement ``what`` for all methods on all their test systems: {method's label: {system: result}}.

    ``what`` is "orders", "symplecticity", "symmetry" or "volume".
    """
    out: dict = {label: {} for label in methods()}
    for label, name in cells(what):
        out[label][name] = measure(what, label, name)
    return out


def frozen() -> dict[str, dict[str, dict[str, float]]]:
    """Repeat a step of an energy-preserving method by the symplectic method with the same parameter lambda.

    Schemes I and III are symplectic methods with a fixed parameter lambda.  Schemes IV and V take the steps of I and
    III, respectively, with a lambda that they choose in each step so that H is conserved.

    Returns {id of Scheme IV or V: {system: {defect, distance, lam}}}: the symplecticity defect of the step with lambda
    fixed, the distance between the ends of this step and of the energy-preserving one, and lambda.
    """
    out = {}
    for free, fixed in (("scheme-iv", "scheme-i"), ("scheme-v", "scheme-iii")):
        out[free] = {}
        for name in FEW:
            system, y = start(name)
            d = system.d
            s = integrate(system, free, h=STEP, steps=1, q0=y[:d], p0=y[d:], arithmetic=MULTIPRECISION)
            lam = float(s.parameter[0])
            if lam != lam:
                continue
            frozen_method = method(fixed, lam=lam)
            gap = max(abs(advance(system, frozen_method, y, STEP) - np.concatenate([s.q[-1], s.p[-1]])))
            out[free][name] = {"defect": defect(frozen_method, name), "distance": float(gap), "lam": lam}
    return out


def adjoint() -> dict[str, dict[str, dict[str, float]]]:
    """Measure whether the adjoint of a method with a parameter lam is the same method with 1 - lam.

    Returns {method's label: {system: {adjoint, itself}}}, two distances from the start: after a step h of the method at
    lam, and a step -h of the method at 1 - lam (``adjoint``) or at lam (``itself``).  Symmetric methods, which are
    their own adjoints, are left out.
    """
    out = {}
    for record in variants():
        if "lam" in record.parameters and not record.symmetric:
            other = record(lam=1 - record.parameters["lam"])
            pairs = [n for n in FEW if runs_on(record, n)]
            out[record.label] = {
                n: {"adjoint": distance(record, n, other), "itself": distance(record, n)} for n in pairs
            }
    return out


def leaves(
    data: tuple[Any, ...], path: tuple[int, ...] = ()
) -> Iterator[tuple[tuple[int, ...], float | Fraction | mpmath.mpf]]:
    """Yield (path, number) for every coefficient in a method's nested tuples ``data`` that is not an integer.

    A path is a tuple of indices, one for each level of the tuples.
    """
    for i, x in enumerate(data):
        if isinstance(x, tuple):
            yield from leaves(x, (*path, i))
        elif isinstance(x, (float, Fraction, mpmath.mpf)) and x != int(x):
            yield (*path, i), x


def replace_at(data: tuple[Any, ...], path: Sequence[int], value: Number) -> tuple[Any, ...]:
    """Return a copy of nested tuples ``data`` with another value at ``path``, a sequence of indices."""
    i, *rest = path
    return (*data[:i], replace_at(data[i], rest, value) if rest else value, *data[i + 1 :])


def perturbation_effects() -> dict[str, dict]:
    """Measure how much a relative perturbation of each coefficient by `SLIP` changes a step of its method.

    Shows whether a misprint in a coefficient would be detected.  Returns {method's id: {system, error, rows}}, where
    ``error`` is that of the unperturbed step.  ``rows`` has a dict for each coefficient: its path in the method's data
    and the step's error; if that is less than ten times the unperturbed one, also the defects of symplecticity and
    symmetry.
    """
    out = {}
    for record in METHODS:
        name = next((n for n in systems(record, few=True)[::-1] if keeps_a_form(n)), None)
        if name and 0 < len(list(leaves(record.data))) <= MOST:
            with precision(digits(record)):
                out[record.id] = perturbation_row(record, name)
    return out


def perturbation_row(record: Method, name: str) -> dict:
    """Measure how a relative perturbation of each coefficient of a method by `SLIP` changes a step on a test system.

    Returns {system, error, rows}, see `perturbation_effects`.
    """
    system, y = start(name)
    end = flow(system, y, SHORT_STEP, pieces=1)[0]

    def error(m: Method) -> float:
        return float(max(abs(advance(system, m, y, SHORT_STEP) - end)))

    right, rows = error(record), []
    for path, x in leaves(record.data):
        m = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * (1 + SLIP)))
        row = {"path": list(path), "error": error(m)}
        if row["error"] < 10 * right:
            row |= {"symplecticity": defect(m, name), "symmetry": distance(m, name)}
        rows.append(row)
    return {"system": name, "error": right, "rows": rows}


def control_errors() -> dict[str, dict[str, dict]]:
    """Measure the errors of methods with a wrong first coefficient, 1/8 too large: a negative control of the orders.

    One method of each family that has coefficients is taken.  Returns {method's id: {system: result of `errors`}}.
    """
    out: dict = {}
    families = {m.family: m for m in reversed(METHODS) if m.order <= LOW_ORDER and list(leaves(m.data))}
    for record in families.values():
        path, x = next(leaves(record.data))
        wrong = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * 9 / 8))
        out[record.id] = {n: errors(wrong, n) for n in systems(record, few=True)}
    return out


def observed_order(row: Mapping[str, Any]) -> Order:
    """Return the observed order (`metrics.Order`) from ``row``, a result of `errors`: {h, error, doubt}.

    Errors up to ten times the reference's uncertainty, ``doubt``, are left out.
    """
    return order(row["h"], row["error"], noise=10 * row["doubt"])


MEASUREMENTS = {what: partial(everywhere, what) for what in CELLS} | {
    f.__name__: f for f in (frozen, adjoint, perturbation_effects, control_errors)
}
