r"""Splittings for a charged particle: drifts of its position, and pushes by the fields E and B at that position.

The particle's x and :math:`u = \gamma\dot x` (`systems.magnetic`) move in turns,

.. math::
    x \leftarrow x + \tfrac{b_k h}2 u/\gamma,\quad u \leftarrow u + \tfrac{b_k h}2 E,\quad u \leftarrow R u,\quad
    u \leftarrow u + \tfrac{b_k h}2 E,\quad x \leftarrow x + \tfrac{b_k h}2 u/\gamma,\qquad k = 0, 1, \dots

R turns u about B: with a vector t along B, whose length is the tangent of half the angle,

.. math::
    R u = u + \frac 2{1 + |t|^2}\,(u + u\times t)\times t .

The rules differ in t, with :math:`\tau = \tfrac{b_k h}2 B` and u the value before the rotation:

- Boris: :math:`t = \tau/\gamma(u)`, the Cayley transform of the rotation;
- Higuera and Cary: :math:`t = \tau/\bar\gamma`, where :math:`\bar\gamma` belongs to the mean of u and R u,
  :math:`2\bar\gamma^2 = \sigma + \sqrt{\sigma^2 + 4(|\tau|^2 + (u\cdot\tau)^2/c^2)},\ \sigma = \gamma(u)^2 - |\tau|^2`;
  where the particle is not relativistic it is Boris's rule;
- exact: :math:`t = \tau\,\tan\theta/(\gamma\theta),\ \theta = |\tau|/\gamma(u)`, the flow of
  :math:`\dot u = \dot x\times B`.

Each substep is a shear, or a rotation of u by an angle that the rotation does not change, so that volume is preserved.
Neighbouring drifts are merged, also the last of a step with the first of the next, except where a row of output is
stored.  A row has :math:`p = mu + A(x)`; the integration itself goes on with u, and with what rounding lost of it.

Sources: J. P. Boris, Proc. Fourth Conf. Num. Sim. Plasmas (1970) 3-67; A. V. Higuera, J. R. Cary, Phys. Plasmas 24
(2017) 052104; Y. He, Y. Sun, J. Liu, H. Qin, J. Comput. Phys. 281 (2015) 135-147.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.systems import magnetic
from phasebench.integrators.values.elementary import cos, sin
from phasebench.integrators.values.fma import fma
from phasebench.integrators.values.vector import (
    add,
    add_product_in_place,
    axpy,
    dispatch_on_none,
    elementwise,
    inline,
    plus,
    read_state,
    scale,
    sum_of,
    unroll,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: The rules of rotation, by their names in a method's data.
RULES = {"boris": 0, "higuera-cary": 1, "exact": 2}
BORIS, HIGUERA_CARY = RULES["boris"], RULES["higuera-cary"]
#: Added to an angle, so that none is zero; it changes no other double.
TINY = 1e-300


class Magnetic(NamedTuple):
    """The data of a splitting for a charged particle.

    Attributes
    ----------
    slowness : (1 / c^2,), c the speed of light; None where the particle is not relativistic
    fields : the function x -> (E, B), both divided by the mass
    shift : the function x -> A / m of the vector potential A
    mass : array (1,)
    b : fractions of h of the symmetric steps that are composed
    rule : the number of the rule of rotation in `RULES`
    h, eps : the step size and the unit round-off, set by the run
    """

    slowness: np.ndarray | None
    fields: Callable
    shift: Callable
    mass: np.ndarray
    b: np.ndarray
    rule: int
    h: float = 0.0
    eps: float = 0.0


class ParticleState(NamedTuple):
    """A state (q, p) of a particle, and u, its velocity times the Lorentz factor.

    Attributes
    ----------
    q, p : position and canonical momentum, p = m u + A(q)
    lost_q, lost_p : what rounding lost of each (compensation)
    u, lost_u : the velocity times the Lorentz factor, and what rounding lost of it
    """

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any
    u: Any
    lost_u: Any


@sum_of("x[i] * y[i]")
def dot(x, y):
    """The scalar product of two vectors."""
    return np.sum(x * y)


@unroll(lambda d: "  return 0.0 * x[0]" if d == 2 else "  return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]")
def along(x, y):
    """The scalar product of the velocity x with the field y; 0 in the plane, where the field is (0, 0, y[0])."""
    return 0.0 * x[0] if len(x) == 2 else np.sum(x * y)


def _cross_text(d: int) -> str:
    if d == 2:
        return "  return x[1] * y[0], -(x[0] * y[0])"
    return "  return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]"


@unroll(_cross_text)
def cross(x, y):
    """The vector product x times y; in the plane y is the vector (0, 0, y[0])."""
    if len(x) == 2:
        return np.array([x[1] * y[0], -(x[0] * y[0])])
    return np.array([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])


@elementwise(outputs=2)
def momentum(u, lost, shift, mass):
    """Compute p = m (u + shift), with shift = A / m: returns (p, what rounding lost of it).

    ``lost`` is what rounding lost of u.  The sum is compensated by Knuth's method, since either term may be the larger.
    """
    s = u + shift
    part = s - u
    error = ((u - (s - part)) + (shift - part)) + lost
    p = mass * s
    return p, fma(mass, s, -p) + mass * error


@elementwise(outputs=2)
def velocity(p, lost, shift, mass):
    """Compute u = p / m - shift from the momentum p, with shift = A / m: returns (u, what rounding lost of it).

    ``lost`` is what rounding lost of p.
    """
    w = p / mass
    error = (fma(-mass, w, p) + lost) / mass
    u = w - shift
    part = u - w
    return u, ((w - (u - part)) + (-shift - part)) + error


@inline
def _gamma_square(slowness: np.ndarray, u: Value) -> Number:
    return 1.0 + slowness[0] * dot(u, u)


#: gamma of u.
gamma = dispatch_on_none(lambda slowness, u: 1.0, lambda slowness, u: _gamma_square(slowness, u) ** 0.5)


def _mean_gamma(slowness, u, tau):
    """The Lorentz factor of the mean of u before and after the rotation, in the rule of Higuera and Cary.

    ``slowness`` is (1 / c^2,), u the value before the rotation, and tau = h B / 2 (B divided by the mass) the vector
    along B that sets its angle.
    """
    square, parallel = dot(tau, tau), along(u, tau)
    sigma = _gamma_square(slowness, u) - square
    return (0.5 * (sigma + (sigma * sigma + 4.0 * (square + slowness[0] * parallel * parallel)) ** 0.5)) ** 0.5


mean_gamma = dispatch_on_none(lambda slowness, u, tau: 1.0, _mean_gamma)


@inline
def half_turn(method: Magnetic, u: Value, tau: Value) -> Value:
    """The vector t along B that sets the rotation of u: its length is the tangent of half the angle.

    tau is h B / 2 (B divided by the mass).  The formulae of the rules stand in the module's docstring; u enters by its
    Lorentz factor alone, except in the rule of Higuera and Cary.
    """
    if method.rule == HIGUERA_CARY:
        return scale(1.0 / mean_gamma(method.slowness, u, tau), tau)
    t = scale(1.0 / gamma(method.slowness, u), tau)
    if method.rule == BORIS:
        return t
    angle = dot(t, t) ** 0.5 + TINY
    return scale(sin(angle) / (cos(angle) * angle), t)


@inline
def apply_push(method: Magnetic, y: ParticleState, h: Number) -> ParticleState:
    """The state after a push over the time h: half a kick by E, a rotation about B, half a kick by E."""
    E, B = method.fields(y.q)
    u = axpy(0.5 * h, E, y.u)
    t = half_turn(method, u, scale(0.5 * h, B))
    turned = scale(2.0 / (1.0 + dot(t, t)), cross(plus(u, cross(u, t)), t))
    u, lost_u = add(y.u, y.lost_u, axpy(h, E, turned))
    return ParticleState(y.q, y.p, y.lost_q, y.lost_p, u, lost_u)


@inline
def apply_drift(method: Magnetic, y: ParticleState, h: Number) -> ParticleState:
    """The state after a drift of q over the time h."""
    q, lost_q = add_product_in_place(y.q, y.lost_q, h / gamma(method.slowness, y.u), y.u)
    return ParticleState(q, y.p, lost_q, y.lost_p, y.u, y.lost_u)


def begin(method: Magnetic, carry: Carry, counts: np.record) -> ParticleState:
    """Read the state (q, p) from ``carry``, where the last call of the kernel left it, and compute u from p."""
    y = read_state(carry)
    u, lost_u = velocity(y.p, y.lost_p, method.shift(y.q), method.mass[0])
    return ParticleState(y.q, y.p, y.lost_q, y.lost_p, u, lost_u)


def start(method: Magnetic, y: ParticleState) -> ParticleState:
    """Apply a step's first drift of q; in later steps it is part of the last drift of the step before."""
    return apply_drift(method, y, 0.5 * method.b[0] * method.h)


def step(method: Magnetic, y: ParticleState, carry: Carry, counts: np.record) -> tuple[ParticleState, int]:
    """Push and drift in turn; the last drift includes the first one of the next step.  Returns (state, `SOLVED`).

    The pushes are added to ``counts`` as evaluations; ``carry`` is not used.
    """
    h, b = method.h, method.b
    for k in range(len(b)):
        following = b[k + 1] if k + 1 < len(b) else b[0]
        y = apply_push(method, y, b[k] * h)
        y = apply_drift(method, y, 0.5 * (b[k] + following) * h)
    counts.gradient += len(method.b)
    return y, SOLVED


def finish(method: Magnetic, y: ParticleState) -> ParticleState:
    """Undo the first drift of the next step, which `step` merged with its own last, and compute p from u."""
    y = apply_drift(method, y, -0.5 * method.b[0] * method.h)
    p, lost_p = momentum(y.u, y.lost_u, method.shift(y.q), method.mass[0])
    return ParticleState(y.q, p, y.lost_q, lost_p, y.u, y.lost_u)


run = loop(step, begin, start, finish)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a splitting for a charged particle.

    ``method.data`` is (name of the rule of rotation in `RULES`, fractions of h of the symmetric steps that are
    composed).
    """
    rule, fractions = method.data
    mass, slowness = magnetic.constants(system)
    step = Magnetic(
        numbers([slowness], arithmetic) if slowness else None,
        magnetic.fields(system, arithmetic),
        magnetic.shift(system, arithmetic),
        numbers([mass], arithmetic),
        numbers(fractions, arithmetic),
        RULES[rule],
    )
    return Prepared(run, step, 1, 2, implicit=False)
