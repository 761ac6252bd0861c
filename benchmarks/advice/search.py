r"""The cheapest run of a candidate that meets an accuracy: mostly the widest step, or the loosest tolerance.

A fixed step of order p has an error :math:`e \sim h^p`, an adaptive peer one in proportion to its tolerance.  From two
runs the exponent is estimated, and the next run is the one that is to meet the accuracy with a `MARGIN`; so it goes on,
the accuracy bracketed, until the run that meets it is little dearer than one that does not.  A candidate is given up
where it cannot win: where its cost, extrapolated, is a multiple of the cheapest so far; where it breaks at every step;
where its error falls no longer.  Where the equations of wide steps take so many sweeps that a finer run was clearly
cheaper, that one is taken.
"""

from __future__ import annotations

from math import inf, log
from typing import NamedTuple

from .cheapest import cheapest as cheapest_of
from .trial import MOST, Point, Trial

number = "{:.2g}".format
#: The next run aims at so much of the accuracy.
MARGIN = 0.8
#: A run that meets the accuracy is refined until one that does not costs more than this share of it.
NEAR = 0.93
#: A candidate is given up where it is so many times dearer than the cheapest, extrapolated; refined where it is less.
HOPELESS, WORTH = 4.0, 1.6
#: An error of such a share of the accuracy may be round-off, from which nothing is extrapolated.
SMALL = 1e-3
#: The most runs of a candidate, and of the same one that fail.
RUNS, FAILURES = 12, 6
#: A next run is at most so many times finer, or wider.
JUMP, WIDER = 16.0, 4.0
#: A step so many times shorter that leaves this much of the error has met round-off.
FLOOR = 0.7
#: Above it an error that does not fall is of steps still too wide, not of round-off.
FINE = 1e-6
#: Loosest tolerance.
LOOSEST = 0.03


class Found(NamedTuple):
    """What a search came to: the cheapest run that meets the accuracy, or why there is none."""

    point: Point | None
    why: str = ""


def search(trial: Trial, accuracy: float, start: float, cheapest: float = inf) -> Found:
    """The cheapest run that meets the accuracy, from a first number of steps or tolerance on.

    ``cheapest`` are the seconds of the cheapest of the other candidates so far.
    """
    size, fails = start, 0
    expected = trial.pilot(size)
    if expected > max(HOPELESS * cheapest, 0.0) and expected > trial.longest:
        return Found(None, f"too slow: about {number(expected)} s")
    for _ in range(RUNS):
        point = trial.at(size)
        fails += not point.ok
        good, bad = next(iter(_meeting(trial, accuracy)), None), _bad(trial, accuracy)
        if good is not None and (_close(trial, good, bad) or _dear(trial, good, bad, accuracy, cheapest)):
            break
        why = _hopeless(trial, accuracy, cheapest, fails) if good is None else ""
        if why:
            return Found(None, why)
        following = _next(trial, accuracy, good, bad)
        if following is None or following in trial.points:
            break
        size = following
    good = cheapest_of(_meeting(trial, accuracy))
    return Found(good) if good else Found(None, _nearest(trial))


def best_within(trial: Trial, budget: float, start: float) -> Found:
    """The run of the smallest error that takes at most the ``budget`` of seconds, from a first size on."""
    size = start
    for _ in range(RUNS):
        point = trial.at(size)
        if not point.ok and point.seconds > budget:
            break
        rate = point.seconds / _work(trial, size)
        following = _fitting(trial, size, budget, rate)
        if following is None or following in trial.points:
            break
        size = following
    fitting = [p for p in trial.points.values() if p.ok and p.seconds <= budget]
    if not fitting:
        ended = [p for p in trial.points.values() if p.ok]
        why = f"too slow: {number(min(p.seconds for p in ended))} s at the least" if ended else trial.failure()
        return Found(None, why)
    return Found(min(fitting, key=lambda p: p.error))


def _work(trial: Trial, size: float) -> float:
    return trial.points[size].steps or 1 if trial.integrator.adaptive else trial.ask.quantity.steps(size)


def _fitting(trial: Trial, size: float, budget: float, rate: float) -> float | None:
    """The next size towards the budget."""
    if trial.integrator.adaptive:
        tighter = size / 10 if trial.points[size].seconds < budget else None
        return tighter if tighter and tighter >= trial.integrator.record.least else None
    wanted = 0.85 * budget / rate if rate > 0 else size * JUMP
    wanted = trial.ask.quantity.steps(min(wanted, size * JUMP, MOST))
    return wanted if abs(wanted / size - 1) > 0.1 else None


def _fineness(trial: Trial, size: float) -> float:
    """What grows as a run gets finer: steps, or one over the tolerance."""
    return 1 / size if trial.integrator.adaptive else size


def _ordered(trial: Trial) -> list[tuple[float, Point]]:
    """(fineness, run), the coarsest first."""
    return sorted((_fineness(trial, size), point) for size, point in trial.points.items())


def _meeting(trial: Trial, accuracy: float) -> list[Point]:
    """The runs that meet the accuracy, the coarsest first."""
    return [p for _, p in _ordered(trial) if trial.meets(p, accuracy)]


def _bad(trial: Trial, accuracy: float) -> Point | None:
    """The finest run that is coarser than every one that meets the accuracy."""
    last = None
    for _, point in _ordered(trial):
        if trial.meets(point, accuracy):
            break
        last = point
    return last


def _close(trial: Trial, good: Point, bad: Point | None) -> bool:
    if bad is None:
        return good.steps <= 1 or ("tol" in good.size and good.size["tol"] >= LOOSEST)
    if "tol" in good.size:
        same = bad.ok and bad.steps >= NEAR * good.steps
        return same or bad.size["tol"] < 2 * good.size["tol"]
    return bad.size["steps"] >= NEAR * good.size["steps"]


def _dear(trial: Trial, good: Point, bad: Point | None, accuracy: float, cheapest: float) -> bool:
    """Whether a run that meets the accuracy is too dear, and coarser ones that may do will be."""
    if bad is not None or good.error < SMALL * accuracy:
        return bad is not None and good.seconds > WORTH * cheapest
    wider = 1.0 if trial.integrator.adaptive else (accuracy / good.error) ** (1 / _exponent(trial))
    return good.seconds / max(wider, 1.0) > WORTH * cheapest


def _exponent(trial: Trial) -> float:
    """How fast the error falls with the fineness: from the two finest runs, within reason of what is declared."""
    declared = 1.0 if trial.integrator.adaptive else float(trial.integrator.order or 2)
    told = [(f, p.error) for f, p in _ordered(trial) if p.ok and 0 < p.error < inf]
    if len(told) < 2:
        return declared
    (f1, e1), (f2, e2) = told[-2:]
    if not (e2 < e1 and f2 > f1):
        return declared
    return min(max(log(e1 / e2) / log(f2 / f1), declared / 2), 2.5 * declared)


def _next(trial: Trial, accuracy: float, good: Point | None, bad: Point | None) -> float | None:
    """The next number of steps or tolerance; None where there is none."""
    ordered = _ordered(trial)
    if good is None:
        finest, point = ordered[-1]
        factor = 4.0
        if point.ok and 0 < point.error < inf:
            factor = (point.error / (MARGIN * accuracy)) ** (1 / _exponent(trial))
        least = 4.0 if trial.integrator.adaptive else 1.1
        return _sized(trial, finest * min(max(factor, least), JUMP))
    f_good = _fineness(trial, next(iter(good.size.values())))
    if bad is None:
        factor = (MARGIN * accuracy / good.error) ** (1 / _exponent(trial)) if good.error > 0 else WIDER
        return _sized(trial, f_good / min(max(factor, 1.1), WIDER if not trial.integrator.adaptive else 100.0))
    f_bad = _fineness(trial, next(iter(bad.size.values())))
    middle = (f_good * f_bad) ** 0.5
    if bad.ok and good.error < bad.error < inf and good.error > 0:
        share = log(bad.error / (0.95 * accuracy)) / log(bad.error / good.error)
        middle = f_bad * (f_good / f_bad) ** min(max(share, 0.15), 0.85)
    return _sized(trial, middle)


def _sized(trial: Trial, fineness: float) -> float | None:
    if not trial.integrator.adaptive:
        return trial.ask.quantity.steps(min(max(fineness, 1.0), MOST))
    least, tightest = trial.integrator.record.least, min(trial.points)
    tol = min(max(1 / fineness, least), LOOSEST)
    return None if tol == tightest == least else tol


def _hopeless(trial: Trial, accuracy: float, cheapest: float, fails: int) -> str:
    """Why a candidate that has not met the accuracy will not win; empty where it may."""
    if fails >= FAILURES:
        return f"breaks at every step that was tried ({trial.failure()})"
    told = [(f, p) for f, p in _ordered(trial) if p.ok]
    if not told:
        slow = [p for p in trial.points.values() if p.seconds > max(trial.longest, HOPELESS * cheapest)]
        return f"too slow, or breaks ({trial.failure()})" if slow else ""
    finest, last = told[-1]
    finer = 10.0 if trial.integrator.adaptive else 1.5
    coarser = [p for f, p in told if f * finer <= finest][-2:]
    if len(coarser) == 2 and last.error < FINE and all(last.error > FLOOR * p.error for p in coarser):
        return f"its error falls no longer: {number(min(p.error for _, p in told))} at the least"
    needed = (last.error / accuracy) ** (1 / _exponent(trial)) if last.error < inf else 1.0
    cost = last.seconds * (needed if not trial.integrator.adaptive else 1.0)
    asymptotic = len(told) >= 2 or last.seconds > HOPELESS * cheapest
    if asymptotic and cost > HOPELESS * cheapest and last.error > accuracy:
        return f"too slow: at this accuracy about {number(cost)} s"
    if last.seconds > trial.longest or (not trial.integrator.adaptive and finest * 1.01 >= MOST):
        return f"too slow: {number(last.seconds)} s bring it to {number(last.error)}"
    return ""


def _nearest(trial: Trial) -> str:
    errors = [p.error for p in trial.points.values() if p.ok]
    return f"does not get there: {number(min(errors))} at the least" if errors else trial.failure()
