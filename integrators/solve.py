r"""The solver of the stage equations :math:`x = G(x)`: to round-off, by fixed point, by Newton where that fails.

Fixed point: iterate until the increment can fall no further.  With :math:`\delta_k = \|x_{k+1} - x_k\|` and
:math:`\theta = \delta_k / \delta_{k-1}` the remaining error is about :math:`\delta_k\theta/(1 - \theta)`; below the
unit round-off of x there is nothing left to gain.  Where the iteration does not contract, Newton's method takes over
on :math:`x - G(x)`, with a difference Jacobian (its error only slows the convergence: the residual is exact).

The start is extrapolated from earlier steps through a table of backward differences (`predict`, `remember`).

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

import numpy as np

from .vector import axpy, bump, distance, jit, load, minus, plus, size, store

SOLVED, STALLED, NOT_FINITE = 0, 1, 2

#: The table of backward differences has this many rows: the start is a polynomial of degree LEVELS - 1 in time.
LEVELS = 5
FIXED_POINT_LIMIT = 40
NEWTON_LIMIT = 25


@jit
def predict(memory, slot, slots, known, like):
    """The start for the equation ``slot`` of ``slots``, extrapolated from ``known`` earlier steps (0: zero)."""
    x = load(memory, slot, like)
    for level in range(1, min(known, LEVELS)):
        x = plus(x, load(memory, level * slots + slot, like))
    return x


@jit
def remember(memory, slot, slots, x):
    """Enter the solution x of equation ``slot`` into the table of backward differences."""
    for level in range(LEVELS):
        old = load(memory, level * slots + slot, x)
        store(memory, level * slots + slot, x)
        x = minus(x, old)


@jit
def _gauss(A, n):
    """Solve in place the n equations in the rows of A, right-hand side in column n; False where singular."""
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


def solver(G):
    """The solver of x = G(x, arguments): a function (arguments, start, scale, eps, work) -> (x, evaluations, Newton
    used: 0 or 1, status)."""

    @jit
    def newton(arguments, x, scale, eps, work):
        """Newton's method on x - G(x) with a difference Jacobian; returns (x, evaluations of G, status).

        ``work`` is an array of at least (n + 1, n + 1) numbers, ``scale`` the size of the variables in which G varies.
        """
        n = len(x)
        step = eps**0.5 * scale
        last = np.inf
        evaluations = 0
        for _ in range(NEWTON_LIMIT):
            g = G(x, arguments)
            for i in range(n):
                column = minus(G(bump(x, i, step), arguments), g)
                store(work, n, column)
                for j in range(n):
                    work[j, i] = (1.0 if i == j else 0.0) - work[n, j] / step
            evaluations += n + 1
            store(work, n, minus(g, x))
            for j in range(n):
                work[j, n] = work[n, j]
            if not size(x) < np.inf:
                return x, evaluations, NOT_FINITE
            if not _gauss(work, n):
                return x, evaluations, STALLED
            for j in range(n):
                work[n, j] = work[j, n]
            new = plus(x, load(work, n, x))
            delta = distance(new, x)
            x = new
            if not delta < np.inf:
                return x, evaluations, NOT_FINITE
            unit = eps * size(x)
            if delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * eps * (size(x) + scale)):
                return x, evaluations, SOLVED
            last = delta
        return x, evaluations, STALLED

    @jit
    def solve(arguments, x, scale, eps, work):
        """Solve x = G(x, arguments) from the start x; returns (x, evaluations of G, Newton used: 0 or 1, status)."""
        start = x
        last = np.inf
        growth = 0
        k = 0
        while k < FIXED_POINT_LIMIT and growth < 2:
            new = G(x, arguments)
            delta = distance(new, x)
            x = new
            k += 1
            if not delta < np.inf:
                break
            unit = eps * size(x)
            if delta <= unit:
                return x, k, 0, SOLVED
            if delta < last:
                if last < np.inf and delta * delta <= 0.25 * unit * (last - delta):
                    return x, k, 0, SOLVED
            elif delta <= 64 * (unit + eps * scale):
                return x, k, 0, SOLVED
            else:
                growth += 1
            last = delta
        new, evaluations, status = newton(arguments, start, scale, eps, work)
        if status != SOLVED and size(x) < np.inf:
            new, more, status = newton(arguments, axpy(0.0, start, x), scale, eps, work)
            evaluations += more
        return new, k + evaluations, 1, status

    return solve
