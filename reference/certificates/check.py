"""Whether a stored certificate still holds: computed anew and compared with what is stored."""

from __future__ import annotations

from dataclasses import dataclass

from phasebench.integrators.errors import InvalidInput

from . import make, stored
from .stored import Certificate, End


@dataclass(frozen=True)
class Outcome:
    """A certificate computed anew beside the stored one.

    Attributes
    ----------
    stored : None where there is none
    fresh : computed now
    moved, allowed : the largest distance between a stored and a fresh state in units of what their uncertainties allow,
        as these two numbers
    changed : in words what is not as stored; empty where nothing moved
    """

    stored: Certificate | None
    fresh: Certificate
    moved: float
    allowed: float
    changed: str

    @property
    def disagree(self) -> int:
        """How many comparisons with other solvers are not within the uncertainties."""
        return sum(not e.agrees(c) for e in self.fresh.ends for c in e.checks)

    @property
    def agree(self) -> bool:
        """Whether other solvers agree on every state."""
        return all(e.agree for e in self.fresh.ends)

    @property
    def holds(self) -> bool:
        """Whether besides nothing moved."""
        return self.agree and not self.changed


def moved(old: End, new: End) -> tuple[float, float]:
    """(how far a state has moved, how far it may have: the sum of both uncertainties)."""
    return float(stored.distance(old, new)), old.uncertainty + new.uncertainty


def compare(old: Certificate | None, new: Certificate) -> Outcome:
    """What moved between a stored certificate and a fresh one."""
    unknown = float("nan")
    if old is None:
        return Outcome(None, new, unknown, unknown, "not stored")
    if [e.t for e in old.ends] != [e.t for e in new.ends]:
        return Outcome(old, new, unknown, unknown, "stored at other times")
    pairs = [moved(a, b) for a, b in zip(old.ends, new.ends, strict=True)]
    late = [e.t for e, (far, may) in zip(new.ends, pairs, strict=True) if not far <= may]
    worst = max(pairs, key=lambda pair: pair[0] / pair[1])
    return Outcome(old, new, *worst, f"moved at t = {', '.join(f'{t:g}' for t in late)}" if late else "")


def renew(problem, mend: bool = False) -> Outcome:
    """Compute the certificate of a problem's orbit at the orbit's times and compare it with the stored one.

    Parameters
    ----------
    problem : with an orbit ``start`` that has ``times``
    mend : let a stored file that cannot be trusted, or whose problem has changed, count as none

    Raises
    ------
    InvalidInput
        For an orbit without times, and for such a file where it is not to be mended.
    """
    if not problem.start.times:
        raise InvalidInput(f"the orbit {problem.label} states no times of certified states; add them to its Orbit")
    try:
        old = stored.find(problem)
    except InvalidInput:
        if not mend:
            raise
        old = None
    return compare(old, make.certify(problem, problem.start.times))
