r"""The largest Lyapunov exponent of an orbit, from its rows alone: the tangent map is integrated along them.

Between two rows the tangent map solves :math:`\dot M = A(t) M`, :math:`A` the Jacobian of the vector field.  It is
approximated by one step of the Magnus series of order 4 (W. Magnus, Comm. Pure Appl. Math. 7 (1954) 649-673; S. Blanes,
F. Casas, J. A. Oteo, J. Ros, Phys. Rep. 470 (2009) 151-238, eq. (254)), with A at the row, at the middle (a cubic
through the two rows and their velocities) and at the next row:

.. math:: M = \exp\bigl(\tfrac h6 (A_0 + 4 A_1 + A_2) + \tfrac{h^2}{12}[A_2, A_0]\bigr).

The exponent is :math:`\ln\|M_n\cdots M_1\| / t`; products are taken pairwise and rescaled.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: Terms of the exponential series after scaling, and the number of squarings.
TERMS, SQUARINGS = 8, 4


@lru_cache(maxsize=16)
def _derivatives(
    system: PartitionedSystem,
) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]:
    """The vector field (2 d, n) and its Jacobian (n, 2 d, 2 d), functions of states (2 d, n)."""
    variables = [*system.q, *system.p]
    field = sp.Matrix([*system.dq, *system.dp])
    jacobian = field.jacobian(variables)
    f = sp.lambdify(variables, list(field), modules="numpy", cse=True)
    J = sp.lambdify(variables, list(jacobian), modules="numpy", cse=True)
    m = len(variables)

    def stack(function: Callable[..., Any], y: np.ndarray) -> np.ndarray:
        return np.stack([np.broadcast_to(x, y.shape[1]).astype(float) for x in function(*y)], axis=-1)

    return lambda y: stack(f, y).T, lambda y: stack(J, y).reshape(-1, m, m)


def exponent(system: PartitionedSystem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> float:
    """Return the largest Lyapunov exponent of an orbit from rows t (n,), q and p (n, d); NaN if one is not finite."""
    if not (np.isfinite(q).all() and np.isfinite(p).all()):
        return float("nan")
    return _log_norm(tangent_maps(system, t, q, p)) / np.abs(t[-1] - t[0])


def tangent_maps(system: PartitionedSystem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the tangent maps from row to row, array (n - 1, 2 d, 2 d), of rows t (n,), q and p (n, d)."""
    y = np.concatenate([q, p], axis=1).T
    field, jacobian = _derivatives(system)
    h = np.diff(t)
    v = field(y)
    middle = (y[:, :-1] + y[:, 1:]) / 2 + h / 8 * (v[:, :-1] - v[:, 1:])
    A = jacobian(y)
    first, last = A[:-1], A[1:]
    h = h[:, None, None]
    omega = h / 6 * (first + 4 * jacobian(middle) + last) + h**2 / 12 * (last @ first - first @ last)
    return _exp(omega)


def _exp(X: np.ndarray) -> np.ndarray:
    """Return the exponentials of n matrices, array (n, m, m), by scaling and squaring of the power series."""
    X = X / 2.0**SQUARINGS
    out = term = np.broadcast_to(np.eye(X.shape[1]), X.shape)
    for k in range(1, TERMS + 1):
        term = term @ X / k
        out = out + term
    for _ in range(SQUARINGS):
        out = out @ out
    return out


def _log_norm(M: np.ndarray) -> float:
    """Return the logarithm of the Frobenius norm of the product M[n-1] ... M[0]; M has shape (n, m, m)."""
    logs = np.zeros(len(M))
    while True:
        size = np.linalg.norm(M, axis=(1, 2))
        M, logs = M / size[:, None, None], logs + np.log(size)
        if len(M) == 1:
            return float(logs[0])
        if len(M) % 2:
            M, logs = np.append(M, [np.eye(M.shape[1])], axis=0), np.append(logs, 0.0)
        M, logs = M[1::2] @ M[::2], logs[1::2] + logs[::2]
