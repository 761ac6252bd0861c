"""Wrong coefficients, frozen parameters and adjoints in multiprecision: what tests measure besides the pages."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np

from phasebench.benchmarks.measure.battery import FEW, LOW_ORDER, keeps_a_form, runs_on, systems, variants
from phasebench.benchmarks.measure.multiprecision import (
    SPAN,
    STEP,
    advance,
    defect,
    digits,
    distance,
    errors,
    flow,
    start,
)
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number
from phasebench.integrators.driver import integrate
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS, method

#: Relative perturbation of a coefficient that must be detected, and the step for it.
SLIP, SHORT_STEP = Fraction(1, 10**6), SPAN / 16
#: Methods with more coefficients are left out: their tables are checked by the order conditions.
MOST = 12


def frozen():
    """A step of Schemes IV and V beside I and III with its lambda: {id: {system: {defect, distance, lam}}}."""
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
    """Distances from the start after a step at lam and one back at 1 - lam, or at lam: {label: {system: {...}}}."""
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
    """(Path of indices, number) of every coefficient in nested tuples that is not an integer."""
    for i, x in enumerate(data):
        if isinstance(x, tuple):
            yield from leaves(x, (*path, i))
        elif isinstance(x, (float, Fraction, mpmath.mpf)) and x != int(x):
            yield (*path, i), x


def replace_at(data, path, value):
    i, *rest = path
    return (*data[:i], replace_at(data[i], rest, value) if rest else value, *data[i + 1 :])


def perturbation_effects():
    out = {}
    for record in METHODS:
        name = next((n for n in systems(record, few=True)[::-1] if keeps_a_form(n)), None)
        if name and 0 < len(list(leaves(record.data))) <= MOST:
            with precision(digits(record)):
                out[record.id] = perturbation_row(record, name)
    return out


def perturbation_row(record: Method, name: str):
    """The step's error with each coefficient changed by `SLIP` and, if that hides it, the defects."""
    system, y = start(name)
    end = flow(system, y, SHORT_STEP, pieces=1)[0]

    def error(m: Method):
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
    """Errors of a method of each family whose first coefficient is 1/8 too large."""
    out: dict = {}
    families = {m.family: m for m in reversed(METHODS) if m.order <= LOW_ORDER and list(leaves(m.data))}
    for record in families.values():
        path, x = next(leaves(record.data))
        wrong = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * 9 / 8))
        out[record.id] = {n: errors(wrong, n) for n in systems(record, few=True)}
    return out


MEASUREMENTS = {f.__name__: f for f in (frozen, adjoint, perturbation_effects, control_errors)}
