r"""A rigid body that turns about a fixed point: its attitude as a quaternion, canonical in eight variables.

The unit quaternion q = (q0, q1, q2, q3) turns vectors of the body into those of space by

.. math::
    R = \frac1{|q|^2}\begin{pmatrix}
    q_0^2 + q_1^2 - q_2^2 - q_3^2 & 2(q_1 q_2 - q_0 q_3) & 2(q_1 q_3 + q_0 q_2) \\
    2(q_1 q_2 + q_0 q_3) & q_0^2 - q_1^2 + q_2^2 - q_3^2 & 2(q_2 q_3 - q_0 q_1) \\
    2(q_1 q_3 - q_0 q_2) & 2(q_2 q_3 + q_0 q_1) & q_0^2 - q_1^2 - q_2^2 + q_3^2 \end{pmatrix} .

With :math:`e_k` the quaternion i, j or k and the product of quaternions, the momenta about the body's axes and H are

.. math::
    L_k = \tfrac12\,p\cdot(q\,e_k),\qquad H = \sum_k \frac{L_k^2}{2 I_k} + V(R).

V does not depend on |q|, so that |q| and p.q, which have no physical meaning, keep their initial values 1 and 0.  The
angular momentum in space is R L; components of it that V conserves are found, and declared as invariants.

Source: T. F. Miller III et al., J. Chem. Phys. 116 (2002) 8649-8659, equations (9)-(14).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

from .hamiltonian import Floats, Formula, Hamiltonian, read

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function

#: Names of the entries of the rotation matrix in a formula of V.
ENTRIES = tuple(f"r{i}{j}" for i in "123" for j in "123")


def product(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """The product of two quaternions, each a sequence of four components, the real part first."""
    (a0, a1, a2, a3), (b0, b1, b2, b3) = a, b
    return [
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    ]


def unit(k: int) -> list[int]:
    """The quaternion i, j or k, for k = 0, 1, 2."""
    return [int(n == k + 1) for n in range(4)]


def rotation(q: Sequence[Any]) -> list[list[Any]]:
    """The three rows of the rotation matrix of a quaternion q of any length; it turns body vectors into space."""
    conjugate = [q[0], -q[1], -q[2], -q[3]]
    square = sum(x * x for x in q)
    columns = [[x / square for x in product(product(q, unit(k)), conjugate)[1:]] for k in range(3)]
    return [list(row) for row in zip(*columns, strict=True)]


class RigidBody(Hamiltonian):
    """A rigid body about a fixed point, in the coordinates q0, ..., q3 of its attitude and their momenta p0, ..., p3.

    Parameters
    ----------
    moments : three principal moments of inertia, positive, none larger than the sum of the others
    V : formula or expression, optional
        The potential energy in the entries r11, ..., r33 of the rotation matrix, or in q0, ..., q3.  Default: 0, the
        free body.

    Attributes
    ----------
    moments : the moments as exact numbers
    V : the potential as an expression in q
    kept : the invariants besides H, name -> expression

    Raises
    ------
    InvalidInput
        For moments that no body has, or if V has other symbols.

    Examples
    --------
    >>> top = RigidBody(moments=(1, 1, "1/2"), V="2*r33")
    >>> q, p = top.start(attitude=(1, 0, 0, 0), momentum=(0.1, 0, 1))
    >>> [round(float(x), 12) for x in top.momentum(q, p)]
    [0.1, 0.0, 1.0]
    """

    rigid = True

    def __init__(self, *, moments: Sequence[Any], V: Formula = "0") -> None:
        self.moments = _moments(moments)
        q = tuple(sp.Symbol(f"q{k}", real=True) for k in range(4))
        p = tuple(sp.Symbol(f"p{k}", real=True) for k in range(4))
        self.V = _potential(V, q)
        L = [sum(x * y for x, y in zip(p, product(q, unit(k)), strict=True)) / 2 for k in range(3)]
        H = sp.Add(*(x**2 / (2 * moment) for x, moment in zip(L, self.moments, strict=True))) + self.V
        self.kept = _kept(self.V, q, p, L, self.moments)
        self._derive(q=q, p=p, H=H, singular=(), invariants=tuple(self.kept.values()))

    def start(self, *, attitude: ArrayLike, momentum: ArrayLike) -> tuple[Floats, Floats]:
        """The state (q, p) of an attitude, a quaternion of any length, and angular momenta (3,) about body axes."""
        try:
            q, L = np.asarray(attitude, float), np.asarray(momentum, float)
        except (TypeError, ValueError):
            q = L = np.zeros(0)
        if q.shape != (4,) or L.shape != (3,) or not (np.isfinite(q).all() and np.isfinite(L).all()) or not q.any():
            raise InvalidInput("an attitude is a quaternion, four numbers that are not all 0; a momentum three numbers")
        q = q / np.sqrt(q @ q)
        return q, 2 * np.array(product(q, [0.0, *L]))

    @staticmethod
    def momentum(q: ArrayLike, p: ArrayLike) -> Floats:
        """The angular momenta about the body's axes, an array (..., 3), of states q, p (..., 4)."""
        q, p = np.moveaxis(np.asarray(q, float), -1, 0), np.moveaxis(np.asarray(p, float), -1, 0)
        return np.stack([sum(a * b for a, b in zip(p, product(q, unit(k)), strict=True)) / 2 for k in range(3)], -1)

    @staticmethod
    def matrix(q: ArrayLike) -> Floats:
        """The rotation matrices (..., 3, 3) of attitudes q (..., 4)."""
        q = np.moveaxis(np.asarray(q, float), -1, 0)
        return np.moveaxis(np.array([[np.asarray(x) for x in row] for row in rotation(q)]), (0, 1), (-2, -1))

    def grad_V(self, arithmetic: str = DOUBLE) -> Function | None:
        """Make the function q -> grad V(q) of quaternions; None for a free body."""
        if self.V == 0:
            return None
        return self.gradient_like("rigid grad_V", "q", lambda: [[sp.diff(self.V, x) for x in self.q]], arithmetic)

    @cached_property
    def pair(self) -> tuple[int, int, int]:
        """The axes 0, 1, 2 in an order (a, b, c) such that a and b are the pair whose 1/I_a and 1/I_b differ least.

        Reich's splitting takes the body for a symmetric top, I_b = I_a, and makes up for that by turns about axis b.
        """
        orders = [(0, 1, 2), (0, 2, 1), (1, 2, 0)]
        return min(orders, key=lambda axes: abs(1 / self.moments[axes[0]] - 1 / self.moments[axes[1]]))


def _moments(given: Sequence[Any]) -> tuple[Any, ...]:
    """Convert three moments of inertia to exact numbers; raises InvalidInput if no body has them."""
    try:
        found = tuple(sp.Rational(Fraction(x) if isinstance(x, (str, float, int)) else x) for x in given)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        found = ()
    if len(found) != 3 or not all(x > 0 for x in found):
        raise InvalidInput(f"moments is {given!r}; give three positive numbers, the principal moments of inertia")
    if 2 * max(found) > sum(found):
        shown = ", ".join(map(str, found))
        raise InvalidInput(f"no body has the moments {shown}: none may be larger than the sum of the other two")
    return found


def _potential(given: Formula, q: tuple[Any, ...]) -> Any:
    """The potential as an expression in the quaternion q that does not depend on |q|."""
    entries = {name: sp.Symbol(name, real=True) for name in ENTRIES}
    V = read(given, entries | {str(x): x for x in q})
    foreign = V.free_symbols - {*q, *entries.values()}
    if foreign:
        raise InvalidInput(
            f"{', '.join(sorted(map(str, foreign)))} in the potential is none of r11, ..., r33 and q0, ..., q3"
        )
    length = sp.sqrt(sum(x * x for x in q))
    V = V.xreplace({x: x / length for x in q})
    flat = [x for row in rotation(q) for x in row]
    return V.xreplace(dict(zip(entries.values(), flat, strict=True)))


def _kept(V: Any, q: Sequence[Any], p: Sequence[Any], L: Sequence[Any], moments: Sequence[Any]) -> dict[str, Any]:
    """The invariants besides H, name -> expression; V is the potential, L the momenta about the body's axes.

    They are |q|^2 ("length"), p.q ("radial-momentum"), the angular momentum about each axis of space if rotations about
    this axis leave V unchanged ("momentum-1", ...), and the angular momentum about each axis of the body if rotations
    about this axis leave V unchanged and the other two moments of inertia are equal ("axis-momentum-1", ...).
    """

    def unchanged(turned: list[Any]) -> bool:
        return sp.simplify(sum(sp.diff(V, x) * rate for x, rate in zip(q, turned, strict=True))) == 0

    kept = {"length": sum(x * x for x in q), "radial-momentum": sum(x * y for x, y in zip(q, p, strict=True))}
    for k in range(3):
        turned = product(unit(k), q)
        if unchanged(turned):
            kept[f"momentum-{k + 1}"] = sum(x * y for x, y in zip(p, turned, strict=True)) / 2
    for k in range(3):
        if moments[k - 1] == moments[k - 2] and unchanged(product(q, unit(k))):
            kept[f"axis-momentum-{k + 1}"] = L[k]
    return kept
