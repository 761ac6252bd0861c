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
a product such as lambda h, rounded once and for all, would break the conditions of symplecticity by a little that has
a sign, and angular momentum would drift.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), equations
(11)-(21) and the Nystrom form; K. Feng, H. M. Wu, M. Z. Qin, D. L. Wang, J. Comput. Math. 7 (1989) 71-96.
"""

from __future__ import annotations

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import LEVELS, SOLVED, predict, remember, solver
from phasebench.integrators.engine.vector import (
    add,
    axpy,
    chosen,
    close,
    head,
    inlined,
    join,
    load,
    opened,
    scale,
    size,
    store,
    tail,
    velocity,
)

from . import splitting


@inlined
def increments(x, arguments):
    """(Delta q, Delta p) = h f at the stage that the increments x make."""
    field, q, p, h, mu, lam = arguments
    dq, dp = field(axpy(mu, head(x), q), axpy(lam, tail(x), p), h, lam)
    return join(scale(h, dq), scale(h, dp))


@inlined
def kick(x, arguments):
    """Delta p = -h grad V at the stage that the kick x makes."""
    dT, dV, q, v, h, mu, lam = arguments
    return scale(-h, dV(axpy(mu, scale(h, axpy(lam, velocity(dT, x), v)), q)))


solve_increments, solve_kick = solver(increments), solver(kick)


def _nystrom(field, dT, dV, q, p, cq, cp, h, mu, lam, x, eps, work):
    v = velocity(dT, p)
    x, n, used, status = solve_kick((dT, dV, q, v, h, mu, lam), x, size(q) + size(p), eps, work)
    q, cq = add(q, cq, scale(h, axpy(lam, velocity(dT, x), v)))
    p, cp = add(p, cp, x)
    return q, p, cq, cp, x, n, used, status


def _general(field, dT, dV, q, p, cq, cp, h, mu, lam, x, eps, work):
    x, n, used, status = solve_increments((field, q, p, h, mu, lam), x, size(q) + size(p), eps, work)
    q, cq = add(q, cq, head(x))
    p, cp = add(p, cp, tail(x))
    return q, p, cq, cp, x, n, used, status


#: One substep from the start x of its equation, in the Nystrom form where ``field`` is None;
#: (field, dT, dV, q, p, cq, cp, h, mu, lam, x, eps, work) -> (q, p, cq, cp, x, evaluations, Newton used, status).
substep = chosen(_nystrom, _general)

#: A zero of the kind of the substep's unknown: the kick, or both increments; (field, zero) -> x.
unknown = chosen(lambda field, zero: zero, lambda field, zero: join(zero, zero))


@inlined
def step(field, dT, dV, plan, h, eps, start, known, first, q, p, cq, cp, memory, work):
    """One step of the substeps ``plan[s]`` = (c, mu, lambda), the one after ``known`` others.

    Its equations start from an extrapolation of earlier steps (``first``) or, where the step is taken again from a
    state nearby, from the last attempt's solutions.  Returns (q, p, cq, cp, evaluations, Newton solves, status).
    """
    slots = len(plan)
    evaluations, newtons, status = 0, 0, SOLVED
    for s in range(slots):
        if first:
            x = predict(memory, s, slots, known, start)
        else:
            x = load(memory, s + known % LEVELS * slots, start)
        q, p, cq, cp, x, n, used, status = substep(
            field, dT, dV, q, p, cq, cp, plan[s, 0] * h, plan[s, 1], plan[s, 2], x, eps, work
        )
        evaluations += n
        newtons += used
        if status != SOLVED:
            break
        remember(memory, s, slots, known, x)
    return q, p, cq, cp, evaluations, newtons, status


def run(field, dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps of the substeps ``plan[s]`` = (c, mu, lambda).

    Returns (rows filled, status); ``state`` (q, p and what rounding lost of them) and ``memory`` go on where they were.
    """
    q, p, cq, cp = opened(state, zero)
    start = unknown(field, zero)
    known, evaluations, newtons = counts[0], 0, 0
    for row in range(len(Q)):
        for _ in range(every):
            q, p, cq, cp, n, used, status = step(
                field, dT, dV, plan, h, eps, start, known, True, q, p, cq, cp, memory, work
            )
            evaluations += n
            newtons += used
            if status != SOLVED:
                counts[0], counts[1], counts[2] = known, counts[1] + evaluations, counts[2] + newtons
                return row, status
            known += 1
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[0], counts[1], counts[2] = known, counts[1] + evaluations, counts[2] + newtons
    return len(Q), 0


def prepare(method, system, arithmetic):
    """Explicit where H is separable and every substep a symplectic Euler one; else Nystrom where T is quadratic."""
    order, substeps = method.data
    simple = order == 1 and system.separable
    if simple and all({mu, lam} == {0, 1} for _, mu, lam in substeps):
        return splitting.from_substeps(substeps, system, arithmetic)
    if simple and system.quadratic_kinetic:
        functions, width = (None, system.grad_T(arithmetic), system.grad_V(arithmetic)), system.d
    else:
        functions, width = (system.field(arithmetic, order), None, None), 2 * system.d
    plan = array(substeps, arithmetic)
    for row, (_, mu, lam) in zip(plan, substeps, strict=True):
        if mu + lam == 1:  # also of the doubles: else the map is symplectic only to round-off, with a sign
            row[1] = 1 - row[2]
            row[2] = 1 - row[1]
    return Prepared(run, functions, plan, array([[0]], arithmetic), width, len(plan), hessian=order > 1)
