r"""Galerkin variational integrators in position-momentum form.

For :math:`L = \tfrac12 v\cdot Mv - V(q)` the discrete Lagrangian is the action over a step of a polynomial of degree s
through the control points :math:`q^0, \dots, q^s` at the times :math:`\tau_0 = 0, \dots, \tau_s = 1` of the step, by a
quadrature :math:`(c_i, b_i)`,

.. math::
    L_d = h\sum_i b_i L(Q_i, \dot Q_i),\qquad
    Q_i = \sum_\mu \varphi_\mu(c_i)\,q^\mu,\qquad \dot Q_i = \tfrac1h\sum_\mu \varphi'_\mu(c_i)\,q^\mu ,

stationary in the inner control points; :math:`p_0 = -\partial L_d/\partial q^0`, :math:`p_1 = \partial L_d/\partial
q^s`.  With the forces :math:`F_i = -\nabla V(Q_i)` the derivative by :math:`q^\nu` is :math:`\tfrac1h M\sum_\mu
K_{\nu\mu}q^\mu + h\sum_i b_i\varphi_\nu(c_i)F_i`, :math:`K_{\nu\mu} = \sum_i b_i\varphi'_\nu(c_i)\varphi'_\mu(c_i)`:
-p0 for :math:`\nu = 0`, zero for the inner points.  These s equations are linear in the control points, with a matrix
of numbers; solved, they leave the equations of the kicks :math:`k_i = b_i F_i`,

.. math::
    Q_i = q_0 + h\,d_i M^{-1}p_0 + h^2 M^{-1}\sum_j a_{ij}k_j,\qquad
    p_1 = p_0 + h\sum_j k_j ,

and q1 = q^s likewise.  The result does not depend on the times of the inner control points.  The kicks are iterated to
round-off from an extrapolated start, by Newton's method where that does not contract.

The map is symplectic as :math:`a_{ij} - a_{ji} = d_i - d_j` and the row of q1 is :math:`1 - d_j`.  The latter holds
exactly in doubles, whatever the weights: a rounding error there would be the same in every step, and angular momentum
would drift.

Source: J. E. Marsden, M. West, Acta Numerica 10 (2001) 357-514, 2.2.6 and 2.6.6; S. Ober-Bloebaum, N. Saake,
Adv. Comput. Math. 41 (2015) 955-986.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.quadrature import gauss_legendre, gauss_lobatto
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import LEVELS, copy, predict, remember, row_solver
from phasebench.integrators.values.vector import (
    State,
    axpy,
    distance,
    inline,
    load,
    plus,
    scale,
    size,
    store,
    update,
    velocity,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value


class Variational(NamedTuple):
    """The coefficients of a Galerkin variational integrator; its unknowns are the kicks k_i = b_i F_i.

    F_i is the force at the position Q_i = q + h d_i v + h^2 M^-1 sum_j a_ij k_j of the quadrature node i.

    Attributes
    ----------
    dT : the function p -> M^-1 p; None if that is p itself
    dV : the gradient of V
    rows : array, for each node i, and last for the end of the step, the row of all a_ij and d_i
    b : the weights of the quadrature rule
    first, end : the kicks first, ..., end - 1 are iterated; each kick before them and after them depends only on kicks
        of lower number, and follows explicitly
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | None
    dV: Callable
    rows: np.ndarray
    b: np.ndarray
    first: int
    end: int
    h: float = 0.0
    eps: float = 0.0


class Equations(NamedTuple):
    """Arguments of the equations for the kicks of a step.

    Attributes
    ----------
    step : the coefficients of the method
    q, p, v : the coordinates, the momenta and the velocity before the step
    memory : array with the kicks of this step and of earlier ones
    like : a zero of the shape of q
    stages : the number of kicks
    """

    step: Variational
    q: Value
    p: Value
    v: Value
    memory: np.ndarray
    like: Value
    stages: int


@inline
def displacement(e: Equations, i: int, at: int) -> Value:
    """The displacement of node i from q, h d_i v + h^2 M^-1 sum_j a_ij k_j; kicks k_j are in the rows ``at``, ..."""
    rows, h = e.step.rows, e.step.h
    x = e.like
    for j in range(e.stages):
        if rows[i, j] != 0:
            x = axpy(rows[i, j], load(e.memory, at + j, e.like), x)
    return scale(h, axpy(rows[i, e.stages], e.v, scale(h, velocity(e.step.dT, x))))


@inline
def renew(e: Equations, at: int, first: int, end: int) -> tuple[Number, Number]:
    """Update the kicks first, ..., end - 1, each from the newest values of the others.

    They are in the rows ``at``, ... of ``e.memory``.  Returns (the distance of new and old kicks, the size of the new).
    """
    change = total = 0.0 * e.step.h
    for i in range(first, end):
        k = scale(-e.step.b[i], e.step.dV(axpy(1.0, displacement(e, i, at), e.q)))  # k_i = b_i F_i
        change = change + distance(k, load(e.memory, at + i, e.like))
        total = total + size(k)
        store(e.memory, at + i, k)
    return change, total


@inline
def sweep(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """Copy the kicks from the rows ``old`` to the rows ``new``, and update them there by `renew`.

    ``old`` and ``new`` are the first of these rows in ``e.memory``.  Returns (the distance of new and old kicks, the
    size of the new).
    """
    copy(e.memory, old, new, e.stages, e.like)
    return renew(e, new, e.step.first, e.step.end)


@inline
def evaluate(e: Equations, old: int, new: int) -> tuple[Number, Number]:
    """The right-hand side for all kicks, those that need no iteration as well, as `sweep` returns it."""
    copy(e.memory, old, new, e.stages, e.like)
    return renew(e, new, 0, e.stages)


@inline
def lengths(e: Equations, at: int) -> tuple[Number, Number]:
    """The size of the forces in a step, twice (`row_solver`): that of p over h, and of the unknowns in rows ``at``, ...

    The rows after these are G there.
    """
    length = size(e.p) / abs(e.step.h)
    for j in range(2 * e.stages):
        length = length + size(load(e.memory, at + j, e.like))
    return length, length


solve = row_solver(sweep, lengths, evaluate=evaluate)


@inline
def solve_kicks(e: Equations, span: Number, carry: Carry, counts: np.record) -> int:
    """Solve the equations for the kicks of a step, from a start extrapolated from earlier steps; returns the status.

    ``span`` is the size of (q, p).  Earlier kicks are read from ``carry``, and evaluations are added to ``counts``.
    The kicks are left in the rows of the memory from LEVELS times ``stages`` on.
    """
    step, r = e.step, e.stages
    at = LEVELS * r
    for i in range(r):
        store(e.memory, at + i, predict(e.memory, i, r, counts.steps, e.like))
    renew(e, at, 0, step.first)
    counts.gradient += r
    if step.first == step.end:
        return SOLVED
    # The unknowns are forces: span / h is what an increment of p is to be compared with.
    sweeps, newton, status = solve(e, at, span / abs(step.h), step.eps, carry.work)
    renew(e, at, step.end, r)
    counts.gradient += (sweeps - 1) * (step.end - step.first) + newton * r
    counts.newton += min(newton, 1)
    return status


def step(method: Variational, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why the kicks could not be solved for).

    They start from the kicks of earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    memory, zero = carry.memory, carry.zero
    r = len(method.b)
    e = Equations(method, y.q, y.p, velocity(method.dT, y.p), memory, zero, r)
    status = solve_kicks(e, size(y.q) + size(y.p), carry, counts)
    if status != SOLVED:
        return y, status
    total = zero
    for j in range(r):
        k = load(memory, LEVELS * r + j, zero)
        total = plus(total, k)
        remember(memory, j, r, counts.steps, k)
    return update(y, displacement(e, r, LEVELS * r), scale(method.h, total)), status


run = loop(step)


QUADRATURES = {"gauss": gauss_legendre, "lobatto": gauss_lobatto}


def _basis(k: int, s: int) -> list[mpmath.mpf]:
    """Coefficients, highest power first, of the polynomial of degree s that is 1 at k/s and 0 at the other j/s."""
    out = [mpmath.mpf(1)]
    for j in range(s + 1):
        if j != k:
            root, scale_ = mpmath.mpf(j) / s, mpmath.mpf(k - j) / s
            out = [(a - root * b) / scale_ for a, b in zip([*out, 0], [0, *out], strict=True)]
    return out


def coefficients(degree: int, rule: list[tuple[mpmath.mpf, mpmath.mpf]]) -> list[list[mpmath.mpf]]:
    """The coefficients of a Galerkin variational integrator for polynomials of a degree: rows (a_ij, d_i), weights b.

    ``rule`` is a quadrature rule [(node, weight), ...].  There is a row of all a_ij and d_i for each node i, and one
    for the end of the step (their meaning: see `Variational`); the last item of the list is the row of weights.
    """
    with mpmath.workdps(DIGITS):
        s, r = degree, len(rule)
        value = [[mpmath.polyval(_basis(k, s), c) for c, _ in rule] for k in range(s + 1)]
        slope = [[mpmath.polyval(_basis(k, s), c, derivative=1)[1] for c, _ in rule] for k in range(s + 1)]
        K = mpmath.matrix(s, s)
        for nu in range(s):
            for mu in range(1, s + 1):
                K[nu, mu - 1] = mpmath.fsum(b * slope[nu][i] * slope[mu][i] for i, (_, b) in enumerate(rule))
        columns = [[-value[nu][j] for nu in range(s)] for j in range(r)]
        columns.append([-1] + [0] * (s - 1))
        control = [mpmath.lu_solve(K, mpmath.matrix(c)) for c in columns]
        at = [[value[mu][i] for mu in range(1, s + 1)] for i in range(r)] + [[0] * (s - 1) + [1]]
        rows = [[mpmath.fdot(row, x) for x in control] for row in at]
        return [*rows, [b for _, b in rule]]


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a Galerkin variational integrator for a system.

    ``method.data`` is (degree, "gauss" or "lobatto", number of quadrature nodes).  The coefficients follow from the
    action, and from them which kicks have to be iterated.
    """
    degree, quadrature, nodes = method.data
    rows = coefficients(degree, QUADRATURES[quadrature](nodes, DIGITS))
    tiny = mpmath.mpf(10) ** (10 - DIGITS)
    rows = [[0 if abs(x) < tiny else x for x in row] for row in rows]
    explicit = 0
    while explicit < nodes and not any(rows[explicit][explicit:nodes]):
        explicit += 1
    end = nodes
    while end > explicit and not any(row[end - 1] for row in rows[:end]):
        end -= 1
    *rows, b = rows
    rows = array(rows, arithmetic)
    for j in range(nodes):
        rows[nodes, j] = 1 - rows[j, nodes]
        rows[j, nodes] = 1 - rows[nodes, j]
    step = Variational(
        system.grad_T(arithmetic), system.grad_V(arithmetic), rows, numbers(b, arithmetic), explicit, end
    )
    return Prepared(run, step, system.d, nodes, implicit=explicit < nodes, linear=nodes * system.d)
