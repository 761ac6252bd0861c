r"""One-stage methods with a parameter, and every composition of them: Schemes I, II, III and their relatives.

One substep of length :math:`ch` with stage weights :math:`(\mu, \lambda)` solves

.. math::
    \bar v = q + \mu\,\Delta q,\quad \bar u = p + \lambda\,\Delta p,\qquad
    (\Delta q, \Delta p) = ch\,f(\bar v, \bar u),\qquad (q, p) \leftarrow (q + \Delta q, p + \Delta p).

With :math:`f = J^{-1}\nabla H` and :math:`\mu = 1 - \lambda` this is Scheme I, the generating function
:math:`S = hH(u, v)`; with :math:`hH` replaced by the truncated series :math:`\bar S = \sum K_i h^i` it is the
generating-function method of order r (Scheme II: r = 2).  Symplectic Euler is :math:`\lambda = 1` or :math:`0`,
the midpoint rule :math:`\mu = \lambda = \tfrac12`, explicit and implicit Euler :math:`\mu = \lambda = 0` and :math:`1`.
Scheme III is the two substeps :math:`(\tfrac12, 1 - \lambda)`, :math:`(\tfrac12, \lambda)`.

For a separable H with quadratic T the stage :math:`\bar u` can be eliminated, which leaves one equation in the kick
:math:`\Delta p = chk`,

.. math::
    k = -\nabla U\bigl(q + \mu\,ch\,(v + \lambda\,ch\,M^{-1}k)\bigr),\qquad v = M^{-1}p,

the one-stage Nystrom form.  The stages are written through the increments themselves, mu Delta q and lambda Delta p:
a rounded product such as lambda h would violate the conditions of symplecticity by the same small amount in every step,
and angular momentum would drift.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), equations
(11)-(21) and the Nystrom form; K. Feng, H. M. Wu, M. Z. Qin, D. L. Wang, J. Comput. Math. 7 (1989) 71-96.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array, freeze
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import LEVELS, predict, remember, solver
from phasebench.integrators.values.vector import (
    State,
    axpy,
    dispatch_on_none,
    head,
    inline,
    join,
    load,
    scale,
    size,
    tail,
    update,
    velocity,
)

from . import splitting

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True


class Parametric(NamedTuple):
    """The data of a one-stage method with a parameter, composed of substeps.

    Attributes
    ----------
    field : the vector field (q', p'); None in the Nystrom form, where the unknown is the increment of p alone
    dT, dV : the gradients of T and V in the Nystrom form, else None
    c : lengths of the substeps as fractions of h
    mu, lam : weights of a substep's stage: it is evaluated at (q + mu Delta q, p + lam Delta p)
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable | None
    dT: Callable | None
    dV: Callable | None
    c: np.ndarray
    mu: np.ndarray
    lam: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Stage(NamedTuple):
    """Arguments of the stage equation of a substep, which starts at the state (q, p).

    Attributes
    ----------
    step : the data of the method
    q, p : the state before the substep
    v : grad T(p) in the Nystrom form, else p
    h : the length of the substep
    mu, lam : the shares of the increments of q and of p at which the right-hand side is evaluated (see `increments`)
    """

    step: Any
    q: Any
    p: Any
    v: Any
    h: float
    mu: float
    lam: float


@inline
def increments(x: Value, stage: Stage) -> Value:
    """The right-hand side of the stage equation x = G(x) for the increments x = (Delta q, Delta p) of a substep.

    G(x) = h f(q + mu Delta q, p + lam Delta p).
    """
    h, lam = stage.h, stage.lam
    dq, dp = stage.step.field(axpy(stage.mu, head(x), stage.q), axpy(lam, tail(x), stage.p), h, lam)
    return join(scale(h, dq), scale(h, dp))


@inline
def shift(x: Value, stage: Stage) -> Value:
    """The increment of q of a substep in Nystrom form, Delta q = h M^-1 (p + lam x), for its kick x = Delta p."""
    return scale(stage.h, axpy(stage.lam, velocity(stage.step.dT, x), stage.v))


@inline
def kick(x: Value, stage: Stage) -> Value:
    """The right-hand side G(x) of the stage equation x = G(x) in Nystrom form, for the kick x = Delta p.

    G(x) = -h grad V(q + mu Delta q), with Delta q from `shift`.
    """
    return scale(-stage.h, stage.step.dV(axpy(stage.mu, shift(x, stage), stage.q)))


@inline
def lengths_of_kick(x: Value, g: Value, stage: Stage) -> tuple[Number, Number]:
    """Return the size that the momenta have in a step with the kick x, as a pair: one for each half of x.

    Newton's method takes its finite differences in proportion to it.  Both halves of x change momenta, so both sizes
    are the same.  g is G(x), the right-hand side of the stage equation x = G(x).
    """
    length = size(stage.p) + size(x) + size(g)
    return length, length


solve_increments, solve_kick = solver(increments), solver(kick, lengths_of_kick)


def _nystrom(field, step, y, c, mu, lam, x, eps, work):
    stage = Stage(step, y.q, y.p, velocity(step.dT, y.p), c * step.h, mu, lam)
    x, n, used, status = solve_kick(stage, x, size(y.q) + size(y.p), eps, work)
    return update(y, shift(x, stage), x), x, n, used, status


def _general(field, step, y, c, mu, lam, x, eps, work):
    stage = Stage(step, y.q, y.p, y.p, c * step.h, mu, lam)
    x, n, used, status = solve_increments(stage, x, size(y.q) + size(y.p), eps, work)
    return update(y, head(x), tail(x)), x, n, used, status


#: One substep; x is the start of its equation. The Nystrom form if ``field`` is None.
#: (field, step, y, c, mu, lam, x, eps, work) -> (y, x, evaluations, 1 if Newton's method was used, status).
substep = dispatch_on_none(_nystrom, _general)

#: (field, zero) -> a zero of the kind of the substep's unknown: the kick, or both increments.
unknown = dispatch_on_none(lambda field, zero: zero, lambda field, zero: join(zero, zero))


@inline
def advance(step: Parametric, y: State, carry: Carry, known: int, first: bool) -> tuple[State, int, int, int]:
    """Take step number ``known`` (from 0) of a one-stage method from the state y.

    Returns (state, evaluations, number of equations solved by Newton's method, status).  If ``first`` is True the
    iterations start from values extrapolated from earlier steps, kept in ``carry``; if False, for a step that is taken
    again from a state nearby, from the solutions of the last attempt.
    """
    stages = len(step.c)
    start = unknown(step.field, carry.zero)
    evaluations, newtons, status = 0, 0, SOLVED
    for s in range(stages):
        if first:
            x = predict(carry.memory, s, stages, known, start)
        else:
            x = load(carry.memory, s + known % LEVELS * stages, start)
        y, x, n, used, status = substep(
            step.field, step, y, step.c[s], step.mu[s], step.lam[s], x, step.eps, carry.work
        )
        evaluations += n
        newtons += used
        if status != SOLVED:
            break
        remember(carry.memory, s, stages, known, x)
    return y, evaluations, newtons, status


def step(method: Parametric, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, status: `SOLVED` or why a stage equation could not be solved).

    Equations start from their solutions in earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    y, evaluations, newtons, status = advance(method, y, carry, counts.steps, True)
    counts.gradient += evaluations
    counts.newton += newtons
    return y, status


run = loop(step)


def quadratic(system: Hamiltonian, arithmetic: str, order: int = 1) -> tuple:
    """Choose the form of the stage equations: returns ((field, dT, dV), number of components of a stage's unknown).

    In the Nystrom form, for a separable H with quadratic T and ``order`` 1, field is None; else dT and dV are.
    ``order`` is that of the truncated generating function.
    """
    if order == 1 and system.separable and system.quadratic_kinetic:
        return (None, system.grad_T(arithmetic), system.grad_V(arithmetic)), system.d
    return (system.field(arithmetic, order), None, None), 2 * system.d


def is_splitting(method: Method) -> bool:
    """True if a parametric method is explicit on separable systems: its substeps are those of symplectic Euler."""
    order, substeps = method.data
    return order == 1 and all({mu, lam} == {0, 1} for _, mu, lam in substeps)


def prepare(method: Method, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a one-stage method for a system.

    ``method.data`` is (order of the generating function, substeps (c, mu, lambda)).  It is a splitting for separable H
    and substeps of symplectic Euler; the Nystrom form is used if T is quadratic.  ``fills`` allows functions that write
    their results into arrays.
    """
    order, substeps = method.data
    if system.separable and is_splitting(method):
        return splitting.from_substeps(substeps, system, arithmetic, fills)
    c, weights_mu, weights_lam = array(zip(*substeps, strict=True), arithmetic)
    for k, (_, mu, lam) in enumerate(substeps):
        if mu + lam == 1:  # also of the doubles: else the map is symplectic only to round-off, with a bias
            weights_mu[k] = 1 - weights_lam[k]
            weights_lam[k] = 1 - weights_mu[k]
    functions, width = quadratic(system, arithmetic, order)
    step = Parametric(*functions, *map(freeze, (c, weights_mu, weights_lam)))
    return Prepared(run, step, width, len(c), hessian=order > 1)
