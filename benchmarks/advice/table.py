"""`phasebench.advise`: the answer as a table."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

from phasebench.benchmarks.measure.global_error import started
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.benchmarks.problems.kepler_found import with_kepler_part
from phasebench.integrators.request import initial

from . import words
from .advise import advise as answered
from .ask import ask

#: What a row may be, in this order.
ROLES = ("choice", "own", "peer", "runner_up", "next")


def advise(
    problem,
    *,
    t_end: float | str,
    accuracy: float | None = None,
    quantity: str = "end-state",
    conserve: Sequence[str] | str = (),
    budget: float | None = None,
    q0=None,
    p0=None,
    limit: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
):
    """Which integrator, at which step, holds an accuracy at the least cost; each that is named was run.

    Parameters
    ----------
    problem : a system with q0 and p0; a problem; a registered name such as ``"henon-heiles:box"``; or a file's path
    t_end : the end of the span; where the problem has a unit of time it may have one, ``"1e4 yr"``
    accuracy : the largest error of the quantity that is allowed
    quantity : ``"end-state"``, ``"trajectory"`` (max norms over (q, p)), ``"energy"`` (relative), or a name of the
        problem's own
    conserve : what has to be kept: any of ``"energy"``, ``"symplectic"``, ``"reversible"``, ``"momentum"``, or an
        invariant of the problem
    budget : instead of an accuracy, the seconds that a run may take: the most accurate is advised
    q0, p0 : arrays (d,), the initial state where not the problem's
    limit : seconds that the search may take; at first a few for a problem of which rows are stored, 50 for another
    progress : called with a line for each thing that is tried

    Returns
    -------
    pandas.DataFrame
        A row for each of the choice, the cheapest of this project, of the others, the runner-up, and what the next ten
        times in accuracy costs (column ``role``): integrator, params, h and steps or tol, model, command, error,
        uncertainty, seconds.  Empty where nothing is advised.  ``attrs`` hold the rest of the answer: ``verified``,
        ``why``, ``lower_model`` (of a scene with a ladder of models), ``alternatives``, ``dropped``, ``reference``,
        ``failed`` (integrators that do not compile, and why: a warning names them).

    Raises
    ------
    InvalidInput
        For what cannot be asked.

    Examples
    --------
    >>> table = advise("pendulum", t_end=10.0, accuracy=1e-3)  # doctest: +SKIP
    >>> table.attrs["verified"]  # doctest: +SKIP
    True
    """
    import pandas as pd

    name = _name(problem)
    made = _made(problem, q0, p0)
    line = None if name is None else _with_state(words.named(made[0], name), q0, p0)
    asked = ask(
        made[1],
        t_end=t_end,
        accuracy=accuracy,
        quantity_name=quantity,
        conserve=conserve,
        budget=budget,
        limit=limit,
        progress=progress,
    )
    answer = answered(asked, line or ())
    if answer["warning"]:
        warnings.warn(answer["warning"], stacklevel=2)
    rows = [{"role": role} | answer[role] for role in ROLES if answer[role] is not None]
    table = pd.DataFrame(rows)
    table.attrs = {key: value for key, value in answer.items() if key not in ROLES}
    return table


def _name(problem) -> str | None:
    """How a problem is named on a command line; None where it is no name that was given."""
    return str(problem) if isinstance(problem, (str, Path)) else None


def _made(problem, q0, p0):
    """(the problem as it was named, the problem from its initial state)."""
    if isinstance(problem, (str, Path)):
        problem = problem_of(problem)
    if not isinstance(problem, Problem):
        system, q, p = initial(problem, q0, p0)
        system = with_kepler_part(system, q)
        problem = Problem("system", "a system", "", system, (Orbit("given", tuple(q), tuple(p)),))
        return problem, problem
    return problem, started(problem, q0, p0)


def _with_state(line: list[str], q0, p0) -> list[str]:
    """The words with the initial state that was given."""
    for option, value in (("--q", q0), ("--p", p0)):
        line = line if value is None else [*line, option, words.joined(value)]
    return line


__all__ = ["advise"]
