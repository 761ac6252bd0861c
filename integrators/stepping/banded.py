r"""Newton's method for stage equations x = G(x) of a narrow band: a step costs as much as the lattice is long.

Simplified Newton: the matrix 1 - G' is made by differences, a colour of columns at once (`structure`), factorized by
Gaussian elimination with row interchanges inside of the band, and kept from step to step; where a move is more than
`SLOW` times the last it is made again.  Where that fails, every iterate gets its own.  The residual is exact, so that
the solution is one to round-off, as that of `solve.solver`.

Equations start from zero.  A start extrapolated from earlier steps, as of the fixed point, saves an iteration or two of
eight at small steps; at those that are too long for the fixed point it costs several, and matrices besides.

References: G. H. Golub, C. F. Van Loan, Matrix Computations (2013), 4.3.5 (bands); E. Hairer, G. Wanner, Solving
Ordinary Differential Equations II (1996), IV.8 (when to make the matrix again).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from phasebench.integrators.values.vector import inline, jit, load, minus, plus, size, store

from .solve import NEWTON_LIMIT, SOLVED, STALLED, difference, near, newton_method
from .structure import band_order, colour_columns, owners

#: The matrix is made again if a move is longer than this share of the one before.
SLOW = 0.3
#: Largest number of iterations for an equation.
LIMIT = 60


class Band(NamedTuple):
    """The sparsity of a banded matrix.

    Attributes
    ----------
    width : half-width of the band, in the order of ``place``
    place, colour : arrays (n,): place in the order, and colour, of each unknown
    owner : array (colours, n): the unknown of a colour that an equation depends on, -1 if none
    """

    width: int
    place: np.ndarray
    colour: np.ndarray
    owner: np.ndarray


class Room(NamedTuple):
    """Memory of a banded solver: two rows of ``memory`` from ``spare`` on; the matrix, rows of ``work`` from ``at``."""

    memory: np.ndarray
    spare: int
    work: np.ndarray
    at: int


def band_of(reach: Sequence[np.ndarray]) -> Band:
    """The band of 1 - G' where column j of G' has nonzeros in the rows reach[j]; raises InvalidInput if it is wide."""
    from .kernel import freeze

    n = len(reach)
    reach = [np.union1d(rows, [j]) for j, rows in enumerate(reach)]  # 1 - G' has a diagonal
    colours = colour_columns(reach, n)
    place, width = band_order(reach)
    return Band(width, freeze(place), freeze(np.array(colours)), freeze(owners(reach, colours)))


@jit
def columns(band: Band) -> int:
    """Number of columns that store the factorized matrix: the band, as much fill-in, and each row's pivot."""
    return 3 * band.width + 2


# -- a matrix of a band ------------------------------------------------------------------------------------------------
#
# Row i is A[at + i]; its entry of column j is in the column j - i + width. After the factorization the diagonal holds
# its inverse, and the last column the row of the pivot.


@jit
def factorize(A: np.ndarray, at: int, n: int, width: int) -> bool:
    """Factorize a band matrix, n rows of A from ``at`` on, in place by elimination with pivots; False if singular."""
    for k in range(n):
        last, end = min(n, k + width + 1), min(n, k + 2 * width + 1)
        pivot = k
        for r in range(k + 1, last):
            if abs(A[at + r, k - r + width]) > abs(A[at + pivot, k - pivot + width]):
                pivot = r
        if not abs(A[at + pivot, k - pivot + width]) > 0:
            return False
        A[at + k, 3 * width + 1] = pivot
        if pivot != k:
            for j in range(k, end):
                a, b = A[at + k, j - k + width], A[at + pivot, j - pivot + width]
                A[at + k, j - k + width], A[at + pivot, j - pivot + width] = b, a
        A[at + k, width] = 1.0 / A[at + k, width]
        for r in range(k + 1, last):
            factor = A[at + r, k - r + width] * A[at + k, width]
            A[at + r, k - r + width] = factor
            for j in range(k + 1, end):
                A[at + r, j - r + width] = A[at + r, j - r + width] - factor * A[at + k, j - k + width]
    return True


@jit
def substitute(A: np.ndarray, at: int, n: int, width: int, table: np.ndarray, row: int) -> None:
    """Solve A x = b with a band matrix of n rows that `factorize` left in A from the row ``at`` on.

    b is the first n numbers of ``table[row]``, which become x; the band has ``width`` diagonals on each side.
    """
    for k in range(n):
        pivot = int(A[at + k, 3 * width + 1])
        b = table[row, pivot]
        table[row, pivot] = table[row, k]
        table[row, k] = b
        for r in range(k + 1, min(n, k + width + 1)):
            table[row, r] = table[row, r] - A[at + r, k - r + width] * b
    for k in range(n - 1, -1, -1):
        b = table[row, k]
        for j in range(min(n, k + 2 * width + 1) - 1, k, -1):  # the next waits for the nearest alone, which comes last
            b = b - A[at + k, j - k + width] * table[row, j]
        table[row, k] = b * A[at + k, width]


@jit
def forget(work: np.ndarray, at: int, end: int) -> None:
    """Mark the matrix in the rows from ``at`` on, of ``end`` columns, as stale: it has to be computed again."""
    work[at, end - 1] = -1.0


@jit
def is_stale(work: np.ndarray, at: int, end: int) -> bool:
    """True if the matrix in the rows from ``at`` on has to be computed again."""
    return work[at, end - 1] < 0


# -- the solver --------------------------------------------------------------------------------------------------------


def band_solver(G: Callable, lengths: Callable) -> Callable:
    """Make the solver of x = G(x, arguments) by Newton's method in a band; ``lengths`` as in `solve.solver`.

    It is a function (arguments, start, span, eps, band, room) -> (x, evaluations of G, status of `solve`): ``start``
    (n,) is the first x, ``span`` the length of a step beside which the smallest change of x counts, eps the relative
    rounding, ``band`` the places of the unknowns in it, and ``room`` the memory.  The factorized matrix stays in the
    room for the next equation of its kind, until `forget`.  The arguments have a field q.
    """

    @jit
    def linearize(arguments, x, g, span, eps, band, room):
        """Factorize the matrix of 1 - G' at x, with g = G(x); False if it is singular."""
        memory, spare, work, at, width = room.memory, room.spare, room.work, room.at, band.width
        n, d = len(x), len(arguments.q)
        first, second = lengths(x, g, arguments)
        in_first, in_second = difference(first / d, span / d, eps), difference(second / d, span / d, eps)
        for i in range(n):
            for k in range(3 * width + 1):
                work[at + i, k] = 0.0
            work[at + i, width] = 1.0
        store(memory, spare, x)
        for c in range(len(band.owner)):
            for i in range(n):
                step = in_first if 2 * i < n else in_second
                memory[spare + 1, i] = memory[spare, i] + (step if band.colour[i] == c else 0.0)
            store(memory, spare + 1, minus(G(load(memory, spare + 1, x), arguments), g))
            for i in range(n):
                j = band.owner[c, i]
                if j >= 0:
                    step = in_first if 2 * j < n else in_second
                    row, column = band.place[i], band.place[j]
                    k = column - row + width
                    work[at + row, k] = work[at + row, k] - memory[spare + 1, i] / step
        return factorize(work, at, n, width)

    @jit
    def move(x, g, band, room):
        """Solve the linear equations of the factorized matrix with the right-hand side g - x."""
        memory, spare, n = room.memory, room.spare, len(x)
        store(memory, spare, minus(g, x))
        for i in range(n):
            memory[spare + 1, band.place[i]] = memory[spare, i]
        substitute(room.work, room.at, n, band.width, memory, spare + 1)
        for i in range(n):
            memory[spare, i] = memory[spare + 1, band.place[i]]
        return load(memory, spare, x)

    @jit
    def simplified_newton(arguments, start, span, eps, band, room):
        """Iterate from the start with the stored matrix, or with one computed on the way (simplified Newton)."""
        work, at, end = room.work, room.at, columns(band)
        x, last = start, np.inf
        evaluations, made = 0, 0
        for _ in range(LIMIT):
            g = G(x, arguments)
            evaluations += 1
            if is_stale(work, at, end):
                made += 1
                evaluations += len(band.owner)
                if made > NEWTON_LIMIT or not linearize(arguments, x, g, span, eps, band, room):
                    break
                last = np.inf
            dx = move(x, g, band, room)
            new, delta = plus(x, dx), size(dx)
            unit = eps * size(new)
            if delta == 0 or near(delta, last, unit):
                return new, evaluations, SOLVED
            if delta <= 1e3 * (unit + eps * span):
                if delta >= last:
                    return new, evaluations, SOLVED
            elif not delta <= SLOW * last:
                forget(work, at, end)
                if made == 0:  # the matrix was that of a step before: begin anew with this one's
                    x = start
                    continue
                if not delta < last:
                    if not delta < np.inf:
                        break
                    continue
            x, last = new, delta
        return x, evaluations, STALLED

    @inline
    def improve(arguments, x, span, eps, work):
        """One step of Newton's method for x = G(x) from x: compute the matrix 1 - G' there and solve with it."""
        band, room = work
        g, evaluations = G(x, arguments), 1 + len(band.owner)
        if not linearize(arguments, x, g, span, eps, band, room):
            return x, np.inf, np.inf, evaluations, STALLED
        dx = move(x, g, band, room)
        new = plus(x, dx)
        return new, size(dx), size(new), evaluations, SOLVED

    newton = newton_method(improve)

    @inline
    def solve(arguments, start, span, eps, band, room):
        """Solve x = G(x) from the start by simplified Newton, then by Newton's method; (x, evaluations, status)."""
        x, evaluations, status = simplified_newton(arguments, start, span, eps, band, room)
        if status != SOLVED:
            x, more, status = newton(arguments, start, span, eps, (band, room))
            evaluations += more
            if status != SOLVED:
                forget(room.work, room.at, columns(band))
        return x, evaluations, status

    return solve
