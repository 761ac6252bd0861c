r"""RATTLE and SHAKE: kicks and drifts that keep constraints g(q) = 0, for H = p . M^-1 p / 2 + V(q).

.. math::
    p_{1/2} = p_0 - \tfrac h2\bigl(\nabla V(q_0) + G(q_0)^T\lambda\bigr),\qquad
    q_1 = q_0 + h M^{-1} p_{1/2},\qquad g(q_1) = 0, \\
    p_1 = p_{1/2} - \tfrac h2\bigl(\nabla V(q_1) + G(q_1)^T\mu\bigr),\qquad G(q_1) M^{-1} p_1 = 0

is RATTLE; steps over fractions of h are composed for a higher order.  The first multiplier puts q on the constraints,
the second p on the hidden ones.  SHAKE has the same q, and as p the mean of the momenta before and after, :math:`p_n =
M(q_{n+1} - q_{n-1})/2h`, which is off the hidden constraints.

The unknown is :math:`w = \tfrac{h^2}2 G(q_0)^T\lambda`.  Newton's method for :math:`g(\bar q - M^{-1}w) = 0`,

.. math::
    w \leftarrow w + G(q_0)^T\bigl(G(q) M^{-1} G(q_0)^T\bigr)^{-1} g(q),\qquad q = \bar q - M^{-1} w ,

starts from the values of earlier steps, and ends where w moves q by less than round-off.

RATTLE is symmetric, symplectic on the manifold of both constraints, and of order 2.  SHAKE keeps
:math:`\sum dq_i\wedge dp_i` too, since :math:`G\,dq = 0`.

Sources: J.-P. Ryckaert, G. Ciccotti, H. J. C. Berendsen, J. Comput. Phys. 23 (1977) 327-341 (SHAKE); H. C. Andersen,
J. Comput. Phys. 52 (1983) 24-34 (RATTLE); B. Leimkuhler, R. D. Skeel, J. Comput. Phys. 112 (1994) 117-125; E. Hairer,
C. Lubich, G. Wanner, Geometric Numerical Integration (2006), VII.1.3-1.4.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import NOT_FINITE, SOLVED, STALLED
from phasebench.integrators.stepping.kernel import Carry, Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import fixed_point, predict, remember, replace
from phasebench.integrators.values.masks import overload_in_lanes
from phasebench.integrators.values.vector import (
    add,
    add_product,
    inline,
    minus,
    plus,
    read_state,
    scale,
    size,
    velocity,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
    from phasebench.integrators.values.kinds import Condition, Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True


class Rattle(NamedTuple):
    """The data of RATTLE or SHAKE.

    Attributes
    ----------
    dT : the function p -> M^-1 p; None if that is p itself
    dV : the gradient of V
    restore, normal : functions of `systems.constrained`: a Newton step onto the constraints, and the part of p that
        leaves the manifold
    b : fractions of h of the steps that are composed
    project : True if p is projected onto the hidden constraints (RATTLE), False if it is that of SHAKE
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | None
    dV: Callable
    restore: Callable
    normal: Callable
    b: np.ndarray
    project: bool
    h: float = 0.0
    eps: float = 0.0


class RattleState(NamedTuple):
    """The state (q, p), and the gradient of V at q.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    gradient : grad V(q)
    """

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value
    gradient: Value


class Drift(NamedTuple):
    """Arguments of the equation g(q + lost + move - M^-1 w) = 0 for w, the constraint impulse times h.

    Attributes
    ----------
    method : the data of the method
    q, lost : the coordinates before the drift, and what rounding lost of them
    move : the move of q without constraints
    """

    method: Rattle
    q: Value
    lost: Value
    move: Value


@inline
def sweep(e: Drift, w: Value, active: Condition) -> tuple[Value, Number, Number]:
    """Do one step of Newton's method for w, the constraint impulse times h, which puts the new q on the constraints.

    e has the coordinates before the drift and their move without constraints; ``active`` are the SIMD lanes to iterate.
    Returns (new w, how far it moves q, size of q).
    """
    moved = minus(e.move, velocity(e.method.dT, w))
    q, _ = add(e.q, e.lost, moved)
    dw = e.method.restore(q, e.q)
    return replace(active, w, plus(w, dw)), size(velocity(e.method.dT, dw)), size(q)


iterate = fixed_point(sweep)


def _solve(e, start, span, eps):
    w, sweeps, solved = iterate(e, start, span, eps)
    if not solved:
        w, more, solved = iterate(e, scale(0.0, start), span, eps)
        sweeps += more
    if solved:
        return w, sweeps, SOLVED
    return w, sweeps, STALLED if size(w) < np.inf else NOT_FINITE


def _solve_lanes(e, start, span, eps):
    w, sweeps, _ = iterate(e, start, span, eps)
    return w, sweeps, SOLVED if (size(w) < np.inf) & (span < np.inf) else NOT_FINITE


#: Solve for w from a start: (w, sweeps, status); in lanes a w that is not found is NaN.
solve = overload_in_lanes(_solve, _solve_lanes)


@inline
def drift(method: Rattle, y: RattleState, h: Number, start: Value) -> tuple[Value, Value, int, int]:
    """Drift from the state y, which has had its kick, over the time h under constraints.

    Returns (w, the constraint impulse times h; the move of q; the number of iterations; status: `SOLVED` or why w was
    not found).  ``start`` is a starting value of w.
    """
    move = scale(h, velocity(method.dT, y.p))
    start = method.normal(y.q, start)  # earlier ones were along the G^T of other places
    w, sweeps, status = solve(Drift(method, y.q, y.lost_q, move), start, size(y.q), method.eps)
    return w, minus(move, velocity(method.dT, w)), sweeps, status


@inline
def kick(y: RattleState, h: Number) -> RattleState:
    """The state after a kick by -grad V over the time h, without the forces of the constraints."""
    p, lost_p = add_product(y.p, y.lost_p, -h, y.gradient)
    return RattleState(y.q, p, y.lost_q, lost_p, y.gradient)


@inline
def pull(y: RattleState, a: Number, w: Value) -> RattleState:
    """The state y with a times the vector w added to p."""
    p, lost_p = add_product(y.p, y.lost_p, a, w)
    return RattleState(y.q, p, y.lost_q, lost_p, y.gradient)


def begin(method: Rattle, carry: Carry, counts: np.record) -> RattleState:
    """Read the state from ``carry``, where the last call of the kernel left it, and evaluate grad V."""
    y = read_state(carry)
    counts.gradient += 1
    return RattleState(y.q, y.p, y.lost_q, y.lost_p, method.dV(y.q))


def step(method: Rattle, y: RattleState, carry: Carry, counts: np.record) -> tuple[RattleState, int]:
    """Take the composed steps in turn, each a kick, a drift on the constraints and a kick; returns (state, status).

    The constraint impulses start from those of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    first, n, found = y, len(method.b), SOLVED
    for k in range(n):
        if found == SOLVED:
            h = method.b[k] * method.h
            start = predict(carry.memory, k, n, counts.steps, carry.zero)
            y = kick(y, 0.5 * h)
            w, moved, _, found = drift(method, y, h, start)
            remember(carry.memory, k, n, counts.steps, w)
            y = pull(y, -1.0 / h, w)
            q, lost_q = add(y.q, y.lost_q, moved)  # q is on the constraints
            y = kick(RattleState(q, y.p, lost_q, y.lost_p, method.dV(q)), 0.5 * h)
            counts.gradient += 1
            if method.project:
                y = pull(y, -1.0, method.normal(q, y.p))  # and p on the hidden ones
            elif found == SOLVED:
                following, _, _, found = drift(method, kick(y, 0.5 * h), h, scale(2.0, w))
                y = pull(y, -0.5 / h, following)
    return y if found == SOLVED else first, found


run = loop(step, begin)


def prepare(method: Method, system: ConstrainedHamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of RATTLE or SHAKE for a system with constraints.

    ``method.data`` is (fractions of h of the composed steps, True for RATTLE, False for SHAKE).
    """
    fractions, project = method.data
    step = Rattle(
        system.grad_T(arithmetic),
        system.grad_V(arithmetic),
        system.restore(arithmetic),
        system.normal(arithmetic),
        numbers(fractions, arithmetic),
        bool(project),
    )
    return Prepared(run, step, system.d, len(fractions), implicit=False)
