r"""A quadratic model of the energy error E(x) of a step with parameter x, to follow its root from step to step.

If the roots of the last steps vary smoothly, and the other root of the model is far, E(0) need not be known.  The first
attempt of a step is at the root extrapolated from earlier steps; the next ones are Newton steps with the slope of E,
extrapolated from the steps in which it was measured: by the secant between two attempts whose distance is large enough
for the round-off of H.  If attempts are always too near for that, one is made farther away every few steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.values.vector import State, inline

from .codes import SOLVED

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number

#: Where the stage equations of an attempt (a trial step) start from: the extrapolation from earlier steps, the last
#: attempt, or the linear continuation of the last attempts in x.
FIRST, LATEST, ALONG = map(np.int64, range(3))
#: What a row of numbers keeps from step to step: E is about E0 + SLOPE x + CURVATURE x^2; the slope's RATE and BEND,
#: its first and second change per step, and its AGE in steps; by how much the last root was MISSED by its prediction;
#: the STREAK of steps since E(0) was looked at or the curvature measured, not positive where roots are not predicted;
#: the UNIT of round-off of H; E at the START, x = 0, when last looked at; the x of the LAST attempt.
SLOPE, CURVATURE, RATE, BEND, AGE, MISSED, STREAK, UNIT, START, LAST = range(10)
NUMBERS = 10
#: A root is followed where c2 x is at most this times the slope there: the other root is at least twice as far from 0.
LONE = 0.3
#: For a root farther than this the other side is looked at first.
CHECKED = 0.1
#: Steps after which E(0) is looked at again; attempts to follow a root.
FOLLOWED, FOLLOW_LIMIT = 24, 7
#: E in units from which a difference is a slope; steps after which such an attempt is made.
SHARP, AGED = 1e3, 5
#: An attempt that is not the last may be solved to this share of the E expected, where that is at least EASED units.
EASE, EASED = 1e-2, 100.0
#: H is known to its round-off times this where no method can do better.
SLACK = 8.0


class Search(NamedTuple):
    """Limits of the search for the root x of the energy error E(x).

    Attributes
    ----------
    radius : the largest size of a root
    first : the first guess of x if there is no model of E from earlier steps
    near : a root farther from zero is sought by continuation, since Muller's method might leave the branch of x = 0
    ratio, points : the continuation's points on either side are radius / ratio^k, k = points - 1, ..., 0
    slack : if Muller's method fails, x = 0 is accepted where |E(0)| is at most this many times the round-off of H
    """

    radius: float
    first: float
    near: float
    ratio: float
    points: int
    slack: float


class Attempt(NamedTuple):
    """A trial step with some parameter x.

    Attributes
    ----------
    y : the state after the step
    E : its energy error
    unit : the round-off of H
    status : the status of the solver of the stage equations (`solve`)
    """

    y: State
    E: float
    unit: float
    status: int


@inline
def smaller_root(c0: float, c1: float, c2: float) -> float:
    """The root of c0 + c1 x + c2 x^2 that is nearest to zero; infinite if there is no real root."""
    D = c1 * c1 - 4 * c0 * c2
    if not D >= 0:
        return np.inf
    root = D**0.5
    denominator = c1 + root if c1 >= 0 else c1 - root
    if denominator == 0:
        return np.inf
    return -2 * c0 / denominator


@inline
def residual_factor(E: float, unit: float) -> float:
    """Return how exactly to solve the stage equations of a trial step whose energy error is expected to be about E.

    The result is the error that the solution may have, as a multiple of round-off: 1, or more if E is far above
    ``unit``, the round-off of H.
    """
    return EASE * abs(E) / unit if 0 < EASED * unit <= EASE * abs(E) < np.inf else 1.0


@inline
def muller(x0: float, x1: float, x2: float, E0: float, E1: float, E2: float) -> tuple[float, float]:
    """(slope, curvature) at x2 of the parabola through the points (x0, E0), (x1, E1), (x2, E2)."""
    d1 = (E2 - E1) / (x2 - x1)
    d0 = (E1 - E0) / (x1 - x0)
    c2 = (d1 - d0) / (x2 - x0)
    return d1 + c2 * (x2 - x1), c2


@inline
def extrapolate_slope(models: np.ndarray, row: int) -> float:
    """Return dE/dx at x = 0, where E(x) is the energy error of a step with parameter x, extrapolated to this step.

    ``models[row]`` has a quadratic model of E, with the slope that was last measured and its changes per step.  The
    model's age, the number of steps since then, is increased by this step.
    """
    age = models[row, AGE] + 1
    models[row, AGE] = age
    return models[row, SLOPE] + age * (models[row, RATE] + 0.5 * (age + 1) * models[row, BEND])


@inline
def renew(models: np.ndarray, row: int, slope: float) -> None:
    """Store a measured slope dE/dx of the energy error E(x) at x = 0 in its model ``models[row]``.

    The slope's first and second change per step, since it was last measured, are stored with it.
    """
    age = models[row, AGE]
    rate = (slope - models[row, SLOPE]) / age
    models[row, BEND] = (rate - models[row, RATE]) / age
    models[row, SLOPE], models[row, RATE], models[row, AGE] = slope, rate, 0.0


@inline
def is_trusted(search: Search, models: np.ndarray, row: int, predicted: float, c1: float, slope: float) -> bool:
    """True if by the model the ``predicted`` root is the one nearest to zero, and the prediction is accurate enough.

    ``models[row]`` is the quadratic model of the energy error E(x) of a step with parameter x; c1 is its slope at
    x = 0, extrapolated to this step, and ``slope`` that at the predicted root.
    """
    c2, room = abs(models[row, CURVATURE]), LONE * abs(slope)
    return (
        0 < models[row, STREAK] < FOLLOWED
        and abs(predicted) <= CHECKED
        and c2 * abs(predicted) <= room
        and c2 * models[row, MISSED] <= 0.1 * room
        and (models[row, AGE] == 1 or abs(c1 - models[row, SLOPE]) <= 0.75 * abs(slope))
    )


def follower(attempt: Callable) -> Callable:
    """Make the function that follows the root x of a step's energy error E(x) from earlier steps.

    ``attempt`` tries a step with a given x (`root.finder`).  The function is (search, models, row, predicted, c1,
    arguments) -> (x, True if found, the `Attempt` at x).  ``search`` has the limits of the search, ``arguments`` go to
    ``attempt``.  It begins at the ``predicted`` root; ``models[row]`` are the numbers of the quadratic model of E from
    earlier steps, which it renews, and c1 is the model's slope at x = 0, extrapolated to this step.
    """

    @inline
    def approach(
        x: Number, slope: Number, models: np.ndarray, row: int, arguments: Any
    ) -> tuple[Number, bool, Attempt, Number, bool]:
        """Iterate from x to a nearby root of the energy error E(x) of a step, beginning with the given slope dE/dx.

        ``models[row]`` is the quadratic model of E, ``arguments`` are passed to trial steps.  Returns (x, True if
        found, the last `Attempt`, slope, True if the slope was measured on the way).
        """
        c2, unit = models[row, CURVATURE], models[row, UNIT]
        ease = residual_factor(slope * models[row, MISSED], unit)
        start, xa, Ea, xb, Eb = FIRST, x, 0.0, x, 0.0
        found, measured = False, False
        new = Attempt(arguments.y, np.inf, 0.0, SOLVED)
        for k in range(FOLLOW_LIMIT):
            new = attempt(x, start, ease, arguments)
            E, unit = new.E, new.unit
            if new.status != SOLVED:
                break
            start = ALONG
            if ease > 1 and abs(E) < ease * unit:  # too near for so easy a solution
                ease = 1.0
                x = x - E / slope
                continue
            if x != xb:
                if abs(E) > 0.5 * abs(Eb) and abs(E) > SLACK * unit:
                    break
                if abs(Eb) > SHARP * unit:
                    slope, measured = (E - Eb) / (x - xb) + c2 * (x - xb), True
                    if xa != xb and abs(Ea * Eb) > 1e3 * unit * abs(slope):
                        slope, c2 = muller(xa, xb, x, Ea, Eb, E)
                        models[row, CURVATURE], models[row, STREAK] = c2, 0.0
                elif abs(E) > 2 * unit:
                    slope = (E - Eb) / (x - xb)  # that was not the slope
            if ease == 1 and (abs(E) <= unit or (k > 2 and abs(E) <= SLACK * unit and abs(E) >= 0.5 * abs(Eb))):
                found = True
                break
            xa, Ea, xb, Eb = xb, Eb, x, E
            x = x - E / slope
            ease = residual_factor(E, unit)
            if not abs(x) < np.inf or x == xb:
                break
        models[row, UNIT] = unit
        return x, found, new, slope, measured

    @inline
    def follow(
        search: Search, models: np.ndarray, row: int, predicted: Number, c1: Number, arguments: Any
    ) -> tuple[Number, bool, Attempt]:
        """Find the root x of the energy error E(x) near its ``predicted`` value: (x, found, the `Attempt` at x).

        ``found`` is False also for a root that may not be the one nearest to zero.  ``models[row]`` is the model of E,
        and c1 its slope at x = 0.
        """
        slope, x = c1 + 2 * models[row, CURVATURE] * predicted, predicted
        if models[row, AGE] > AGED and abs(slope) * models[row, MISSED] < SHARP * models[row, UNIT]:
            x = x + 3 * SHARP * models[row, UNIT] / slope
        x, found, result, slope, measured = approach(x, slope, models, row, arguments)
        miss, c2 = abs(x - predicted), models[row, CURVATURE]
        if not (found and abs(c2) * max(abs(x), miss) <= LONE * abs(slope)):
            return x, False, result
        models[row, MISSED] = miss
        models[row, STREAK] += 1
        if measured:
            renew(models, row, slope - 2 * c2 * x)
        return x, True, result

    return follow
