"""Verify a certificate (stored states of an orbit, a bound of their error, a horizon) by independent measurements.

- The digits: the orbit is integrated with `AGAIN`, whose number of bits and tolerance (hence order and steps) differ
  from those of the run of the digits and of the run that measured their error.  A stated uncertainty is wrong if it is
  below the error, or above `LOOSE` times it.
- The horizon, the time up to which rounding stays below a limit: rounding is simulated with another displacement and
  tolerance; the stated horizon must lie in the `horizon.Rounding.band` of the result.
- The equations: Gauss's method, which shares no code with the Taylor runs, and IAS15 integrate the orbit too.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from phasebench.integrators.errors import InvalidInput

from . import horizon, make, others, stored
from .along import GRID, Precision, along
from .horizon import Rounding, Span
from .stored import Certificate, End

#: Bits and tolerance of the second high-precision run; the tolerance is far below errors in quadruple precision.
AGAIN = Precision(256, "1e-50")
#: An uncertainty above this multiple of the error is useless.
LOOSE = 1e4


@dataclass(frozen=True)
class Outcome:
    """The result of verifying a certificate, the stored states of an orbit with bounds of their errors.

    Attributes
    ----------
    certificate : as stored, with the new comparisons with other solvers
    errors : the measured errors of the stored states, each the largest up to its time
    span : the horizon, up to which the orbit can be followed in long double, and its interval, measured again
    leaves : the last grid time before a run in long double on this machine is off by more than the limit
    long_double : the largest distance of that run from the orbit, up to the last time
    growth, rate : how neighbouring orbits separate, as in `Certificate`, measured again
    wrong : a sentence for each statement of the certificate that does not hold
    moved : what differs from the previously stored certificate, in words; "" if nothing does
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
        """The stated uncertainties divided by the measured errors; infinite where no error was seen."""
        pairs = zip(self.certificate.ends, self.errors, strict=True)
        return tuple(end.uncertainty / error if error else inf for end, error in pairs)

    @property
    def disagree(self) -> int:
        """The number of comparisons with other solvers that differ by more than the uncertainties."""
        return sum(e.compares(c) and not e.agrees(c) for e in self.certificate.ends for c in e.checks)

    @property
    def holds(self) -> bool:
        """True if no statement is wrong and another solver agrees with every state."""
        return not self.wrong and all(e.agree for e in self.certificate.ends)

    def row(self) -> dict[str, object]:
        """The table row on the orbit, for `phasebench.certify` and for the report."""
        known, ratios = self.certificate, self.ratios
        last = known.ends[-1]
        first = last.checks[0]
        checks = [(e, c) for e in known.ends for c in e.checks]
        return {
            "problem": known.problem,
            "t_end": known.t_end,
            "states": len(known.ends),
            "limit": known.limit,
            "error": self.errors[-1],
            "uncertainty": last.uncertainty,
            "least bound": min(ratios),
            "largest bound": max(ratios),
            "long double": self.long_double,
            "horizon": known.horizon,
            "earliest": known.earliest,
            "latest": known.latest,
            "long double leaves": self.leaves,
            "digits hold to the end": known.digits_horizon == known.t_end,
            "growth": self.growth,
            "rate": self.rate,
            "energy": max(abs(e.energy) for e in known.ends),
            "second solver": first.solver,
            "distance": first.distance,
            "its uncertainty": first.uncertainty,
            "other solvers": ", ".join(last.format(c) for c in last.checks[1:]),
            "disagree": self.disagree,
            "pairs": sum(e.compares(c) for e, c in checks),
            "no comparison": sum(not e.compares(c) for e, c in checks),
            "unchecked": sum(not any(e.compares(c) for c in e.checks) for e in known.ends),
            "changed": "; ".join(self.wrong),
        }


def examine(problem: Any, certificate: Certificate, grid_points: int = GRID) -> Outcome:
    """Measure again what a certificate states of a problem's orbit, and return the comparison.

    ``grid_points`` is the number of times at which distances between orbits are measured.  Raises the errors of
    `along.along`.
    """
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


def _times(problem: Any, times: list[float]) -> list[str]:
    wanted = list(problem.start.times)
    return [] if wanted == times else [f"it is stored at t = {times}, the orbit's times are {wanted}"]


def _bounds(ends: tuple[End, ...], errors: Iterable[float]) -> list[str]:
    """A sentence for each stated uncertainty that is below the measured error, or above `LOOSE` times it."""
    wrong = []
    for end, error in zip(ends, errors, strict=True):
        if not error <= end.uncertainty <= LOOSE * error:
            wrong.append(f"at t = {end.t:g} the digits are off by {error:.2g}, and {end.uncertainty:.2g} is stated")
    return wrong


def _spans(certificate: Certificate, rounding: Rounding) -> list[str]:
    """A sentence for each of a certificate's limit, horizon and interval that is outside of the band measured."""
    low, high = rounding.band
    stated = Span(certificate.horizon, certificate.earliest, certificate.latest)
    same = certificate.limit == horizon.LIMIT
    wrong = [] if same else [f"the limit is stated as {certificate.limit:g} and is {horizon.LIMIT:g}"]
    for name, a, t, b in zip(Span._fields, low, stated, high, strict=True):
        if not a <= t <= b:
            wrong.append(f"{name} is stated as {t:g} and measured between {a:g} and {b:g}")
    return wrong


def recheck(problem: Any) -> Outcome:
    """Verify the stored certificate of a problem's orbit: states, bounds of their errors and horizon.

    Raises
    ------
    InvalidInput
        If none is stored, or if its file or the problem has changed.
    """
    certificate = stored.find(problem)
    if certificate is None:
        raise InvalidInput(f"no reference of {problem.label} is stored; phasebench certify {problem.label} --update")
    return examine(problem, certificate)


def renew(problem: Any) -> Outcome:
    """Compute the certificate of a problem's orbit (states with bounds of their errors) anew, and verify it.

    The states are those at the times that the orbit declares.

    Raises
    ------
    InvalidInput
        For an orbit that declares no times.
    """
    if not problem.start.times:
        raise InvalidInput(f"the orbit {problem.label} states no times of certified states; add them to its Orbit")
    try:
        old = stored.find(problem)
    except InvalidInput:
        old = None
    new = make.certify(problem, problem.start.times)
    return replace(examine(problem, new), moved=describe_change(old, new))


def describe_change(old: Certificate | None, new: Certificate) -> str:
    """How a new certificate's states differ from the old one's, in words; "" if they agree.

    The text has the times and, for each, the max norm of the difference; it is "new" if there is no old certificate.
    """
    if old is None:
        return "new"
    before = {e.t: e for e in old.ends}
    if list(before) != [e.t for e in new.ends]:
        return "at other times"
    far = {e.t: stored.distance(before[e.t].texts, e.texts) for e in new.ends}
    return ", ".join(f"t = {t:g} by {d:.2g}" for t, d in far.items() if d)
