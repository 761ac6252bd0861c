r"""How a certified end state is computed.

The digits are those of a Taylor run in quadruple precision (113 bits).  Their error is measured: the same orbit is
followed in `PRECISION`, of other bits, another order and other steps, and the uncertainty is

.. math:: U = F\,\max_{s \le t} |z(s) - Z(s)| + G(t)\,\tau ,

where z are the stored digits at the stored times s up to t, Z the run of many bits, F is `FACTOR`, and the last term is
what Z itself may be off: its tolerance tau in each step, grown as rounding grows along the orbit, the largest over the
draws of `horizon`.  It has to be below a `SHARE` of the first, so that U bounds the error.

Beside it run long double, Gauss's method and IAS15 (`others`); how far the orbit can be followed says `horizon`.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

from phasebench.reference.solvers import taylor

from . import horizon, others, stored
from .along import GRID, Along, Precision, along, upto
from .stored import Certificate, End

#: What the digits are measured against; their own precision has 113 bits and order 41.
PRECISION = Precision(200, "1e-58")
#: A bound holds another reader's digits as well: F.
FACTOR = 4.0
#: What the run of many bits may be off, in units of the error that it measures.
SHARE = 1e-3


def certify(problem, times: Sequence[float], grid_points: int = GRID) -> Certificate:
    """Compute the certified states of a problem's orbit at ``times``, increasing and positive; the last is the end.

    Raises
    ------
    InvalidInput
        For times that do not increase from above 0.
    ReferenceFailed
        Where a run does not reach the end, or has too few bits.
    """
    path = along(problem, times, PRECISION, grid_points)
    times = [float(t) for t in times]
    texts = _digits(problem, times)
    rounding = horizon.rounding(problem, path.grid)
    apart = horizon.neighbour(problem, path.grid, path.near)
    growth, rate = horizon.growth(path.grid, apart, path.size)
    at = [path.grid.index(t) for t in times]
    bounds = bound(texts, times, path, rounding.distances.max(axis=0)[at])
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


def _digits(problem, times) -> list[tuple[str, ...]]:
    """The quadruple run at the times in decimal."""
    _, quad = taylor.extended()
    rows = taylor.states(problem.system, quad, problem.q0, problem.p0, times)
    return [tuple(f"{Decimal(str(x)):.{stored.DIGITS - 1}e}" for x in row) for row in rows]


def errors(texts, times, path: Along) -> list[float]:
    """The errors of decimal states at the times against a run of many bits, each the largest so far."""
    return upto([stored.apart(text, map(str, path.row(t))) for text, t in zip(texts, times, strict=True)]).tolist()


def bound(texts, times, path: Along, grown) -> list[float]:
    """The uncertainties of decimal states; ``grown`` is what rounding by `horizon.UNIT` has become at the times.

    Raises
    ------
    ReferenceFailed
        Where the run of many bits may be off by more than its share.
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
    """The packages that the digits come from."""
    from phasebench.reference.tables import version_of

    return {name: version_of(name) for name in ("heyoka", "numpy", "sympy", "mpmath", "rebound")}
