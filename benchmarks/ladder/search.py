r"""Searches for the cheapest run of an integrator (a candidate) that meets an accuracy: mostly that of the widest step.

The error of a fixed step of order p is assumed :math:`e \sim h^p`, that of an adaptive peer (an integrator of another
package) proportional to its tolerance.  The exponent is estimated from two runs; the next run aims at the accuracy with
a `MARGIN`, and the search goes on until the run that meets the accuracy costs little more than one that misses it.  A
candidate is given up if its extrapolated cost is a multiple of the cheapest so far, if it fails at every step, or if
its error no longer falls.  If the implicit equations need so many iterations in wide steps that a finer run was clearly
cheaper, the finer run is the result.
"""

from __future__ import annotations

from itertools import takewhile
from math import inf, log
from typing import NamedTuple

from phasebench.integrators.driver import TIMEOUT

from .bracket import aim
from .bracket import cheapest as cheapest_of
from .climb import FLOOR
from .rung import Rung
from .trial import MOST, Trial

number = "{:.2g}".format
#: The next run aims at the share `MARGIN` of the accuracy; inside a bracket at the share `AIMED`.
MARGIN, AIMED = 0.8, 0.95
#: The search ends when the cost of the run that misses is at least this share of that of the run that meets.
NEAR = 0.93
#: Multiples of the cheapest time: above `HOPELESS` (extrapolated) a candidate is given up, above `WORTH` not refined.
HOPELESS, WORTH = 4.0, 1.6
#: An error below this share of the accuracy may be round-off and is not extrapolated.
SMALL = 1e-3
#: Largest number of runs of a candidate, and of failed ones.
RUNS, FAILURES = 12, 6
#: Largest factor between successive sizes, to finer and to coarser ones.
JUMP, WIDER = 16.0, 4.0
#: An error above this that does not fall is due to steps that are too wide, not to round-off.
FINE = 1e-6
#: An error above this share of the quantity is not extrapolated: the steps are too wide.
WILD = 0.1
#: Loosest tolerance.
LOOSEST = 0.03


class Found(NamedTuple):
    """The result of a search: the cheapest run that meets the accuracy as ``rung``, or None and the reason ``why``."""

    rung: Rung | None
    why: str = ""


def search(trial: Trial, accuracy: float, start: float, cheapest: float = inf) -> Found:
    """Find the cheapest run that meets the accuracy, starting from a number of steps or a tolerance.

    ``cheapest`` is the time in seconds of the cheapest candidate so far.
    """
    size, fails = start, 0
    expected = trial.pilot(size)
    if expected > max(HOPELESS * cheapest, 0.0) and expected > trial.longest:
        return Found(None, f"too slow: about {number(expected)} s")
    for _ in range(RUNS):
        fails += not trial.at(size, cheapest).ok
        good, bad = next(iter(trial.meeting(accuracy)), None), _bad(trial, accuracy)
        if good is not None and (_close(good, bad) or _dear(trial, good, bad, accuracy, cheapest)):
            break
        why = _hopeless(trial, accuracy, cheapest, fails) if good is None else ""
        if why:
            return Found(None, why)
        following = _next(trial, accuracy, good, bad)
        if following is None or following in trial.rungs:
            break
        size = following
    good = cheapest_of(trial.meeting(accuracy))
    return Found(good) if good else Found(None, _nearest(trial))


def best_within(trial: Trial, budget: float, start: float) -> Found:
    """Find the run of the smallest error in at most ``budget`` seconds; ``start`` is the first steps or tolerance."""
    size = start
    for _ in range(RUNS):
        rung = trial.at(size)
        if not rung.ok and rung.seconds > budget:
            break
        following = _fitting(trial, rung, budget)
        if following is None or following in trial.rungs:
            break
        size = following
    ended = [r for r in trial.rungs.values() if r.ok]
    fitting = [r for r in ended if r.seconds <= budget]
    if not fitting:
        why = f"too slow: {number(min(r.seconds for r in ended))} s at the least" if ended else trial.failure()
        return Found(None, why)
    return Found(min(fitting, key=lambda r: r.error))


def _fitting(trial: Trial, rung: Rung, budget: float) -> float | None:
    """The number of steps or tolerance to try after the run ``rung``, for about ``budget`` seconds; None if none."""
    if rung.steps is None:
        tighter = rung.tol / 10
        return tighter if rung.seconds < budget and tighter >= trial.integrator.record.least else None
    wanted = 0.85 * budget * rung.steps / rung.seconds if rung.seconds > 0 else rung.steps * JUMP
    wanted = trial.task.quantity.steps(min(wanted, rung.steps * JUMP, MOST))
    return wanted if abs(wanted / rung.steps - 1) > 0.1 else None


def _bad(trial: Trial, accuracy: float) -> Rung | None:
    """The finest run that is coarser than all runs that meet the accuracy; None if there is none."""
    *_, last = (None, *takewhile(lambda r: not trial.meets(r, accuracy), trial.sorted_rungs))
    return last


def _close(good: Rung, bad: Rung | None) -> bool:
    """True if no run between ``good`` and ``bad`` (or None) is worth trying, since their costs are close."""
    if bad is None:
        return good.taken <= 1 or (good.tol is not None and good.tol >= LOOSEST)
    if good.tol is not None:
        same = bad.ok and bad.taken >= NEAR * good.taken
        return same or bad.tol < 2 * good.tol
    return bad.steps >= NEAR * good.steps


def _dear(trial: Trial, good: Rung, bad: Rung | None, accuracy: float, cheapest: float) -> bool:
    """True if the run ``good`` is too slow to win, and so are coarser runs that might meet the accuracy."""
    if good.tol is not None:
        return bad is not None and good.seconds > WORTH * cheapest
    gap = inf if bad is None else good.steps / bad.steps
    extrapolated = good.error >= SMALL * accuracy
    wider = min((accuracy / good.error) ** (1 / _exponent(trial)) if extrapolated else inf, gap)
    return good.seconds / max(wider, 1.0) > WORTH * cheapest


def _exponent(trial: Trial) -> float:
    """The exponent p of error ~ fineness^-p (steps or 1 / tol) of the two finest runs, kept near the declared order."""
    declared, slope = _declared_order(trial), _slope(trial)
    return declared if slope is None or slope <= 0 else min(max(slope, declared / 2), 2.5 * declared)


def _declared_order(trial: Trial) -> float:
    return 1.0 if trial.integrator.adaptive else float(trial.integrator.order or 2)


def _slope(trial: Trial) -> float | None:
    """The exponent p of error ~ fineness^-p (steps or 1 / tol) of the two finest runs; None if there are fewer."""
    told = [r for r in trial.sorted_rungs if r.ok and 0 < r.error < inf][-2:]
    return log(told[0].error / told[1].error) / log(told[1].fineness / told[0].fineness) if len(told) == 2 else None


def _next(trial: Trial, accuracy: float, good: Rung | None, bad: Rung | None) -> float | None:
    adaptive = trial.integrator.adaptive
    if good is None:
        return _size_at(trial, _finer(trial, accuracy))
    if bad is None:
        factor = (MARGIN * accuracy / good.error) ** (1 / _exponent(trial)) if good.error > 0 else WIDER
        return _size_at(trial, good.fineness / min(max(factor, 1.1), 100.0 if adaptive else WIDER))
    return _size_at(trial, aim(bad, good, AIMED * accuracy))


def _finer(trial: Trial, accuracy: float) -> float:
    """The next fineness while no run meets the accuracy, extrapolated from the finest run; short of those timed out."""
    stopped = min((r.fineness for r in trial.sorted_rungs if r.status == TIMEOUT), default=inf)
    going = [r for r in trial.sorted_rungs if r.fineness < stopped]
    finest, factor = stopped / JUMP**2, 4.0
    if going:
        last = going[-1]
        finest = last.fineness
        if last.ok and 0 < last.error < inf:
            factor = (last.error / (MARGIN * accuracy)) ** (1 / _exponent(trial))
    following = finest * min(max(factor, 4.0 if trial.integrator.adaptive else 1.1), JUMP)
    return following if following < stopped else (finest * stopped) ** 0.5


def _size_at(trial: Trial, fineness: float) -> float | None:
    if not trial.integrator.adaptive:
        return trial.task.quantity.steps(min(max(fineness, 1.0), MOST))
    least, tightest = trial.integrator.record.least, min(trial.rungs)
    tol = min(max(1 / fineness, least), LOOSEST)
    return None if tol == tightest == least else tol


def _hopeless(trial: Trial, accuracy: float, cheapest: float, fails: int) -> str:
    """The reason why a candidate that has not met the accuracy will not win, or "" if it may."""
    if fails >= FAILURES:
        return f"breaks at every step that was tried ({trial.failure()})"
    adaptive, told = trial.integrator.adaptive, [r for r in trial.sorted_rungs if r.ok]
    if not told:
        slow = [r for r in trial.rungs.values() if r.seconds > max(trial.longest, HOPELESS * cheapest)]
        return f"too slow, or breaks ({trial.failure()})" if slow else ""
    last = told[-1]
    if last.seconds < cheapest and last.fineness * 1.01 < MOST:
        return ""  # the next rung may be the cheapest of all, whatever these few extrapolate to
    finer = 10.0 if adaptive else 1.5
    coarser = [r for r in told if r.fineness * finer <= last.fineness][-2:]
    if len(coarser) == 2 and last.error < FINE and all(last.error > FLOOR * r.error for r in coarser):
        return f"its error falls no longer: {number(min(r.error for r in told))} at the least"
    needed = (last.error / accuracy) ** (1 / _exponent(trial)) if last.error < inf else 1.0
    cost = last.seconds * (1.0 if adaptive else needed)
    slope = _slope(trial)
    falling = slope is not None and slope >= _declared_order(trial) / 2 and last.error < WILD * trial.scale
    asymptotic = falling or last.seconds > HOPELESS * cheapest
    if asymptotic and cost > HOPELESS * cheapest and last.error > accuracy:
        return f"too slow: at this accuracy about {number(cost)} s"
    if last.seconds > trial.longest or (not adaptive and last.fineness * 1.01 >= MOST):
        return f"too slow: {number(last.seconds)} s bring it to {number(last.error)}"
    return ""


def _nearest(trial: Trial) -> str:
    errors = [r.error for r in trial.rungs.values() if r.ok]
    return f"does not get there: {number(min(errors))} at the least" if errors else trial.failure()
