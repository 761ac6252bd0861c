"""Measurements without round-off, in a process of their own, which `elsewhere` starts: run with a name it prints JSON.

Each measurement runs every method of the registry on every system of `battery` where it can run, uncompiled, on numbers
of 40 digits and more.  The reference is Gragg's extrapolated explicit midpoint rule, which shares only the vector field
with the methods.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from fractions import Fraction
from functools import cache, partial

import mpmath
import numpy as np

from phasebench.integrators.driver import integrate
from phasebench.integrators.engine.codegen import MULTIPRECISION, epsilon, exactly, precision, vector
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method

from .battery import (
    FEW,
    LATER,
    LOW_ORDER,
    SYSTEMS,
    by_label,
    canonical,
    high_order_variants,
    runs_on,
    systems,
    variants,
)
from .metrics import jacobian, order, pair_defect, symplecticity_defect

DIGITS = 40
SPAN = Fraction(1, 256)
LADDER = (1, 2, 3, 4)
STEP = Fraction(1, 40)
#: That of steps of variable length, whose defect is as small as their error.
VARIABLE_STEP = Fraction(3, 10)
#: A coefficient wrong by this share of itself has to show.
SLIP, SHORT_STEP = Fraction(1, 10**6), SPAN / 16
#: Methods of more coefficients come from tables, every number of which the order conditions check.
MOST = 12
COLUMNS = 14


#: The results of the midpoint rule are weighted by numbers that sum to 1, and their sizes to this: so round-off grows.
AMPLIFIED = sum(
    abs(math.prod(Fraction(n**2, n**2 - m**2) for m in range(2, 2 * COLUMNS + 1, 2) if m != n))
    for n in range(2, 2 * COLUMNS + 1, 2)
)


def extrapolated(f, y, T):
    """(y(T), its uncertainty) of y' = f(y) by extrapolation of the explicit midpoint rule (W. B. Gragg 1965).

    The uncertainty is the last column's change, which tells where the extrapolation converges, and round-off.
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
    """(y(T), uncertainty) by `extrapolated` over pieces."""
    f = system.vector_field(MULTIPRECISION)
    y, T, doubt = vector(y), exactly(T, MULTIPRECISION), 0
    for _ in range(pieces):
        y, more = extrapolated(lambda x: f(0, x), y, T / pieces)
        doubt += more
    return y, doubt


def digits(record: Method) -> int:
    """The digits at which a method is measured: its error along the ladder lies far above them."""
    return max(DIGITS, 8 * record.order)


def start(name):
    """The system and a state on its orbit that is no turning point, in the working precision."""
    return _start(name, mpmath.mp.dps)


@cache
def _start(name, digits):
    system, q, p = SYSTEMS[name]()
    y = vector([*q, *p])
    if name not in ("tao", "coupled", "two-frequencies"):
        y = flow(system, y, LATER)[0]
    return system, y


def reference(name):
    """(system, initial state, state at SPAN, its uncertainty), in the working precision."""
    return _reference(name, mpmath.mp.dps)


@cache
def _reference(name, digits):
    system, y = start(name)
    return system, y, *flow(system, y, SPAN)


def displacement():
    """The displacement of a difference Jacobian in the working precision."""
    return epsilon(MULTIPRECISION) ** 0.2


def advance(system, record, y, h, steps=1):
    """The state after some steps."""
    d = system.d
    s = integrate(system, record, h=h, steps=steps, q0=y[:d], p0=y[d:], arithmetic=MULTIPRECISION, save_every=0)
    if s.status != "ok":
        raise ArithmeticError(f"{record.label}: {s.reason}")
    return np.concatenate([s.q[-1], s.p[-1]])


def errors(record: Method, name: str) -> dict:
    """Errors at SPAN along LADDER, and the reference's uncertainty."""
    system, y, end, doubt = reference(name)
    error = [max(abs(advance(system, record, y, SPAN / n, n) - end)) for n in LADDER]
    return {"h": [float(SPAN / n) for n in LADDER], "error": [float(e) for e in error], "doubt": float(doubt)}


def step_of(record: Method) -> Fraction:
    """The step of which the defects are measured."""
    return VARIABLE_STEP if record.family == "adaptive" else STEP


def defect(record: Method, name: str) -> float:
    """The symplecticity defect of one step; of a high order, for one pair of vectors."""
    system, y = start(name)
    h = step_of(record)
    if record.order > LOW_ORDER:
        return float(pair_defect(lambda x: advance(system, record, x, h), y))
    return float(symplecticity_defect(jacobian(lambda x: advance(system, record, x, h), y, displacement())))


def distance(record: Method, name: str, back: Method | None = None) -> float:
    """The distance from the start after a step with H and one with -H, which ``back`` takes, at first the method."""
    system, y = start(name)
    h = step_of(record)
    return float(max(abs(advance(system, back or record, advance(system, record, y, h), -h) - y)))


#: Of every method on every system: the measure of a cell, and the systems where it is made.
CELLS = {
    "orders": (errors, systems),
    "symplecticity": (defect, lambda m: [n for n in systems(m, few=True) if canonical(n)]),
    "symmetry": (distance, lambda m: systems(m, few=True)),
}


def cells(what: str) -> list[tuple[str, str]]:
    """(label, system) of every cell of a measurement of `CELLS`."""
    return [(m.label, n) for m in methods().values() for n in CELLS[what][1](m)]


def measure(what: str, label: str, name: str):
    """One cell of a measurement of `CELLS`, or why it failed, at the digits that the method's order needs."""
    record = methods()[label]
    with precision(digits(record)):
        try:
            return CELLS[what][0](record, name)
        except Exception as error:  # one method that fails is to fail its own tests alone
            return f"{type(error).__name__}: {error}"


@cache
def methods() -> dict[str, Method]:
    """Label -> method, of all that are measured."""
    return by_label(variants() + high_order_variants())


def everywhere(what: str) -> dict:
    """{label: {system: `measure` of it}}."""
    out: dict = {label: {} for label in methods()}
    for label, name in cells(what):
        out[label][name] = measure(what, label, name)
    return out


def frozen():
    """Schemes IV and V with the parameter of one step frozen: {id: {system: {defect, distance, lam}}}."""
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
    """Distances after Phi^lam_h and, with -H, the method at 1 - lam and at lam: {label: {system: {...}}}.

    Of methods that are not symmetric: the others are their own adjoints.
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
    """(path, number) of every coefficient in a record's data that is no integer."""
    for i, x in enumerate(data):
        if isinstance(x, tuple):
            yield from leaves(x, (*path, i))
        elif isinstance(x, (float, Fraction, mpmath.mpf)) and x != int(x):
            yield (*path, i), x


def changed(data, path, value):
    """The data with another value at a path."""
    i, *rest = path
    return (*data[:i], changed(data[i], rest, value) if rest else value, *data[i + 1 :])


def perturbed():
    """What one coefficient more by `SLIP` of itself does to a step: {id: {system, error, rows}}.

    ``rows`` has for every coefficient its path, the step's error, and where that is not ten times the unperturbed one
    the defects of symplecticity and symmetry.
    """
    out = {}
    for record in METHODS:
        name = next((n for n in systems(record, few=True)[::-1] if canonical(n)), None)
        if name and 0 < len(list(leaves(record.data))) <= MOST:
            with precision(digits(record)):
                out[record.id] = slipped(record, name)
    return out


def slipped(record: Method, name: str) -> dict:
    """`perturbed` of one method."""
    system, y = start(name)
    end = flow(system, y, SHORT_STEP, pieces=1)[0]

    def error(m):
        return float(max(abs(advance(system, m, y, SHORT_STEP) - end)))

    right, rows = error(record), []
    for path, x in leaves(record.data):
        m = replace(record, data=changed(record.data, path, exactly(x, MULTIPRECISION) * (1 + SLIP)))
        row = {"path": list(path), "error": error(m)}
        if row["error"] < 10 * right:
            row |= {"symplecticity": defect(m, name), "symmetry": distance(m, name)}
        rows.append(row)
    return {"system": name, "error": right, "rows": rows}


def spoiled():
    """Errors, as of `errors`, where the first coefficient is an eighth of itself more: {id: {system: row}}.

    Of the first method of every family that has coefficients in its record.
    """
    out: dict = {}
    families = {m.family: m for m in reversed(METHODS) if m.order <= LOW_ORDER and list(leaves(m.data))}
    for record in families.values():
        path, x = next(leaves(record.data))
        wrong = replace(record, data=changed(record.data, path, exactly(x, MULTIPRECISION) * 9 / 8))
        out[record.id] = {n: errors(wrong, n) for n in systems(record, few=True)}
    return out


def elsewhere(name: str):
    """The measurement of that name, made in a process with NUMBA_DISABLE_JIT=1; raises RuntimeError where it fails."""
    command = [sys.executable, "-m", "phasebench.benchmarks.measure.multiprecision", name]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])["result"]


def observed_order(row):
    """The observed order of a measurement of `orders`; errors below ten times the reference's uncertainty are noise."""
    return order(row["h"], row["error"], noise=10 * row["doubt"])


MEASUREMENTS = {what: partial(everywhere, what) for what in CELLS} | {
    f.__name__: f for f in (frozen, adjoint, perturbed, spoiled)
}

if __name__ == "__main__":
    begin = time.perf_counter()
    with precision(DIGITS):
        result = MEASUREMENTS[sys.argv[1]]()
    print(json.dumps({"seconds": time.perf_counter() - begin, "result": result}))
