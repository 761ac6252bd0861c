r"""Newton's method for stage equations :math:`x = G(x)`: one compiled function, which asks its caller for values of G.

The caller evaluates G where `newton` tells it, and calls it again, until the status is not `ASKED` (reverse
communication).  So the function is compiled once for all methods and systems, and a kernel, which rarely needs it,
holds nothing of it but a pointer.

The Jacobian is made by finite differences of G, in n + 1 evaluations for n unknowns.  Its error only slows the
convergence: the residual is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import types

from phasebench.integrators.values.vector import inline

from .codes import ASKED, NOT_FINITE, SOLVED, STALLED

#: Iterations from one start.
LIMIT = 25
#: Rows of ``Work.rows`` after those of the matrix: x, G(x), numbers that an iteration keeps, and from `ASKED_AT` on two
#: rows for a caller that has no memory of its own for the unknowns.
X, GX, KEPT, ASKED_AT, MORE_ROWS = 0, 1, 2, 3, 5
#: The numbers kept: the component that differs from x where G is asked for, from 1, or 0; the lengths of differences
#: in the first and in the second half of the unknowns; corrections made; the length of the last; True at the second
#: start.
COMPONENT, FIRST, SECOND, MADE, LAST, AGAIN, NUMBERS = range(7)


class Work(NamedTuple):
    """Memory for linear equations, and Newton's method as a function that a kernel calls by a pointer.

    Attributes
    ----------
    rows : array of the shape `shape`, or of another one for a family that solves its linear equations itself
    newton : the function `newton`; None if the kernel has no use for it
    search : the function `root.search_anew`; None if the kernel has no use for it
    """

    rows: np.ndarray
    newton: Callable | None
    search: Callable | None


def shape(n: int) -> tuple[int, int]:
    """The shape of the memory that `newton` needs for n unknowns."""
    return n + MORE_ROWS, max(n + 1, NUMBERS)


@inline
def gauss(A: np.ndarray, n: int) -> bool:
    """Solve n linear equations by Gaussian elimination with row interchanges; returns False if they are singular.

    The matrix is A[:n, :n], which is overwritten; column n of A is the right-hand side, and becomes the solution.
    """
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[pivot, j]):
                pivot = i
        if not abs(A[pivot, j]) > 0:
            return False
        for k in range(n + 1):
            A[j, k], A[pivot, k] = A[pivot, k], A[j, k]
        for i in range(n):
            if i != j:
                factor = A[i, j] / A[j, j]
                for k in range(j, n + 1):
                    A[i, k] = A[i, k] - factor * A[j, k]
    for j in range(n):
        A[j, n] = A[j, n] / A[j, j]
    return True


@inline
def difference(length: float, span: float, eps: float) -> float:
    """Length of a finite difference in a variable of size ``length``, or of size ``span`` if that is zero."""
    return eps**0.5 * (length if length > 0 else span)


@inline
def newton_converged(delta: float, last: float, unit: float, noise: float) -> bool:
    """True if Newton's method has reached round-off, or is near it and no longer converging.

    ``delta`` is the length of its last correction and ``last`` of the one before; ``unit`` is the round-off of the
    unknowns, ``noise`` that of the variables in which their equations vary.
    """
    return delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * (unit + noise))


def newton(
    work: np.ndarray,
    rows: np.ndarray,
    at: int,
    stages: int,
    n: int,
    half: int,
    first: float,
    second: float,
    span: float,
    eps: float,
) -> int:
    """Go on with Newton's method, now that G is known where it was asked for; returns the status.

    Call `begin` first.  Then ``rows[at : at + stages, :n]`` is the place where G is asked for, and the rows after it
    are to be G there.  Status `ASKED`: G is to be evaluated again, and this function to be called.  Otherwise the place
    is the solution (`SOLVED`), or the status says why there is none: where the method fails it begins once more, from
    zero.

    ``work`` is memory of the `shape` for stages x n unknowns.  ``first`` and ``second`` are the sizes of the variables
    to which unknowns belong, in turn for every ``half`` unknowns; ``span`` is the size of the variables (such as q and
    p) of the functions in G; x is solved to ``eps``, the unit round-off, relative to its own size and to ``span``.
    """
    order = stages * n
    x, g, kept = order + X, order + GX, order + KEPT
    known = int(work[kept, COMPONENT])
    if known == 0:
        for r in range(order):
            work[x, r], work[g, r] = rows[at + r // n, r % n], rows[at + stages + r // n, r % n]
        work[kept, FIRST], work[kept, SECOND] = difference(first, span, eps), difference(second, span, eps)
    else:
        i = known - 1
        step = work[kept, SECOND if i // half % 2 else FIRST]
        for r in range(order):
            change = rows[at + stages + r // n, r % n] - work[g, r]
            work[r, i] = (1.0 if r == i else 0.0) - change / step
        rows[at + i // n, i % n] = work[x, i]
    if known < order:
        rows[at + known // n, known % n] = work[x, known] + work[kept, SECOND if known // half % 2 else FIRST]
        work[kept, COMPONENT] = known + 1
        return ASKED
    work[kept, COMPONENT] = 0
    status = _correct(work, order, span, eps)
    if status != ASKED and status != SOLVED and work[kept, AGAIN] == 0:
        begin(work, order)
        work[kept, AGAIN] = 1
        for r in range(order):
            work[x, r] = 0.0 * work[kept, FIRST]
        status = ASKED
    for r in range(order):
        rows[at + r // n, r % n] = work[x, r]
    return status


@inline
def _correct(work: np.ndarray, order: int, span: float, eps: float) -> int:
    """Correct x by the matrix 1 - G' and G(x) in ``work``; returns `ASKED` if another iteration is needed."""
    x, g, kept = order + X, order + GX, order + KEPT
    for r in range(order):
        work[r, order] = work[g, r] - work[x, r]
        if not abs(work[r, order]) < np.inf:
            return NOT_FINITE
    if not gauss(work, order):
        return STALLED
    delta, length = 0.0, 0.0
    for r in range(order):
        work[x, r] = work[x, r] + work[r, order]
        delta += abs(work[r, order])
        length += abs(work[x, r])
    if not delta < np.inf:
        return NOT_FINITE
    if newton_converged(delta, work[kept, LAST], eps * length, eps * span):
        return SOLVED
    work[kept, LAST] = delta
    work[kept, MADE] += 1
    return STALLED if work[kept, MADE] == LIMIT else ASKED


@inline
def begin(work: np.ndarray, order: int) -> None:
    """Prepare `newton` for other equations, of ``order`` unknowns."""
    for k in range(NUMBERS):
        work[order + KEPT, k] = 0.0
    work[order + KEPT, LAST] = np.inf


#: The type of tables of numbers, the memory of kernels.
TABLE = types.Array(types.float64, 2, "C")
SIGNATURE = types.int64(TABLE, TABLE, types.int64, types.int64, types.int64, types.int64, *4 * (types.float64,))
