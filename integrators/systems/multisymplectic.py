r"""Multisymplectic equations :math:`K z_t + L z_x = \nabla S(z)` in one space dimension, discretized in space.

K and L are skew.  Three local laws hold at every point of space-time, for solutions U, V of the linearized equation:

.. math::
    (U^T K V)_t + (U^T L V)_x &= 0, \\
    (S - \tfrac12 z^T L z_x)_t + (\tfrac12 z^T L z_t)_x &= 0, \\
    (\tfrac12 z^T K z_x)_t + (S - \tfrac12 z^T K z_t)_x &= 0

(conservation of multisymplecticity, energy and momentum).  Here z = (y, w): y evolves in time, q before p, and w are
the slopes of the first components of y.

Space is a period of N cells.  There are two discretizations (*divisions*).  In both, w is a difference of y, w = D y,
and the derivative of w is :math:`-D^T w`, so that y obeys a canonical Hamiltonian system:

- `Box`, the midpoint rule in space: :math:`z_{m+1/2} = (\zeta_m + \zeta_{m+1})/2` and
  :math:`z_x = (\zeta_{m+1} - \zeta_m)/\Delta x`, with values :math:`\zeta_m` at the nodes and means z in the cells; N
  is odd, since only then do the means determine the values at the nodes;
- `Staggered`, the symplectic Euler rule in space: w is the backward difference of y, and the derivative of w is its
  forward difference; together they are the central second difference.  :math:`L_+` is the part of L that acts on w.

Source: T. J. Bridges, S. Reich, Phys. Lett. A 284 (2001) 184-193; B. Moore, S. Reich, Numer. Math. 95 (2003) 625-652.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phasebench.integrators.errors import InvalidInput


@dataclass(frozen=True)
class Equation:
    """A multisymplectic equation K z_t + L z_x = grad S(z) for z = (y, w); w are slopes in space of components of y.

    S is the sum of a function of y and a quadratic function of w.

    Attributes
    ----------
    K, L : skew matrices, arrays (n, n)
    S, gradient, hessian : functions of arrays z (..., n), with values of shape (...), (..., n) and (..., n, n)
    slopes : the number k of components of w; y has the other n - k, the first half of them q, the others p
    """

    K: np.ndarray
    L: np.ndarray
    S: Callable
    gradient: Callable
    hessian: Callable
    slopes: int

    @property
    def moving(self) -> int:
        """How many components of the unknown z evolve in time: those that are not slopes in space."""
        return len(self.K) - self.slopes


def _form(a: np.ndarray, B: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The bilinear form a^T B b in each cell, for arrays a, b of shape (..., n)."""
    return np.einsum("...i,ij,...j->...", a, B, b)


@dataclass(frozen=True)
class Division:
    """A discretization of an ``equation`` on a periodic interval of ``N`` cells of width ``dx``.

    It is the base class of `Box` and `Staggered`.  States are arrays with cells and components as their last two axes.
    """

    equation: Equation
    N: int
    dx: float

    def __post_init__(self) -> None:
        """Raise InvalidInput unless there are at least 3 cells of positive width."""
        if int(self.N) != self.N or self.N < 3 or not self.dx > 0:
            raise InvalidInput(f"{self.N} cells of width {self.dx}: at least 3 of positive width are needed")

    def lift(self, y: np.ndarray) -> np.ndarray:
        """The variables z = (y, w) in each cell, from arrays y (..., N, m) of the m components that evolve in time.

        w are the slopes in space of the first components of y, as many as the equation has.
        """
        return np.concatenate([y, self.slope(y[..., : self.equation.slopes])], axis=-1)

    @cached_property
    def _parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Blocks of the matrices of the equation: (the inverse of K's block that acts on y, L's block from w to y)."""
        m = self.equation.moving
        return np.linalg.inv(self.equation.K[:m, :m]), self.equation.L[:m, m:]

    @cached_property
    def _second(self) -> np.ndarray:
        """The matrix -D^T D of the second difference in space, D being that of the slope."""
        D = self.slope(np.eye(self.N))
        return -D.T @ D

    def field(self, y: np.ndarray) -> np.ndarray:
        """The right-hand side of the equation discretized in space: y_t, at y (N, m), m components in N cells."""
        inverse, L = self._parts
        z = self.lift(y)
        force = self.equation.gradient(z)[..., : y.shape[-1]] - self.back(z[..., y.shape[-1] :]) @ L.T
        return force @ inverse.T

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        """The Jacobian matrix of `field`, (N m, N m), at y (N, m), the state of N cells with m components each."""
        m, k = self.equation.moving, self.equation.slopes
        inverse, L = self._parts
        local = inverse @ self.equation.hessian(self.lift(y))[:, :m, :m]
        full = np.einsum("ij,ab->iajb", self._second, -inverse @ L @ np.eye(k, m))
        cells = np.arange(self.N)
        full[cells, :, cells, :] += local
        return full.reshape(self.N * m, self.N * m)

    def divergence(self, flux: np.ndarray) -> np.ndarray:
        """The discrete divergence, array (..., N), of a flux (..., N) through the left ends of the cells."""
        return (np.roll(flux, -1, axis=-1) - flux) / self.dx

    def total_energy(self, y: np.ndarray) -> float:
        """The sum of the energy density over the cells, times their width."""
        return float(self.energy(self.lift(y)).sum() * self.dx)


class Box(Division):
    """The midpoint rule in space: unknowns are means over cells, fluxes are taken at the nodes, the ends of cells."""

    def __post_init__(self) -> None:
        """Raise InvalidInput for an even number of cells: then values in cells do not determine those at nodes."""
        super().__post_init__()
        if self.N % 2 == 0:
            raise InvalidInput(f"the box scheme on a period needs an odd number of cells, not {self.N}")

    @cached_property
    def _inverse(self) -> np.ndarray:
        """The inverse, array (N, N), of the matrix that averages neighbouring values; its entries are 1 and -1."""
        return np.linalg.inv((np.eye(self.N) + np.roll(np.eye(self.N), 1, axis=1)) / 2).round()

    def nodes(self, z: np.ndarray) -> np.ndarray:
        """The values of z at the cells' left ends, from z in the cells.

        The values are means of neighbouring cells plus a correction of the size of the second difference; the
        alternating sum of z, which gives them directly, would lose digits.
        """
        left, right = np.roll(z, 1, axis=-2), np.roll(z, -1, axis=-2)
        return (left + z) / 2 - self._inverse @ ((right - z) - (z - left)) / 4

    def slope(self, z: np.ndarray) -> np.ndarray:
        """The space derivative of z in each cell: z at its right end minus z at its left end, divided by its width."""
        return self.nodes((np.roll(z, -1, axis=-2) - z) / self.dx)

    back = slope

    def two_form(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The flux u^T L v of the symplectic form through the left ends of the cells; u, v are tangents in the cells.

        Tangents are solutions of the linearized equation, arrays (..., N, n).
        """
        return _form(self.nodes(u), self.equation.L, self.nodes(v))

    def energy(self, z: np.ndarray) -> np.ndarray:
        """The energy density S - z^T L z_x / 2 in each cell."""
        return self.equation.S(z) - _form(z, self.equation.L, self.slope(z)) / 2

    def energy_flux(self, z: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The energy flux z^T L z_t / 2 through the left ends of the cells; ``rate`` is z_t."""
        return _form(self.nodes(z), self.equation.L, self.nodes(rate)) / 2

    def momentum(self, z: np.ndarray) -> np.ndarray:
        """The momentum density z^T K z_x / 2 in each cell."""
        return _form(z, self.equation.K, self.slope(z)) / 2

    def momentum_flux(self, z: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The momentum flux S - z^T K z_t / 2 through the left ends of the cells; ``rate`` is z_t."""
        z = self.nodes(z)
        return self.equation.S(z) - _form(z, self.equation.K, self.nodes(rate)) / 2


class Staggered(Division):
    """The symplectic Euler rule in space: w in a cell is the slope of y between it and the cell on its left."""

    def slope(self, z: np.ndarray) -> np.ndarray:
        """The backward difference of z in space (from the cell on the left), divided by the width of a cell."""
        return (z - np.roll(z, 1, axis=-2)) / self.dx

    def back(self, w: np.ndarray) -> np.ndarray:
        """The forward difference of w in space (to the cell on the right), divided by the width of a cell."""
        return (np.roll(w, -1, axis=-2) - w) / self.dx

    @cached_property
    def _upper(self) -> np.ndarray:
        """The matrix L_+: the block of the equation's matrix L that acts on the slopes w, with zeros elsewhere."""
        m = self.equation.moving
        upper = np.zeros_like(self.equation.L)
        upper[:m, m:] = self.equation.L[:m, m:]
        return upper

    def _across(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The bilinear form a^T L_+ b (..., N) for each cell, with b in the cell and a in the cell on its left."""
        return _form(np.roll(a, 1, axis=-2), self._upper, b)

    def two_form(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The flux of the symplectic form of two tangents u, v, as of `Box`."""
        return self._across(u, v) - self._across(v, u)

    def energy(self, z: np.ndarray) -> np.ndarray:
        """The energy density S + z_x^T L_+ z in each cell."""
        return self.equation.S(z) + _form(self.slope(z), self._upper, z)

    def energy_flux(self, z: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The energy flux -z_t^T L_+ z through the left ends of the cells; ``rate`` is z_t, of the cell on the left."""
        return -self._across(rate, z)

    def momentum(self, z: np.ndarray) -> np.ndarray:
        """The momentum density z^T K z_x / 2 in each cell, with z_x by central differences."""
        return _form(z, self.equation.K, (self.slope(z) + self.back(z)) / 2) / 2

    def momentum_flux(self, z: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """The momentum flux S - z^T K z_t / 2 through the left ends of the cells; ``rate`` is z_t.

        There y is the mean of the two cells that meet; w is the cell's own, since as a backward difference it belongs
        to this end.
        """
        m = self.equation.moving
        z, rate = z.copy(), rate.copy()
        for x in (z, rate):
            x[..., :m] = (x[..., :m] + np.roll(x[..., :m], 1, axis=-2)) / 2
        return self.equation.S(z) - _form(z, self.equation.K, rate) / 2
