r"""Where a one-step map of the harmonic oscillator is stable: the steps z = h omega for which its powers stay bounded.

On a linear system a step is a matrix: its columns are the images of the unit vectors, exact up to round-off.  A 2 x 2
matrix M has both eigenvalues in the closed unit disc if and only if three margins are not negative (Jury's conditions),

.. math::
    1 - \operatorname{tr} M + \det M \ge 0,\qquad 1 + \operatorname{tr} M + \det M \ge 0,\qquad 1 - \det M \ge 0,

of a symplectic map the first two: :math:`|\operatorname{tr} M| \le 2`.  The margins are smooth in z where the map is:
they are scanned, their changes of sign are refined by Brent's method, and where one of them has a minimum between
points of the scan without changing its sign at them, the minimum is refined too, so that a window of instability far
narrower than the scan is found.  Of an implicit map the trace may have a pole just past the end of an interval, where
both of the first margins change their signs through infinity; their product over the sum of their squares is bounded,
and passes a pole without changing its sign: it is a fourth margin, whose roots are ends where the others' may be poles.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.5 and IX.3; E. I. Jury, Theory and
Application of the z-Transform Method (1964), 3.1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

#: The scan: the distance of its points, and where it ends.
SPACING, LAST = 0.05, 10.0
#: Allowances in the margins: what the solver of an implicit step leaves (by the matrix's size), and the rounding of the
#: determinant (by the square of it).
SLACK, ROUNDING = 1e-10, 1e-14
#: Boundaries are known to this.
SHARP = 1e-10
#: The scan ends where a step has multiplied by more than this over a whole unit of z: a polynomial does not come back.
HOPELESS = 1e4


@dataclass(frozen=True)
class Stability:
    """The stable steps.

    Attributes
    ----------
    intervals : pairs (from, to) of z, in order; they end at the end of the scan, ``scanned``, at the latest
    scanned : how far it was looked: a step that cannot be taken ends it
    """

    intervals: tuple[tuple[float, float], ...]
    scanned: float

    @property
    def limit(self) -> float | None:
        """The end of the interval that begins at 0: 0 where there is none, None where it is all that was scanned."""
        if not self.intervals or self.intervals[0][0] > 0:
            return 0.0
        end = self.intervals[0][1]
        return None if end >= self.scanned else end

    @property
    def windows(self) -> tuple[tuple[float, float], ...]:
        """The unstable steps between stable ones."""
        return tuple((a[1], b[0]) for a, b in pairwise(self.intervals))


def margins(M) -> np.ndarray:
    """Jury's three margins of a matrix of shape (2, 2), with what round-off may take from them added."""
    M = np.asarray(M, dtype=float)
    trace, det = M[0, 0] + M[1, 1], M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    size = np.abs(M).max()
    return np.array([1 - trace + det, 1 + trace + det, 1 - det]) + SLACK * (1 + size) + min(ROUNDING * size**2, 1)


def _with_bounded(three: np.ndarray) -> np.ndarray:
    """The margins with the bounded one of the first two: positive where both are, negative where one is."""
    first, second, _ = three
    product = -1.0 if max(first, second) < 0 else first * second / (first**2 + second**2)
    return np.append(three, product)


def radius(M) -> float:
    """The spectral radius of a matrix: by how much a step multiplies in the long run."""
    return float(np.abs(np.linalg.eigvals(M)).max())


def stability(
    step_matrix: Callable[[float], np.ndarray | None], last: float = LAST, spacing: float = SPACING
) -> Stability:
    """Where a map is stable.

    Parameters
    ----------
    step_matrix : z -> the matrix of a step, shape (2, 2); None where the step cannot be taken
    last, spacing : of the scan
    """
    seen: dict[float, tuple[np.ndarray, float]] = {}

    def look(z: float) -> tuple[np.ndarray, float]:
        """The margins, and by how much a step multiplies: inf where it cannot be taken."""
        if z not in seen:
            M = step_matrix(z)
            taken = M is not None and np.isfinite(M).all()
            seen[z] = (_with_bounded(margins(M)), float(np.abs(M).max())) if taken else (np.full(4, -1.0), np.inf)
        return seen[z]

    def at(z: float) -> np.ndarray:
        return look(z)[0]

    scan = _scan(look, last, spacing)
    if not scan:
        return Stability((), 0.0)
    ends = sorted({0.0, scan[-1], *_roots(at, scan)})
    pieces = [(a, b) for a, b in pairwise(ends) if (at((a + b) / 2) >= 0).all()]
    pieces = [p for p in pieces if not _grows_from_the_start(at, scan, p)]
    return Stability(tuple(_joined(pieces)), scan[-1])


def _scan(look, last: float, spacing: float) -> list[float]:
    """The points of the scan up to where a step cannot be taken, or has been hopeless for long."""
    scan: list[float] = []
    since = None
    for k in range(1, round(last / spacing) + 1):
        z = k * spacing
        by = look(z)[1]
        if by == np.inf:
            break
        scan.append(z)
        since = (since or z) if by > HOPELESS else None
        if since is not None and z - since >= 1:
            break
    return scan


def _roots(at, scan: list[float]) -> Iterator[float]:
    """Where a margin changes its sign."""
    from scipy.optimize import brentq

    for i in range(4):

        def f(z, i=i):
            return at(z)[i]

        for a, b in pairwise(_with_extrema(f, scan)):
            if (f(a) < 0) != (f(b) < 0):
                yield brentq(f, a, b, xtol=SHARP)


def _with_extrema(f, scan: list[float]) -> list[float]:
    """The scan, with the extrema between its points at which f has the other sign than at its neighbours."""
    from scipy.optimize import minimize_scalar

    points = list(scan)
    for a, b, c in zip(scan, scan[1:], scan[2:], strict=False):
        sign = -1.0 if f(b) < 0 else 1.0
        values = [sign * f(z) for z in (a, b, c)]
        bend = values[0] - 2 * values[1] + values[2]  # a parabola's extremum is within an eighth of it
        if min(values) < 0 or values[1] > min(values[0], values[2], bend):
            continue
        found = minimize_scalar(lambda z, s=sign: s * f(z), bounds=(a, c), method="bounded", options={"xatol": 1e-9})
        if found.fun < 0:
            points.append(float(found.x))
    return sorted(points)


def _grows_from_the_start(at, scan: list[float], piece: tuple[float, float]) -> bool:
    """Whether the interval from 0 is there only because growth as a power of z is below the slack at first.

    Then it ends where the determinant passes 1, having never been below: of Euler's explicit method it is 1 + z^2.
    """
    start, end = piece
    if start > 0 or end >= scan[-1]:
        return False
    beyond, within = at(end * 1.01), [at(end * k / 8) for k in range(1, 8)]
    return bool(beyond[2] < 0 and all(m[2] <= 4 * SLACK for m in within))


def _joined(pieces):
    """Pieces that touch as one."""
    out: list[tuple[float, float]] = []
    for start, end in pieces:
        if out and start - out[-1][1] <= 0:
            out[-1] = (out[-1][0], end)
        else:
            out.append((start, end))
    return out
