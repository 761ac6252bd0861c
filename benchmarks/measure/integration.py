"""`integrate` and `prepare`; rows at given times, and where functions of the state vanish (events)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.units import span
from phasebench.integrators import section
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import Parameters, State, method_parameters, rename_arguments
from phasebench.integrators.prepared import PreparedRun
from phasebench.integrators.record import Method
from phasebench.integrators.request import grid, spacing
from phasebench.integrators.statuses import NOT_CONVERGED
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.reference.peers import Peer
from phasebench.reference.peers.prepared import PreparedPeer

from .ensembles import Section, fields_of, integrate_ensemble
from .integrator import AnyProblem, Integrator, integrator, parameters_of
from .own_step import Step
from .solution import Solution

if TYPE_CHECKING:
    from phasebench.integrators.solution import Floats
    from phasebench.integrators.solution import Solution as Rows

#: A run that an event may stop begins with this share of its steps, and is made again with twice as many.
SHARE = 64
#: The round-off of times, relative to them: a row so close to a wanted time is taken as it is.
CLOSE = 8 * np.finfo(float).eps


@rename_arguments(timeout="time_limit")
@method_parameters(parameters_of)
def integrate(
    problem: AnyProblem,
    method: str | Path | Method | Peer | Integrator | Step,
    *,
    h: float | str | None = None,
    t_end: float | str | None = None,
    steps: int | None = None,
    tol: float | None = None,
    t0: float | str = 0.0,
    q0: State | None = None,
    p0: State | None = None,
    save_every: int = 1,
    t_eval: Sequence[float] | np.ndarray | None = None,
    events: Mapping[str, str] | None = None,
    stop: str | Iterable[str] = (),
    time_limit: float | None = None,
    parameters: Parameters | None = None,
) -> Solution:
    """Integrate a problem with a method of this project, a peer, or a user's own step.

    Parameters
    ----------
    problem : a system; a problem; a registered name such as ``"henon-heiles:box"``; or the path of a file with one
    method : an id of a method or a peer; a record; a function ``step(system, q, p, h) -> (q, p)``; or the path of a
        file with one
    h, t_end, steps : two of them; h alone is adjusted so that a whole number of steps ends at t_end.  For an adaptive
        peer they set the grid of its rows, and t_end alone gives start and end.  If the problem has a unit of time,
        times may have one too: ``h="1 day", t_end="1e4 yr"``.  A t_end before t0, or a negative h with steps, goes back
        in time
    tol : an adaptive peer's tolerance
    t0 : the time at the start; the system does not depend on it
    q0, p0 : arrays (d,), the initial state if not the problem's
    save_every : save every Nth state, and the last; 0 saves the first and the last
    t_eval : array (m,), times at which to save states instead, each by a shorter step from the one before it
    events : functions of the coordinates and momenta whose zeros are wanted, by name: ``{"turn": "x*px + y*py"}``; they
        are found between steps (`section`), in ``events`` of the solution, whatever direction the sign changes in
    stop : name or names of events; the solution ends at the first of them
    time_limit : seconds after which the integration stops with status "timeout"; a peer cannot be stopped
    parameters : values of the method's parameters, ``{"lam": "1/3"}``: numbers, NumPy scalars, fractions or text

    Returns
    -------
    Solution
        t (n,), q and p (n, d), status, reason, counts, seconds; energy(), invariants(), error(), to_frame()

    Raises
    ------
    InvalidInput
        For unusable input; a failure on the way (a blow-up, a stage not solved) is a status instead.

    Examples
    --------
    >>> integrate("pendulum", "scheme-i", h=0.1, steps=10, parameters={"lam": "1/3"}).status
    'ok'
    """
    chosen = integrator(method, parameters=parameters)
    if time_limit is not None and not chosen.stoppable:
        raise InvalidInput(f"'{chosen.id}' cannot be stopped: leave out the time limit")
    found = _problem(problem, chosen, q0)
    unit = getattr(found, "time_unit", "")
    times = {name: span(t, unit, name) for name, t in (("h", h), ("t_end", t_end), ("t0", t0))}
    run = {"steps": steps, "tol": tol, "q0": q0, "p0": p0, "save_every": save_every, "timeout": time_limit, **times}
    if t_eval is None and not events and not stop:
        return Solution.of(chosen.run(found, **run))
    return _wanted(chosen, found, Wanted.of(t_eval, events, stop), **run)


@method_parameters(parameters_of)
def prepare(
    problem: AnyProblem,
    method: str | Path | Method | Peer | Integrator,
    *,
    tol: float | None = None,
    q0: State | None = None,
    p0: State | None = None,
    parameters: Parameters | None = None,
) -> PreparedRun | PreparedPeer:
    """A compiled run for many short integrations: ``run(h, steps)``, or ``run(t_end)`` for an adaptive peer.

    A call consists of a reset to the initial state and the package's own call only; it returns (q, p, status).

    Parameters
    ----------
    problem : a system, if q0 and p0 are given; a problem; a registered name such as ``"henon-heiles:box"``; or the
        path of a file with one
    method, parameters : an id of a method or a peer, or a record; and values of a method's parameters
    tol : an adaptive peer's tolerance
    q0, p0 : arrays (d,), the initial state if not the problem's

    Raises
    ------
    InvalidInput
        For unusable input, or an integrator that cannot be prepared (a user's own step).

    Examples
    --------
    >>> run = prepare("pendulum", "stormer-verlet")
    >>> run(0.01, 100)[2]
    'ok'
    >>> prepare("pendulum", "heyoka", tol=1e-9)(1.0)[2]
    'ok'
    """
    chosen = integrator(method, parameters=parameters)
    return chosen.prepare(_problem(problem, chosen, q0), tol=tol, q0=q0, p0=p0)


def _problem(problem: Any, method: Integrator, q0: State | None) -> Any:
    """The problem, by its name; a bare system gets the Kepler part found at q0 if the method requires one."""
    if isinstance(problem, (str, Path)):
        return problem_of(problem)
    needs = "Kepler part" in getattr(method.record, "requires", ())
    if not needs or q0 is None or not isinstance(problem, PartitionedSystem):
        return problem
    from phasebench.benchmarks.problems.kepler_found import with_kepler_part

    return with_kepler_part(problem, np.asarray(q0, float))


class Wanted(NamedTuple):
    """What is asked of a run: the times of its rows (None: its steps), events by name, and the events that end it."""

    times: Floats | None
    events: Mapping[str, str]
    stop: tuple[str, ...]

    @classmethod
    def of(cls, t_eval: Any, events: Any, stop: str | Iterable[str]) -> Wanted:
        """Check the arguments of `integrate`; raises InvalidInput."""
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


def _wanted(
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
