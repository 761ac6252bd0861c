"""Right-hand sides for solvers that call a Python function of y = (q, p): all of y', or V'(q) and T'(p) apart."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem
    from phasebench.integrators.values.kinds import Value

#: Size of the cache of compiled right-hand sides.
KEPT = 128


@lru_cache(maxsize=KEPT)
def compiled_field(system: PartitionedSystem) -> Callable[[float, np.ndarray], np.ndarray]:
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
    def f(t: float, y: np.ndarray) -> np.ndarray:
        q, p = halves(np.ascontiguousarray(y).reshape(2, d))
        dq, dp = field(q, p, 0.0, 0.0)
        out = np.empty(2 * d)
        for i in range(d):
            out[i], out[d + i] = dq[i], dp[i]
        return out

    return f


def right_hand_side(system: PartitionedSystem) -> Callable[[float, np.ndarray], np.ndarray]:
    """A function (t, y) -> y' on arrays (2 d,): compiled, unless compilation is disabled."""
    from phasebench.integrators.compile import codegen

    return compiled_field(system) if codegen.compiled() else system.vector_field()


@lru_cache(maxsize=KEPT)
def split_gradients(system: Hamiltonian) -> tuple[Callable[[np.ndarray], Value], Callable[[np.ndarray], Value]]:
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
