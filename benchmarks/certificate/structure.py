r"""Symplecticity, symmetry, reversibility and volume of a step: each defect with its floor and the step's own error.

The defects are those of `measure.step_map`.  In 40 digits they are taken by differences over 1e-8, practically exactly;
in doubles over 1e-3 (in single precision more), where the floor is the change that doubling the displacement makes.
Above d = 2 symplecticity is measured on a few pairs of vectors.  Reversibility is measured where H(q, -p) = H(q, p).  A
step of a charged particle's (x, v) is measured in (q, p): where it is symplectic there, it is K-symplectic in (x, v)
(`systems.magnetic`).

A defect far above the floor is not round-off.  A structure is kept if the defect is at the floor and the step's own
error :math:`|\Phi_h - \varphi_h|` is far above it; a step without error would show nothing.

A step on constraints is measured on their manifold: symplecticity is that of tangents of the manifold.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.judge.evidence import EPS, between, shows_structure
from phasebench.benchmarks.measure import step_map
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision, to_number
from phasebench.integrators.values.kinds import Number

from .order import flow
from .stepping import DIGITS, StepFailed, Stepper

#: The steps h, dyadic: the second is used if the first decides nothing.
STEPS = (0.5, 0.125)
#: Where the arithmetic is coarser than that of doubles, so that the step's own error is larger.
WIDER = (1.0, 0.5)
#: The displacements of differences, in doubles and in many digits.
DISPLACEMENT, TINY = 1e-3, 1e-8
#: Symplecticity is measured by the Jacobian up to JACOBIAN components of the state, above on PAIRS pairs of vectors.
JACOBIAN, PAIRS = 4, 3
#: In many digits: defects below this come from coefficients in doubles, or from a solver that stops at that accuracy.
ROUNDED = 1e-13
#: A step in many digits with third differences above this rounds internally.
SMOOTH = 1e-24


def structure_row(stepper: Stepper, seed: int, defect: Callable) -> dict:
    """Measure whether a step keeps a structure, at the first step size of `STEPS` that decides it: a row.

    ``defect`` is (stepper, y, h) -> (defect, its noise), such as `symplecticity`.
    """
    rows, why = [], ""
    for h in WIDER if stepper.subject.eps > EPS else STEPS:
        try:
            with precision(DIGITS):
                rows.append(row_at(stepper, seed, h, defect))
        except StepFailed as failure:
            if not failure.numerical:
                raise
            why = str(failure)
            continue
        if shows_structure(rows[-1]) is not None:
            break
    if not rows:
        raise StepFailed(why)
    return next((row for row in rows if between(row) and shows_structure(rows[-1]) is not False), rows[-1])


def row_at(stepper: Stepper, seed: int, h: float, defect: Callable) -> dict:
    """As `structure_row`, at a step h of units of time; raises StepFailed."""
    entry = stepper.entry
    y = stepper.state(entry.start(seed))
    h_ = stepper.number(h * entry.unit)
    value, floor = measure_defect(stepper, y, h_, defect)
    truth = flow(entry, seed, h * entry.unit, 4)[0]
    own = float(max(abs((stepper(y, h_) - stepper.state(truth)) / entry.sizes)))
    row = {"on": stepper.entry.name, "arithmetic": stepper.arithmetic, "h": h * entry.unit}
    return row | {"value": float(value), "floor": floor, "own": own}


def measure_defect(stepper: Stepper, y: np.ndarray, h: Number, defect: Callable) -> tuple[float, float]:
    """Return (a defect of a step h from the state y, the floor below which it is round-off); raises StepFailed."""
    with np.errstate(all="ignore"):
        value, noise = defect(stepper, y, h)
    if not np.isfinite(value + noise):
        raise StepFailed("ArithmeticError: the step left the numbers")
    if stepper.arithmetic != DOUBLE:
        return value, ROUNDED
    return value, max(noise, 100 * stepper.subject.eps * float(max(abs(y / stepper.entry.sizes))))


def _displacements(stepper: Stepper) -> tuple[tuple[Number, ...], float]:
    if stepper.arithmetic != DOUBLE:
        return (to_number(TINY, MULTIPRECISION),), 0.0
    first = max(DISPLACEMENT, stepper.subject.eps**0.2)
    return (first, 2 * first), stepper.subject.eps / first


def symplecticity(stepper: Stepper, y: np.ndarray, h: Number) -> tuple[float, float]:
    """How far a step h from the state y is from symplectic: (defect, its round-off)."""
    name, (displacements, rounding) = stepper.entry.name, _displacements(stepper)
    if stepper.entry.system.constrained:
        found = [step_map.restricted(lambda x: stepper(x, h), stepper.retract, y, delta) for delta in displacements]
        value, noise = float(np.abs(found[0]).max()), float(np.abs(found[-1] - found[0]).max())
    elif len(y) <= JACOBIAN and not stepper.entry.share:
        value, noise = step_map.symplecticity(lambda x: stepper(x, h), y, *displacements)
    else:
        draws = np.random.default_rng([1, *name.encode()]).uniform(0.5, 1.0, (PAIRS, 2, len(y)))
        signs = np.random.default_rng([2, *name.encode()]).choice([-1.0, 1.0], draws.shape)
        pairs = [tuple(map(stepper.state, pair)) for pair in draws * signs * stepper.entry.sizes]
        value, noise = step_map.pair_symplecticity(lambda x: stepper(x, h), y, pairs, *displacements)
    return value, noise + rounding


def volume(stepper: Stepper, y: np.ndarray, h: Number) -> tuple[float, float]:
    """How far a step h from y is from volume-preserving: (|det M - 1|, its round-off), in units of the sizes."""
    sizes, (displacements, rounding) = stepper.state(stepper.entry.sizes), _displacements(stepper)
    value, noise = step_map.volume(lambda x: stepper(x * sizes, h) / sizes, y / sizes, *displacements)
    return value, noise + rounding


def symmetry(stepper: Stepper, y: np.ndarray, h: Number) -> tuple[float, float]:
    """How far a step is from symmetric: (distance from y after a step h and a step -h, 0)."""
    there, back = (lambda x: stepper.advance(x, h)), (lambda x: stepper.advance(x, -h))
    return float(step_map.return_distance(there, back, y, stepper.entry.sizes)), 0.0


def reversibility(stepper: Stepper, y: np.ndarray, h: Number) -> tuple[float, float]:
    """How far a step is from reversible: (distance from y after two steps h with the sign of p changed, 0)."""
    return float(step_map.reversibility_defect(lambda x: stepper.advance(x, h), y, sizes=stepper.entry.sizes)), 0.0


DEFECTS = {"symplectic": symplecticity, "symmetric": symmetry, "reversible": reversibility, "volume": volume}


def smooth(stepper: Stepper, seed: int) -> float:
    """The third difference of a step over four calls whose state and h grow by a factor of 1 + 1e-9.

    It is of the order of 1e-27 unless the step rounds its numbers internally.
    """
    with precision(DIGITS):
        y, tiny = stepper.state(stepper.entry.start(seed)), to_number(1e-9, MULTIPRECISION)
        h = stepper.number(0.125 * stepper.entry.unit)
        a, b, c, e = (stepper(y * (1 + k * tiny), h * (1 + k * tiny)) for k in range(4))
        return float(max(abs((e - 3 * c + 3 * b - a) / stepper.entry.sizes)))
