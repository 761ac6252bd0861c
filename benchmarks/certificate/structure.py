r"""The structure of a step: symplecticity, symmetry, reversibility, each with its floor and the step's own error.

- symplecticity: :math:`\max|M^TJM - J|`, M the Jacobian by differences: over 1e-8 in 40 digits, which is exact, over
  1e-3 in doubles, where the floor is what doubling the displacement changes; above d = 2
  :math:`|\omega(Mu, Mv) - \omega(u, v)|` of a few vectors u, v in general position;
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

from .evidence import between, shown
from .order import EPS, flow, numerical
from .stepping import DIGITS, StepFailed, Stepper

#: The steps of the measure, dyadic: the second one where the first tells nothing.
STEPS = (0.5, 0.125)
#: The displacements of differences, in doubles and in many digits.
DISPLACEMENT, TINY = 1e-3, 1e-8
#: A state of more numbers has its symplecticity told from so many pairs of vectors, not from its Jacobian.
JACOBIAN, PAIRS = 4, 3
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
        if shown(rows[-1]) is not None:
            break
    if not rows:
        raise StepFailed(why)
    return next((row for row in rows if between(row) and shown(rows[-1]) is not False), rows[-1])


def _row(stepper: Stepper, seed: int, h: float, defect: Callable) -> dict:
    entry = stepper.entry
    y = stepper.state(entry.start(seed))
    h_ = stepper.number(h * entry.unit)
    value, noise = defect(stepper, y, h_)
    truth = flow(entry, seed, h * entry.unit, 4)[0]
    own = float(max(abs((stepper(y, h_) - stepper.state(truth)) / entry.sizes)))
    floor = max(noise, 100 * EPS * float(max(abs(y / entry.sizes)))) if stepper.arithmetic == DOUBLE else ROUNDED
    row = {"on": stepper.entry.name, "arithmetic": stepper.arithmetic, "h": h * entry.unit}
    return row | {"value": float(value), "floor": floor, "own": own}


def symplecticity(stepper: Stepper, y, h) -> tuple[float, float]:
    """(defect, its noise)."""
    if len(y) > JACOBIAN or stepper.entry.share:
        return _pairs(stepper, y, h)
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


def _pairs(stepper: Stepper, y, h) -> tuple[float, float]:
    """`symplecticity` of pairs of vectors, whose components are of the size of the state's."""
    double, entry, d = stepper.arithmetic == DOUBLE, stepper.entry, len(y) // 2
    delta = DISPLACEMENT if double else exactly(TINY, MULTIPRECISION)
    draws = np.random.default_rng([1, *entry.name.encode()]).uniform(0.5, 1.0, (PAIRS, 2, len(y)))
    signs = np.random.default_rng([2, *entry.name.encode()]).choice([-1.0, 1.0], draws.shape)
    worst, noise = 0.0, 0.0
    for u, v in draws * signs * entry.sizes:
        found = []
        for k in (1, 2) if double else (1,):
            Mu, Mv = (_along(stepper, y, w, h, k * delta) for w in (stepper.state(u), stepper.state(v)))
            if double and not (np.isfinite(Mu).all() and np.isfinite(Mv).all()):
                raise StepFailed("ArithmeticError: the step left the numbers")
            terms = abs(Mu[:d]) @ abs(Mv[d:]) + abs(Mu[d:]) @ abs(Mv[:d]) + abs(u[:d]) @ abs(v[d:])
            kept_ = Mu[:d] @ Mv[d:] - Mu[d:] @ Mv[:d] - (stepper.state(u[:d]) @ v[d:] - stepper.state(u[d:]) @ v[:d])
            found.append(kept_ / terms)
        worst = max(worst, abs(float(found[0])))
        noise = max(noise, abs(float(found[-1] - found[0])))
    return worst, noise + (EPS / DISPLACEMENT if double else 0.0)


def _along(stepper: Stepper, y, w, h, delta):
    """The derivative of the step along w, by fourth-order central differences."""
    near = stepper(y + delta * w, h) - stepper(y - delta * w, h)
    far = stepper(y + 2 * delta * w, h) - stepper(y - 2 * delta * w, h)
    return (8 * near - far) / (12 * delta)


def symmetry(stepper: Stepper, y, h) -> tuple[float, float]:
    """(distance of the step with -h after the step from the start, 0)."""
    return _away(stepper, stepper(stepper(y, h), -h), y)


def reversibility(stepper: Stepper, y, h) -> tuple[float, float]:
    """(distance of the step, the momenta reversed before and after it, after the step from the start, 0)."""
    rho = np.repeat([1, -1], len(y) // 2)
    return _away(stepper, rho * stepper(rho * stepper(y, h), h), y)


def _away(stepper: Stepper, end, y) -> tuple[float, float]:
    away = float(max(abs((end - y) / stepper.entry.sizes)))
    if not np.isfinite(away):
        raise StepFailed("ArithmeticError: the step left the numbers")
    return away, 0.0


def smooth(stepper: Stepper, seed: int) -> float:
    """The third difference of the step along a line of states and of steps h: of round-off inside, if it is large."""
    with precision(DIGITS):
        y, tiny = stepper.state(stepper.entry.start(seed)), exactly(1e-9, MULTIPRECISION)
        h = stepper.number(0.125 * stepper.entry.unit)
        a, b, c, e = (stepper(y * (1 + k * tiny), h * (1 + k * tiny)) for k in range(4))
        return float(max(abs((e - 3 * c + 3 * b - a) / stepper.entry.sizes)))
