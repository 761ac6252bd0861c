r"""Structural defects of a step Phi_h, a map of states y = (q, p), array (2 d,), in doubles or multiprecision numbers.

- symplecticity: :math:`\max|M^TJM - J|`, M the Jacobian by differences; in high dimensions
  :math:`|\omega(Mu, Mv) - \omega(u, v)|` for pairs of vectors u, v in general position;
- symmetry: :math:`\Phi_{-h}(\Phi_h(y)) - y`;
- reversibility: :math:`\rho\Phi_h(\rho\Phi_h(y)) - y`;
- volume: :math:`\det M - 1`.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), V.1 and VI.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.integrators.values.kinds import Number


def jacobian(step: Callable, y: ArrayLike, delta: Number | None = None) -> np.ndarray:
    """Return the Jacobian (m, m) of a map ``step`` on arrays (m,) at y, by fourth-order central differences.

    ``delta`` is the displacement, by default the fifth root of the round-off of doubles; the error is then about 1e-12
    times the fifth derivative.  For multiprecision (object arrays) pass the fifth root of the round-off there.
    """
    y = np.asarray(y)
    delta = np.finfo(float).eps ** 0.2 if delta is None else delta
    return np.array([derivative(step, y, e, delta) for e in np.eye(len(y), dtype=y.dtype)]).T


def form_residual(M: ArrayLike) -> np.ndarray:
    """Return M^T J M - J for M of shape (2 d, 2 d) in the order (q, p); raise ValueError for other shapes."""
    M = np.asarray(M)
    d, odd = divmod(len(M), 2)
    if M.ndim != 2 or M.shape[0] != M.shape[1] or odd:
        raise ValueError(f"a symplectic matrix has shape (2 d, 2 d), not {M.shape}")
    J = np.kron(np.array([[0, 1], [-1, 0]]), np.eye(d, dtype=int))
    return M.T @ (J @ M) - J


def symplecticity_defect(M: ArrayLike) -> Number:
    """Return the largest |M^T J M - J| over the entries, for M of shape (2 d, 2 d) in the order (q, p)."""
    return np.max(np.abs(form_residual(M)))


def symplecticity(step: Callable, y: ArrayLike, *displacements: Number) -> tuple[float, float]:
    """Return (max |M^T J M - J|, its change from the first to the last displacement of the differences)."""
    residuals = [form_residual(jacobian(step, y, delta)) for delta in displacements]
    return float(np.abs(residuals[0]).max()), float(np.abs(residuals[-1] - residuals[0]).max())


def determinant(M: ArrayLike) -> Number:
    """Return the determinant of M, an array (m, m) of doubles or multiprecision numbers, by elimination with pivots."""
    M, found = np.array(M), 1
    for k in range(len(M)):
        pivot = k + int(np.argmax(np.abs(M[k:, k])))
        if M[pivot, k] == 0:
            return 0 * M[pivot, k]
        if pivot != k:
            M[[k, pivot]], found = M[[pivot, k]], -found
        found = found * M[k, k]
        M[k + 1 :] = M[k + 1 :] - np.multiply.outer(M[k + 1 :, k] / M[k, k], M[k])
    return found


def volume(step: Callable, y: ArrayLike, *displacements: Number) -> tuple[float, float]:
    """Return (|det M - 1|, its change from the first to the last displacement of the differences)."""
    found = [determinant(jacobian(step, y, delta)) - 1 for delta in displacements]
    return float(abs(found[0])), float(abs(found[-1] - found[0]))


def restricted(step: Callable, retract: Callable, y: ArrayLike, delta: Number | None = None) -> np.ndarray:
    """Return M^T J M - N^T J N, array (2 d, 2 d): how a step changes the two-form on a manifold.

    ``retract`` maps states near y to the manifold; N is its Jacobian at y, M that of ``step`` after ``retract``.
    """
    M, N = jacobian(lambda x: step(retract(x)), y, delta), jacobian(retract, y, delta)
    return form_residual(M) - form_residual(N)


def pair_symplecticity(
    step: Callable, y: np.ndarray, pairs: Sequence[tuple[np.ndarray, np.ndarray]], *displacements: Number
) -> tuple[float, float]:
    """Measure by how much a step changes the canonical two-form: omega(M u, M v) - omega(u, v), M its Jacobian at y.

    The change is relative to the sizes of the terms of omega, for pairs (u, v) of arrays (2 d,) of the size of y.
    Returns (largest over the pairs with the first displacement, largest difference with the last).
    """
    d, found = len(y) // 2, []
    for u, v in pairs:
        for delta in displacements:
            Mu, Mv = (derivative(step, y, w, delta) for w in (u, v))
            terms = abs(Mu[:d]) @ abs(Mv[d:]) + abs(Mu[d:]) @ abs(Mv[:d]) + abs(u[:d]) @ abs(v[d:])
            change = Mu[:d] @ Mv[d:] - Mu[d:] @ Mv[:d] - (u[:d] @ v[d:] - u[d:] @ v[:d])
            found.append(float(change / terms))
    defects = np.reshape(found, (len(pairs), len(displacements)))
    return float(np.abs(defects[:, 0]).max()), float(np.abs(defects[:, -1] - defects[:, 0]).max())


def derivative(step: Callable, y: np.ndarray, w: np.ndarray, delta: Number) -> np.ndarray:
    """Return the derivative of a map at y along w, by fourth-order central differences with displacement delta."""
    near = step(y + delta * w) - step(y - delta * w)
    far = step(y + 2 * delta * w) - step(y - 2 * delta * w)
    return (8 * near - far) / (12 * delta)


def pair_defect(step: Callable, y: np.ndarray, retract: Callable | None = None) -> Number:
    """Return |omega(M u, M v) - omega(u, v)| for one pair of vectors in general position, M a step's Jacobian at y.

    ``retract``, if given, maps states near y to a manifold, to which u and v are made tangent.  The vectors are of the
    size of y, the defect is relative to the terms of omega(u, v).  It takes second-order central differences with the
    cube root of mpmath's working precision: four steps in any dimension.
    """
    import mpmath

    from phasebench.integrators.compile.codegen import MULTIPRECISION, epsilon, vector

    d, delta = len(y) // 2, epsilon(MULTIPRECISION) ** (1 / 3)
    u, v = (vector([mpmath.cos(k * (i + 1)) * (abs(x) or 1) for i, x in enumerate(y)]) for k in (1, 2))
    if retract is not None:
        whole, inner = step, retract
        u, v = ((inner(y + delta * w) - inner(y - delta * w)) / (2 * delta) for w in (u, v))
        step = lambda x: whole(inner(x))  # noqa: E731
    Mu, Mv = ((step(y + delta * w) - step(y - delta * w)) / (2 * delta) for w in (u, v))
    terms = abs(u[:d]) @ abs(v[d:]) + abs(u[d:]) @ abs(v[:d])
    return abs(Mu[:d] @ Mv[d:] - Mu[d:] @ Mv[:d] - (u[:d] @ v[d:] - u[d:] @ v[:d])) / terms


def return_distance(there: Callable, back: Callable, y: np.ndarray, sizes: float | np.ndarray = 1) -> Number:
    """Return the max norm of back(there(y)) - y, with components in units of ``sizes``."""
    return np.max(np.abs((back(there(y)) - y) / sizes))


def reversibility_defect(
    step: Callable, y: ArrayLike, rho: np.ndarray | None = None, sizes: float | np.ndarray = 1
) -> Number:
    """Return the max norm of rho(step(rho(step(y)))) - y, 0 for a reversible step; components in units of ``sizes``.

    ``rho`` (m,) has the signs +-1 of the components of y (m,); by default it reverses p.
    """
    y = np.asarray(y)
    rho = np.repeat([1, -1], len(y) // 2) if rho is None else rho
    return return_distance(step, lambda z: rho * step(rho * z), y, sizes)
