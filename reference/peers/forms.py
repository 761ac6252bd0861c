r"""What the formula of a system is to a package: bodies under gravity, particles with masses, a known potential.

REBOUND's particles, :math:`\ddot x_i = a_i(x)` in space, represent a system in one of three ways (`settings`):

- `CENTRAL`: :math:`H = |p|^2/(2m) - m\mu/|q| + U(q)` with a declared Kepler part is a massless particle around a body
  of mass :math:`\mu` at rest in the origin, with the extra force :math:`-\nabla U`;
- `GRAVITY`: :math:`H = \sum_i |p_i|^2/(2m_i) - \sum_{i<j} G m_i m_j/|q_i - q_j|` is N bodies under REBOUND's own
  gravity, in the frame of the data;
- `POTENTIAL`: any :math:`H = \sum_i p_i^2/(2m_i) + V(q)` is :math:`\lceil d/3 \rceil` massless particles whose
  coordinates, three by three, are q (unused ones stay 0), with the extra force :math:`-V_{q_i}/m_i`.

Packages of molecular dynamics take :math:`H = \sum_i p_i^2/(2m_i) + V(q)` as particles on parallel lines (`ON_LINES`).
Packages of galactic dynamics have potentials compiled, of which two kinds are among the problems here: sums of powers
of the distance, :math:`V = \sum_k c_k |q|^{a_k}` (harmonic, Kepler, its Schwarzschild term), and Henon and Heiles's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from .record import only

if TYPE_CHECKING:
    import sympy as sp

    from phasebench.integrators.systems.hamiltonian import Hamiltonian, PartitionedSystem

CENTRAL, GRAVITY, POTENTIAL = "a central body", "gravity between bodies", "a potential"


@dataclass(frozen=True)
class Setting:
    """The representation of a system by REBOUND's particles.

    Attributes
    ----------
    kind : `CENTRAL`, `GRAVITY` or `POTENTIAL`
    masses : of the particles, including the body at rest
    dimension : number of coordinates of the system per particle
    first : index of the particle with the first coordinates
    inverse : d numbers; the velocity of q_i is inverse[i] p_i
    G : the gravitational constant
    gradient : () -> the compiled gradient of the extra potential, a function q -> (d,); None without extra force
    """

    kind: str
    masses: tuple[float, ...]
    dimension: int
    first: int
    inverse: tuple[float, ...]
    G: float = 1.0
    gradient: Callable | None = None

    def place(self, i: int) -> tuple[int, int]:
        """Where coordinate i is among the particles: (index of the particle, axis 0, 1 or 2)."""
        return self.first + i // self.dimension, i % self.dimension

    @cached_property
    def places(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Where all coordinates are among the particles, as indices of an array (particles, 3)."""
        particles, axes = zip(*map(self.place, range(len(self.inverse))), strict=True)
        return particles, axes


def _mass_and_terms(system: PartitionedSystem) -> tuple[tuple[sp.Expr | int, ...], list[sp.Expr]] | None:
    """(the exact numbers 1/m_i, the terms of V) of H = sum p_i^2 / (2 m_i) + V(q); None for other forms of H."""
    import sympy as sp

    if not system.quadratic_kinetic:
        return None
    if not isinstance(system.H, sp.Basic):  # a system given by hand-written loops, without a formula
        return ((1,) * system.d, []) if system.unit_mass else None
    momenta, coordinates, T, V = set(system.p), set(system.q), [], []
    for term in sp.Add.make_args(system.H):
        for part in sp.Add.make_args(sp.expand(term) if term.free_symbols & momenta else term):
            (T if part.free_symbols & momenta else V).append(part)
    if any(t.free_symbols & coordinates for t in T):
        return None
    double = sp.Poly(2 * sp.Add(*T), *system.p).as_dict()
    inverse = tuple(double.pop(tuple(int(x == y) * 2 for y in system.p), 0) for x in system.p)
    return None if double or 0 in inverse else (inverse, V)


def attracting(system: PartitionedSystem) -> tuple[list[sp.Expr], sp.Expr, int] | None:
    """(masses, G, dimension), exact, of a system of gravitating bodies; None for other systems."""
    split = _mass_and_terms(system)
    return None if split is None else _bodies(system.q, *split)


@lru_cache(maxsize=64)
def settings(system: PartitionedSystem) -> dict[str, Setting]:
    """The possible representations of a system by REBOUND's particles: kind -> `Setting`, most special kind first."""
    import sympy as sp

    split = _mass_and_terms(system)
    if split is None:
        return {}
    inverse, terms = split
    numbers, fitting = tuple(map(float, inverse)), {}
    part = system.kepler
    if part is not None and len(part.masses) == 1 and not part.change and part.mu[0] > 0:
        rest = sp.Add(*terms) - part.potential(system.q)
        gradient = (lambda: part.interaction(system)) if rest != 0 else None
        fitting[CENTRAL] = Setting(CENTRAL, (float(part.mu[0]), 0.0), part.dimension, 1, numbers, gradient=gradient)
    bodies = _bodies(system.q, inverse, terms)
    if bodies is not None:
        masses, G, dimension = bodies
        fitting[GRAVITY] = Setting(GRAVITY, tuple(map(float, masses)), dimension, 0, numbers, float(G))
    fitting[POTENTIAL] = Setting(POTENTIAL, (0.0,) * -(-system.d // 3), 3, 0, numbers, gradient=system.grad_V)
    return fitting


def _bodies(
    q: Sequence[sp.Symbol], inverse: Sequence[sp.Expr | int], terms: Sequence[sp.Expr]
) -> tuple[list[sp.Expr], sp.Expr, int] | None:
    """(masses, G, dimension) of gravitating bodies; None if the potential is not that of their gravity.

    ``q`` are the coordinates, ``inverse`` the numbers 1/m_i, one for each of them, and ``terms`` the terms of V.
    """
    for dimension in (3, 2):
        n, left = divmod(len(q), dimension)
        rows = [set(inverse[i * dimension : (i + 1) * dimension]) for i in range(n)]
        if left or n < 2 or any(len(row) > 1 for row in rows) or len(terms) != n * (n - 1) // 2:
            continue
        masses = [1 / row.pop() for row in rows]
        where = [q[i * dimension : (i + 1) * dimension] for i in range(n)]
        pairs = {_squares(zip(where[i], where[j], strict=True)): (i, j) for i, j in combinations(range(n), 2)}
        G = set()
        for term in terms:
            strength, rest = term.as_independent(*q, as_Add=False)
            i, j = pairs.pop(_differences(rest), (None, None))
            if i is None:
                break
            G.add(-strength / (masses[i] * masses[j]))
        if not pairs and len(G) == 1 and min(*masses, *G) > 0:
            return masses, G.pop(), dimension
    return None


def _squares(pairs: Iterable[tuple[sp.Expr, sp.Expr]]) -> frozenset:
    """A key for the sum of (a - b)^2 over pairs (a, b), which does not depend on the signs of the differences."""
    return frozenset(frozenset((a - b, b - a)) for a, b in pairs)


def _differences(e: sp.Expr) -> frozenset | None:
    """The key, as from `_squares`, of the sum of squares in an inverse distance; None for other expressions."""
    if not (e.is_Pow and 2 * e.exp == -1 and all(s.is_Pow and s.exp == 2 for s in e.base.args)):
        return None
    return frozenset(frozenset((s.base, -s.base)) for s in e.base.args)


# -- particles on parallel lines --------------------------------------------------------------------------------------

#: The fields of a `Peer` for particles with masses.
ON_LINES = only(
    "H = sum p_i^2 / 2 m_i + V(q)",
    "its particles have masses: H must be a sum of p_i^2 / 2 m_i, and V(q)",
    lambda system: system.canonical and system.separable and system.diagonal,
)


def masses(system: Hamiltonian) -> np.ndarray:
    """The masses m_i of a system H = sum p_i^2 / 2 m_i + V(q), array (d,)."""
    import sympy as sp

    return np.array([1 / float(sp.diff(v, p)) for v, p in zip(system.dq, system.p, strict=True)])


def on_lines(x: np.ndarray) -> np.ndarray:
    """Turn d numbers into positions or velocities of d particles on parallel lines: (d, 3), zero but for column 0."""
    places = np.zeros((len(x), 3))
    places[:, 0] = x
    return places


# -- potentials of galactic dynamics ----------------------------------------------------------------------------------


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
