r"""Splittings with modified kicks for H = p . M^-1 p / 2 + V(q): drifts, kicks, and gradients of the force.

.. math::
    p \leftarrow p - b_k h\,\nabla V(q) + c_k h^3\,G(q),\qquad q \leftarrow q + a_k h\,M^{-1} p,\qquad
    G = \nabla\bigl(\nabla V\cdot M^{-1}\nabla V\bigr) = 2 V'' M^{-1}\nabla V .

The modified kick is the flow of :math:`b_k h V - c_k h^3\,\nabla V\cdot M^{-1}\nabla V`, a function of q alone, so that
the step is symplectic.  The product :math:`V'' v` is derived from H as the gradient of :math:`v\cdot\nabla V`, as a
whole: no matrix of second derivatives is formed.  Without the Hessian the kick is that of a second force,

.. math::
    p \leftarrow p - b_k h\,\nabla V\Bigl(q - \frac{2 c_k h^2}{b_k}\,M^{-1}\nabla V(q)\Bigr),

equal to the above up to :math:`h^5`: symmetric and volume-preserving, not symplectic.  It serves systems whose
potential is given by a program and not by a formula.

The step is symmetric: its last kick equals its first, and is evaluated at the same q as the first kick of the next
step, so that the two are merged, except where a row of output is stored.  A modified kick counts as two evaluations of
the gradient.

Source: S. A. Chin, Phys. Lett. A 226 (1997) 344-348; I. P. Omelyan, I. M. Mryglod, R. Folk, Comput. Phys. Commun. 151
(2003) 272-314; K. Schaefers, J. Finkenrath, M. Guenther, F. Knechtli, arXiv:2403.10370 (without the Hessian), after H.
Yin, R. D. Mawhinney, PoS Lattice 2011, 051.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values import inplace
from phasebench.integrators.values.vector import (
    add_product_in_place,
    apply,
    axpy,
    in_place,
    inline,
    overload_by_kind,
    rows,
    scale,
    view_state,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Function, Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: Up to this many degrees of freedom values are tuples, as in `splitting`.
MOST = 10


class ForceGradient(NamedTuple):
    """The data of a splitting with modified kicks: kick 0, then for k = 1, 2, ... the drift k and the kick k.

    Attributes
    ----------
    dT : grad T: a function, or the array 1 / m_i if grad T is p_i / m_i, or None if it is p itself
    inertia : M^-1, as dT, which it is unless H depends on time
    dV : the function grad V
    product : the function (q, v) -> V''(q) v; None if the modified kick is made of two forces, without the Hessian
    a : fractions of h of the drifts; a[0] is not used
    b, c : weights of the kicks, which change p by -b h grad V + c h^3 G with G = 2 V'' M^-1 grad V, the gradient of the
        force
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | np.ndarray | None
    inertia: Callable | np.ndarray | None
    dV: Callable
    product: Callable | None
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class KickState(NamedTuple):
    """The state (q, p), and the kick that ends one step and begins the next, p' = p - h weight slope.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    slope, weight : the vector and the number that make the kick at q
    velocity, place : working memory for a velocity and for a point
    """

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any
    slope: Any
    weight: Any
    velocity: Any
    place: Any


def _combine(b, g, c, k):
    for i in range(len(g)):
        g[i] = b * g[i] + c * k[i]
    return g


def _displace(x, a, v, out):
    for i in range(len(x)):
        out[i] = x[i] + a * v[i]
    return out


@in_place(_displace)
def displace(x, a, v, out):
    """Return x + a v; for arrays the result is written to ``out``."""
    return axpy(a, v, x)


@in_place(_combine)
def combine(b, g, c, k):
    """Return b g + c k, the slope of a modified kick; for arrays the result is written over g.

    g is the gradient of V and k = V''(q) v the second term of the kick, both (d,).
    """
    return axpy(c, k, scale(b, g))


def second_force(product, dV, b, c, q, slope, v, place):
    """The modified kick without the Hessian, by a second force: returns (weight b, slope grad V(q - (2 c / b) v)).

    ``dV`` is the function grad V, b and c are the weights as in `modified_kick`, and v is M^-1 grad V(q).  Arrays
    ``slope`` and ``place`` are overwritten, ``product`` is not used.
    """
    return b, apply(dV, displace(q, -2.0 * c / b, v, place), slope)


def modified_kick(product, dV, b, c, q, slope, v, place):
    """Compute a modified kick at q: returns (weight, slope), with which p becomes p - h weight slope.

    The argument ``slope`` is grad V(q), and v is M^-1 grad V(q).  b is the weight of grad V, and c is h^2 times the
    weight of the gradient of the force; ``dV`` is the function grad V, ``product`` is (q, v) -> V''(q) v, or None for a
    kick by a second force.  Arrays ``slope`` and ``place`` are overwritten.
    """
    if product is None:
        return second_force(product, dV, b, c, q, slope, v, place)
    return 1.0 + 0.0 * b, combine(b, slope, -2.0 * c, product(q, v))


def _of_values(
    product: types.Type,
    dV: types.Type,
    b: types.Type,
    c: types.Type,
    q: types.Type,
    slope: types.Type,
    v: types.Type,
    place: types.Type,
) -> Callable:
    """Choose the code of `modified_kick` that is compiled for vectors that are tuples, of numbers or of SIMD lanes.

    The arguments are the Numba types of those of `modified_kick`; the choice depends on that of ``product``.  Returns a
    Python function.
    """
    if isinstance(product, (types.NoneType, types.Omitted)):
        return second_force
    return lambda product, dV, b, c, q, slope, v, place: (
        1.0 + 0.0 * b,
        combine(b, slope, -2.0 * c, product(q, v)),
    )


def _of_arrays(
    product: types.Type,
    dV: types.Type,
    b: types.Type,
    c: types.Type,
    q: types.Type,
    slope: types.Type,
    v: types.Type,
    place: types.Type,
) -> Callable:
    """Choose the code of `modified_kick` that is compiled for vectors that are arrays.

    The arguments are the Numba types of those of `modified_kick`; the choice depends on that of ``product``.  Returns a
    Python function.
    """

    def written(product, dV, b, c, q, slope, v, place):
        product(q, v, place)
        return 1.0, combine(b, slope, -2.0 * c, place)

    return second_force if isinstance(product, (types.NoneType, types.Omitted)) else written


overload_by_kind(modified_kick, _of_values, _of_arrays)


@inline
def evaluate(
    method: ForceGradient, q: Value, b: Number, c: Number, y: KickState, counts: np.record
) -> tuple[Number, Value]:
    """Evaluate the kick with the weights b and c (of the gradient of V and of the force) at q: returns (weight, slope).

    With them the kick is p - h weight slope (see `modified_kick`).  Evaluated gradients are added to ``counts``; arrays
    of the state y, its working memory, are overwritten.
    """
    slope = apply(method.dV, q, y.slope)
    counts.gradient += 1
    if c == 0:
        return b, slope
    counts.gradient += 1
    v = apply(method.inertia, slope, y.velocity)
    return modified_kick(method.product, method.dV, b, c * (method.h * method.h), q, slope, v, y.place)


@inline
def apply_kick(y: KickState, h: Number) -> KickState:
    """Kick the momenta by the slope that the state y carries (grad V, or its modification): p - h y.weight y.slope."""
    p, lost_p = add_product_in_place(y.p, y.lost_p, -h * y.weight, y.slope)
    return KickState(y.q, p, y.lost_q, lost_p, y.slope, y.weight, y.velocity, y.place)


def begin(method: ForceGradient, carry: Carry, counts: np.record) -> KickState:
    """Read the state from ``carry`` and evaluate the kick at its q.

    Arrays are rows of ``carry`` itself, which steps overwrite.
    """
    y = view_state(carry)
    slope, velocity = rows(carry.state, 4, 5, carry.zero)
    place, _ = rows(carry.state, 6, 6, carry.zero)
    b, c = 2 * method.b[0], 2 * method.c[0]
    y = KickState(y.q, y.p, y.lost_q, y.lost_p, slope, b, velocity, place)
    if b != 0 or c != 0:
        weight, slope = evaluate(method, y.q, b, c, y, counts)
        y = KickState(y.q, y.p, y.lost_q, y.lost_p, slope, weight, velocity, place)
    return y


def start(method: ForceGradient, y: KickState) -> KickState:
    """Apply a step's first kick; in later steps it is part of the last kick of the step before."""
    return apply_kick(y, method.h / 2) if method.b[0] != 0 or method.c[0] != 0 else y


def step(method: ForceGradient, y: KickState, carry: Carry, counts: np.record) -> tuple[KickState, int]:
    """Drift and kick in turn; the last kick includes the first one of the next step.  Returns (state, `SOLVED`)."""
    h, last = method.h, len(method.a) - 1
    for k in range(1, last + 1):
        velocity = apply(method.dT, y.p, y.velocity)
        q, lost_q = add_product_in_place(y.q, y.lost_q, method.a[k] * h, velocity)  # exp(a_k h A), a drift
        p, lost_p, slope, weight = y.p, y.lost_p, y.slope, y.weight
        b, c = method.b[k], method.c[k]
        if k == last:
            b, c = 2 * b, 2 * c
        if b != 0 or c != 0:
            weight, slope = evaluate(method, q, b, c, y, counts)
            p, lost_p = add_product_in_place(p, lost_p, -h * weight, slope)  # exp(b_k h B + c_k h^3 C), a modified kick
        y = KickState(q, p, lost_q, lost_p, slope, weight, y.velocity, y.place)
    return y, SOLVED


def finish(method: ForceGradient, y: KickState) -> KickState:
    """Undo the half of the last kick that belongs to the next step, before a row of output is stored."""
    return apply_kick(y, -method.h / 2) if method.b[0] != 0 or method.c[0] != 0 else y


run = loop(step, begin, start, finish)


def hessian_product(system: Hamiltonian, arithmetic: str) -> Function:
    """Make the function (q, v) -> V''(q) v from the formula of V, as the gradient of v . grad V(q) by q."""
    T = codegen.value_type(system.d, system.fills)
    v = sp.symbols(f"direction_0:{system.d}")

    def results() -> list:
        slope = sum(x * sp.diff(system.potential, q) for x, q in zip(v, system.q, strict=True))
        return [[sp.diff(slope, q) for q in system.q]]

    return system.make_function("hessian product", [("q", system.q), ("v", v)], results, T(T, T), arithmetic)


def prepare(method: Method, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a splitting with modified kicks for a system.

    ``method.data`` is (rows (a, b, c) of a drift and the kick after it, True if the Hessian is avoided); the first row
    has a kick alone.  ``fills`` allows functions that write their results into arrays.
    """
    weights, hessian_free = method.data
    a, b, c = (numbers(column, arithmetic) for column in zip(*weights, strict=True))
    masses = getattr(system, "inverse_masses", None) if fills else None
    system = inplace.in_place_version(system, arithmetic, MOST) if fills else system
    dT = numbers(masses, arithmetic) if masses else system.grad_T(arithmetic)
    product = None if hessian_free else hessian_product(system, arithmetic)
    inertia = system.inertia(arithmetic) if system.driven else dT
    step = ForceGradient(dT, inertia, system.grad_V(arithmetic), product, a, b, c)
    return Prepared(run, step, 1, 3, implicit=False, arrays=system.fills)
