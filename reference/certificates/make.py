r"""Compute certified states: states of an orbit in quadruple precision with a bound of their error.

The digits are those of a Taylor run in quadruple precision (113 bits).  Their error is measured: the same orbit is
integrated with `PRECISION`, which has more bits, another order and other steps, and the uncertainty is

.. math:: U = F\,\max_{s \le t} |z(s) - Z(s)| + G(t)\,\tau ,

where z are the stored digits at the stored times s up to t, Z is the run with more bits, and F is `FACTOR`.  The last
term is the possible error of Z itself: its tolerance tau per step, times the largest growth of rounding along the orbit
over the draws of `horizon`.  It must be below `SHARE` times the measured error, so that U bounds the error.

For comparison the orbit is also integrated in long double, by Gauss's method and by IAS15 (`others`); `horizon`
computes how far it can be followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from phasebench.reference.solvers import taylor

from . import horizon, others, stored
from .along import GRID, Along, Precision, along, upto
from .stored import Certificate, End

if TYPE_CHECKING:
    import numpy as np

#: Precision of the run that measures the digits' error; the digits come from 113 bits and order 41.
PRECISION = Precision(200, "1e-58")
#: Safety factor F, so that the bound also holds for another machine's digits.
FACTOR = 4.0
#: Largest possible error of the run with more bits, in units of the error that it measures.
SHARE = 1e-3


def certify(problem: Any, times: Sequence[float], grid_points: int = GRID) -> Certificate:
    """Compute the certified states of a problem's orbit at ``times``, positive and increasing; the last is the end.

    Raises
    ------
    InvalidInput
        If the times are not positive, finite and increasing.
    ReferenceFailed
        If a run does not reach the end, or has too few bits.
    """
    path = along(problem, times, PRECISION, grid_points)
    times = [float(t) for t in times]
    texts = _digits(problem, times)
    rounding = horizon.rounding(problem, path.grid)
    apart = horizon.neighbour(problem, path.grid, path.near)
    growth, rate = horizon.growth(path.grid, apart, path.size)
    at = [path.grid.index(t) for t in times]
    bounds = uncertainties(texts, times, path, rounding.distances.max(axis=0)[at])
    off = path.distances(path.near)[at]
    said = others.words(problem, times, path, apart)
    ends, d = [], problem.system.d
    for i, t in enumerate(times):
        q, p = texts[i][:d], texts[i][d:]
        ends.append(End(t, q, p, bounds[i], float(off[i]), stored.energy_change(problem, q, p), said[i]))
    return Certificate(
        problem=problem.label,
        orbit=problem.start.name,
        parameters=dict(problem.parameters),
        q0=tuple(map(float, problem.q0)),
        p0=tuple(map(float, problem.p0)),
        fingerprint=stored.fingerprint(problem),
        t_end=times[-1],
        limit=horizon.LIMIT,
        bits=path.precision.bits,
        spacing=times[-1] / grid_points,
        **rounding.span()._asdict(),
        growth=growth,
        rate=rate,
        ends=tuple(ends),
    )


def _digits(problem: Any, times: Sequence[float]) -> list[tuple[str, ...]]:
    """The states of the quadruple-precision run at the times, as decimal strings."""
    _, quad = taylor.extended_types()
    rows = taylor.states(problem.system, quad, problem.q0, problem.p0, times)
    return [tuple(f"{Decimal(str(x)):.{stored.DIGITS - 1}e}" for x in row) for row in rows]


def errors(texts: Sequence[Sequence[str]], times: Sequence[float], path: Along) -> list[float]:
    """The max norms of stored states (as text) minus those of a high-precision run, each the largest so far.

    ``texts`` has the 2 d components of (q, p) for each of the ``times``; ``path`` is the run, whose grid has these
    times.
    """
    return upto([stored.distance(text, map(str, path.row(t))) for text, t in zip(texts, times, strict=True)]).tolist()


def uncertainties(
    texts: Sequence[Sequence[str]], times: Sequence[float], path: Along, grown: Sequence[float] | np.ndarray
) -> list[float]:
    """Bounds of the errors of decimal states, one for each time.

    A bound is `FACTOR` times the measured error, plus the possible error of the high-precision run.  ``texts``,
    ``times`` and ``path`` are as for `errors`; ``grown`` is, for each time, how far a relative rounding by
    `horizon.UNIT` in every step has moved the state.

    Raises
    ------
    ReferenceFailed
        If the error of the high-precision run itself may exceed `SHARE` times the error that it measures.
    """
    bounds = []
    for t, error, unit in zip(times, errors(texts, times, path), grown, strict=True):
        own = float(unit) / horizon.UNIT * float(path.precision.tolerance)
        if not own <= SHARE * error:
            raise taylor.ReferenceFailed(
                f"at t = {t:g} the run of {path.precision.bits} bits may be off by {own:.1e}; the digits' error, "
                f"{error:.1e}, needs more bits"
            )
        bounds.append(FACTOR * error + own)
    return bounds


def versions() -> dict[str, str | None]:
    """Versions of the packages that the digits depend on."""
    from phasebench.reference.installed import version_of

    return {name: version_of(name) for name in ("heyoka", "numpy", "sympy", "mpmath", "rebound")}
