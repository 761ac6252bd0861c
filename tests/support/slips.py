"""Wrong coefficients, frozen parameters and adjoints in multiprecision: what tests measure besides the pages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

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


def frozen() -> dict[str, dict[str, dict[str, float]]]:
    """Repeat a step of Schemes IV and V by I and III, the symplectic methods with the same lambda, held fixed.

    Returns {id: {system: {defect, distance, lam}}}: the symplecticity defect of the step with lambda fixed, its
    distance from the energy-preserving one, and lambda.
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

    Returns {method's label: {system: {adjoint, itself}}}, the distances from the start after a step at lam and one back
    at 1 - lam, or at lam.  Symmetric methods, which are their own adjoints, are left out.
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
    """Yield (path of indices, number) for every coefficient in nested tuples that is not an integer."""
    for i, x in enumerate(data):
        if isinstance(x, tuple):
            yield from leaves(x, (*path, i))
        elif isinstance(x, (float, Fraction, mpmath.mpf)) and x != int(x):
            yield (*path, i), x


def replace_at(data: tuple[Any, ...], path: Sequence[int], value: Any) -> tuple[Any, ...]:
    """Return a copy of nested tuples ``data`` with another value at ``path``."""
    i, *rest = path
    return (*data[:i], replace_at(data[i], rest, value) if rest else value, *data[i + 1 :])


def perturbation_effects() -> dict[str, dict]:
    """Measure how much a relative perturbation of each coefficient changes a step: {id: `perturbation_row`}."""
    out = {}
    for record in METHODS:
        name = next((n for n in systems(record, few=True)[::-1] if keeps_a_form(n)), None)
        if name and 0 < len(list(leaves(record.data))) <= MOST:
            with precision(digits(record)):
                out[record.id] = perturbation_row(record, name)
    return out


def perturbation_row(record: Method, name: str) -> dict:
    """Measure how much a relative perturbation of each coefficient by `SLIP` changes a step on a test system.

    Returns {system, error, rows}: the unperturbed step's error, and for each coefficient its path and the step's error;
    if that is less than ten times the unperturbed one, also the defects of symplecticity and symmetry.
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
    """Errors of a method of each family with a first coefficient 1/8 too large, a control: {id: {system: errors}}."""
    out: dict = {}
    families = {m.family: m for m in reversed(METHODS) if m.order <= LOW_ORDER and list(leaves(m.data))}
    for record in families.values():
        path, x = next(leaves(record.data))
        wrong = replace(record, data=replace_at(record.data, path, to_number(x, MULTIPRECISION) * 9 / 8))
        out[record.id] = {n: errors(wrong, n) for n in systems(record, few=True)}
    return out


MEASUREMENTS = {f.__name__: f for f in (frozen, adjoint, perturbation_effects, control_errors)}
