r"""Newton's method for stage equations x = G(x) whose Jacobian is banded: the cost is linear in the unknowns.

Simplified Newton: the matrix 1 - G' is computed by finite differences, one for all columns of a *colour*, which have no
row in common (`structure`).  It is factorized by Gaussian elimination with row interchanges inside of the band, and
kept from step to step; when a correction is longer than `SLOW` times the one before, the matrix is computed again.
Where simplified Newton fails, every iterate gets its own matrix.  The residual is exact, so that the solution is
accurate to round-off, like that of `solve.solver`.

The iteration starts from zero.  A start extrapolated from earlier steps, as for the fixed point, saves an iteration or
two of eight at small steps; at steps that are too long for the fixed point it costs several, and further matrices.

References: G. H. Golub, C. F. Van Loan, Matrix Computations (2013), 4.3.5 (bands); E. Hairer, G. Wanner, Solving
Ordinary Differential Equations II (1996), IV.8 (when to make the matrix again).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.values.vector import inline, jit, load, minus, plus, size, store

from .codes import NOT_FINITE, SOLVED, STALLED
from .newton import LIMIT as NEWTON_LIMIT
from .newton import difference, newton_converged
from .solve import near
from .structure import band_order, colour_columns, owners

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Number, Value

#: The matrix is computed again if a correction is longer than this share of the one before.
SLOW = 0.3
#: Largest number of iterations for an equation.
LIMIT = 60


class Band(NamedTuple):
    """The sparsity of a matrix (n, n) that is banded when its unknowns are reordered.

    Unknowns are coloured so that each equation depends on at most one unknown of each colour: then one finite
    difference gives all columns of a colour.

    Attributes
    ----------
    width : half-width of the band after reordering
    place, colour : arrays (n,): position in the new order, and colour, of each unknown
    owner : array (colours, n): for each colour and equation the unknown of that colour in the equation, -1 if none
    """

    width: int
    place: np.ndarray
    colour: np.ndarray
    owner: np.ndarray


class Room(NamedTuple):
    """Memory of a banded solver.

    Attributes
    ----------
    memory, spare : the solver overwrites the rows ``spare`` and ``spare + 1`` of the array ``memory``
    work, at : the factorized matrix is in the rows of the array ``work`` from ``at`` on
    """

    memory: np.ndarray
    spare: int
    work: np.ndarray
    at: int


def band_of(reach: Sequence[np.ndarray]) -> Band:
    """Find the `Band` of 1 - G', given the rows reach[j] in which column j of the Jacobian G' has nonzeros.

    Raises InvalidInput if the band is too wide (`structure.MOST`).
    """
    from .kernel import freeze

    n = len(reach)
    reach = [np.union1d(rows, [j]) for j, rows in enumerate(reach)]  # 1 - G' has a diagonal
    colours = colour_columns(reach, n)
    place, width = band_order(reach)
    return Band(width, freeze(place), freeze(np.array(colours)), freeze(owners(reach, colours)))


@jit
def columns(band: Band) -> int:
    """Return the number of columns of the array for a factorized matrix: band, fill-in, and each row's pivot."""
    return 3 * band.width + 2


# -- a matrix of a band ------------------------------------------------------------------------------------------------
#
# Row i is A[at + i]; its entry of column j is in the column j - i + width. After the factorization the diagonal holds
# its inverse, and the last column the row of the pivot.


@jit
def factorize(A: np.ndarray, at: int, n: int, width: int) -> bool:
    """Factorize a band matrix in place by Gaussian elimination with row interchanges; returns False if it is singular.

    Its n rows are those of A from ``at`` on; entry (i, j) stands in column j - i + ``width``, with ``width`` the
    half-width of the band.
    """
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
    """Mark a stored matrix, so that it will be computed again; it is in the rows of ``work`` from ``at`` on.

    ``end`` is the number of its columns, the last of which takes the mark.
    """
    work[at, end - 1] = -1.0


@jit
def is_stale(work: np.ndarray, at: int, end: int) -> bool:
    """True if `forget` has marked the matrix in the rows of ``work`` from ``at`` on, which has ``end`` columns."""
    return work[at, end - 1] < 0


# -- the solver --------------------------------------------------------------------------------------------------------


def band_solver(G: Callable, lengths: Callable) -> Callable:
    """Make the solver of x = G(x, arguments) by Newton's method with a banded matrix.

    The solver is a function (arguments, start, span, eps, band, room) -> (x, evaluations of G, status as in `solve`).
    ``start`` (n,) is the first x, ``span`` the size of the variables in which G varies, ``eps`` the machine epsilon,
    ``band`` the `Band` of 1 - G', and ``room`` the `Room`, in which the factorized matrix stays for the next equation
    of the same kind, until `forget`.  ``arguments`` is passed to G; it is a NamedTuple with a field q.

    ``lengths(x, G(x), arguments)`` returns the sizes of the variables to which the two halves of x belong, to choose
    the lengths of finite differences.
    """

    @jit
    def linearize(arguments: Any, x: Value, g: Value, span: Number, eps: Number, band: Band, room: Room) -> bool:
        """Compute 1 - G' at x by finite differences, with g = G(x), and factorize it; returns False if singular."""
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
    def move(x: Value, g: Value, band: Band, room: Room) -> Value:
        """Return Newton's correction of x: solve (1 - G') dx = g - x with the factorized matrix in ``room``."""
        memory, spare, n = room.memory, room.spare, len(x)
        store(memory, spare, minus(g, x))
        for i in range(n):
            memory[spare + 1, band.place[i]] = memory[spare, i]
        substitute(room.work, room.at, n, band.width, memory, spare + 1)
        for i in range(n):
            memory[spare, i] = memory[spare + 1, band.place[i]]
        return load(memory, spare, x)

    @jit
    def simplified_newton(
        arguments: Any, start: Value, span: Number, eps: Number, band: Band, room: Room
    ) -> tuple[Value, int, int]:
        """Simplified Newton from the start, with the stored matrix or a new one; (x, evaluations, status)."""
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

    @jit
    def newton(
        arguments: Any, start: Value, span: Number, eps: Number, band: Band, room: Room
    ) -> tuple[Value, int, int]:
        """Newton's method from the start, with a matrix for every iterate; (x, evaluations, status)."""
        x, last, evaluations = start, np.inf, 0
        for _ in range(NEWTON_LIMIT):
            g = G(x, arguments)
            evaluations += 1 + len(band.owner)
            if not linearize(arguments, x, g, span, eps, band, room):
                break
            dx = move(x, g, band, room)
            x, delta = plus(x, dx), size(dx)
            if not delta < np.inf:
                return x, evaluations, NOT_FINITE
            if newton_converged(delta, last, eps * size(x), eps * span):
                return x, evaluations, SOLVED
            last = delta
        return x, evaluations, STALLED

    @inline
    def solve(
        arguments: Any, start: Value, span: Number, eps: Number, band: Band, room: Room
    ) -> tuple[Value, int, int]:
        """Solve x = G(x) from the start by simplified Newton, then by Newton's method; (x, evaluations, status).

        The arguments are those that `band_solver` describes.
        """
        x, evaluations, status = simplified_newton(arguments, start, span, eps, band, room)
        if status != SOLVED:
            x, more, status = newton(arguments, start, span, eps, band, room)
            evaluations += more
            if status != SOLVED:
                forget(room.work, room.at, columns(band))
        return x, evaluations, status

    return solve
