"""Ensembles and sections of problems by their name, with methods of this project or a step of one's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators import ensemble
from phasebench.integrators import section as sections
from phasebench.integrators.ensemble import Ensemble
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.lots import Orbits
from phasebench.integrators.record import Method
from phasebench.integrators.section import Section

from .integrator import Integrator, integrator
from .own_step import OwnStep, integrate_step


def integrate_ensemble(
    problem,
    method: str | Path | Method | Callable,
    Q,
    P,
    *,
    h=None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: Mapping | None = None,
    save_every: int = 0,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Ensemble:
    """Integrate many orbits of a problem, each with a status of its own.

    Parameters
    ----------
    problem : a system, a problem, a registered name such as ``"henon-heiles"``, or the path of a file with one
    method : an id or a method; or a function ``step(system, q, p, h) -> (q, p)`` or the path of a file with one, which
        is called from Python for every step of every orbit, one after the other, and is slow
    Q, P : arrays (n, d), the initial states; one that is not finite is "invalid", and the others go on
    h : number, or array (n,) with a step for each orbit
    t_end, steps : as of `integrate`; with steps of several lengths, ``t_end`` keeps no rows but the first and the last
    parameters : values of the method's parameters: numbers, or arrays (n,) with a value for each orbit
    save_every : keep every Nth state, and the last; 0 keeps the first and the last
    lanes : whether orbits go into SIMD lanes; where that is left open, if they can and there are enough of them
    threads : how many at once; all cores that this process may use
    progress : called with the number of orbits that are at their end

    Returns
    -------
    Ensemble

    Raises
    ------
    InvalidInput
        For input that cannot be used, and for a step that raises or returns no state; what happens to an orbit on the
        way is its status.

    Examples
    --------
    >>> integrate_ensemble("pendulum", "scheme-i", [[1.0], [2.0]], [[0.0], [0.0]], h=0.1, steps=10).status.tolist()
    ['ok', 'ok']
    """
    problem, method = _problem(problem), _method(method)
    orbits = ensemble.begin(problem, method, Q, P, h, t_end, steps, parameters, save_every)
    return ensemble.conclude(orbits, *_run(orbits, method, lanes, threads, progress))


def section(
    problem,
    method: str | Path | Method | Callable,
    Q,
    P,
    *,
    of: str,
    at: float = 0.0,
    rising: bool = True,
    every: int = 1,
    h=None,
    t_end: float | None = None,
    steps: int | None = None,
    parameters: Mapping | None = None,
    lanes: bool | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Section:
    """Find where the orbits of an ensemble cross a plane: a Poincare section.

    Parameters
    ----------
    problem, method, Q, P : as of `integrate_ensemble`
    of, at : the coordinate or momentum by its name, such as ``"q1"``, and its value on the plane
    rising : whether crossings with a rising coordinate count, else those with a falling one
    every : look at every Nth step; two crossings between two looks are missed
    h : number, or array (n,) with a step for each orbit
    t_end, steps : as of `integrate`
    parameters, lanes, threads, progress : as of `integrate_ensemble`

    Returns
    -------
    Section
        Of each crossing its orbit, t, q and p: 8 (2 d + 2) bytes.

    Raises
    ------
    InvalidInput
        For input that cannot be used; what happens to an orbit on the way is its status.

    Examples
    --------
    >>> section("pendulum", "gauss-4", [[1.0]], [[0.0]], of="q", h=0.1, t_end=20.0).counts().tolist()
    [3]
    """
    problem, method = _problem(problem), _method(method)
    orbits = sections.begin(
        *(problem, method, Q, P),
        **{"of": of, "at": at, "rising": rising, "every": every},
        **{"h": h, "t_end": t_end, "steps": steps, "parameters": parameters},
    )
    return sections.concluded(orbits, _run(orbits, method, lanes, threads, progress)[1])


def _problem(problem):
    return problem_of(problem) if isinstance(problem, (str, Path)) else problem


def _method(method) -> str | Method | OwnStep:
    """What integrates the orbits: the id of a method, a method, or a step of the user's own."""
    if isinstance(method, Method):
        return method
    if isinstance(method, Integrator):
        chosen = method
    else:
        chosen = integrator(method)
    if not isinstance(chosen.record, (Method, OwnStep)):
        raise InvalidInput(f"'{chosen.id}' is a peer, which integrates one orbit at a time: call integrate for each")
    return method if isinstance(method, str) and isinstance(chosen.record, Method) else chosen.record


def _run(orbits: Orbits, method, lanes, threads, progress):
    """Which orbits went in lanes, and the seconds."""
    if not isinstance(method, OwnStep):
        return ensemble.run(orbits, lanes, threads, progress)
    if lanes:
        raise InvalidInput(f"'{method.id}' is a step of your own: it does not run in lanes")
    return ensemble.run_alone(orbits, _own, progress)


def _own(orbits: Orbits, i: int):
    return integrate_step(
        orbits.system,
        orbits.kinds[0],
        **{"h": float(orbits.h[i]), "steps": int(orbits.steps[i]), "save_every": int(orbits.every[i])},
        **{"q0": orbits.q[i], "p0": orbits.p[i]},
    )
