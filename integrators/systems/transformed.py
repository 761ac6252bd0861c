r"""Poincare's transformation of time: fixed steps of the transformed Hamiltonian are variable steps in time.

.. math::
    K(q, t, p, p_t) = \sigma(q)\,\bigl(H(q, p) + p_t\bigr),\qquad \frac{dt}{d\tau} = \sigma(q),

with time as one more coordinate and, as its momentum, minus the energy.  Started with :math:`p_t = -H(q_0, p_0)`, so
that K = 0, the flow of K in the fictitious time :math:`\tau` passes through the states of the flow of H.  K is a
Hamiltonian like any other: a symplectic method is symplectic in this extended phase space, its step h is a step of
:math:`\tau`, and the time of a stored state is its last coordinate.  K is not separable, whatever H is.

Source: K. Zare, V. Szebehely, Celest. Mech. 11 (1975) 469-482; E. Hairer, Appl. Numer. Math. 25 (1997) 219-227; S.
Reich, SIAM J. Numer. Anal. 36 (1999) 1549-1570.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

from .hamiltonian import Hamiltonian
from .singularities import size, steering_distances

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from .hamiltonian import Formula, PartitionedSystem


def distance_scale(system: PartitionedSystem) -> sp.Expr:
    r"""The default scale of time :math:`\sigma = (\sum_k r_k^{-3})^{-1/2}`, an expression in the coordinates.

    The r_k are the distances to the singularities of the system.  Raises InvalidInput if there are none,
    or if they are not formulae.
    """
    distances = steering_distances(system)
    if not distances or not all(isinstance(r, sp.Expr) for r in distances):
        raise InvalidInput("the system has no distances to singularities as formulae; give the scale of time")
    return 1 / sp.sqrt(sum(size(r) ** -3 for r in distances))


class TransformedHamiltonian(Hamiltonian):
    """The canonical system of K = sigma (H + p_t), in which time is transformed: dt/dtau = sigma.

    Its coordinates are those of H and the time t, its momenta those of H and p_t, which is minus the energy.

    Parameters
    ----------
    system : Hamiltonian, the system of H, of d degrees of freedom; the transformed system has d + 1
    scale : expression or formula in the coordinates, positive: sigma; default `distance_scale`

    Raises
    ------
    InvalidInput
        If the system is not canonical, or the scale has other symbols than its coordinates.
    """

    def __init__(self, system: Hamiltonian, scale: Formula | None = None) -> None:
        if not system.canonical:
            raise InvalidInput("only a canonical system has a transformed Hamiltonian")
        self.original = system
        self.time_scale = distance_scale(system) if scale is None else system._formula(scale)
        if self.time_scale.free_symbols - {*system.q}:
            raise InvalidInput(f"the scale of time is {self.time_scale}; it must be a formula in the coordinates alone")
        t, minus_energy = (sp.Symbol(name, real=True) for name in ("time_", "minus_energy_"))
        super().__init__(
            q=[*system.q, t],
            p=[*system.p, minus_energy],
            H=self.time_scale * (system.H + minus_energy),
            singular=system.singular,
            invariants=system.invariants,
        )
        self.softened = system.softened

    def start(self, q0: ArrayLike, p0: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """The initial state (q0, t = 0), (p0, -H) of this system from the original one's, arrays (d + 1,)."""
        q, p = np.asarray(q0, float), np.asarray(p0, float)
        H = self.original.observe(self.original.H, q[None], p[None])[0]
        return np.append(q, 0.0), np.append(p, -H)
