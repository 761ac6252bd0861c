"""Measurements without round-off, in a process of their own, which `elsewhere` starts: run with a name it prints JSON.

Each measurement runs every method of the registry on every system of `cases` where it can run, uncompiled, on numbers
of 40 digits.  The reference is Gragg's extrapolated explicit midpoint rule, which shares only the vector field with
the methods.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np

from phasebench.integrators.driver import integrate
from phasebench.integrators.engine.codegen import MULTIPRECISION, exactly
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
SPAN = mpmath.mpf(1) / 256
LADDER = (1, 2, 3, 4)
STEP = mpmath.mpf(1) / 40
#: A coefficient wrong by this share of itself has to show.
SLIP, SHORT_STEP = mpmath.mpf(10) ** -6, SPAN / 16
#: Methods of more coefficients come from tables, every number of which the order conditions check.
MOST = 12
COLUMNS = 14


def vector(*parts):
    """One object array of mpmath numbers."""
    return np.array([mpmath.mpf(x) for part in parts for x in part], dtype=object)


def extrapolated(f, y, T):
    """(y(T), its uncertainty) of y' = f(y) by extrapolation of the explicit midpoint rule (W. B. Gragg 1965)."""
    rows: list = []
    for j in range(COLUMNS):
        n = 2 * (j + 1)
        h = T / n
        a, b = y, y + h * f(y)
        for _ in range(n - 1):
            a, b = b, a + 2 * h * f(b)
        row = [(a + b + h * f(b)) / 2]
        for k in range(1, j + 1):
            ratio = mpmath.mpf(n) ** 2 / (2 * (j + 1 - k)) ** 2
            row.append(row[k - 1] + (row[k - 1] - rows[j - 1][k - 1]) / (ratio - 1))
        rows.append(row)
    return rows[-1][-1], max(abs(rows[-1][-1] - rows[-1][-2]))


def flow(system, y, T, pieces=8):
    """(y(T), uncertainty) by `extrapolated` over pieces."""
    f = system.vector_field(MULTIPRECISION)
    doubt = mpmath.mpf(0)
    for _ in range(pieces):
        y, more = extrapolated(lambda x: f(0, x), y, T / pieces)
        doubt += more
    return y, doubt


def digits(chosen) -> int:
    """The digits at which a method is measured: its error along the ladder lies far above them."""
    return max(DIGITS, 8 * chosen.order)


def start(name):
    """The system and a state on its orbit that is no turning point, in the working precision."""
    return _start(name, mpmath.mp.dps)


@cache
def _start(name, digits):
    system, q, p = SYSTEMS[name]()
    y = vector(q, p)
    if name not in ("tao", "coupled", "two-frequencies"):
        y = flow(system, y, mpmath.mpf(LATER))[0]
    return system, y


def reference(name):
    """(system, initial state, state at SPAN, its uncertainty), in the working precision."""
    return _reference(name, mpmath.mp.dps)


@cache
def _reference(name, digits):
    system, y = start(name)
    return system, y, *flow(system, y, SPAN)


def advance(system, chosen, y, h, steps=1):
    """The state after some steps."""
    d = system.d
    s = integrate(system, chosen, h=h, steps=steps, q0=y[:d], p0=y[d:], arithmetic=MULTIPRECISION, save_every=0)
    if s.status != "ok":
        raise ArithmeticError(f"{chosen.label}: {s.reason}")
    return vector(s.q[-1], s.p[-1])


def everywhere(measure, few=None, only=lambda name: True):
    """{label: {system: measure(method, system's name), or why it failed}}, at the digits that an order needs."""

    def attempt(chosen, name):
        try:
            return measure(chosen, name)
        except Exception as error:  # one method that fails is to fail its own tests alone
            return f"{type(error).__name__}: {error}"

    out = {}
    for chosen in variants() + high_order_variants():
        with mpmath.workdps(digits(chosen)):
            out[chosen.label] = {n: attempt(chosen, n) for n in systems(chosen, few) if only(n)}
    return out


def orders():
    """Errors at SPAN along LADDER, and the reference's uncertainty: {label: {system: {h, error, doubt}}}."""

    def measure(chosen, name):
        system, y, end, doubt = reference(name)
        error = [max(abs(advance(system, chosen, y, SPAN / n, n) - end)) for n in LADDER]
        return {"h": [float(SPAN / n) for n in LADDER], "error": [float(e) for e in error], "doubt": float(doubt)}

    return everywhere(measure)


def symplecticity():
    """The symplecticity defect of one step: {label: {system: defect}}; of a high order, for one pair of vectors."""

    def measure(chosen, name):
        system, y = start(name)
        if chosen.order > LOW_ORDER:
            return float(pair_defect(lambda x: advance(system, chosen, x, STEP), y))
        delta = mpmath.mp.eps ** mpmath.mpf("0.2")
        return float(symplecticity_defect(jacobian(lambda x: advance(system, chosen, x, STEP), y, delta)))

    return everywhere(measure, few=True, only=canonical)


def frozen():
    """Schemes IV and V with the parameter of one step frozen: {id: {system: {defect, distance, lam}}}."""
    delta = mpmath.mp.eps ** mpmath.mpf("0.2")
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
            gap = max(abs(advance(system, frozen_method, y, STEP) - vector(s.q[-1], s.p[-1])))
            M = jacobian(lambda x, a=system, b=frozen_method: advance(a, b, x, STEP), y, delta)
            out[free][name] = {"defect": float(symplecticity_defect(M)), "distance": float(gap), "lam": lam}
    return out


def symmetry():
    """The distance from the start after a step with H and one with -H: {label: {system: distance}}."""

    def measure(chosen, name):
        system, y = start(name)
        return float(max(abs(advance(system, chosen, advance(system, chosen, y, STEP), -STEP) - y)))

    return everywhere(measure, few=True)


def adjoint():
    """The distance from the start after Phi^lam_h and, with -H, the same method at 1 - lam or at lam: {label: ...}."""
    out = {}
    for chosen in variants():
        if "lam" not in chosen.parameters:
            continue
        other = chosen(**dict(chosen.parameters) | {"lam": 1 - chosen.parameters["lam"]})
        out[chosen.label] = {}
        for name in FEW:
            if not runs_on(chosen, name):
                continue
            system, y = start(name)
            there = advance(system, chosen, y, STEP)
            distances = [float(max(abs(advance(system, m, there, -STEP) - y))) for m in (other, chosen)]
            out[chosen.label][name] = dict(zip(("adjoint", "itself"), distances, strict=True))
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
    delta = mpmath.mp.eps ** mpmath.mpf("0.2")
    out = {}
    for chosen in METHODS:
        if not 0 < len(list(leaves(chosen.data))) <= MOST:
            continue
        name = next((n for n in systems(chosen, few=True)[::-1] if canonical(n)), None)
        if name is None:
            continue
        with mpmath.workdps(digits(chosen)):
            system, y = start(name)
            end = flow(system, y, SHORT_STEP, pieces=1)[0]

            def error(m, system=system, y=y, end=end):
                return float(max(abs(advance(system, m, y, SHORT_STEP) - end)))

            right, rows = error(chosen), []
            for path, x in leaves(chosen.data):
                m = replace(chosen, data=changed(chosen.data, path, exactly(x, MULTIPRECISION) * (1 + SLIP)))
                row = {"path": list(path), "error": error(m)}
                if row["error"] < 10 * right:
                    M = jacobian(lambda x, a=system, b=m: advance(a, b, x, STEP), y, delta)
                    row["symplecticity"] = float(symplecticity_defect(M))
                    row["symmetry"] = float(max(abs(advance(system, m, advance(system, m, y, STEP), -STEP) - y)))
                rows.append(row)
            out[chosen.id] = {"system": name, "error": right, "rows": rows}
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


MEASUREMENTS = {f.__name__: f for f in (orders, symplecticity, frozen, symmetry, adjoint, perturbed)}

if __name__ == "__main__":
    mpmath.mp.dps = DIGITS
    begin = time.perf_counter()
    result = MEASUREMENTS[sys.argv[1]]()
    by_label(variants())
    print(json.dumps({"seconds": time.perf_counter() - begin, "result": result}))
