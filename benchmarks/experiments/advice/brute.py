"""The cheapest of everything, found without advice: each integrator on a fine ladder of its sizes.

Nothing is known of whom to try, nothing is extrapolated: sizes go from four steps, or a loose tolerance, finer by
`COARSE` until a run meets the accuracy or costs `DEAR` times the cheapest so far; then, between the last that did not
and the first that did, by `FINE`.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from phasebench.benchmarks.advice.ask import Ask
from phasebench.benchmarks.advice.portfolio import SLOW, portfolio
from phasebench.benchmarks.advice.trial import Point, Trial
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import Truth

#: A number of steps is so many times the one before, at first and at last; a tolerance the one before divided by it.
COARSE, FINE, TOLERANCE = 1.5, 1.08, 3.0
#: A run that does not meet the accuracy and takes so many times the cheapest ends a ladder.
DEAR = 2.0
FEWEST, LOOSEST, RUNGS = 1, 0.1, 45
#: Seconds that the first may take that meets the accuracy.
LONGEST = 1.0


class Best(NamedTuple):
    """The cheapest: whose trial, which run; how many were tried, in how many runs."""

    trial: Trial
    point: Point
    tried: int
    runs: int


def best(ask: Ask, true: Truth) -> Best | None:
    """The cheapest of all that can do it; None where nothing meets the accuracy."""
    found, tried, runs, cheapest = None, 0, 0, inf
    for integrator, _ in portfolio(ask, ask.accuracy)[0]:
        if integrator.kind in SLOW:
            continue
        trial = Trial(integrator, ask, true, min(LONGEST, 3 * DEAR * cheapest))
        point = cheapest_of(trial, cheapest)
        tried, runs = tried + 1, runs + len(trial.points)
        if point is not None and point.seconds < cheapest and _keeps(integrator, ask, point):
            found, cheapest = (trial, point), point.seconds
    return found and Best(*found, tried, runs)


def _keeps(integrator: Integrator, ask: Ask, point: Point) -> bool:
    from phasebench.benchmarks.advice import kept

    return not ask.conserve or kept.broken(integrator, ask, point.size) is None


def cheapest_of(trial: Trial, cheapest: float) -> Point | None:
    """The cheapest run of one that meets the accuracy."""
    factor = TOLERANCE if trial.integrator.adaptive else COARSE
    at, last = (LOOSEST if trial.integrator.adaptive else float(FEWEST)), None
    for _ in range(RUNGS):
        if trial.integrator.adaptive and at < trial.integrator.record.least:
            return None
        if trial.pilot(at) > max(20 * cheapest, LONGEST):
            return None
        point = trial.at(at)
        if trial.meets(point, trial.ask.accuracy):
            break
        if (point.ok and point.seconds > DEAR * cheapest) or point.seconds > trial.longest:
            return None
        last, at = at, (at / factor if trial.integrator.adaptive else max(at + 1, round(at * factor)))
    else:
        return None
    if last is not None and not trial.integrator.adaptive and point.seconds < DEAR * cheapest:
        finer = last * FINE
        while finer < at:
            trial.at(round(finer))
            finer = max(finer * FINE, finer + 1)
    return min((p for p in trial.points.values() if trial.meets(p, trial.ask.accuracy)), key=lambda p: p.seconds)
