r"""Projection and symmetric projection of any base step onto the initial values of the energy and other invariants.

Let :math:`g(y) = (H - H^0, I_1 - I_1^0, \dots)` with the values at the start of the run, and G = g' its Jacobian.
Standard projection follows each step :math:`\tilde y = \Phi_h(y_0)` of the base method by

.. math::
    y_1 = \tilde y + G(\tilde y)^T\mu,\qquad g(y_1) = 0,

symmetric projection, for a symmetric base, is

.. math::
    \hat y = y_0 + G(y_0)^T\mu,\qquad \tilde y = \Phi_h(\hat y),\qquad y_1 = \tilde y + G(y_1)^T\mu,\qquad g(y_1) = 0,

with the same mu on both sides, which makes it symmetric.  The multipliers come from a simplified Newton iteration to
round-off: with the matrix :math:`G G^T` at :math:`\tilde y`, and with the sum of those at y_0 and y_1, since
:math:`G(\Phi_h(y))\Phi_h'(y) = G(y) + O(h^{p+1})`.  The target is the initial value, so errors do not add up.

A step is taken with mu = 0 and counted as a fallback where the gradients are dependent, the iteration fails, or the
correction is longer than the state; a later step wins back what it lost.

``plan`` is the base method's, ``table`` is [[H0, I0, ...]].

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), IV.4 (Algorithm 4.2) and V.4.1;
E. Hairer, "Symmetric projection methods for differential equations on manifolds", BIT 40 (2000) 726-734.
"""

from __future__ import annotations

import numpy as np
import sympy as sp
from numba import types

from phasebench.integrators.engine import codegen
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.solve import LEVELS, SOLVED, gauss, predict, remember, solver
from phasebench.integrators.engine.vector import (
    add,
    chosen,
    close,
    head,
    inlined,
    join,
    load,
    minus,
    opened,
    plus,
    scale,
    size,
    store,
    tail,
    velocity,
    written,
)
from phasebench.integrators.records.projection import projected as projected

from . import parametric, runge_kutta, splitting

#: Where the base methods' functions and coefficients come from.
FAMILIES = {"runge_kutta": runge_kutta, "parametric": parametric, "splitting": splitting}
LIMIT = 20
#: An invariant is known to its round-off times this where the iteration can do no better.
SLACK = 64.0
MISSED = "could not be projected and were taken as the base method's"
#: Where the multipliers of a symmetric projection start: from earlier steps', from zero; then without projection.
PREDICTED, UNPROJECTED = 0, 2


@written(lambda d: "  return " + " and ".join(f"abs(r[{i}]) <= a * M[{i}]" for i in range(d)))
def within(r, a, M):
    """Whether the size of every component of r is at most a times that of M; not so where one is NaN."""
    return np.all(np.abs(r) <= a * M)


# -- the base methods' steps ------------------------------------------------------------------------------------------


def _kicks_and_drifts(kick, field, dT, dV, plan, h, eps, zero, known, first, q, p, cq, cp, memory, work):
    evaluations = 0
    for k in range(len(plan)):
        if plan[k, 0] != 0:
            q, cq = add(q, cq, scale(plan[k, 0] * h, velocity(dT, p)))
        if plan[k, 1] != 0:
            p, cp = add(p, cp, scale(-plan[k, 1] * h, kick(q)))
            evaluations += 1
    return q, p, cq, cp, evaluations, 0, SOLVED


def _substeps(kick, field, dT, dV, plan, h, eps, zero, known, first, q, p, cq, cp, memory, work):
    start = parametric.unknown(field, zero)
    return parametric.step(field, dT, dV, plan, h, eps, start, known, first, q, p, cq, cp, memory, work)


_partitioned = chosen(_substeps, _kicks_and_drifts)


def _one_stage(tableau, kick, field, dT, dV, plan, h, eps, zero, known, first, q, p, cq, cp, memory, work):
    return _partitioned(kick, field, dT, dV, plan, h, eps, zero, known, first, q, p, cq, cp, memory, work)


def _explicit(tableau, kick, field, dT, dV, plan, h, eps, zero, known, first, q, p, cq, cp, memory, work):
    x = runge_kutta.increment(tableau, plan, h, zero, q, p, memory)
    q, cq = add(q, cq, head(x))
    p, cp = add(p, cp, tail(x))
    return q, p, cq, cp, len(plan) - 1, 0, SOLVED


#: The base method's step: explicit Runge-Kutta where ``tableau`` is its field, explicit kicks and drifts where ``kick``
#: is grad V, else substeps with stage equations; returns (q, p, cq, cp, evaluations, Newton solves, status).
step = chosen(_one_stage, _explicit)


# -- the projections --------------------------------------------------------------------------------------------------


@inlined
def corrected(mu, r, A, work):
    """(mu - A^-1 r, whether A is regular); the rows of the matrix stand in A one after the other."""
    m = len(r)
    for i in range(m):
        for j in range(m):
            work[i, j] = A[i * m + j]
        work[i, m] = -r[i]
    if not gauss(work, m):
        return mu, False
    for j in range(m):
        work[m, j] = work[j, m]
    return plus(mu, load(work, m, mu)), True


@inlined
def closing(x, arguments):
    """G(y)^T mu at y = (q, p) + x: the last part of a symmetric projection is its fixed point."""
    pull, q, p, mu = arguments
    dq, dp = pull(plus(q, head(x)), plus(p, tail(x)), mu)
    return join(dq, dp)


solve_closing = solver(closing)


def _standard(mirror, constraint, gram, pull, base, h, eps, zero, target, q, p, cq, cp, memory, work, counts):
    tableau, kick, field, dT, dV, plan = base
    q1, p1, c1, d1, n, used, status = step(
        tableau, kick, field, dT, dV, plan, h, eps, zero, counts[0], True, q, p, cq, cp, memory, work
    )
    counts[1] += n
    counts[2] += used
    value, M = constraint(q1, p1)
    r = minus(value, target)
    mu = scale(0.0, target)
    if status != SOLVED or within(r, eps, M):
        return q1, p1, c1, d1, mu, True, status
    A = gram(q1, p1)
    counts[1] += 1
    reach = size(q1) + size(p1)
    last = np.inf
    for _ in range(LIMIT):
        mu, regular = corrected(mu, r, A, work)
        dq, dp = pull(q1, p1, mu)
        counts[1] += 1
        if not (regular and size(dq) + size(dp) <= reach):
            break
        qa, ca = add(q1, c1, dq)
        pa, da = add(p1, d1, dp)
        value, M = constraint(qa, pa)
        r = minus(value, target)
        if within(r, eps, M) or (size(r) >= 0.5 * last and within(r, SLACK * eps, M)):
            return qa, pa, ca, da, mu, True, status
        last = size(r)
    return q1, p1, c1, d1, scale(0.0, target), False, status


def _symmetric(mirror, constraint, gram, pull, base, h, eps, zero, target, q, p, cq, cp, memory, work, counts):
    tableau, kick, field, dT, dV, plan = base
    ring = LEVELS * len(plan)  # where ``memory`` keeps the multipliers of earlier steps
    A0 = mirror(q, p)
    A = A0
    counts[1] += 1
    attempt, k, last = PREDICTED, 0, np.inf
    x = join(zero, zero)
    mu = predict(memory, ring, len(plan), counts[0], target)
    while True:
        dq, dp = pull(q, p, mu)
        counts[1] += 1
        q1, c1 = add(q, cq, dq)
        p1, d1 = add(p, cp, dp)
        q1, p1, c1, d1, n, used, status = step(
            tableau, kick, field, dT, dV, plan, h, eps, zero, counts[0], k == 0, q1, p1, c1, d1, memory, work
        )
        counts[1] += n
        counts[2] += used
        if attempt == UNPROJECTED:
            return q1, p1, c1, d1, mu, False, status
        reach = size(q1) + size(p1)
        x, n, _, closed = solve_closing((pull, q1, p1, mu), x, reach, eps, work)
        counts[1] += n
        good = status == SOLVED and closed == SOLVED and size(x) <= reach
        if good:
            qa, ca = add(q1, c1, head(x))
            pa, da = add(p1, d1, tail(x))
            value, M = constraint(qa, pa)
            r = minus(value, target)
            if within(r, eps, M) or (size(r) >= 0.5 * last and within(r, SLACK * eps, M)):
                remember(memory, ring, len(plan), counts[0], mu)
                return qa, pa, ca, da, mu, True, status
            last = size(r)
            if k == 0:
                A = plus(A0, gram(qa, pa))
                counts[1] += 1
            mu, good = corrected(mu, r, A, work)
            k += 1
        if not good or k == LIMIT:
            attempt, k, last = attempt + 1, 0, np.inf
            mu = scale(0.0, mu)
            x = scale(0.0, x)
            if attempt == UNPROJECTED:
                remember(memory, ring, len(plan), counts[0], mu)


#: One projected step, symmetric where ``mirror`` (the matrix G G^T once more) is given; returns (q, p, cq, cp, mu,
#: whether the step is projected, status of the base's step).
project = chosen(_standard, _symmetric)


def run(
    mirror, constraint, gram, pull, tableau, kick, field, dT, dV,
    plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts,
):  # fmt: skip
    """Fill the rows of Q, P and aux (the last multiplier of H, NaN for a fallback); returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    target = load(table, 0, constraint(q, p)[0])
    base = (tableau, kick, field, dT, dV, plan)
    for row in range(len(Q)):
        multiplier = np.nan
        for _ in range(every):
            q, p, cq, cp, mu, found, status = project(
                mirror, constraint, gram, pull, base, h, eps, zero, target, q, p, cq, cp, memory, work, counts
            )
            if status != SOLVED:
                return row, status
            counts[0] += 1
            multiplier = mu[0]
            if not found:
                counts[3] += 1
                multiplier = np.nan
        store(Q, row, q)
        store(P, row, p)
        aux[row] = multiplier
    close(state, q, p, cq, cp)
    return len(Q), 0


def functions(system, invariants, arithmetic):
    """What the kernel asks of the invariants: ``constraint``, ``gram``, ``pull``.

    constraint(q, p) -> (values, M) of shape (m,), values known to eps M; gram(q, p) -> G G^T row by row, of shape
    (m m,); pull(q, p, mu) -> G^T mu as its parts (q, p).
    """
    m, y = len(invariants), (*system.q, *system.p)
    mu = [sp.Dummy() for _ in invariants]
    T, Tm, Tmm = (_vector_type(system.d, n) for n in (system.d, m, m * m))
    state = [("q", system.q), ("p", system.p)]
    key = " ".join(map(sp.srepr, invariants))

    def magnitude(e):
        return sum(sp.Abs(t) for t in sp.Add.make_args(e)) + sum(sp.Abs(x * sp.diff(e, x)) for x in y)

    def products():
        G = sp.Matrix([[sp.diff(e, x) for x in y] for e in invariants])
        return [list(G * G.T)]

    def pulled():
        total = sum(a * e for a, e in zip(mu, invariants, strict=True))
        return [[sp.diff(total, x) for x in system.q], [sp.diff(total, x) for x in system.p]]

    constraint = system.made(
        f"constraint {key}",
        state,
        lambda: [list(invariants), [magnitude(e) for e in invariants]],
        types.Tuple((Tm, Tm))(T, T),
        arithmetic,
    )
    gram = system.made(f"gram {key}", state, products, Tmm(T, T), arithmetic)
    pull = system.made(f"pull {key}", [*state, ("mu", mu)], pulled, types.Tuple((T, T))(T, T, Tm), arithmetic)
    return constraint, gram, pull


def _vector_type(d, n):
    """The Numba type of n numbers beside states of d components."""
    tuples = codegen.value_kind(d) == "tuple"
    return types.UniTuple(types.float64, n) if tuples else types.Array(types.float64, 1, "C")


def prepare(method, system, arithmetic):
    """The base method's own functions and coefficients, with those of the invariants."""
    base, onto, symmetric = method.data
    inner = FAMILIES[base.family].prepare(base, system, arithmetic)
    tableau = kick = field = dT = dV = None
    if inner.run is runge_kutta.run:
        (tableau,) = inner.functions
    elif inner.run is splitting.run:
        dT, kick = inner.functions
    else:
        field, dT, dV = inner.functions
    invariants = (system.H, *(system.invariants if onto == "invariants" else ()))
    m = len(invariants)
    constraint, gram, pull = functions(system, invariants, arithmetic)

    def begin(table, q, p):
        table[0, :] = constraint(q, p)[0]

    return Prepared(
        run,
        (gram if symmetric else None, constraint, gram, pull, tableau, kick, field, dT, dV),
        inner.plan,
        array([[0] * m], arithmetic),
        max(inner.width, m),
        len(inner.plan),
        implicit=inner.implicit,
        hessian=inner.hessian,
        linear=max(inner.width, m, 2 * system.d if symmetric else 0),
        begin=begin,
        missed=MISSED,
    )
