r"""Lobatto IIIA-IIIB pairs on the manifold of constraints g(q) = 0, for every H(q, p).

With the coefficients a of IIIA and :math:`\hat a` of IIIB, of s stages, and :math:`f = -H_q`:

.. math::
    Q_i = q_0 + h\sum_j a_{ij} H_p(Q_j, P_j),\qquad
    P_i = p_0 + h\sum_j \hat a_{ij}\bigl(f(Q_j, P_j) - G(Q_j)^T\Lambda_j\bigr),\qquad g(Q_i) = 0,

where :math:`Q_1 = q_0,\ Q_s = q_1`, and no stage depends on :math:`\Lambda_s`, which puts
:math:`p_1 = p_0 + h\sum_j b_j(f_j - G_j^T\Lambda_j)` on the hidden constraints, :math:`G H_p(q_1, p_1) = 0`.  It is
symmetric, symplectic on the manifold, and of order 2s - 2; s = 2 is RATTLE where H is separable.

The unknowns are, for each stage, :math:`x_j = h b_j H_p`, :math:`z_j = h b_j (f_j - G_j^T\Lambda_j)` and
:math:`h^2\Lambda_j`.  A sweep evaluates H_p and f at the stages, and then corrects the multipliers by Newton's method
with the matrix at the step's start: with :math:`C = (a\hat a)_{i > 1,\,k < s}`

.. math::
    h^2\,\delta\Lambda_k = \sum_i (C^{-1})_{ki}\,\bigl(G(Q_i) H_{pp}(q_0, p_0) G(q_0)^T\bigr)^{-1} g(Q_i),

and x, z by the change that follows to first order.  All unknowns are compared in the scale of q.

Sources: L. O. Jay, SIAM J. Numer. Anal. 33 (1996) 368-387; E. Hairer, C. Lubich, G. Wanner, Geometric Numerical
Integration (2006), VII.1.5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.tableaus import tableau
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import NOT_FINITE, SOLVED, STALLED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import LEVELS, copy, fixed_point, predict
from phasebench.integrators.values.vector import (
    State,
    add,
    axpy,
    distance,
    inline,
    load,
    minus,
    plus,
    scale,
    size,
    store,
    update,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.constrained import ConstrainedHamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: The rows of a stage's unknowns: x, z and the multipliers.
X, Z, MULTIPLIER, ROWS = range(4)


class Manifold(NamedTuple):
    """The data of a Lobatto IIIA-IIIB pair on the manifold of constraints: functions of the system, and coefficients.

    The functions are those of the same names in `systems.constrained`; G is the Jacobian of the constraints g.

    Attributes
    ----------
    field : (q, p, h, lam) -> (H_p, -H_q), without constraints; h and lam are ignored
    multipliers : (q, q0, p0) -> (G(q) H_pp(q0, p0) G(q0)^T)^-1 g(q), the correction of multipliers by a Newton step
    pull : (q, x) -> G(q)^T x
    mobility : (q, p, x) -> H_pp x
    normal : (q, p) -> the part of p that leaves the manifold
    A_q, A_p : arrays (s, s), the coefficients a of IIIA and hat a of IIIB, divided by the weights
    b : array (s, 1), the weights
    C : array (s - 1, s - 1), the inverse of the product of the matrices a and hat a without its first row and last
        column, with which a Newton step combines the corrections that the constraints of the stages require
    noise : array (1, 1), how much that inverse magnifies the round-off of constraints
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    multipliers: Callable
    pull: Callable
    mobility: Callable
    normal: Callable
    A_q: np.ndarray
    A_p: np.ndarray
    b: np.ndarray
    C: np.ndarray
    noise: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Stages(NamedTuple):
    """Arguments of the equations of a step, which starts at the state (q, p).

    Attributes
    ----------
    method : the data of the method
    q, p : the state before the step
    memory : array with the unknowns x, z and multipliers of the stages
    like : a zero of the shape of q
    spare : the first row of ``memory`` that may be overwritten
    """

    method: Manifold
    q: Any
    p: Any
    memory: np.ndarray
    like: Any
    spare: int


@inline
def combine(e: Stages, A: np.ndarray, i: int, at: int, start: Value) -> Value:
    """Return ``start`` plus the sum over the stages j of A[i, j] times row at + 3 j of ``e.memory``.

    A stage has three rows, x, z and its multipliers; ``at`` is the row of one of them in the first stage.
    """
    y = start
    for j in range(len(e.method.b)):
        y = axpy(A[i, j], load(e.memory, at + ROWS * j, e.like), y)
    return y


@inline
def sweep(e: Stages, rows: tuple[int, int], active: bool) -> tuple[tuple[int, int], Number, Number]:
    """Do one iteration for the unknowns of all stages: evaluate the field, then correct the multipliers.

    ``rows`` is (first row of the old unknowns, first row of the new ones) in ``e.memory``.  Returns (the two row
    numbers exchanged, the distance between old and new unknowns, the size of the new), as `fixed_point` requires;
    ``active`` is not used.
    """
    method, memory, like, spare = e.method, e.memory, e.like, e.spare
    old, new = rows
    s, h = len(method.b), method.h
    for i in range(s):
        Q, P = combine(e, method.A_q, i, old + X, e.q), combine(e, method.A_p, i, old + Z, e.p)
        v, f = method.field(Q, P, h, 0.0)
        multiplier = load(memory, old + ROWS * i + MULTIPLIER, like)
        z = axpy(-1.0 / h, method.pull(Q, multiplier), scale(h, f))
        store(memory, new + ROWS * i + X, scale(method.b[i, 0] * h, v))
        store(memory, new + ROWS * i + Z, scale(method.b[i, 0], z))
        store(memory, new + ROWS * i + MULTIPLIER, multiplier)
        store(memory, spare + ROWS * i, Q)
        store(memory, spare + ROWS * i + 1, P)
    for i in range(1, s):
        Q = combine(e, method.A_q, i, new + X, e.q)
        store(memory, spare + ROWS * i + 2, method.multipliers(Q, e.q, e.p))
    delta, length = 0.0, 0.0
    following = spare + ROWS * s
    for k in range(s - 1):
        change = scale(0.0, like)
        for i in range(1, s):
            change = axpy(method.C[k, i - 1], load(memory, spare + ROWS * i + 2, like), change)
        multiplier = load(memory, new + ROWS * k + MULTIPLIER, like)
        store(memory, new + ROWS * k + MULTIPLIER, plus(multiplier, change))
        pulled = scale(method.b[k, 0], method.pull(load(memory, spare + ROWS * k, like), change))
        delta += size(pulled)
        store(memory, following + ROWS * k, scale(-1.0 / h, pulled))
        z = load(memory, new + ROWS * k + Z, like)
        store(memory, new + ROWS * k + Z, axpy(-1.0 / h, pulled, z))
    store(memory, following + ROWS * (s - 1), scale(0.0, like))
    for j in range(s):
        moved = combine(e, method.A_p, j, following, scale(0.0, like))
        Q, P = load(memory, spare + ROWS * j, like), load(memory, spare + ROWS * j + 1, like)
        x = load(memory, new + ROWS * j + X, like)
        x = axpy(method.b[j, 0] * h, method.mobility(Q, P, moved), x)
        store(memory, new + ROWS * j + X, x)
        z = load(memory, new + ROWS * j + Z, like)
        delta += distance(x, load(memory, old + ROWS * j + X, like))
        delta += abs(h) * distance(z, load(memory, old + ROWS * j + Z, like))
        length += size(x) + abs(h) * size(z)
    return (new, old), delta, length


@inline
def tangent(e: Stages, p: Value, active: bool) -> tuple[Value, Number, Number]:
    """Project p by one step of Newton's method for G H_p(q, p) = 0 along G^T: returns (new p, its change, its size).

    G is the Jacobian of the constraints at the coordinates q of e, so that p gets nearer to the hidden constraints;
    ``active`` is not used.
    """
    new = minus(p, e.method.normal(e.q, p))
    return new, distance(new, p), size(new)


iterate, project = fixed_point(sweep), fixed_point(tangent)


def step(method: Manifold, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y: solve for the stages, then project p; returns (state, status).

    The iteration starts from values of earlier steps, kept in ``carry``, and again from zero if it fails.  The status
    is `SOLVED` or why the step failed; evaluations are added to ``counts``.
    """
    memory, like = carry.memory, carry.zero
    n = ROWS * len(method.b)
    at = LEVELS * n
    e = Stages(method, y.q, y.p, memory, like, at + 2 * n)
    for r in range(n):
        store(memory, at + r, predict(memory, r, n, counts.steps, like))
    span = method.noise[0, 0] * (size(y.q) + abs(method.h) * size(y.p))
    rows, sweeps, solved = iterate(e, (at, at + n), span, method.eps)
    if not solved:
        for r in range(n):
            store(memory, at + r, scale(0.0, like))
        rows, more, solved = iterate(e, (at, at + n), span, method.eps)
        sweeps += more
    counts.gradient += sweeps * len(method.b)
    dq, dp = scale(0.0, like), scale(0.0, like)
    for j in range(len(method.b)):
        dq = plus(dq, load(memory, rows[0] + ROWS * j + X, like))
        dp = plus(dp, load(memory, rows[0] + ROWS * j + Z, like))
    if not solved:
        return y, STALLED if size(dq) + size(dp) < np.inf else NOT_FINITE
    copy(memory, rows[0], counts.steps % LEVELS * n, n, like)
    new = update(y, dq, dp)
    p, _, solved = project(Stages(method, new.q, new.p, memory, like, at), new.p, size(y.p), method.eps)
    if not solved:
        return y, STALLED if size(p) < np.inf else NOT_FINITE
    p, lost_p = add(new.p, new.lost_p, minus(p, new.p))
    return State(new.q, p, new.lost_q, lost_p), SOLVED


run = loop(step)


def prepare(method: Method, system: ConstrainedHamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a Lobatto IIIA-IIIB pair for a system with constraints.

    ``method.data`` is (s,), the number of stages.
    """
    (s,) = method.data
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    found = tableau("lobatto-iiia-iiib", s, s, False, digits, unit)
    with mpmath.workdps(digits):
        b = mpmath.diag([row[i] for i, row in enumerate(found.B)])
        product = mpmath.matrix(found.A_q) * b * mpmath.matrix(found.A_p) * b
        C = mpmath.inverse(product[1:, : s - 1]).tolist()
        noise = 1 + sum(b[k, k] * abs(x) for k, row in enumerate(C) for x in row)
    step = Manifold(
        system.free_field(arithmetic),
        system.multipliers(arithmetic),
        system.pull(arithmetic),
        system.mobility(arithmetic),
        system.normal(arithmetic),
        array(found.A_q, arithmetic),
        array(found.A_p, arithmetic),
        array(([row[i]] for i, row in enumerate(found.B)), arithmetic),
        array(C, arithmetic),
        array([[noise]], arithmetic),
    )
    return Prepared(run, step, system.d, ROWS * s, linear=1)
