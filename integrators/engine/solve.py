r"""The solver of the stage equations :math:`x = G(x)`: to round-off, by fixed point, by Newton where that fails.

Fixed point: iterate until the increment can fall no further.  With :math:`\delta_k = \|x_{k+1} - x_k\|` and
:math:`\theta = \delta_k / \delta_{k-1}` the remaining error is about :math:`\delta_k\theta/(1 - \theta)`; it is brought
far below the round-off of x, or until it no longer falls.  Where the iteration does not contract, Newton's method takes
over on :math:`x - G(x)`, with a difference Jacobian (its error only slows the convergence: the residual is exact).

The start is extrapolated from earlier steps (`predict`, `remember`).

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VIII.5-6.
"""

from __future__ import annotations

from math import comb

import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS

from .vector import axpy, bump, distance, inlined, jit, load, minus, plus, scale, size, store

SOLVED, STALLED, NOT_FINITE = 0, 1, 2

#: Row m: the weights of the last m solutions, newest first.
_EXTRAPOLATION = np.array(
    [[(-1) ** j * comb(m, j + 1) if j < m else 0 for j in range(LEVELS)] for m in range(LEVELS + 1)], dtype=float
)
FIXED_POINT_LIMIT = 40
#: The iteration's own error is brought to this share of round-off: it has a sign, and what has a sign adds up in time.
SHARE = 1e-3
NEWTON_LIMIT = 25


@inlined
def predict(memory, first, slots, known, like):
    """The start of an equation, extrapolated from its last solutions (at most LEVELS of ``known``; 0: zero).

    They are the rows first, first + slots, ... of ``memory``, a ring.  The newest is added last, so that a step's chain
    of operations waits for one product only.
    """
    m = min(known, LEVELS)
    x = scale(0.0, like)
    for back in range(LEVELS, 0, -1):
        row = first + (known - back) % LEVELS * slots
        x = axpy(_EXTRAPOLATION[m, back - 1], load(memory, row, like), x)
    return x


@inlined
def predict_number(memory, first, slots, known):
    """As `predict`, for a ring of numbers in the first column of ``memory``."""
    m = min(known, LEVELS)
    x = 0.0
    for back in range(LEVELS, 0, -1):
        x = x + _EXTRAPOLATION[m, back - 1] * memory[first + (known - back) % LEVELS * slots, 0]
    return x


@inlined
def remember(memory, first, slots, known, x):
    """Enter the solution x of the step after ``known`` others into its ring."""
    store(memory, first + known % LEVELS * slots, x)


@inlined
def settled(delta, last, length, span, eps):
    """Whether a fixed point is reached, by the last two changes.

    ``length`` is the size of the unknowns, ``span`` that of the variables in which their equation varies.
    """
    if delta == 0:
        return True
    if delta < last:
        return last < np.inf and delta * delta <= SHARE * (eps * length) * (last - delta)
    return delta <= 64 * (eps * length + eps * span)


@inlined
def confirmed(delta, last, length, span, eps):
    """Whether a finer quadrature changed nothing, and whether it changed nothing or round-off, by the last two changes.

    ``length`` and ``span`` are as in `settled`.  To be asked of q and p apart: where momenta are far smaller than
    coordinates, a joint norm hides their error.
    """
    sure = delta <= 16 * eps * length
    return sure, sure or (delta > 0.5 * last and delta <= 64 * eps * (length + span))


@inlined
def polished(delta, last, unit, noise):
    """Whether Newton's method is at its end, by the last two moves: at round-off, or near it and no longer falling."""
    return delta <= unit or (delta >= 0.5 * last and delta <= 1e3 * (unit + noise))


@jit
def gauss(A, n):
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
    """The solver of x = G(x, arguments): a function (arguments, start, span, eps, work) -> (x, evaluations, Newton
    used: 0 or 1, status)."""

    @jit
    def newton(arguments, x, span, eps, work):
        """Newton's method on x - G(x) with a difference Jacobian; returns (x, evaluations of G, status).

        ``work`` is an array of at least (n + 1, n + 1) numbers, ``span`` the size of the variables in which G varies.
        """
        n = len(x)
        step = eps**0.5 * span
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
            if not gauss(work, n):
                return x, evaluations, STALLED
            for j in range(n):
                work[n, j] = work[j, n]
            new = plus(x, load(work, n, x))
            delta = distance(new, x)
            x = new
            if not delta < np.inf:
                return x, evaluations, NOT_FINITE
            if polished(delta, last, eps * size(x), eps * span):
                return x, evaluations, SOLVED
            last = delta
        return x, evaluations, STALLED

    @inlined
    def solve(arguments, x, span, eps, work):
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
            # `settled`, written out: called it makes a step of Scheme I 6 % slower
            unit = eps * size(x)
            if delta == 0:
                return x, k, 0, SOLVED
            if delta < last:
                if last < np.inf and delta * delta <= SHARE * unit * (last - delta):
                    return x, k, 0, SOLVED
            elif delta <= 64 * (unit + eps * span):
                return x, k, 0, SOLVED
            else:
                growth += 1
            last = delta
        new, evaluations, status = newton(arguments, start, span, eps, work)
        if status != SOLVED and size(x) < np.inf:
            new, more, status = newton(arguments, axpy(0.0, start, x), span, eps, work)
            evaluations += more
        return new, k + evaluations, 1, status

    return solve
