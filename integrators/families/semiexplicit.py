r"""Semiexplicit symplectic methods for every H: explicit steps of two copies between symmetric projections.

Two copies of the state y = (q, p), :math:`2\mu` apart, move by the explicit substeps of `extended` without a bond,

.. math::
    (a, b) = e^{\frac h2A}\,e^{hB}\,e^{\frac h2A}\,(y + \mu,\ y - \mu),\qquad
    A = H(q_a, p_b),\quad B = H(q_b, p_a),

and :math:`\mu = (\mu_q, \mu_p)` is such that the same shift makes them equal again,
:math:`a + \mu = b - \mu = y_1`.  With the increments :math:`\Delta_a, \Delta_b` of the copies that is

.. math::
    \mu = -\tfrac14\bigl(\Delta_a(\mu) - \Delta_b(\mu)\bigr),\qquad y_1 = y + \tfrac12\bigl(\Delta_a + \Delta_b\bigr),

an equation in as many unknowns as the state has, whatever the number of substeps, in which a fixed point contracts with
h.  A composition for a higher order is taken of the substeps, between one pair of projections.

The step is symmetric, symplectic in the original phase space and keeps quadratic invariants.  It is the implicit
Runge-Kutta method whose stages are the substeps: with the lengths :math:`w_i` of all substeps in turn (A for odd i, B
for even i) the weights are :math:`w_i / 2` and

.. math::
    a_{ij} = \tfrac{s_i s_j}4 w_j + [\,j < i,\ s_i\ne s_j\,]\,w_j,\qquad s_i = 1 \text{ for A}, -1 \text{ for B},

which fulfils :math:`b_i a_{ij} + b_j a_{ji} = b_i b_j`.  The rows of order 2 are (1/8, -1/4, 1/8), (3/8, 1/4, -1/8) and
(1/8, 3/4, 1/8).

Source: B. Jayawardana, T. Ohsawa, Math. Comput. 92 (2023) 251-281; T. Ohsawa, SIAM J. Numer. Anal. 61 (2023)
1293-1315 (quadratic invariants).  The tableau is derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.coefficients.copies import lengths_of_a
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import predict, remember, solver
from phasebench.integrators.values.vector import (
    axpy,
    head,
    inline,
    jit,
    join,
    minus,
    plus,
    scale,
    size,
    tail,
    update,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Value
    from phasebench.integrators.values.vector import State

#: Orbits may be integrated side by side.
IN_LANES = True


class Semiexplicit(NamedTuple):
    """The data of a semiexplicit method: the field, and the lengths of the substeps A and B in turn.

    With two copies (q, p) and (x, y) of the state, A moves x and p by the field at (q, y), B moves q and y by the field
    at (x, p).

    Attributes
    ----------
    field : the vector field (q', p')
    a, b : A over a[0] h, B over b[0] h, A over a[1] h, ..., A over a[-1] h
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    a: np.ndarray
    b: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Shift(NamedTuple):
    """Arguments of the equation for mu, half the distance between the two copies of the state.

    Attributes
    ----------
    method : the data of the method
    q, p : the state before the step
    """

    method: Semiexplicit
    q: Value
    p: Value


@jit
def increments(mu: Value, e: Shift) -> tuple[Value, Value]:
    """The increments over a step of both copies, which start at y + mu and y - mu: two vectors of q and p."""
    field, a, b, h = e.method.field, e.method.a, e.method.b, e.method.h
    q, p = plus(e.q, head(mu)), plus(e.p, tail(mu))
    x, y = minus(e.q, head(mu)), minus(e.p, tail(mu))
    dx, dp = field(q, y, h, 0.0)
    dx, dp = scale(a[0] * h, dx), scale(a[0] * h, dp)  # exp(a_0 h A)
    dq, dy = scale(0.0, dx), scale(0.0, dp)
    for k in range(len(b)):
        slope_q, slope_p = field(plus(x, dx), plus(p, dp), h, 0.0)
        dq, dy = axpy(b[k] * h, slope_q, dq), axpy(b[k] * h, slope_p, dy)  # exp(b_k h B)
        slope_q, slope_p = field(plus(q, dq), plus(y, dy), h, 0.0)
        dx, dp = axpy(a[k + 1] * h, slope_q, dx), axpy(a[k + 1] * h, slope_p, dp)  # exp(a_k h A)
    return join(dq, dp), join(dx, dy)


@inline
def shift(mu: Value, e: Shift) -> Value:
    """The right-hand side of the equation mu = G(mu): -1/4 of the difference of the two copies' increments."""
    first, second = increments(mu, e)
    return scale(-0.25, minus(first, second))


solve = solver(shift)


def step(method: Semiexplicit, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take a step from the state y: find the mu for which the two copies agree after it; returns (state, status).

    The iteration starts from the mu of earlier steps, in ``carry.memory``; evaluations are added to ``counts``.
    """
    mu = predict(carry.memory, 0, 1, counts.steps, join(carry.zero, carry.zero))
    e = Shift(method, y.q, y.p)
    mu, evaluations, newton, status = solve(e, mu, size(y.q) + size(y.p), method.eps, carry.work)
    counts.gradient += (evaluations + 1) * (len(method.a) + len(method.b))
    counts.newton += newton
    if status != SOLVED:
        return y, status
    remember(carry.memory, 0, 1, counts.steps, mu)
    first, second = increments(mu, e)
    both = scale(0.5, plus(first, second))
    return update(y, head(both), tail(both)), SOLVED


run = loop(step)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a semiexplicit method for a system.

    ``method.data`` is (fractions of h of the composed steps,).
    """
    (fractions,) = method.data
    lengths = (numbers(x, arithmetic) for x in (lengths_of_a(fractions), fractions))
    step = Semiexplicit(system.field(arithmetic), *lengths)
    return Prepared(run, step, width=2 * system.d, stages=1)
