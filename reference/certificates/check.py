"""Whether a certificate holds: everything that it states is measured again by other means, so that it can fail.

- The digits: the orbit is followed in `AGAIN`, of other bits, another order and other steps than those that the digits
  and their uncertainty were made with.  A stated uncertainty is wrong below the error, and above `LOOSE` times it.
- The horizon: rounding is drawn again at another displacement and tolerance; it has to fall in `horizon.Rounding.band`.
- The equations: Gauss's method, which shares no code with the Taylor runs, and IAS15 follow the orbit again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from phasebench.integrators.errors import InvalidInput

from . import horizon, make, others, stored
from .along import GRID, Precision, along
from .horizon import Rounding, Span
from .stored import Certificate, End

#: Bits and tolerance of the second run of many bits; the tolerance is far below an error of quadruple precision.
AGAIN = Precision(256, "1e-50")
#: A bound above so many times the error says nothing.
LOOSE = 1e4


@dataclass(frozen=True)
class Outcome:
    """A certificate with what was measured of it again.

    Attributes
    ----------
    certificate : as it is stored, with what other solvers said now
    errors : of its states, each the largest up to its time
    span : the horizon measured again
    leaves : when a run in long double on this machine left the limit
    long_double : how far that run ended from the orbit
    growth, rate : as the certificate's, now
    wrong : in words what does not hold, a statement each; empty where everything does
    moved : in words what differs from the certificate that was stored before; empty where nothing does
    """

    certificate: Certificate
    errors: tuple[float, ...]
    span: Span
    leaves: float
    long_double: float
    growth: float
    rate: float | None
    wrong: tuple[str, ...]
    moved: str = ""

    @property
    def ratios(self) -> tuple[float, ...]:
        """The stated uncertainties in units of the errors."""
        pairs = zip(self.certificate.ends, self.errors, strict=True)
        return tuple(end.uncertainty / error for end, error in pairs)

    @property
    def disagree(self) -> int:
        """How many comparisons with other solvers are beyond the uncertainties."""
        return sum(e.compares(c) and not e.agrees(c) for e in self.certificate.ends for c in e.checks)

    @property
    def holds(self) -> bool:
        """Whether everything does, and another solver agrees on every state."""
        return not self.wrong and all(e.agree for e in self.certificate.ends)


def examine(problem, certificate: Certificate, grid_points: int = GRID) -> Outcome:
    """Measure again what a certificate of a problem's orbit states; raises as `along.along`."""
    times = [e.t for e in certificate.ends]
    path = along(problem, times, AGAIN, grid_points)
    errors = make.errors([e.texts for e in certificate.ends], times, path)
    rounding = horizon.rounding(problem, path.grid, horizon.OTHER)
    apart = horizon.neighbour(problem, path.grid, path.near)
    growth, rate = horizon.growth(path.grid, apart, path.size)
    off = path.distances(path.near)
    said = others.words(problem, times, path, apart)
    ends = tuple(replace(e, checks=c) for e, c in zip(certificate.ends, said, strict=True))
    return Outcome(
        certificate=replace(certificate, ends=ends),
        errors=tuple(errors),
        span=rounding.span(),
        leaves=horizon.within(path.grid, off, path.size),
        long_double=float(off[-1]),
        growth=growth,
        rate=rate,
        wrong=(*_times(problem, times), *_bounds(certificate.ends, errors), *_spans(certificate, rounding)),
    )


def _times(problem, times) -> list[str]:
    wanted = list(problem.start.times)
    return [] if wanted == times else [f"it is stored at t = {times}, the orbit's times are {wanted}"]


def _bounds(ends: tuple[End, ...], errors) -> list[str]:
    """Which stated uncertainties are no bounds, or say nothing."""
    wrong = []
    for end, error in zip(ends, errors, strict=True):
        if not error <= end.uncertainty <= LOOSE * error:
            wrong.append(f"at t = {end.t:g} the digits are off by {error:.2g}, and {end.uncertainty:.2g} is stated")
    return wrong


def _spans(certificate: Certificate, rounding: Rounding) -> list[str]:
    """Which of the horizon and the ends of its interval are not those of the problem."""
    low, high = rounding.band
    stated = Span(certificate.horizon, certificate.earliest, certificate.latest)
    same = certificate.limit == horizon.LIMIT
    wrong = [] if same else [f"the limit is stated as {certificate.limit:g} and is {horizon.LIMIT:g}"]
    for name, a, t, b in zip(Span._fields, low, stated, high, strict=True):
        if not a <= t <= b:
            wrong.append(f"{name} is stated as {t:g} and measured between {a:g} and {b:g}")
    return wrong


def recheck(problem) -> Outcome:
    """Measure again what the stored certificate of a problem's orbit states.

    Raises
    ------
    InvalidInput
        For an orbit that none is stored of, or whose file or problem has changed.
    """
    certificate = stored.find(problem)
    if certificate is None:
        raise InvalidInput(f"no reference of {problem.label} is stored; phasebench certify {problem.label} --update")
    return examine(problem, certificate)


def renew(problem) -> Outcome:
    """Compute the certificate of a problem's orbit at the orbit's times anew, and measure it by other means.

    Raises
    ------
    InvalidInput
        For an orbit without times.
    """
    if not problem.start.times:
        raise InvalidInput(f"the orbit {problem.label} states no times of certified states; add them to its Orbit")
    try:
        old = stored.find(problem)
    except InvalidInput:
        old = None
    new = make.certify(problem, problem.start.times)
    return replace(examine(problem, new), moved=moved(old, new))


def moved(old: Certificate | None, new: Certificate) -> str:
    """In words which digits are not as they were stored, and by how much; empty where all are."""
    if old is None:
        return "new"
    before = {e.t: e for e in old.ends}
    if list(before) != [e.t for e in new.ends]:
        return "at other times"
    far = {e.t: stored.apart(before[e.t].texts, e.texts) for e in new.ends}
    return ", ".join(f"t = {t:g} by {d:.2g}" for t, d in far.items() if d)
