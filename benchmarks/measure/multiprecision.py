"""Measurements without round-off.

Each measurement runs every method of the registry on every system of `battery` that the method can integrate,
uncompiled, with 40 digits or more.  The reference is Gragg's extrapolated explicit midpoint rule, which shares only the
vector field with the methods.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache, partial

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


def extrapolate(f, y, T):
    """(y(T), its uncertainty) of y' = f(y) by extrapolation of the explicit midpoint rule (W. B. Gragg 1965).

    The uncertainty is the change in the last column, which shows the convergence, plus a bound of round-off.
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


def flow(system, y, T, pieces=8):
    """(y(T), uncertainty) of a system's flow, by `extrapolate` over ``pieces`` equal parts of T."""
    f = system.vector_field(MULTIPRECISION)
    y, T, doubt = vector(y), to_number(T, MULTIPRECISION), 0
    for _ in range(pieces):
        y, more = extrapolate(lambda x: f(0, x), y, T / pieces)
        doubt += more
    return y, doubt


def digits(record: Method) -> int:
    """The working digits for a method, so that its error along the ladder is far above round-off."""
    return max(DIGITS, 8 * record.order)


def start(name):
    """(system, a state on its orbit that is no turning point) of the named system, in the working precision."""
    return _start(name, mpmath.mp.dps)


@cache
def _start(name, digits):
    system, q, p = SYSTEMS[name]()
    y = vector([*q, *p])
    if name not in ("tao", "coupled", "two-frequencies"):
        y = flow(system, y, LATER)[0]
    return system, y


def reference(name):
    """(system, initial state, exact state at time `SPAN`, its uncertainty) of a named system, in working precision."""
    return _reference(name, mpmath.mp.dps)


@cache
def _reference(name, digits):
    system, y = start(name)
    return system, y, *flow(system, y, SPAN)


def displacement():
    """The displacement for a Jacobian by finite differences, in the working precision."""
    return epsilon(MULTIPRECISION) ** 0.2


def advance(system, record, y, h, steps=1):
    """The state after some steps; raises ArithmeticError if the integration fails."""
    d = system.d
    s = integrate(system, record, h=h, steps=steps, q0=y[:d], p0=y[d:], arithmetic=MULTIPRECISION, save_every=0)
    if s.status != "ok":
        raise ArithmeticError(f"{record.label}: {s.reason}")
    return np.concatenate([s.q[-1], s.p[-1]])


def errors(record: Method, name: str) -> dict:
    """A method's errors at time `SPAN` on the named system for several steps h, and the reference's uncertainty."""
    system, y, end, doubt = reference(name)
    steps = ladder(record)
    error = [max(abs(advance(system, record, y, SPAN / n, n) - end)) for n in steps]
    return {"h": [float(SPAN / n) for n in steps], "error": [float(e) for e in error], "doubt": float(doubt)}


def ladder(record: Method) -> tuple[int, ...]:
    """The numbers of steps to time `SPAN` from which a method's order is measured."""
    if not record.one_step:
        return tuple(n * record.earlier for n in MULTISTEP_LADDER)
    return FIELD_LADDER if record.family == "field" else LADDER


def retraction(system):
    """The map from states (2 d,) near the manifold of a system with constraints to states on it; None of any other."""
    if not system.constrained:
        return None
    d = system.d
    return lambda y: np.concatenate(system.retract(y[:d], y[d:], MULTIPRECISION))


def step_of(record: Method) -> Fraction:
    """The step size at which a method's defects of symplecticity and symmetry are measured."""
    return VARIABLE_STEP if record.family in ("adaptive", "field") else STEP


def defect(record: Method, name: str) -> float:
    """The symplecticity defect of a method's step on the named system; at high order, of one pair of vectors only."""
    system, y = start(name)
    h = step_of(record)
    retract = retraction(system)
    if record.order > LOW_ORDER:
        return float(pair_defect(lambda x: advance(system, record, x, h), y, retract))
    if retract is not None:
        return float(np.max(np.abs(restricted(lambda x: advance(system, record, x, h), retract, y, displacement()))))
    return float(symplecticity_defect(jacobian(lambda x: advance(system, record, x, h), y, displacement())))


def distance(record: Method, name: str, back: Method | None = None) -> float:
    """The distance from the start after a step h with ``record`` and a step -h with ``back`` (default: ``record``)."""
    system, y = start(name)
    h = step_of(record)
    there, again = (lambda x: advance(system, record, x, h)), (lambda x: advance(system, back or record, x, -h))
    return float(return_distance(there, again, y))


def volume_defect(record: Method, name: str) -> float:
    """|det M - 1| for the Jacobian M of one step of a method on the named system."""
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
    """(method's label, system's name) of every pair on which the measurement ``what``, a key of `CELLS`, is made."""
    return [(m.label, n) for m in methods().values() for n in CELLS[what][1](m)]


def measure(what: str, label: str, name: str):
    """Measure ``what`` (a key of `CELLS`) for a method's label and a system's name; if it fails, the error as text."""
    record = methods()[label]
    with precision(digits(record)):
        try:
            return CELLS[what][0](record, name)
        except Exception as error:  # a method that fails must not break the measurement of the others
            return f"{type(error).__name__}: {error}"


@cache
def methods() -> dict[str, Method]:
    """Label -> method, for all methods that are measured."""
    return by_label(variants() + high_order_variants())


def everywhere(what: str) -> dict:
    """Make the measurement ``what``, a key of `CELLS`, for all methods and systems: {label: {system: result}}."""
    out: dict = {label: {} for label in methods()}
    for label, name in cells(what):
        out[label][name] = measure(what, label, name)
    return out


def frozen():
    """Repeat a step of the energy-preserving Schemes IV and V by Schemes I and III with the lambda that it chose.

    Returns {id: {system: {defect, distance, lam}}}: the symplecticity defect of the step with lambda fixed, and the
    distance of its end from that of the energy-preserving step.
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


def adjoint():
    """Test that the adjoint of a method with parameter lam has 1 - lam: {label: {system: {adjoint, itself}}}.

    The two distances are from the start, after a step h and a step -h with the method at 1 - lam or at lam.  Symmetric
    methods are left out, as they are their own adjoints.
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


def leaves(data, path=()):
    """(path, number) of every coefficient in a record's data that is not an integer."""
    for i, x in enumerate(data):
        if isinstance(x, tuple):
            yield from leaves(x, (*path, i))
        elif isinstance(x, (float, Fraction, mpmath.mpf)) and x != int(x):
            yield (*path, i), x


def replace_at(data, path, value):
    """A copy of nested tuples with another value at a path."""
    i, *rest = path
    return (*data[:i], replace_at(data[i], rest, value) if rest else value, *data[i + 1 :])


def perturbation_effects():
    """The effect of each coefficient's relative perturbation by `SLIP` on a step: {id: {system, error, rows}}.

    ``rows`` has the path of each coefficient and the step's error; if that is less than ten times the unperturbed one,
    also the defects of symplecticity and symmetry.
    """
    out = {}
    for record in METHODS:
        name = next((n for n in systems(record, few=True)[::-1] if keeps_a_form(n)), None)
        if name and 0 < len(list(leaves(record.data))) <= MOST:
            with precision(digits(record)):
                out[record.id] = perturbation_row(record, name)
    return out


def perturbation_row(record: Method, name: str) -> dict:
    """The effect of changing each coefficient by `SLIP` on a step of system ``name``; see `perturbation_effects`."""
    system, y = start(name)
    end = flow(system, y, SHORT_STEP, pieces=1)[0]

    def error(m):
        return float(max(abs(advance(system, m, y, SHORT_STEP) - end)))

    right, rows = error(record), []
    for path, x in leaves(record.data):
        m = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * (1 + SLIP)))
        row = {"path": list(path), "error": error(m)}
        if row["error"] < 10 * right:
            row |= {"symplecticity": defect(m, name), "symmetry": distance(m, name)}
        rows.append(row)
    return {"system": name, "error": right, "rows": rows}


def control_errors():
    """Measure `errors` of methods whose first coefficient is made 1/8 too large, a negative control of the orders.

    For one method of each family with coefficients in its record: {id: {system: row}}.
    """
    out: dict = {}
    families = {m.family: m for m in reversed(METHODS) if m.order <= LOW_ORDER and list(leaves(m.data))}
    for record in families.values():
        path, x = next(leaves(record.data))
        wrong = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * 9 / 8))
        out[record.id] = {n: errors(wrong, n) for n in systems(record, few=True)}
    return out


def observed_order(row):
    """The observed order from the result of `errors`; errors up to ten times the reference's uncertainty are noise."""
    return order(row["h"], row["error"], noise=10 * row["doubt"])


MEASUREMENTS = {what: partial(everywhere, what) for what in CELLS} | {
    f.__name__: f for f in (frozen, adjoint, perturbation_effects, control_errors)
}
