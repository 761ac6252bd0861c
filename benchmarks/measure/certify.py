"""`phasebench.certify`: measures stored reference states again, or certifies the state of an orbit at a chosen time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from phasebench.benchmarks.problems import labels
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.keywords import check_names

from .tabular import TabularResult

if TYPE_CHECKING:
    import pandas as pd

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.reference.certificates.check import Outcome
    from phasebench.reference.certificates.stored import Certificate

#: Columns that are printed.
PRINTED = ("problem", "t_end", "error", "uncertainty", "horizon", "second solver", "distance", "changed")


@dataclass(frozen=True, repr=False)
class References(TabularResult):
    """The result of measuring stored reference states again.

    Attributes
    ----------
    rows : a dict for each orbit: the measured error, the stated uncertainty and horizon (the time up to which rounding
        to long double stays small), the distances of other solvers, the statements that do not hold
    holds, wrong : whether every statement holds and every solver agrees; labels of the orbits for which not
    """

    rows: tuple[dict[str, Any], ...]
    holds: bool
    wrong: tuple[str, ...]

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame, a row for each orbit: error, uncertainty, horizon, distances of other solvers."""
        import pandas as pd

        return pd.DataFrame(list(self.rows))

    def _heading(self) -> list[str]:
        return [f"{len(self.rows)} references measured again; wrong: {', '.join(self.wrong) or 'none'}"]

    def _printed(self) -> pd.DataFrame:
        return self.to_frame()[list(PRINTED)]


@dataclass(frozen=True, repr=False)
class CertifiedState(TabularResult):
    """A state of an orbit to 34 digits, with its uncertainty and its comparisons with other solvers.

    Attributes
    ----------
    problem, t : label of the problem with its orbit, and the time
    q, p : arrays (d,), rounded to double
    q_text, p_text : d decimal strings each
    uncertainty : bound of the digits' error, max norm
    horizon : the time up to which rounding to long double stays small
    agree : whether the other solvers agree
    checks : a dict for each other solver: solver (its name), distance (from this state), uncertainty (its own)
    """

    problem: str
    t: float
    q: NDArray[np.float64] = field(compare=False)
    p: NDArray[np.float64] = field(compare=False)
    q_text: tuple[str, ...]
    p_text: tuple[str, ...]
    uncertainty: float
    horizon: float
    agree: bool
    checks: tuple[dict[str, Any], ...]

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame, a row for each component of q and p: its name and its digits as text."""
        import pandas as pd

        names = [f"{x}{i}" for x, texts in (("q", self.q_text), ("p", self.p_text)) for i in range(1, len(texts) + 1)]
        return pd.DataFrame({"component": names, "digits": [*self.q_text, *self.p_text]})

    def _heading(self) -> list[str]:
        agree = "agree" if self.agree else "DISAGREE"
        line = f"{self.problem} at t = {self.t!r}, uncertainty {self.uncertainty:.2g}, horizon {self.horizon:.6g}"
        return [f"{line}; {', '.join(c['solver'] for c in self.checks)} {agree}"]


@overload
def certify(
    problem: str | Sequence[str] = ...,
    *,
    t_end: None = None,
    time_limit: float = ...,
    progress: Callable[[str], None] = ...,
) -> References: ...
@overload
def certify(
    problem: str, *, t_end: float, time_limit: float = ..., progress: Callable[[str], None] = ...
) -> CertifiedState: ...
@check_names
def certify(
    problem: str | Sequence[str] = (),
    *,
    t_end: float | None = None,
    time_limit: float = 300.0,
    progress: Callable[[str], None] = lambda line: None,
) -> References | CertifiedState:
    """Measure stored reference states again, or certify the state of one problem at one chosen time.

    Parameters
    ----------
    problem : names such as ``"henon-heiles:box"``; all problems by default
    t_end : time of a state to be computed and certified now, for exactly one problem; None for the stored states
    time_limit : seconds that the state at ``t_end`` may take
    progress : function that is called with a line of text about what is done

    Returns
    -------
    References, or with ``t_end`` a CertifiedState

    Raises
    ------
    InvalidInput
        For an unknown problem, or a state that cannot be certified within the time limit.
    """
    names = [problem] if isinstance(problem, str) else list(problem)
    if t_end is not None:
        if len(names) != 1:
            raise InvalidInput("t_end certifies one problem: name one, as id or id:orbit")
        made = problem_of(names[0])
        new = certify_end(made, float(t_end), time_limit, progress)
        (end,) = new.ends
        checks = tuple({"solver": c.solver, "distance": c.distance, "uncertainty": c.uncertainty} for c in end.checks)
        return CertifiedState(
            *(made.label, end.t, end.q, end.p, end.q_text, end.p_text),
            *(end.uncertainty, new.horizon, end.agree, checks),
        )
    outcomes = recheck(labels(names), progress)
    wrong = tuple(o.certificate.problem for o in outcomes if not o.holds)
    return References(tuple(o.row() for o in outcomes), not wrong, wrong)


def recheck(names: Sequence[str], progress: Callable[[str], None], update: bool = False) -> list[Outcome]:
    """Verify the stored reference states of the orbits with these labels: an `Outcome` for each.

    With ``update`` the states are computed anew instead, and stored as soon as all statements on them hold.
    ``progress`` is called with each label.
    """
    from phasebench.reference.certificates import check, make, stored

    outcomes = []
    for name in names:
        progress(name)
        made = problem_of(name)
        outcomes.append(check.renew(made) if update else check.recheck(made))
        if update and outcomes[-1].holds:
            stored.keep(outcomes[-1].certificate, labels([made.id]), make.versions())
    return outcomes


def certify_end(made: Problem, t_end: float, time_limit: float, progress: Callable[[str], None]) -> Certificate:
    """Certify the state at ``t_end`` within ``time_limit`` seconds; raise InvalidInput if that cannot be done."""
    from phasebench.reference.certificates import make
    from phasebench.reference.solvers import watch
    from phasebench.reference.solvers.taylor import ReferenceFailed

    if not time_limit > 0:
        raise InvalidInput(f"the time limit is {time_limit}; it must be a positive number of seconds")
    if not 0 < t_end < float("inf"):
        raise InvalidInput(f"the end time is {t_end}; it must be a positive number")
    try:
        with watch.watching(time_limit, progress):
            return make.certify(made, [t_end])
    except watch.TooLong as late:
        limit = f"the time limit of {time_limit:g} s"
        raise InvalidInput(f"{made.label} cannot be certified to {t_end:g} in {limit}: {late}") from None
    except ReferenceFailed as error:
        raise InvalidInput(f"{made.label} cannot be certified to {t_end!r}: {error}") from None
