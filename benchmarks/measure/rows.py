"""Rows of a solution where they are wanted: at given times, and where functions of the state vanish (events)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators import section
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import grid, spacing
from phasebench.integrators.statuses import NOT_CONVERGED
from phasebench.reference.peers import Peer

from .solution import Solution

if TYPE_CHECKING:
    from phasebench.integrators.solution import Floats
    from phasebench.integrators.solution import Solution as Rows

    from .integrator import Integrator

#: A run that an event may stop begins with this share of its steps, and is made again with twice as many.
SHARE = 64
#: The round-off of times, relative to them: a row so close to a wanted time is taken as it is.
CLOSE = 8 * np.finfo(float).eps


class Wanted(NamedTuple):
    """What is asked of a run: the times of its rows (None: its steps), events by name, and the events that end it."""

    times: Floats | None
    events: Mapping[str, str]
    stop: tuple[str, ...]

    @classmethod
    def of(cls, t_eval: Any, events: Any, stop: str | Iterable[str]) -> Wanted:
        """Check the arguments of `integrator.integrate`; raises InvalidInput."""
        times = None
        if t_eval is not None:
            try:
                times = np.array(t_eval, float)
            except (TypeError, ValueError):
                times = np.empty((0, 0))
            if times.ndim != 1 or not len(times) or not np.isfinite(times).all():
                raise InvalidInput("t_eval must be finite numbers, an array (m,) of times")
        events = {} if events is None else events
        if not isinstance(events, Mapping) or not all(isinstance(x, str) for pair in events.items() for x in pair):
            raise InvalidInput("events must map names to formulas, as {'pericentre': 'x*px + y*py'}")
        names = (stop,) if isinstance(stop, str) else tuple(stop)
        unknown = [name for name in names if name not in events]
        if unknown:
            raise InvalidInput(
                f"stop has {unknown[0]!r}, which is none of the events: {', '.join(events) or 'there are none'}"
            )
        return cls(times, events, names)


def integrate(
    chosen: Integrator, problem: Any, wanted: Wanted, *, save_every: int, tol: float | None, **run: Any
) -> Solution:
    """Integrate, and keep the rows that are wanted; ``run`` has the other arguments of `Integrator.run`."""
    times, (h, steps) = wanted.times, _grid(chosen, wanted, run)
    if times is not None:
        if save_every != 1:
            raise InvalidInput("t_eval and save_every both say which rows are kept: leave one out")
        _check_order(times, run["t0"], h * steps)
    more = {x: run[x] for x in ("q0", "p0", "t0", "timeout")} | {"tol": tol}
    for n in _lengths(steps, wanted.stop):
        full = chosen.run(problem, h=h, steps=n, **more)
        events = {name: section.in_rows(full, of) for name, of in wanted.events.items()}
        first = min(
            (events[x] for x in wanted.stop if len(events[x])), key=lambda x: abs(x.t[0] - run["t0"]), default=None
        )
        if first is not None or full.status != "ok":
            break
    end = float(full.t[-1] if first is None else first.t[0])
    found = _at_times(chosen, problem, full, times, end, tol) if times is not None else _thinned(full, save_every, end)
    if first is not None and end not in found.t[-1:]:
        rows = (np.append(getattr(found, x), getattr(first, x)[:1], axis=0) for x in ("t", "q", "p"))
        found = replace(found, **dict(zip(("t", "q", "p"), rows, strict=True)), parameter=None)
    if not len(found.t):
        found = replace(found, t=full.t[:1], q=full.q[:1], p=full.p[:1])
    return Solution.of(found, events={name: _until(x, end, h) for name, x in events.items()})


def _grid(chosen: Integrator, wanted: Wanted, run: Mapping[str, Any]) -> tuple[float, int]:
    """(Step, number of steps); of an adaptive peer those between which events are looked for, else of its end."""
    if chosen.adaptive and run["h"] is None and run["steps"] is None and run["t_end"] is not None:
        if wanted.events:
            raise InvalidInput(f"'{chosen.id}' has no steps between which events are found: give h, too")
        return grid(None, run["t_end"], 1, run["t0"])
    return grid(run["h"], run["t_end"], run["steps"], run["t0"])


def _lengths(steps: int, stop: Iterable[str]) -> Iterator[int]:
    """Yield numbers of steps: all, or where an event may stop the run a few at first, then twice as many."""
    n = max(1, steps // SHARE) if stop else steps
    while n < steps:
        yield n
        n *= 2
    yield steps


def _check_order(times: Floats, t0: float, span: float) -> None:
    way, end = np.sign(span), t0 + span
    if (np.diff(way * times) < 0).any() or way * (times[0] - t0) < 0:
        raise InvalidInput(f"t_eval must be in the order of the integration, from t0 = {t0:g} on")
    if way * (times[-1] - end) > CLOSE * max(abs(end), abs(span)):
        raise InvalidInput(f"t_eval goes to {times[-1]:.17g}, the integration to t_end = {end:.17g}")


def _until(found: section.Section, end: float, h: float) -> section.Section:
    from .ensembles import Section, fields_of

    kept = np.sign(h) * (found.t - end) <= 0
    return Section(**fields_of(found) | {x: getattr(found, x)[kept] for x in ("orbit", "t", "q", "p")})


def _thinned(full: Rows, save_every: int, end: float) -> Rows:
    """Every so many rows of a solution, and its last, up to a time."""
    last = len(full.t) - 1
    index = np.append(np.arange(0, last, spacing(save_every, max(1, last))), last)
    index = index[np.sign(full.h) * (full.t[index] - end) <= 0]
    chosen = None if full.parameter is None else full.parameter[index[1:] - 1]
    return replace(full, t=full.t[index], q=full.q[index], p=full.p[index], parameter=chosen)


def _at_times(chosen: Integrator, problem: Any, full: Rows, times: Floats, end: float, tol: float | None) -> Rows:
    """The states at some times: those of rows, or after one shorter step of the integrator from the row before."""
    from .ensembles import integrate_ensemble

    way = np.sign(full.h)
    times = times[way * (times - end) <= CLOSE * abs(end)]
    at = np.searchsorted(way * full.t, way * times, side="right") - 1
    after = np.minimum(at + 1, len(full.t) - 1)
    close = CLOSE * np.maximum(np.abs(times), abs(full.h))
    at = np.where(np.abs(full.t[after] - times) <= close, after, at)
    q, p, rest = full.q[at], full.p[at], times - full.t[at]
    between = np.flatnonzero(np.abs(rest) > close)
    if not isinstance(chosen.record, Peer) and len(between):
        ends = integrate_ensemble(problem, chosen, q[between], p[between], h=rest[between], steps=1)
        q[between], p[between] = ends.q, ends.p
    for k in between if isinstance(chosen.record, Peer) else ():
        start = full.t[at[k]]
        if chosen.adaptive and k and at[k] == at[k - 1]:
            q[k], p[k], start = q[k - 1], p[k - 1], times[k - 1]
        if times[k] != start:
            one = chosen.run(problem, h=times[k] - start, steps=1, q0=q[k], p0=p[k], tol=tol)
            q[k], p[k] = one.q[-1], one.p[-1]
    good = np.isfinite(q).all(1) & np.isfinite(p).all(1)
    if not good.all():
        n = int(good.argmin())
        reason = f"the step to t = {times[n]:g} is not solved; take a smaller h"
        return replace(full, t=times[:n], q=q[:n], p=p[:n], parameter=None, status=NOT_CONVERGED, reason=reason)
    return replace(full, t=times, q=q, p=p, parameter=None)
