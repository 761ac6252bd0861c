r"""Find where orbits cross a surface :math:`x = c`, and store the points.

x is a coordinate or momentum (the surface is a plane), or any function of these.  Between two rows (stored states) of
an orbit on different sides of the surface, the flow itself is integrated to it, with x as the independent variable in
the place of time (Henon 1982):

.. math::
    \frac{\mathrm dy}{\mathrm dx} = \frac{f(y)}{f_x(y)},\qquad \frac{\mathrm dt}{\mathrm dx} = \frac1{f_x(y)},

from the row that is nearer, by one step of the method of order 8 of DOP853.  The point is on a plane to the last bit,
and as exact as the rows as long as these are close.

Source: M. Henon, On the numerical computation of Poincare maps, Physica D 5 (1982) 412-414; the method as in
`coefficients.dop853`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from numba import types

from .coefficients import dop853
from .coefficients.dop853 import STAGES
from .compile import codegen, machine, progress
from .compile.lazy import sympy as sp
from .families.magnetic import dot
from .families.runge_kutta import total
from .stepping.kernel import _type, entry, value
from .values.vector import jit, join, load, plus, scale, store

if TYPE_CHECKING:
    from .systems.hamiltonian import PartitionedSystem
    from .values.kinds import Function, Value

#: The room of `Crossings` grows by so many points, or by this share of what there is.
GROWTH, SHARE = 1 << 14, 32


@jit
def _carry(
    field: Function,
    slope: Function | None,
    q: Value,
    p: Value,
    t: float,
    k: int,
    dx: float,
    tableau: np.ndarray,
    slopes: np.ndarray,
    zero: Value,
) -> tuple[Value, Value, float]:
    """Carry (q, p, t) along the flow until x has changed by dx, by one step of order 8.

    x is component k of (q, p), or the function whose derivatives ``slope(q, p, 0, 0)`` returns.
    ``field(q, p, 0, 0)`` returns (q', p').  ``tableau`` has the rows of A, then b, of the Runge-Kutta method,
    ``slopes`` is memory for its stages, and ``zero`` a vector of d zeros.  Returns the new (q, p, t).
    """
    d = len(zero)
    for i in range(STAGES):
        dq, dp = total(tableau, i, dx, slopes, zero)
        y, v = plus(q, dq), plus(p, dp)
        dq, dp = field(y, v, 0.0, 0.0)
        if slope is None:
            rate = 1.0 / (dq[k] if k < d else dp[k - d])  # dt/dx
        else:
            of_q, of_p = slope(y, v, 0.0, 0.0)
            rate = 1.0 / (dot(of_q, dq) + dot(of_p, dp))
        store(slopes, i, scale(rate, join(dq, dp)))
        t = t + dx * tableau[STAGES, i] * rate
    dq, dp = total(tableau, STAGES, dx, slopes, zero)
    return plus(q, dq), plus(p, dp), t


@jit
def _take(q: np.ndarray, p: np.ndarray, last: np.ndarray, b: int, i: int, j: int, work: np.ndarray) -> None:
    """Write q and p of row i of an orbit, or of the row in ``last`` if i is -1, to the two rows of ``work``."""
    for a in range(q.shape[2]):
        work[0, a] = q[b, i, a, j] if i >= 0 else last[0, b, a, j]
        work[1, a] = p[b, i, a, j] if i >= 0 else last[1, b, a, j]


def _find(
    field: Function,
    level: Function | None,
    slope: Function | None,
    q: np.ndarray,
    p: np.ndarray,
    last: np.ndarray,
    plane: np.ndarray,
    every: int,
    begin: int,
    steps: int,
    h: np.ndarray,
    points: np.ndarray,
    owners: np.ndarray,
    work: np.ndarray,
    slopes: np.ndarray,
    tableau: np.ndarray,
    zero: Value,
) -> int:
    """Find the crossings of a surface by orbits between their rows, write them to ``points``; return their number.

    q, p are rows (blocks of orbits, rows, d, lanes), each ``every`` steps after the one before.  ``last``, of shape (2,
    blocks, d, lanes), holds q and p of the row before these, the state after ``begin`` of the run's ``steps`` steps; it
    is overwritten by the last of these rows, for the next call.  ``plane`` (1, 3) has the index of the component in (q,
    p), the value on the surface and the sign of a crossing (1: rising, -1: falling, 0: either); ``h`` (blocks, lanes)
    has the step of each orbit.  A row of ``points`` becomes (t, q, p), and the same row of ``owners`` the number of the
    orbit, block times lanes plus lane.  ``field(q, p, 0, 0)`` returns (q', p'); if the surface is no plane of a
    component, ``level(q, p)`` returns (its function, 0) and ``slope(q, p, 0, 0)`` the derivatives with respect to q and
    p.

    ``work`` (2, d) and ``slopes`` (STAGES + 1, 2 d) are work arrays; ``tableau`` has the rows of A, then b, of a
    Runge-Kutta method; ``zero`` is a vector of d zeros.
    """
    k, at, sign = int(plane[0, 0]), plane[0, 1], plane[0, 2]
    blocks, rows, d, lanes = q.shape
    side, c = (1, k - d) if k >= d else (0, k)
    x = p if k >= d else q
    found = 0
    for b in range(blocks):
        for i in range(rows):
            if level is None and i > 0:
                many = 0
                for j in range(lanes):
                    before, after = x[b, i - 1, c, j] - at, x[b, i, c, j] - at
                    many += ((before < 0) & (after >= 0) & (sign >= 0)) | ((before > 0) & (after <= 0) & (sign <= 0))
                if many == 0:
                    continue
            for j in range(lanes):
                if level is None:
                    before = (x[b, i - 1, c, j] if i > 0 else last[side, b, c, j]) - at
                    after = x[b, i, c, j] - at
                else:
                    _take(q, p, last, b, i - 1, j, work)
                    before = level(load(work, 0, zero), load(work, 1, zero))[0] - at
                    _take(q, p, last, b, i, j, work)
                    after = level(load(work, 0, zero), load(work, 1, zero))[0] - at
                rises, falls = before < 0 and after >= 0, before > 0 and after <= 0
                if not ((rises and sign >= 0) or (falls and sign <= 0)):
                    continue
                nearer, apart = (i, after) if abs(after) < abs(before) else (i - 1, before)
                _take(q, p, last, b, nearer, j, work)
                t = h[b, j] * min(begin + (nearer + 1) * every, steps)
                y, v = load(work, 0, zero), load(work, 1, zero)
                y, v, t = _carry(field, slope, y, v, t, k, -apart, tableau, slopes, zero)
                store(work, 0, y)
                store(work, 1, v)
                if level is None:
                    work[side, c] = at
                good = np.isfinite(t)
                for a in range(d):
                    good = good and np.isfinite(work[0, a]) and np.isfinite(work[1, a])
                    points[found, 1 + a], points[found, 1 + d + a] = work[0, a], work[1, a]
                points[found, 0], owners[found, 0] = t, b * lanes + j
                if good:
                    found += 1
    for b in range(blocks):
        for a in range(d):
            for j in range(lanes):
                last[0, b, a, j], last[1, b, a, j] = q[b, rows - 1, a, j], p[b, rows - 1, a, j]
    return found


def _sort(points: np.ndarray, owners: np.ndarray, next_place: np.ndarray) -> None:
    """Sort points in place by the orbit to which they belong; points of one orbit keep their order.

    ``owners`` (m, 1) has the number of the orbit of each point, ``next_place`` (n, 1) for each orbit the row of its
    first point after sorting; both arrays are overwritten.
    """
    for i in range(len(owners)):
        orbit = owners[i, 0]
        owners[i, 0] = next_place[orbit, 0]
        next_place[orbit, 0] += 1
    for i in range(len(owners)):
        while owners[i, 0] != i:
            j = owners[i, 0]
            for a in range(points.shape[1]):
                points[i, a], points[j, a] = points[j, a], points[i, a]
            owners[i, 0], owners[j, 0] = owners[j, 0], j


_NUMBERS, _WHOLE, _BLOCKS = (
    types.Array(t, n, "C") for t, n in ((types.float64, 2), (types.int64, 2), (types.float64, 4))
)
_compiled: dict = {}


@cache
def _tableau() -> np.ndarray:
    return np.array(dop853.tableau(), float)


def _surface(system: PartitionedSystem, x: sp.Expr | None) -> tuple[Function | None, Function | None]:
    """The functions ``level`` and ``slope`` of `_find` for a function x of the variables; None for a component."""
    if x is None:
        return None, None
    T, kind = codegen.value_type(system.d), sp.srepr(x)
    given, numbers = [("q", system.q), ("p", system.p)], types.UniTuple(types.float64, 2)(*2 * (T,))
    level = system.make_function(f"level {kind}", given, lambda: [x, sp.Integer(0)], numbers, codegen.DOUBLE)
    slopes = [[sp.diff(x, v) for v in variables] for variables in (system.q, system.p)]
    return level, system.field_like(f"slope {kind}", lambda: slopes, codegen.DOUBLE)


def finder(system: PartitionedSystem, x: sp.Expr | None = None) -> Callable:
    """Return the search for crossings, `_find`, compiled for a system; x is a function of its variables, or None.

    The function takes the arguments of `_find` from q to slopes, and returns the number of crossings found.
    """
    functions, d = (system.field(), *_surface(system, x)), system.d
    zero, tableau = value(np.zeros(d), d), _tableau()
    if not codegen.compiled():
        return lambda *arguments: _find(*functions, *arguments, tableau, zero)
    T, whole = codegen.value_type(d), types.int64
    signature = whole(
        *(*map(_type, functions), _BLOCKS, _BLOCKS, _BLOCKS, _NUMBERS, whole, whole, whole),
        *(_NUMBERS, _NUMBERS, _WHOLE, _NUMBERS, _NUMBERS, _NUMBERS, T),
    )
    if signature not in _compiled:
        options = codegen.options(d) | {"nogil": True}
        with progress.compiling("the search of crossings", d):
            _compiled[signature] = entry(machine.load_or_compile(_find, signature, options, "crossings"))
    call = _compiled[signature]
    return lambda *arguments: call(*functions, *arguments, tableau, zero)


def sorter() -> Callable:
    """Return the compiled function (points, owners, next_place) that sorts crossings by orbit, `_sort`."""
    if not codegen.compiled():
        return _sort
    if "sort" not in _compiled:
        signature = types.none(_NUMBERS, _WHOLE, _WHOLE)
        options = codegen.options(1) | {"nogil": True}
        _compiled["sort"] = entry(machine.load_or_compile(_sort, signature, options, "crossings-sort"))
    return _compiled["sort"]


class Crossings:
    """Points at which orbits cross a plane, with the orbits' indices, in two growing tables filled by several threads.

    Attributes
    ----------
    points : array (capacity, 2 d + 1) of t, q, p; as many rows as the object's ``len`` are filled
    owners : array (capacity, 1), the number of the orbit of each point
    """

    def __init__(self, d: int) -> None:
        self.points, self.owners = np.empty((GROWTH, 2 * d + 1)), np.empty((GROWTH, 1), np.int64)
        self._filled, self._lock = 0, Lock()

    def __len__(self) -> int:
        return self._filled

    def add(self, points: np.ndarray, owners: np.ndarray) -> None:
        """Append points, rows (t, q, p) of an array (m, 2 d + 1), with the numbers of their orbits (m,)."""
        with self._lock:
            first, self._filled = self._filled, self._filled + len(points)
            if self._filled > len(self.points):
                self._resize(self._filled + max(GROWTH, self._filled // SHARE))
            self.points[first : self._filled] = points
            self.owners[first : self._filled, 0] = owners

    def _resize(self, rows: int) -> None:
        """Allocate room for ``rows`` rows, without a copy where the operating system can extend memory."""
        for table in (self.points, self.owners):
            table.resize((rows, table.shape[1]), refcheck=False)

    def drop(self, orbits: np.ndarray) -> None:
        """Remove the points of the orbits with these numbers."""
        if not len(orbits):
            return
        kept = ~np.isin(self.owners[: self._filled, 0], orbits)
        n = int(kept.sum())
        for table in (self.points, self.owners):
            table[:n] = table[: self._filled][kept]
        self._filled = n

    def sort_points(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Sort the points of n orbits by orbit and time; afterwards none can be added.

        Returns (array of the points, array (n,) with the number of points of each orbit).
        """
        self._resize(self._filled)
        numbers = np.bincount(self.owners[:, 0], minlength=n)
        sorter()(self.points, self.owners, (np.cumsum(numbers) - numbers)[:, None].copy())
        return self.points, numbers
