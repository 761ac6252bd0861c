"""`phasebench.advise`: the cheapest integration that meets an accuracy, as an `Advice`."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.benchmarks.measure.global_error import with_start
from phasebench.benchmarks.measure.integrator import AnyProblem
from phasebench.benchmarks.measure.tabular import TabularResult
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.kepler_found import with_kepler_part
from phasebench.integrators.keywords import State, check_names, rename_arguments

from . import words
from .advise import advise as answered
from .ask import ask

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: The roles that rows have, in this order.
ROLES = ("choice", "own", "peer", "runner_up", "next")


#: Columns that are printed.
PRINTED = ("role", "integrator", "params", "h", "steps", "tol", "error", "seconds")


@dataclass(frozen=True)
class Advised:
    """An integration that was run: the integrator, its step or tolerance, its error and its time.

    Attributes
    ----------
    integrator, params : the id of a method or a peer, and the values of its parameters
    h, steps, tol : the step and the number of steps, or the tolerance; else None
    command : the command line of the integration
    error, uncertainty : the error of the quantity, and the uncertainty of the reference value
    seconds, interval : the median of warm runs, and its interval where it was timed in turns with others
    remark : such as "exact for this problem: any step"
    end_state_error : distance from heyoka's end state, where a conserved quantity was asked for
    tie : whether its time cannot be told apart from that of ``Advice.choice``
    """

    integrator: str
    params: Mapping[str, str]
    command: str
    error: float
    uncertainty: float
    seconds: float
    h: float | None = None
    steps: int | None = None
    tol: float | None = None
    model: str = "full"
    interval: tuple[float, float] | None = None
    remark: str = ""
    end_state_error: float | None = None
    tie: bool | None = None


@dataclass(frozen=True, repr=False)
class Advice(TabularResult):
    """The answer to a question of advice: the recommended integration and its alternatives.

    Attributes
    ----------
    problem, t_end, quantity, accuracy, budget : the question
    choice, runner_up : the recommended integration and the second best, or None
    own, peer : the best one of this project's methods, and of the peers, or None
    next : the cheapest integration that meets a tenth of the accuracy, or None
    verified : whether the choice met the accuracy when it was run again, and the reference was confirmed
    why : why nothing is advised, else ""
    alternatives, dropped : others that meet the accuracy, and those that fell out, with the reason
    lower_model : a simpler model that meets the accuracy, or None
    notes : sentences on what could invalidate the advice
    incomplete : whether a time limit ended it before all that could have changed the answer was tried
    answer : all of it, as the command prints it with --json
    """

    problem: str
    t_end: float
    quantity: str
    accuracy: float | None
    budget: float | None
    choice: Advised | None
    own: Advised | None
    peer: Advised | None
    runner_up: Advised | None
    next: Advised | None
    verified: bool
    why: str
    alternatives: tuple[Advised, ...]
    dropped: tuple[dict[str, Any], ...]
    lower_model: dict[str, Any] | None
    notes: tuple[str, ...]
    incomplete: bool
    answer: dict[str, Any] = field(compare=False)

    def to_frame(self) -> pd.DataFrame:
        """A row for each role: the choice, own, peer, runner_up, next; ``attrs`` holds the rest of the answer."""
        import pandas as pd

        rows = [{"role": role} | self.answer[role] for role in ROLES if self.answer[role] is not None]
        frame = pd.DataFrame(rows)
        frame.attrs = {key: value for key, value in self.answer.items() if key not in ROLES}
        return frame

    def plot(self) -> Figure:
        """A work-precision diagram: error against seconds of all integrations that met the accuracy."""
        from .figures import advice

        return advice(self)

    def _heading(self) -> list[str]:
        asked = f"error of at most {self.accuracy:g}" if self.accuracy is not None else f"within {self.budget:g} s"
        lines = [f"{self.problem}, {self.quantity} to t = {self.t_end:g}, {asked}"]
        lines += [f"nothing is advised: {self.why}"] if self.choice is None else []
        lines += [] if self.verified or self.choice is None else ["not verified: the reference was not confirmed"]
        return [*lines, *self.notes]

    def _printed(self) -> pd.DataFrame:
        frame = self.to_frame()
        if frame.empty:
            return frame
        shown = frame[[column for column in PRINTED if column in frame]].astype(object)
        shown["params"] = [", ".join(f"{k}={v}" for k, v in x.items()) for x in frame["params"]]
        for column, digits in (("h", 6), ("steps", 12), ("tol", 2), ("error", 2), ("seconds", 3)):
            if column in shown:
                shown[column] = [f"{x:.{digits}g}" if x == x and x is not None else "" for x in shown[column]]
        return shown.fillna("")


def _advised(row: dict[str, Any] | None) -> Advised | None:
    if row is None:
        return None
    names = {f.name for f in fields(Advised)}
    return Advised(**{name: value for name, value in row.items() if name in names})


@rename_arguments(limit="time_limit")
@check_names
def advise(
    problem: AnyProblem,
    *,
    t_end: float | str,
    accuracy: float | None = None,
    quantity: str = "end-state",
    conserve: Sequence[str] | str = (),
    budget: float | None = None,
    q0: State | None = None,
    p0: State | None = None,
    time_limit: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Advice:
    """Recommend the integrator and step that meet an accuracy at the least cost, confirmed by running them.

    Parameters
    ----------
    problem : a system with q0 and p0; a problem; a registered name such as ``"henon-heiles:box"``; or a file's path
    t_end : the end of the span; where the problem has a unit of time it may have one, ``"1e4 yr"``; a negative one goes
        back in time
    accuracy : the largest error of the quantity that is allowed
    quantity : ``"end-state"``, ``"trajectory"`` (max norms over (q, p)), ``"energy"`` (relative), or a name of the
        problem's own
    conserve : what must be conserved: any of ``"energy"``, ``"symplectic"``, ``"reversible"``, ``"momentum"``, or an
        invariant of the problem
    budget : instead of an accuracy, the seconds that a run may take: the most accurate integration is advised
    q0, p0 : arrays (d,), the initial state if not the problem's own
    time_limit : seconds of the clock that the answer may take; by default the search may take 3 of the processor for a
        problem with stored measurements, 50 for another
    progress : called with a line of text for each integrator that is tried

    Returns
    -------
    Advice
        Prints as a table with a row for each role; ``choice``, ``own``, ``peer``, ``runner_up`` and ``next`` have named
        fields, `to_frame` a row for each, `plot` draws a work-precision diagram.  A warning names integrators that do
        not compile

    Raises
    ------
    InvalidInput
        For an argument that cannot be used.

    Examples
    --------
    >>> advice = advise("pendulum", t_end=10.0, accuracy=1e-3)  # doctest: +SKIP
    >>> advice.verified  # doctest: +SKIP
    True
    """
    since = time.perf_counter()
    name = _name(problem)
    made = _made(problem, q0, p0)
    line = None if name is None else _with_state(words.problem_arguments(made[0], name), q0, p0)
    asked = ask(
        made[1],
        t_end=t_end,
        accuracy=accuracy,
        quantity_name=quantity,
        conserve=conserve,
        budget=budget,
        limit=time_limit,
        progress=progress,
        since=since,
    )
    answer = answered(asked, line or ())
    if answer["warning"]:
        warnings.warn(answer["warning"], stacklevel=2)
    return Advice(
        **{name: answer[name] for name in ("problem", "t_end", "quantity", "accuracy", "budget", "verified", "why")},
        **{role: _advised(answer[role]) for role in ROLES},
        alternatives=tuple(a for a in map(_advised, answer["alternatives"]) if a is not None),
        dropped=tuple(answer["dropped"]),
        lower_model=answer["lower_model"],
        notes=tuple(answer["notes"]),
        incomplete=answer["incomplete"],
        answer=answer,
    )


def _name(problem: Any) -> str | None:
    return str(problem) if isinstance(problem, (str, Path)) else None


def _made(problem: Any, q0: State | None, p0: State | None) -> tuple[Problem, Problem]:
    """(The problem as given, the same problem with the initial state q0, p0); a system is made a `Problem` with it."""
    if isinstance(problem, (str, Path)):
        problem = problem_of(problem)
    if not isinstance(problem, Problem):
        made = with_start(problem, q0, p0)
        made = replace(made, system=with_kepler_part(made.system, made.q0))
        return made, made
    return problem, with_start(problem, q0, p0)


def _with_state(line: list[str], q0: State | None, p0: State | None) -> list[str]:
    for option, value in (("--q", q0), ("--p", p0)):
        line = line if value is None else [*line, option, words.format_numbers(value)]
    return line


__all__ = ["advise"]
