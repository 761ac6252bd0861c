r"""Splitting methods for a separable H = T(p) + V(q): kicks and drifts, one kernel for every table of coefficients.

.. math::
    p \leftarrow p - b_k h\,\nabla V(q),\qquad q \leftarrow q + a_k h\,\nabla T(p),\qquad k = 0, 1, \dots

Before the drift over :math:`a_k h` the step kicks over :math:`b_k h`; ``a[0]`` is zero, ``b[0]`` the first kick.  The
last kick of a step and the first of the next act at the same q: they are merged, except where a row of output is
stored, so that a Stormer-Verlet step costs one gradient.

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.5 and V.3.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import OWN, Carry, Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values import inplace
from phasebench.integrators.values.vector import add_product_in_place, apply, inline, rows, view_state

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: Up to this many degrees of freedom values are tuples; from d = 10 to 18 arrays are faster by 5 to 40 %.
MOST = 10
#: Rows of the carry's state for a gradient and a velocity that are arrays.
GRADIENT, VELOCITY = OWN, OWN + 1


class Splitting(NamedTuple):
    """The data of a splitting: the kick b[0], then for k = 1, 2, ... the drift a[k] and the kick b[k].

    Attributes
    ----------
    dT : grad T: a function, or the array 1 / m_i if grad T is p_i / m_i, or None if it is p itself
    dV : the function grad V
    a, b : fractions of h of the drifts and of the kicks; a[0] is not used
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | np.ndarray | None
    dV: Callable
    a: np.ndarray
    b: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class SplittingState(NamedTuple):
    """The state (q, p), with the gradient of V at q.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    gradient : grad V(q)
    velocity : working memory for a velocity
    """

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value
    gradient: Value
    velocity: Value


@inline
def kick(y: SplittingState, h: Number) -> SplittingState:
    """The state after a kick over the time h, exp(h B): p - h grad V(q)."""
    p, lost_p = add_product_in_place(y.p, y.lost_p, -h, y.gradient)
    return SplittingState(y.q, p, y.lost_q, lost_p, y.gradient, y.velocity)


def begin(method: Splitting, carry: Carry, counts: np.record) -> SplittingState:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it, and evaluate grad V.

    Arrays are rows of ``carry`` itself, which steps overwrite.
    """
    y = view_state(carry)
    gradient, velocity = rows(carry.state, GRADIENT, VELOCITY, carry.zero)
    counts.gradient += 1
    return SplittingState(y.q, y.p, y.lost_q, y.lost_p, apply(method.dV, y.q, gradient), velocity)


def start(method: Splitting, y: SplittingState) -> SplittingState:
    """Apply a step's first kick; in later steps it is part of the last kick of the step before."""
    first = method.b[0] * method.h
    return kick(y, first) if first != 0 else y


def step(method: Splitting, y: SplittingState, carry: Carry, counts: np.record) -> tuple[SplittingState, int]:
    """Drift and kick in turn; the last kick includes the first one of the next step.  Returns (state, `SOLVED`)."""
    h, last = method.h, len(method.a) - 1
    q, p, lost_q, lost_p, gradient, velocity = y
    for k in range(1, last + 1):
        velocity = apply(method.dT, p, velocity)
        q, lost_q = add_product_in_place(q, lost_q, method.a[k] * h, velocity)  # exp(a_k h A), a drift
        kick = method.b[k] * h
        if k == last:
            kick += method.b[0] * h
        if kick != 0:
            gradient = apply(method.dV, q, gradient)
            counts.gradient += 1
            p, lost_p = add_product_in_place(p, lost_p, -kick, gradient)  # exp(b_k h B), a kick
    return SplittingState(q, p, lost_q, lost_p, gradient, velocity), SOLVED


def finish(method: Splitting, y: SplittingState) -> SplittingState:
    """Undo the first kick of the next step, which `step` merged with its own last, before a row of output is stored."""
    first = method.b[0] * method.h
    return kick(y, -first) if first != 0 else y


run = loop(step, begin, start, finish)


def _prepare(parts: list[tuple[bool, Any]], system: Hamiltonian, arithmetic: str, fills: bool) -> Prepared:
    """Prepare the kernel of a splitting with the substeps ``parts``, merging neighbours of one kind.

    A part is (True for a kick or False for a drift, its length as a fraction of h); ``fills`` is that of `prepare`.
    """
    rows = [[0, 0]]
    for kick, fraction in parts:
        if kick:
            rows[-1][1] += fraction
        elif rows[-1][1] == 0 and len(rows) > 1:
            rows[-1][0] += fraction
        else:
            rows.append([fraction, 0])
    a, b = (numbers(column, arithmetic) for column in zip(*rows, strict=True))
    masses = getattr(system, "inverse_masses", None) if fills else None
    system = inplace.in_place_version(system, arithmetic, MOST) if fills else system
    dT = numbers(masses, arithmetic) if masses else system.grad_T(arithmetic)
    step = Splitting(dT, system.grad_V(arithmetic), a, b)
    return Prepared(run, step, 1, 2, implicit=False, arrays=system.fills)


def from_substeps(substeps: tuple, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel of the splitting equal to substeps (c, mu, lambda) of symplectic Euler on a separable H.

    A substep has the length c h; those with lambda = 1 kick first, those with lambda = 0 drift first, and mu, which is
    1 - lambda, is not used.  ``fills`` is that of `prepare`.
    """
    parts = []
    for c, _, lam in substeps:
        parts += [(True, c), (False, c)] if lam == 1 else [(False, c), (True, c)]
    return _prepare(parts, system, arithmetic, fills)


def prepare(method: Method, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a splitting into drifts and kicks for a system.

    ``method.data`` is (a, b), fractions of h: for each k a kick of b_k, then a drift of a_k; those at the ends may be
    zero. ``fills`` allows functions that write their results into arrays.
    """
    a, b = method.data
    parts = [part for drift, kick in zip_longest(a, b, fillvalue=0) for part in ((True, kick), (False, drift))]
    return _prepare([(kick, fraction) for kick, fraction in parts if fraction != 0], system, arithmetic, fills)
