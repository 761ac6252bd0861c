"""Find in a formula H its Kepler part, the sum of Kepler problems that Wisdom-Holman methods solve exactly."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING

from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.systems import deferred
from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

if TYPE_CHECKING:
    from phasebench.integrators.families.wisdom_holman import KeplerPart

#: A body is central if it is this many times as heavy as all others together.
HEAVY = 5


def with_kepler_part(system: PartitionedSystem, q0: Sequence[float]) -> PartitionedSystem:
    """Return a system with the Kepler part found in its H at q0, unless it declares one or none is found."""
    if not system.canonical or system.loops or system.kepler is not None:
        return system
    part = kepler_part(system, q0)
    if part is None:
        return system
    found = copy(system)
    vars(found).pop("traits", None)
    found.kepler, found.key = part, deferred.key_of(system.key, repr(part)) if system.key else ""
    return found


def kepler_part(system: Hamiltonian, q0: Sequence[float]) -> KeplerPart | None:
    """Return the Kepler part of a system that starts at q0; None if none is found in H.

    It is found for bodies about a much heavier one, and for one body about a centre at the origin.  Bodies that attract
    each other (coordinates body by body) get Jacobi's coordinates, in the order of their distance from the central one
    at q0.
    """
    from phasebench.reference.peers.forms import attracting

    found = attracting(system)
    if found is None:
        return _about_the_origin(system)
    from .gravity import kepler_part as jacobi

    masses, G, dimension = found
    centre = max(range(len(masses)), key=lambda i: masses[i])
    if not all(m.is_Rational for m in (*masses, G)) or masses[centre] < HEAVY * (sum(masses) - masses[centre]):
        return None
    return jacobi(masses, G, sorted(range(len(masses)), key=lambda i: _square(q0, i, centre, dimension)), dimension)


def _square(q0: Sequence[float], i: int, j: int, dimension: int) -> float:
    return sum((q0[dimension * i + k] - q0[dimension * j + k]) ** 2 for k in range(dimension))


def _about_the_origin(system: Hamiltonian) -> KeplerPart | None:
    """Return the Kepler part of H = p^2 / (2 m) - k / |q| + U(q) in the plane or in space; None for another H."""
    from phasebench.integrators.families.wisdom_holman import KeplerPart

    if system.d not in (2, 3) or not system.quadratic_kinetic:
        return None
    inverse = {sp.diff(v, p) for v, p in zip(system.dq, system.p, strict=True)}
    alone = all(v.free_symbols <= {p} for v, p in zip(system.dq, system.p, strict=True))
    mass = 1 / inverse.pop()
    if inverse or not alone or not (mass.is_Rational and mass > 0):
        return None
    r = sp.sqrt(sum(x**2 for x in system.q))
    k = -sum(c for c in (t * r for t in sp.Add.make_args(system.potential)) if not c.free_symbols)
    return KeplerPart(system.d, (mass,), (k / mass,)) if k != 0 and k.is_Rational and k > 0 else None
