r"""Recognizes systems :math:`H = |p|^2/2 + V(q)` with a potential that packages of galactic dynamics have compiled.

Two kinds of potential occur among the problems here: sums of powers of the distance,
:math:`V = \sum_k c_k |q|^{a_k}` (harmonic, Kepler, its Schwarzschild term), and Henon and Heiles's.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


def unit_mass(system: PartitionedSystem) -> bool:
    """True if H = |p|^2 / 2 + V(q)."""
    return getattr(system, "unit_mass", False)


@lru_cache(maxsize=64)
def powers(system: PartitionedSystem) -> tuple[tuple[float, float], ...] | None:
    """Pairs (c, a) with V = sum c |q|^a up to a constant; None if V does not have this form."""
    if not unit_mass(system) or system.d > 3:
        return None
    import sympy as sp

    V, r = system.potential, sp.Symbol("r", positive=True)
    along = sp.expand(V.subs({x: r if i == 0 else 0 for i, x in enumerate(system.q)}))
    pairs = [term.as_coeff_exponent(r) for term in sp.Add.make_args(along)]
    if any(c.free_symbols or not a.is_number for c, a in pairs):
        return None
    everywhere = along.subs(r, sp.sqrt(sum(x**2 for x in system.q)))
    if sp.expand(V - everywhere) != 0:
        return None
    return tuple((float(c), float(a)) for c, a in pairs if a != 0 and c != 0)


@lru_cache(maxsize=64)
def is_henon_heiles(system: PartitionedSystem) -> bool:
    """True if V = (q1^2 + q2^2) / 2 + q1^2 q2 - q2^3 / 3."""
    if not unit_mass(system) or system.d != 2:
        return False
    import sympy as sp

    x, y = system.q
    return sp.expand(system.potential - (x**2 + y**2) / 2 - x**2 * y + y**3 / 3) == 0
