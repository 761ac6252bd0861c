r"""The structure of a step: symplecticity, symmetry, reversibility, each with its floor and the step's own error.

- symplecticity: :math:`\max|M^TJM - J|`, M the Jacobian by differences: over 1e-8 in 40 digits, which is exact, over
  1e-3 in doubles, where the floor is what doubling the displacement changes;
- symmetry: :math:`\Phi_{-h}(\Phi_h(y)) - y`;
- reversibility: :math:`\rho\Phi_h(\rho\Phi_h(y)) - y`, where H(q, -p) = H(q, p).

A defect far above the floor is none of round-off.  A structure is kept where the defect is at the floor and the step's
own error :math:`|\Phi_h - \varphi_h|` is far above it: of a step without error nothing could be seen.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), V.1 and VI.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.integrators.engine.codegen import DOUBLE, MULTIPRECISION, exactly, precision

from .evidence import kept
from .order import EPS, flow, numerical
from .stepping import DIGITS, StepFailed, Stepper

#: The steps of the measure, dyadic: the second one where the first tells nothing.
STEPS = (0.5, 0.125)
#: The displacements of differences, in doubles and in many digits.
DISPLACEMENT, TINY = 1e-3, 1e-8
#: In many digits: a defect below it is of coefficients that are doubles, or of a solver that stops at theirs.
ROUNDED = 1e-13
#: A step in many digits whose third differences are above it rounds inside.
SMOOTH = 1e-24


def measured(stepper: Stepper, seed: int, defect: Callable) -> dict:
    """The row of a structure, at the first step that tells."""
    rows, why = [], ""
    for h in STEPS:
        try:
            with precision(DIGITS):
                rows.append(_row(stepper, seed, h, defect))
        except StepFailed as failure:
            if not numerical(failure):
                raise
            why = str(failure)
            continue
        if kept(rows[-1]) is not None:
            break
    if not rows:
        raise StepFailed(why)
    return rows[-1]


def _row(stepper: Stepper, seed: int, h: float, defect: Callable) -> dict:
    y = stepper.state(stepper.entry.start(seed))
    h_ = stepper.number(h)
    value, noise = defect(stepper, y, h_)
    truth = flow(stepper.entry.name, seed, h, 4)[0]
    own = float(max(abs(stepper(y, h_) - stepper.state(truth))))
    floor = max(noise, 100 * EPS * float(max(abs(y)))) if stepper.arithmetic == DOUBLE else ROUNDED
    row = {"on": stepper.entry.name, "arithmetic": stepper.arithmetic, "h": h}
    return row | {"value": float(value), "floor": floor, "own": own}


def symplecticity(stepper: Stepper, y, h) -> tuple[float, float]:
    """(defect, its noise)."""
    double = stepper.arithmetic == DOUBLE
    delta = DISPLACEMENT if double else exactly(TINY, MULTIPRECISION)
    defects = []
    for displacement in (delta, 2 * delta) if double else (delta,):
        M = metrics.jacobian(lambda x: stepper(x, h), y, displacement)
        if double and not np.isfinite(M).all():
            raise StepFailed("ArithmeticError: the step left the numbers")
        d = len(y) // 2
        J = np.kron(np.array([[0, 1], [-1, 0]]), np.eye(d, dtype=int))
        defects.append(M.T @ (J @ M) - J)
    noise = np.abs(defects[-1] - defects[0]).max() if double else 0.0
    return float(abs(defects[0]).max()), float(noise) + (EPS / DISPLACEMENT if double else 0.0)


def symmetry(stepper: Stepper, y, h) -> tuple[float, float]:
    """(distance of the step with -h after the step from the start, 0)."""
    return _away(stepper(stepper(y, h), -h), y)


def reversibility(stepper: Stepper, y, h) -> tuple[float, float]:
    """(distance of the step, the momenta reversed before and after it, after the step from the start, 0)."""
    rho = np.repeat([1, -1], len(y) // 2)
    return _away(rho * stepper(rho * stepper(y, h), h), y)


def _away(end, y) -> tuple[float, float]:
    away = float(max(abs(end - y)))
    if not np.isfinite(away):
        raise StepFailed("ArithmeticError: the step left the numbers")
    return away, 0.0


def smooth(stepper: Stepper, seed: int) -> float:
    """The third difference of the step along a line of states and of steps h: of round-off inside, if it is large."""
    with precision(DIGITS):
        y, tiny = stepper.state(stepper.entry.start(seed)), exactly(1e-9, MULTIPRECISION)
        h = stepper.number(0.125)
        a, b, c, e = (stepper(y * (1 + k * tiny), h * (1 + k * tiny)) for k in range(4))
        return float(max(abs(e - 3 * c + 3 * b - a)))
