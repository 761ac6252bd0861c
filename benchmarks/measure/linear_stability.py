r"""Linear stability of one-step maps: the steps z = h omega at which the powers of the oscillator's map are bounded.

On a linear system a step is a matrix, whose columns are the images of the unit vectors up to round-off.  A 2 x 2 matrix
M has both eigenvalues in the closed unit disc if and only if three margins are not negative (Jury's conditions),

.. math::
    1 - \operatorname{tr} M + \det M \ge 0,\qquad 1 + \operatorname{tr} M + \det M \ge 0,\qquad 1 - \det M \ge 0;

for a symplectic map the first two suffice: :math:`|\operatorname{tr} M| \le 2`.  The margins are as smooth in z as the
map.  They are scanned, and their changes of sign are refined by Brent's method.  A minimum between scan points without
a change of sign at these is refined too, so that a window of instability much narrower than the scan is found.  The
trace of an implicit map may have a pole just past the end of an interval, where both of the first margins change sign
through infinity.  A fourth margin, their product divided by the sum of their squares, is bounded and keeps its sign at
a pole: its roots are true ends where the roots of the others may be poles.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), I.5 and IX.3; E. I. Jury, Theory and
Application of the z-Transform Method (1964), 3.1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

#: Spacing of the scan, and its end.
SPACING, LAST = 0.05, 10.0
#: Allowances in the margins: for the solver of an implicit step (times the matrix's size), for rounding of the
#: determinant (times the size squared), and, times the size, this many times the measured noise of the entries.
SLACK, ROUNDING, NOISY = 1e-10, 1e-14, 10.0
#: Largest difference between the matrix of two steps and the square of one, for a step that keeps only the state.
SQUARE = 1e-9
#: Accuracy of the boundaries.
SHARP = 1e-10
#: Half the width of the interval on which a multiple root is sought, and the degree of the polynomial there, in excess
#: of twice the root's order.
FLAT, DEGREE = 0.02, 4
#: The scan ends if matrix entries exceed this over a unit of z: a polynomial does not become stable again.
HOPELESS = 1e4


def is_square(one: np.ndarray, two: np.ndarray) -> bool:
    """True if the matrix of two steps is the square of that of one: then a step depends on the state alone."""
    return not np.abs(two - one @ one).max() > SQUARE


@dataclass(frozen=True)
class Stability:
    """The stable steps z = h omega of a linear map.

    Attributes
    ----------
    intervals : pairs (from, to) of z, in order, none beyond ``scanned``
    scanned : end of the scan, earlier than requested if a step fails
    """

    intervals: tuple[tuple[float, float], ...]
    scanned: float

    @property
    def limit(self) -> float | None:
        """The end of the stable interval from 0; 0 if none begins there, None if it reaches the end of the scan."""
        if not self.intervals or self.intervals[0][0] > 0:
            return 0.0
        end = self.intervals[0][1]
        return None if end >= self.scanned else end

    @property
    def windows(self) -> tuple[tuple[float, float], ...]:
        """The intervals (from, to) of unstable z between the stable ones."""
        return tuple((a[1], b[0]) for a, b in pairwise(self.intervals))


def margins(M: ArrayLike, noise: float = 0.0) -> np.ndarray:
    """Return Jury's margins of M (2, 2), plus an allowance for round-off and the error ``noise`` of its entries."""
    M = np.asarray(M, dtype=float)
    size = np.abs(M).max()
    allowance = (SLACK + NOISY * noise) * (1 + size) + min(ROUNDING * size**2, 1)
    return jury(M) + allowance


def jury(M: np.ndarray) -> np.ndarray:
    """Return the margins 1 - tr M + det M, 1 + tr M + det M and 1 - det M of a matrix (2, 2), >= 0 if it is stable."""
    trace, det = M[0, 0] + M[1, 1], M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    return np.array([1 - trace + det, 1 + trace + det, 1 - det])


def _with_bounded(three: np.ndarray) -> np.ndarray:
    """Append a fourth margin with the sign of the lesser of the first two, which keeps it at a pole of the trace."""
    first, second, _ = three
    product = -1.0 if max(first, second) < 0 else first * second / (first**2 + second**2)
    return np.append(three, product)


def radius(M: np.ndarray) -> float:
    """Return the spectral radius of a matrix: the growth per step in the long run."""
    return float(np.abs(np.linalg.eigvals(M)).max())


def stability(
    step_matrix: Callable[[float], np.ndarray | None],
    last: float = LAST,
    spacing: float = SPACING,
    noise: Callable[[float], float] = lambda z: 0.0,
) -> Stability:
    """Find the stable steps z = h omega of a method whose map on the harmonic oscillator is linear.

    Parameters
    ----------
    step_matrix : z -> the matrix of a step, shape (2, 2); None if the step fails
    last, spacing : end and spacing of the scan of z
    noise : z -> the error of the matrix's entries, needed only if it exceeds `SLACK` (a solver's error may)
    """
    seen: dict[float, tuple[np.ndarray, float]] = {}

    def look(z: float) -> tuple[np.ndarray, float]:
        """(The four margins at z, the largest entry of the matrix); -1 and infinity if the step fails."""
        if z not in seen:
            M = step_matrix(z)
            taken = M is not None and np.isfinite(M).all()
            seen[z] = (np.full(4, -1.0), np.inf)
            if taken:
                seen[z] = (_with_bounded(margins(M, noise(z))), float(np.abs(M).max()))
        return seen[z]

    def at(z: float) -> np.ndarray:
        return look(z)[0]

    scan = _scan(look, last, spacing)
    if not scan:
        return Stability((), 0.0)
    ends = sorted({0.0, scan[-1], *_roots(at, scan)})
    pieces = [(a, b) for a, b in pairwise(ends) if (at((a + b) / 2) >= 0).all()]
    pieces = [p for p in pieces if not _grows_from_the_start(at, scan, p)]
    return Stability(tuple(_merge(pieces)), scan[-1])


def multiple_root(f: Callable[[float], float], z: float, reach: float) -> float:
    """Refine an estimate z of a multiple root of f, near which f is flat and its round-off hides the root.

    If f has a root of order m, or m roots closer than round-off can tell, its derivative of order m - 1 has a simple
    one there, which is that of a polynomial through f at points about z.  m follows from the growth of f from the
    distance ``reach``, at which f exceeds its round-off, to twice that.  Returns z itself for a simple root or a pole.
    """
    near, far = (abs(f(z - way) * f(z + way)) for way in (reach, 2 * reach))
    order = round(float(np.log(far / near) / np.log(4.0))) if near > 0 and 0 < far < np.inf else 1
    if order < 2:
        return z
    domain = (z - FLAT, z + FLAT)
    curve = np.polynomial.Chebyshev.interpolate(np.vectorize(f), 2 * order + DEGREE, domain)
    roots = curve.deriv(order - 1).roots()
    root = roots[np.abs(roots - z).argmin()]
    return float(root.real) if abs(root - z) < reach else z


def _scan(look: Callable[[float], tuple[np.ndarray, float]], last: float, spacing: float) -> list[float]:
    """The multiples of ``spacing`` to the first failed step, or until entries exceed `HOPELESS` over a unit of z."""
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


def _roots(at: Callable[[float], np.ndarray], scan: list[float]) -> Iterator[float]:
    """Yield every z between points of the scan at which one of the four stability margins ``at(z)`` changes sign."""
    from scipy.optimize import brentq

    for i in range(4):

        def f(z: float, i: int = i) -> float:
            return at(z)[i]

        for a, b in pairwise(_with_extrema(f, scan)):
            if (f(a) < 0) != (f(b) < 0):
                yield brentq(f, a, b, xtol=SHARP)


def _with_extrema(f: Callable[[float], float], scan: list[float]) -> list[float]:
    """Return the points of a scan, plus extrema of f between them where f has another sign than at the neighbours."""
    from scipy.optimize import minimize_scalar

    points = list(scan)
    for a, b, c in zip(scan, scan[1:], scan[2:], strict=False):
        sign = -1.0 if f(b) < 0 else 1.0
        values = [sign * f(z) for z in (a, b, c)]
        bend = values[0] - 2 * values[1] + values[2]  # a parabola's extremum differs from f(b) by at most bend / 8
        if min(values) < 0 or values[1] > min(values[0], values[2], bend):
            continue
        found = minimize_scalar(lambda z, s=sign: s * f(z), bounds=(a, c), method="bounded", options={"xatol": 1e-9})
        if found.fun < 0:
            points.append(float(found.x))
    return sorted(points)


def _grows_from_the_start(at: Callable[[float], np.ndarray], scan: list[float], piece: tuple[float, float]) -> bool:
    """True if a stable interval (0, end) is spurious, since the map grows at every step z > 0.

    Near z = 0 the growth of such a map, of which explicit Euler with det M = 1 + z^2 is one, is hidden by the allowance
    for round-off.  Its signs: det M is nowhere below 1 within, and just beyond the end only det M > 1 makes it
    unstable.
    """
    start, end = piece
    if start > 0 or end >= scan[-1]:
        return False
    beyond, within = at(end * 1.01), [at(end * k / 8) for k in range(1, 8)]
    by_growth = beyond[2] < 0 <= min(beyond[:2])
    return bool(by_growth and all(m[2] <= 4 * SLACK for m in within))


def _merge(pieces: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Merge those of the intervals (start, end), given in order, that touch; return the list of intervals."""
    out: list[tuple[float, float]] = []
    for start, end in pieces:
        if out and start - out[-1][1] <= 0:
            out[-1] = (out[-1][0], end)
        else:
            out.append((start, end))
    return out
