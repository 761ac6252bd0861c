r"""Recognize the Hamiltonian of a charged particle in a magnetic field, and derive its fields E and B.

A Hamiltonian of d = 2 or 3 degrees of freedom is *magnetic* where it is

.. math::
    H = \frac{|p - A(x)|^2}{2m} + \phi(x)\qquad\text{or, relativistic,}\qquad
    H = c\sqrt{m^2c^2 + |p - A(x)|^2} + \phi(x)

with curl A not zero; the charge is within A and phi.  With :math:`p = mu + A(x)`,

.. math::
    \dot x = u/\gamma,\qquad \dot u = E(x) + \dot x\times B(x),\qquad
    E = -\nabla\phi/m,\quad B = \nabla\times A/m,\quad \gamma = \sqrt{1 + |u|^2/c^2}

(:math:`\gamma = 1` in the first case).  In the plane B is along z.  A frame that rotates with the angular velocity
:math:`\Omega` is a field :math:`B = 2\Omega`.

Adding to A a field whose curl is zero changes p and nothing else.  A map of (x, u) preserves volume if it does so in
(x, p), since p is u sheared and scaled; it preserves the two-form :math:`dx\wedge m\,du + B` (is *K-symplectic*) if it
is symplectic in (x, p).

Source: Y. He, Y. Sun, J. Liu, H. Qin, J. Comput. Phys. 281 (2015) 135-147; A. V. Higuera, J. R. Cary, Phys.
Plasmas 24 (2017) 052104.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import mpmath
from phasebench.integrators.compile.lazy import sympy as sp

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function

    from .hamiltonian import PartitionedSystem

#: The kinds of magnetic systems: the values of the trait.
CLASSICAL, RELATIVISTIC = "classical", "relativistic"
#: Fields of more operations than this are not simplified, which would take long.
LONG = 400
#: Digits of an irrational mass or speed of light.
DIGITS = 60


@dataclass(frozen=True)
class Particle:
    """The potentials and fields of a charged particle: expressions in its coordinates.

    Attributes
    ----------
    A, phi : the vector potential (d expressions) and the scalar potential, with the charge in both
    mass : the mass m
    slowness : 1 / c^2, with c the speed of light; 0 for a classical particle
    E, B : the electric and magnetic field, both divided by m, d expressions each; in the plane B is (B_z, 0)
    """

    A: tuple[Any, ...]
    phi: Any
    mass: Any
    slowness: Any
    E: tuple[Any, ...]
    B: tuple[Any, ...]

    @property
    def kind(self) -> str:
        """The form of the Hamiltonian: "relativistic" or "classical"."""
        return RELATIVISTIC if self.slowness else CLASSICAL


_particles: WeakKeyDictionary = WeakKeyDictionary()


def kind(system: PartitionedSystem) -> str:
    """The form of a Hamiltonian: "classical" or "relativistic"; "" if it is not a particle in a magnetic field."""
    found = particle(system)
    return found.kind if found else ""


def particle(system: PartitionedSystem) -> Particle | None:
    """The potentials and fields of a system, found in its H; None if it is no charged particle in a magnetic field."""
    if system not in _particles:
        _particles[system] = _recognize(system)
    return _particles[system]


def _recognize(system: PartitionedSystem) -> Particle | None:
    if not system.canonical or system.loops or system.d not in (2, 3) or system.separable:
        return None
    kinetic = _square(system.H, system.p)
    if kinetic is not None:
        inverse_mass, A, phi = kinetic
        return _of(system, A, phi, 1 / inverse_mass, sp.Integer(0))
    for root in system.H.atoms(sp.Pow):
        if root.exp == sp.Rational(1, 2) and root.has(*system.p):
            return _of_root(system, root)
    return None


def _square(f: sp.Expr, p: Sequence[sp.Symbol]) -> tuple[Any, tuple, Any] | None:
    """(k, A, rest) where f is k |p - A|^2 / 2 + rest with a constant k > 0, A and rest free of p; else None."""
    slopes = [sp.diff(f, x) for x in p]
    if _varies(sp.diff(slopes[0], p[0])):
        return None
    seconds = [[sp.expand(sp.diff(s, x)) for x in p] for s in slopes]
    k = seconds[0][0]
    if not k.is_positive or k.free_symbols:
        return None
    if any(seconds[i][j] != (k if i == j else 0) for i in range(len(p)) for j in range(len(p))):
        return None
    A = tuple(sp.expand(x - s / k) for x, s in zip(p, slopes, strict=True))
    rest = sp.expand(f.subs(dict(zip(p, A, strict=True)), simultaneous=True))
    return None if any(e.has(*p) for e in (*A, rest)) else (k, A, rest)


def _varies(f: sp.Expr) -> bool:
    """True if f has clearly different values at two points, and so is not constant; False does not prove that it is."""
    names = sorted(f.free_symbols, key=str)
    places = ({x: sp.Rational(31 * (i + 1) % (37 + k), 29) for i, x in enumerate(names)} for k in range(2))
    values = [f.evalf(subs=place) for place in places]
    return all(v.is_Float and v.is_finite for v in values) and bool(abs(values[0] - values[1]) > abs(values[0]) / 1000)


def _of_root(system: PartitionedSystem, root: sp.Pow) -> Particle | None:
    """The particle of H = a root + phi, root = sqrt(M + k |p - A|^2 / 2) with positive constants a, k, M; else None."""
    a, inside = sp.diff(system.H.subs(root, sp.Symbol("r_")), sp.Symbol("r_")), _square(root.base, system.p)
    phi = sp.expand(system.H - a * root)
    if inside is None or a.free_symbols or not a.is_positive or phi.has(*system.p):
        return None
    k, A, M = inside
    M = sp.simplify(M)
    if M.free_symbols or not M.is_positive:
        return None
    square = a**2 * k / 2  # c^2
    return _of(system, A, phi, a * sp.sqrt(M) / square, 1 / square)


def _of(
    system: PartitionedSystem, A: Sequence[sp.Expr], phi: sp.Expr, mass: sp.Expr, slowness: sp.Expr
) -> Particle | None:
    x = system.q
    if len(x) == 2:
        curl = (sp.diff(A[1], x[0]) - sp.diff(A[0], x[1]), sp.Integer(0))
    else:
        curl = tuple(sp.diff(A[k], x[j]) - sp.diff(A[j], x[k]) for j, k in ((1, 2), (2, 0), (0, 1)))
    B = tuple(_short(b / mass) for b in curl)
    if not any(B):
        return None
    E = tuple(_short(-sp.diff(phi, z) / mass) for z in x)
    return Particle(tuple(map(_short, A)), phi, mass, slowness, E, B)


def _short(e: sp.Expr) -> sp.Expr:
    """Return the shorter of an expression and its simplified form; a long expression is returned as it is."""
    if sp.count_ops(e) > LONG:
        return e
    simplified = sp.simplify(e)
    return simplified if sp.count_ops(simplified) < sp.count_ops(e) or simplified == 0 else e


def constants(system: PartitionedSystem) -> tuple[Any, Any]:
    """The mass and the inverse square of the speed of light, (m, 1 / c^2): fractions, or numbers of `DIGITS` digits."""
    found = particle(system)
    with mpmath.workdps(DIGITS):
        return tuple(
            Fraction(int(x.p), int(x.q)) if x.is_Rational else mpmath.mpf(x.evalf(DIGITS))
            for x in (sp.sympify(found.mass), sp.sympify(found.slowness))
        )


# -- functions of the coordinates, as kernels call them ----------------------------------------------------------------


def fields(system: PartitionedSystem, arithmetic: str = DOUBLE) -> Function:
    """Make the function x -> (E, B) of the electric and magnetic field, both divided by the mass, at a position x."""
    T = codegen.value_type(system.d)

    def results() -> list[list[Any]]:
        found = particle(system)
        return [list(found.E), list(found.B)]

    return system.make_function("E and B", [("q", system.q)], results, types.Tuple((T, T))(T), arithmetic)


def shift(system: PartitionedSystem, arithmetic: str = DOUBLE) -> Function:
    """Make the function x -> A(x) / m of the vector potential A over the mass: p / m = u + A / m."""
    T = codegen.value_type(system.d)

    def results() -> list[list[Any]]:
        found = particle(system)
        return [[a / found.mass for a in found.A]]

    return system.make_function("A / m", [("q", system.q)], results, T(T), arithmetic)
