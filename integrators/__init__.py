"""Geometric integrators of Hamiltonian systems: the methods, and the functions that run them.

>>> from phasebench.integrators import Hamiltonian, integrate
>>> pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
>>> solution = integrate(pendulum, "scheme-i", h=0.01, t_end=1.0, q0=[1.0], p0=[0.0])
>>> solution.status
'ok'
"""

from __future__ import annotations

from phasebench.integrators.compile import lazy as _lazy

_HOMES = {
    "ConstrainedHamiltonian": "systems.constrained",
    "Ensemble": "ensemble",
    "Hamiltonian": "systems.hamiltonian",
    "PartitionedSystem": "systems.hamiltonian",
    "RigidBody": "systems.rigid",
    "SplitHamiltonian": "systems.parts",
    "InvalidInput": "errors",
    "METHODS": "registry",
    "Method": "record",
    "Solution": "solution",
    "TransformedHamiltonian": "systems.transformed",
    "integrate": "driver",
    "integrate_ensemble": "ensemble",
    "method": "registry",
    "prepare": "prepared",
}
__all__ = sorted(_HOMES)


# Numba loads only when a system or a kernel is asked for.
__getattr__ = _lazy.attributes(__name__, _HOMES)
