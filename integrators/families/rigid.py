r"""Integrators of a rigid body in quaternions: kicks by its potential, and rotations of the free body.

A step over h, composed over fractions of it for a higher order, is half a kick, :math:`p \leftarrow p - \tfrac h2\nabla
V(q)`, the free body, and half a kick.  The free body moves by :math:`q \leftarrow q u,\ p \leftarrow p u` with unit
quaternions u, which keeps |q| and the momentum in space, or by :math:`q \leftarrow w q,\ p \leftarrow w p` with w about
that momentum.  With the angular momentum L about the body's axes, the moments of inertia I and a number c (1 / I_k, or
a difference of two of these) the rotations of the methods are:

- an axis: the flow of :math:`c L_k^2 / 2`, :math:`u = \cos z + e_k\sin z` with :math:`z = h c L_k / 2`;
- a spherical top: the flow of :math:`c |L|^2 / 2`, :math:`w` a turn by :math:`h c |L|` about the momentum in space;
- Moser and Veselov: :math:`u = (\rho_0, \rho)` with :math:`\rho_0\,I\rho + \rho\times I\rho = \tfrac h2 L`;
- the midpoint rule for :math:`\dot L = L\times I^{-1} L`: with the mean :math:`\bar L` of L before and after,
  :math:`\bar L = L + \tfrac h2\,\bar L\times I^{-1}\bar L` and u the Cayley transform of :math:`h I^{-1}\bar L`.

Dullweber, Leimkuhler and McLachlan take the axes 3, 2, 1, 2, 3.  Reich's splitting takes the flow of a symmetric top,
which is that of a spherical top and that of an axis (they commute), between two half flows of the remaining axis; the
top has equal moments about the two axes whose 1 / I are nearest to each other.

All but the midpoint rule are symplectic; all are symmetric and of order 2.  Unknowns are solved to round-off.

Sources: A. Dullweber, B. Leimkuhler, R. McLachlan, J. Chem. Phys. 107 (1997) 5840-5851; T. F. Miller III et al., J.
Chem. Phys. 116 (2002) 8649-8659 (in quaternions); S. Reich, Physica D 76 (1994) 375-383, and Touma, Wisdom, Astron. J.
107 (1994) 1189-1202 (symmetric tops); J. Moser, A. P. Veselov, Commun. Math. Phys. 139 (1991) 217-243; E. Hairer, G.
Vilmart, J. Phys. A 39 (2006) 13225-13235 (in quaternions); M. A. Austin, P. S. Krishnaprasad, L.-S. Wang, J. Comput.
Phys. 107 (1993) 105-117 (midpoint).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import predict, remember, solver
from phasebench.integrators.values.elementary import sin
from phasebench.integrators.values.vector import (
    add,
    add_product,
    axpy,
    dispatch_on_none,
    inline,
    plus,
    read_state,
    scale,
    size,
    unroll,
)

from .magnetic import dot

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.rigid import RigidBody
    from phasebench.integrators.values.kinds import Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: Kinds of turns beside the axes 0, 1 and 2.
SPHERE = 3
#: Schemes by their names in a method's data; the first two have the turns that `_turns` lists.
AXES, TOP, MOSER_VESELOV, MIDPOINT = "axes", "top", "moser-veselov", "midpoint"
#: Added to a length, so that none is zero; it changes no other double.
TINY = 1e-300


class Turns(NamedTuple):
    """The data of an explicit method for a rigid body: a step is a kick, rotations and a kick.

    Attributes
    ----------
    dV : grad V of the quaternion q; None for a free body
    b : fractions of h of the steps that are composed
    kinds : for each rotation, an axis 0, 1, 2 or `SPHERE` for one about the momentum
    strengths : for each rotation, c times its fraction of h, for the flow of c L_k^2 / 2 or c |L|^2 / 2
    h, eps : the step size and the unit round-off, set by the run
    """

    dV: Callable | None
    b: np.ndarray
    kinds: np.ndarray
    strengths: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Implicit(NamedTuple):
    """The data of an implicit method for a rigid body: a kick, a rotation that solves an equation, and a kick.

    Attributes
    ----------
    dV : grad V of the quaternion q; None for a free body
    b : fractions of h of the steps that are composed
    moments, inverse : (0, I_1, I_2, I_3), and the same of 1 / I_k
    midpoint : True for the midpoint rule, False for Moser and Veselov
    h, eps : the step size and the unit round-off, set by the run
    """

    dV: Callable | None
    b: np.ndarray
    moments: np.ndarray
    inverse: np.ndarray
    midpoint: bool
    h: float = 0.0
    eps: float = 0.0


class BodyState(NamedTuple):
    """The state (q, p) of a rigid body in quaternions, and the gradient of V at q.

    Attributes
    ----------
    q, p : the state, four numbers each
    lost_q, lost_p : what rounding lost of each (compensation)
    gradient : grad V(q)
    """

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value
    gradient: Value


@unroll(
    lambda d: (
        "  return (x[0]*y[0] - x[1]*y[1] - x[2]*y[2] - x[3]*y[3], x[0]*y[1] + x[1]*y[0] + x[2]*y[3] - x[3]*y[2],\n"
        "    x[0]*y[2] - x[1]*y[3] + x[2]*y[0] + x[3]*y[1], x[0]*y[3] + x[1]*y[2] - x[2]*y[1] + x[3]*y[0])"
    )
)
def product(x, y):
    """The product of two quaternions."""
    w = x[0] * y[0] - x[1] * y[1] - x[2] * y[2] - x[3] * y[3]
    i = x[0] * y[1] + x[1] * y[0] + x[2] * y[3] - x[3] * y[2]
    j = x[0] * y[2] - x[1] * y[3] + x[2] * y[0] + x[3] * y[1]
    k = x[0] * y[3] + x[1] * y[2] - x[2] * y[1] + x[3] * y[0]
    return np.array([w, i, j, k])


@unroll(lambda d: "  return (-x[1], x[0], x[3], -x[2])")
def times_i(x):
    """The quaternion x i."""
    return np.array([-x[1], x[0], x[3], -x[2]])


@unroll(lambda d: "  return (-x[2], -x[3], x[0], x[1])")
def times_j(x):
    """The quaternion x j."""
    return np.array([-x[2], -x[3], x[0], x[1]])


@unroll(lambda d: "  return (-x[3], x[2], -x[1], x[0])")
def times_k(x):
    """The quaternion x k."""
    return np.array([-x[3], x[2], -x[1], x[0]])


@unroll(lambda d: "  return (x[0], -x[1], -x[2], -x[3])")
def conjugate(x):
    """The conjugate of a quaternion."""
    return np.array([x[0], -x[1], -x[2], -x[3]])


@unroll(lambda d: "  return (w, x[1], x[2], x[3])")
def with_real(w, x):
    """The quaternion x with its real part replaced by w."""
    return np.array([w, x[1], x[2], x[3]])


@unroll(lambda d: "  return (0.0 * x[0], a[1]*x[1], a[2]*x[2], a[3]*x[3])")
def stretch(x, a):
    """The imaginary part of the quaternion x, each component times the number of the same index of the array a."""
    return np.array([0 * x[0], a[1] * x[1], a[2] * x[2], a[3] * x[3]])


@inline
def momentum(y: BodyState) -> Value:
    """The angular momenta L about the body's axes, as a quaternion: half the imaginary part of q* p."""
    m = scale(0.5, product(conjugate(y.q), y.p))
    return with_real(0.0 * m[0], m)


@inline
def moved(y: BodyState, dq: Value, dp: Value) -> BodyState:
    """The state y after the increments dq and dp, added with compensation."""
    q, lost_q = add(y.q, y.lost_q, dq)
    p, lost_p = add(y.p, y.lost_p, dp)
    return BodyState(q, p, lost_q, lost_p, y.gradient)


@inline
def about_axis(y: BodyState, image_q: Value, image_p: Value, strength: Number) -> BodyState:
    """The state after the flow of c L_k^2 / 2 about axis k over the time h, with strength = h c.

    ``image_q`` is q e_k and ``image_p`` is p e_k, with e_k one of the units i, j, k.
    """
    z = 0.25 * strength * dot(y.p, image_q)
    s, half = sin(z), sin(0.5 * z)
    less = -2.0 * half * half  # cos z - 1
    return moved(y, axpy(s, image_q, scale(less, y.q)), axpy(s, image_p, scale(less, y.p)))


@inline
def about_momentum(y: BodyState, strength: Number) -> BodyState:
    """The state after the flow of c |L|^2 / 2 over h, with strength = h c: a rotation about the momentum in space."""
    m = scale(0.5, product(y.p, conjugate(y.q)))
    m = with_real(0.0 * m[0], m)
    length = dot(m, m) ** 0.5 + TINY
    angle = 0.5 * strength * length
    half = sin(0.5 * angle)
    w = with_real(-2.0 * half * half, scale(sin(angle) / length, m))
    return moved(y, product(w, y.q), product(w, y.p))


@inline
def kick(y: BodyState, h: Number) -> BodyState:
    """The state after a kick by -grad V over the time h."""
    p, lost_p = add_product(y.p, y.lost_p, -h, y.gradient)
    return BodyState(y.q, p, y.lost_q, lost_p, y.gradient)


#: grad V at q; zero of a free body.
slope = dispatch_on_none(lambda dV, q: scale(0.0, q), lambda dV, q: dV(q))


def begin(method: Turns | Implicit, carry: Carry, counts: np.record) -> BodyState:
    """Read the state from ``carry``, where the last call of the kernel left it, and evaluate grad V."""
    y = read_state(carry)
    counts.gradient += 1
    return BodyState(y.q, y.p, y.lost_q, y.lost_p, slope(method.dV, y.q))


def step(method: Turns, y: BodyState, carry: Carry, counts: np.record) -> tuple[BodyState, int]:
    """Take the composed steps in turn, each a kick, rotations and a kick; returns (state, `SOLVED`)."""
    for k in range(len(method.b)):
        h = method.b[k] * method.h
        y = kick(y, 0.5 * h)
        for n in range(len(method.kinds)):
            kind, strength = method.kinds[n], method.strengths[n] * h
            if kind == 0:
                y = about_axis(y, times_i(y.q), times_i(y.p), strength)
            elif kind == 1:
                y = about_axis(y, times_j(y.q), times_j(y.p), strength)
            elif kind == 2:
                y = about_axis(y, times_k(y.q), times_k(y.p), strength)
            else:
                y = about_momentum(y, strength)
        y = kick(BodyState(y.q, y.p, y.lost_q, y.lost_p, slope(method.dV, y.q)), 0.5 * h)
        counts.gradient += 1
    return y, SOLVED


class Turn(NamedTuple):
    """Arguments of the equation for the rotation of an implicit step.

    Attributes
    ----------
    method : the data of the method, with the moments of inertia
    target : h L / 2, with L the angular momentum about the body's axes, as a quaternion without real part
    """

    method: Implicit
    target: Value


@inline
def cross(x: Value, y: Value) -> Value:
    """The vector product of two imaginary quaternions."""
    z = product(x, y)
    return with_real(0.0 * z[0], z)


@inline
def equation(x: Value, e: Turn) -> Value:
    """The right-hand side of the equation x = G(x) for the rotation of an implicit step, at the iterate x.

    x is the vector rho of Moser and Veselov, or h / 2 times the mean of L in the midpoint rule (see the module).
    """
    if e.method.midpoint:
        return plus(e.target, cross(x, stretch(x, e.method.inverse)))
    rest = axpy(-1.0, cross(x, stretch(x, e.method.moments)), e.target)
    return scale((1.0 - dot(x, x)) ** -0.5, stretch(rest, e.method.inverse))


@inline
def lengths(x: Value, g: Value, e: Turn) -> tuple[Number, Number]:
    """Return the lengths that scale Newton's finite differences in the first and in the second half of the unknown x.

    Both are the same number, the sum of the 1-norms of x and of h L / 2 (L is the angular momentum).  x is an iterate
    of the equation x = G(x) with the arguments e; g = G(x) is not used.
    """
    length = size(e.target) + size(x)
    return length, length


solve = solver(equation, lengths)


@inline
def turn_of(method: Implicit, x: Value) -> Value:
    """The quaternion u - 1 of the rotation u that follows from the solution x of `equation`."""
    if method.midpoint:
        a = stretch(x, method.inverse)
        root = (1.0 + dot(a, a)) ** 0.5
        return with_real(-dot(a, a) / (root * (1.0 + root)), scale(1.0 / root, a))
    square = dot(x, x)
    return with_real(-square / (1.0 + (1.0 - square) ** 0.5), x)


def implicit_step(method: Implicit, y: BodyState, carry: Carry, counts: np.record) -> tuple[BodyState, int]:
    """Take the composed steps in turn, each a kick, an implicit rotation and a kick; returns (state, status).

    Equations start from their solutions in earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    first, n, found = y, len(method.b), SOLVED
    for k in range(n):
        if found == SOLVED:
            h = method.b[k] * method.h
            y = kick(y, 0.5 * h)
            e = Turn(method, scale(0.5 * h, momentum(y)))
            x = predict(carry.memory, k, n, counts.steps, carry.zero)
            x, _, newton, found = solve(e, x, size(e.target), method.eps, carry.work)
            counts.newton += newton
            if found == SOLVED:
                remember(carry.memory, k, n, counts.steps, x)
                less = turn_of(method, x)
                y = moved(y, product(y.q, less), product(y.p, less))
                y = kick(BodyState(y.q, y.p, y.lost_q, y.lost_p, slope(method.dV, y.q)), 0.5 * h)
                counts.gradient += 1
    return y if found == SOLVED else first, found


run = loop(step, begin)
run_implicit = loop(implicit_step, begin)


def _turns(scheme: str, system: RigidBody) -> list[tuple[int, Any]]:
    """The rotations of an explicit step in turn: pairs (axis 0, 1 or 2, or `SPHERE`; c times the fraction of h).

    The numbers are exact.  ``scheme`` is "axes" or "top", as in `prepare`; c is the factor in the flow of c L_k^2 / 2
    or c |L|^2 / 2.
    """
    inverse = [1 / moment for moment in system.moments]
    if scheme == AXES:
        return [(k, inverse[k] / (1 if k == 0 else 2)) for k in (2, 1, 0, 1, 2)]
    a, b, c = system.pair
    outer = (inverse[b] - inverse[a]) / 2
    inner = [(SPHERE, inverse[a]), (c, inverse[c] - inverse[a])]
    return [turn for turn in ((b, outer), *inner, (b, outer)) if turn[1] != 0]


def prepare(method: Method, system: RigidBody, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a method for a rigid body.

    ``method.data`` is (scheme, fractions of h of the composed steps).  The scheme is "axes" (rotations about the axes
    3, 2, 1, 2, 3), "top" (Reich's splitting), "moser-veselov" or "midpoint".
    """
    scheme, fractions = method.data
    dV, b = system.grad_V(arithmetic), numbers(fractions, arithmetic)
    if scheme in (MOSER_VESELOV, MIDPOINT):
        moments, inverse = (numbers([0, *x], arithmetic) for x in (system.moments, [1 / m for m in system.moments]))
        step = Implicit(dV, b, moments, inverse, scheme == MIDPOINT)
        return Prepared(run_implicit, step, system.d, len(fractions), implicit=False, linear=system.d)
    kinds, strengths = zip(*_turns(scheme, system), strict=True)
    step = Turns(dV, b, np.array(kinds), numbers(strengths, arithmetic))
    return Prepared(run, step, 1, 1, implicit=False)
