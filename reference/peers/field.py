"""Right-hand sides for solvers that call a Python function of y = (q, p): y' whole, or its two halves."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

#: Size of the cache of compiled right-hand sides.
KEPT = 128


@lru_cache(maxsize=KEPT)
def compiled_field(system):
    """A compiled function (t, y) -> y' on arrays y = (q, p) of shape (2 d,); y need not be contiguous."""
    import numba
    from numba import float64

    from phasebench.integrators.compile import codegen
    from phasebench.integrators.values import vector

    field, d, load = system.field(), system.d, vector.load
    zero = (0.0,) * d
    if codegen.value_kind(d) == "tuple":
        halves = numba.njit(lambda rows: (load(rows, 0, zero), load(rows, 1, zero)))
    else:
        halves = numba.njit(lambda rows: (rows[0], rows[1]))

    @numba.njit([float64[::1](float64, float64[::1]), float64[::1](float64, float64[:])], error_model="numpy")
    def f(t, y):
        q, p = halves(np.ascontiguousarray(y).reshape(2, d))
        dq, dp = field(q, p, 0.0, 0.0)
        out = np.empty(2 * d)
        for i in range(d):
            out[i], out[d + i] = dq[i], dp[i]
        return out

    return f


def right_hand_side(system):
    """A function (t, y) -> y' on arrays (2 d,): compiled, unless compilation is disabled."""
    from phasebench.integrators.compile import codegen

    return compiled_field(system) if codegen.compiled() else system.vector_field()


@lru_cache(maxsize=KEPT)
def split_gradients(system):
    """Compiled functions y -> V'(q) and y -> T'(p) for H = T(p) + V(q), on arrays y = (q, p) of shape (2 d,)."""
    import numba

    from phasebench.integrators.compile import codegen
    from phasebench.integrators.values import vector

    d, load, zero = system.d, vector.load, (0.0,) * system.d
    grad_V, grad_T = system.grad_V(), system.grad_T() or numba.njit(lambda p: p)
    if codegen.compiled() and codegen.value_kind(d) == "tuple":
        half = numba.njit(lambda y, i: load(y.reshape(2, d), i, zero))
    else:
        half = numba.njit(lambda y, i: y.reshape(2, d)[i])
    slope = numba.njit(lambda y: grad_V(half(y, 0)))
    velocity = numba.njit(lambda y: grad_T(half(y, 1)))
    return slope, velocity
