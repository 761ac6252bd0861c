"""Ensembles and Poincare sections of named problems, with methods of this project or a user's own step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators import ensemble
from phasebench.integrators import section as sections
from phasebench.integrators.batches import Orbits
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import State, States, Value, check_names
from phasebench.integrators.record import Method

from .integrator import AnyProblem, Integrator, integrator
from .own_step import OwnStep, Step, integrate_step

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Values of a method's parameters: one for all orbits, or an array (n,).
OrbitParameters: TypeAlias = "Mapping[str, Value | State]"
#: Rows of an ensemble or a section that a notebook shows.
HEAD = 10


class Ensemble(ensemble.Ensemble):
    """The end states of many integrated orbits with a status each, which can be plotted and made a DataFrame.

    Attributes are those of `integrators.ensemble.Ensemble`.
    """

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas DataFrame with a row for each orbit: end time t, end state by names, h, status and reason."""
        import pandas as pd

        ends = np.hstack([self.q, self.p])
        columns = {"t": self.t} | {name: ends[:, k] for k, name in enumerate(self.names)}
        return pd.DataFrame(columns | {"h": self.h, "status": self.status, "reason": self.reason})

    def plot(self) -> Figure:
        """Return a figure of the end states in the plane of the first q and p, with a marker for each status."""
        from . import figures

        return figures.ensemble(self)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>{self.to_frame().to_html(index=False, max_rows=HEAD)}"


class Section(sections.Section):
    """A Poincare section: the crossings of a plane by orbits, which can be plotted and made a DataFrame.

    Attributes are those of `integrators.section.Section`.
    """

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas DataFrame with a row for each crossing: index of the orbit, t, coordinates and momenta."""
        import pandas as pd

        states = np.hstack([self.q, self.p])
        return pd.DataFrame({"orbit": self.orbit, "t": self.t} | {x: states[:, k] for k, x in enumerate(self.names)})

    def plot(self) -> Figure:
        """Return a figure of the crossings (`figures.section`); raises InvalidInput for d = 1."""
        from . import figures

        return figures.section(self)

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>{self.to_frame().to_html(index=False, max_rows=HEAD)}"


@check_names
def integrate_ensemble(
    problem: AnyProblem,
    method: str | Path | Method | Integrator | Step,
    Q: States,
    P: States,
    *,
    h: float | State | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: OrbitParameters | None = None,
    save_every: int = 0,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Ensemble:
    """Integrate many orbits of a problem, each with its own status.

    Parameters
    ----------
    problem : a system, a problem, a registered name such as ``"henon-heiles"``, or the path of a file with one
    method : an id or a method; or a function ``step(system, q, p, h) -> (q, p)`` or the path of a file with one, which
        is slow, since Python calls it for every step of one orbit after the other
    Q, P : arrays (n, d), the initial states; an orbit whose state is not finite gets the status "invalid"
    h : number, or array (n,) with a step for each orbit
    t_end, steps : as in `integrate`; if the steps differ, ``t_end`` saves only the first and the last state
    parameters : values of the method's parameters, or of the problem's: numbers, or arrays (n,) with a value for each
        orbit.  Orbits with the same values of the problem's run together; each further value takes some 0.2 s
    save_every : save every Nth state, and the last; 0 saves the first and the last
    lanes : True to integrate orbits in SIMD lanes; by default if possible and if there are enough orbits
    threads : number of threads; by default all cores that this process may use
    progress : called with the number of finished orbits

    Returns
    -------
    Ensemble
        The end states (saved states, if asked for) and the status of each orbit.

    Raises
    ------
    InvalidInput
        For unusable input, and for a step that raises or returns no state; a failure of one orbit on the way is its
        status instead.

    Examples
    --------
    >>> integrate_ensemble("pendulum", "scheme-i", [[1.0], [2.0]], [[0.0], [0.0]], h=0.1, steps=10).status.tolist()
    ['ok', 'ok']
    """
    chosen = _method(method)
    given, of_problem = _sort_parameters(problem, chosen, parameters or {})
    whole = ensemble.begin(_problem(problem), chosen, Q, P, h, t_end, steps, given, save_every)
    if not of_problem:
        return Ensemble(**fields_of(ensemble.conclude(whole, *_run(whole, chosen, lanes, threads, progress))))
    groups, ends, done = _groups(of_problem, len(whole.q)), [], 0
    problems = [_changed(problem, values) for values, _ in groups]
    driven = [x for x in problems if _is_driven(x)]
    if driven and not whole.system.driven:
        whole = ensemble.begin(driven[0], chosen, Q, P, h, t_end, steps, given, save_every)
    for changed, (_, members) in zip(problems, groups, strict=True):
        some = {name: np.asarray(x)[members] if np.ndim(x) else x for name, x in given.items()}
        sizes = np.asarray(h)[members] if np.ndim(h) else h
        start = whole.q[members], whole.p[members]
        lost = whole.system.driven and not _is_driven(changed)
        real = [x[:, :-1] for x in start] if lost else start
        orbits = ensemble.begin(changed, chosen, *real, sizes, t_end, steps, some, save_every)
        tell = None if progress is None else partial(_tell, progress, done)
        end = ensemble.conclude(orbits, *_run(orbits, chosen, lanes, threads, tell))
        ends.append(_with_time(end, *(x[:, -1:] for x in start)) if lost else end)
        done += len(members)
    return Ensemble(**_merged(ends, np.concatenate([members for _, members in groups])) | {"system": whole.system})


@check_names
def section(
    problem: AnyProblem,
    method: str | Path | Method | Integrator | Step,
    Q: States,
    P: States,
    *,
    of: str,
    at: float = 0.0,
    rising: bool | None = True,
    every: int = 1,
    h: float | State | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: OrbitParameters | None = None,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Section:
    """Find where the orbits of an ensemble cross a plane: a Poincare section.

    Parameters
    ----------
    problem, method, Q, P : as in `integrate_ensemble`
    of, at : the name of a coordinate or momentum, such as ``"q1"``, or a formula of these, such as ``"q1 - q2"``; and
        its value at a crossing
    rising : True for crossings at which it rises, False for those at which it falls, None for either
    every : test every Nth step for a crossing; two crossings between two tests are missed
    h : number, or array (n,) with a step for each orbit
    t_end, steps : as in `integrate`
    parameters, lanes, threads, progress : as in `integrate_ensemble`; parameters are the method's alone

    Returns
    -------
    Section
        Index of the orbit, t, q and p of each crossing, which take 8 (2 d + 2) bytes of memory.

    Raises
    ------
    InvalidInput
        For unusable input; a failure of one orbit on the way is its status instead.

    Examples
    --------
    >>> section("pendulum", "gauss-4", [[1.0]], [[0.0]], of="q", h=0.1, t_end=20.0).counts().tolist()
    [3]
    """
    chosen = _method(method)
    orbits = sections.begin(
        *(_problem(problem), chosen, Q, P),
        **{"of": of, "at": at, "rising": rising, "every": every},
        **{"h": h, "t_end": t_end, "steps": steps, "parameters": parameters},
    )
    return Section(**fields_of(sections.build_section(orbits, _run(orbits, chosen, lanes, threads, progress)[1])))


def _tell(progress: Callable[[int], None], before: int, number: int) -> None:
    progress(before + number)


def _sort_parameters(problem: AnyProblem, method: str | Method | OwnStep, parameters: Mapping) -> tuple[dict, dict]:
    """Sort parameters into those of the method and those of the problem; a name that both have is the method's."""
    if not parameters:
        return {}, {}
    names = getattr(integrator(method).record, "parameters", {})
    made = _problem(problem)
    known = {**getattr(made, "parameters", {}), **getattr(getattr(made, "system", made), "parameters", {})}
    of_problem = {name: x for name, x in parameters.items() if name in known and name not in names}
    return {name: x for name, x in parameters.items() if name not in of_problem}, of_problem


def _groups(parameters: Mapping[str, Any], n: int) -> list[tuple[dict[str, float], np.ndarray]]:
    """[(the values of parameters, the orbits that have them)]; raises InvalidInput for arrays of another length."""
    columns = [np.broadcast_to(ensemble.column(f"the parameter {k}", x, n), n).tolist() for k, x in parameters.items()]
    members: dict[tuple, list[int]] = {}
    for i, values in enumerate(zip(*columns, strict=True)):
        members.setdefault(values, []).append(i)
    return [(dict(zip(parameters, values, strict=True)), np.array(found)) for values, found in members.items()]


def _changed(problem: AnyProblem, values: Mapping[str, float]) -> Problem | PartitionedSystem:
    """The problem, or its system, with other values of its parameters."""
    if isinstance(problem, (str, Path)):
        return problem_of(problem, **values)
    system = getattr(problem, "system", problem)
    if values.keys() <= system.parameters.keys():
        return system.with_parameters(**values)
    return problem_of(problem.label, **{**problem.parameters, **values})


def _is_driven(problem: Problem | PartitionedSystem) -> bool:
    return getattr(problem, "system", problem).driven


def _with_time(end: ensemble.Ensemble, t: np.ndarray, p_t: np.ndarray) -> ensemble.Ensemble:
    """Orbits of a system whose parameters take the time out of H, with the time and its momentum as others have them.

    t, p_t : arrays (n, 1), at the start
    """
    return replace(
        end,
        **{"q": np.hstack([end.q, t + end.t[:, None]]), "p": np.hstack([end.p, p_t])},
        **{"Q": np.dstack([end.Q, t + end.times]), "P": np.dstack([end.P, p_t + 0 * end.times])},
    )


def _merged(parts: Sequence[ensemble.Ensemble], members: np.ndarray) -> dict[str, Any]:
    """The fields of one ensemble, whose orbits ``members`` are those of the parts in turn."""
    if len(parts) == 1:
        return fields_of(parts[0])
    order, kinds = np.argsort(members), list(dict.fromkeys(m for part in parts for m in part.methods))
    method = [np.array([kinds.index(m) for m in part.methods])[part.method] for part in parts]
    rows = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])[order]
        for f in fields(ensemble.Ensemble)
        if isinstance(getattr(parts[0], f.name), np.ndarray)
    }
    counts = {name: sum(part.counts[name] for part in parts) for name in parts[0].counts}
    more = {"methods": kinds, "method": np.concatenate(method)[order], "counts": counts}
    return rows | more | {"seconds": sum(part.seconds for part in parts)}


def fields_of(found: Any) -> dict[str, Any]:
    """The fields of a dataclass, name -> value."""
    return {f.name: getattr(found, f.name) for f in fields(found)}


def _problem(problem: AnyProblem) -> Problem | PartitionedSystem:
    return problem_of(problem) if isinstance(problem, (str, Path)) else problem


def _method(method: str | Path | Method | Integrator | Step) -> str | Method | OwnStep:
    """The id or record of a method, or a user's step; raises InvalidInput for a peer."""
    if isinstance(method, Method):
        return method
    if isinstance(method, Integrator):
        chosen = method
    else:
        chosen = integrator(method)
    if not isinstance(chosen.record, (Method, OwnStep)):
        raise InvalidInput(f"'{chosen.id}' is a peer, which integrates one orbit at a time: call integrate for each")
    return method if isinstance(method, str) and isinstance(chosen.record, Method) else chosen.record


def _run(
    orbits: Orbits,
    method: str | Method | OwnStep,
    lanes: bool | None,
    threads: int | None,
    progress: Callable[[int], None] | None,
) -> tuple[np.ndarray, float]:
    """Returns (boolean array: which orbits ran in SIMD lanes; seconds)."""
    if not isinstance(method, OwnStep):
        return ensemble.run(orbits, lanes, threads, progress)
    if lanes:
        raise InvalidInput(f"'{method.id}' is a step of your own: it does not run in lanes")
    return ensemble.run_alone(orbits, _own, progress)


def _own(orbits: Orbits, i: int) -> Solution:
    return integrate_step(
        orbits.system,
        orbits.kinds[0],
        **{"h": float(orbits.h[i]), "steps": int(orbits.steps[i]), "save_every": int(orbits.every[i])},
        **{"q0": orbits.q[i], "p0": orbits.p[i]},
    )
