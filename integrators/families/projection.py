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

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), IV.4 (Algorithm 4.2) and V.4.1;
E. Hairer, "Symmetric projection methods for differential equations on manifolds", BIT 40 (2000) 726-734.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types

from phasebench.integrators.engine import codegen
from phasebench.integrators.engine.kernel import Prepared, value
from phasebench.integrators.engine.lazy import sympy as sp
from phasebench.integrators.engine.solve import LEVELS, SOLVED, gauss, predict, remember, solver
from phasebench.integrators.engine.vector import (
    State,
    add,
    advanced,
    chosen,
    close,
    head,
    inlined,
    join,
    keep,
    load,
    minus,
    opened,
    plus,
    scale,
    size,
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


class Projection(NamedTuple):
    """The step of the base method, one of three; what is kept, g = 0 where its values are those of ``target``.

    ``constraint``, ``gram`` and ``pull`` are of `functions`; ``mirror`` is ``gram`` where the projection is symmetric,
    else None.
    """

    mirror: Callable | None
    constraint: Callable
    gram: Callable
    pull: Callable
    explicit: runge_kutta.RungeKutta | None
    split: splitting.Splitting | None
    implicit: parametric.Parametric | None
    stages: int
    target: Any
    h: float = 0.0
    eps: float = 0.0


@written(lambda d: "  return " + " and ".join(f"abs(r[{i}]) <= a * M[{i}]" for i in range(d)))
def within(r, a, M):
    """Whether the size of every component of r is at most a times that of M; not so where one is NaN."""
    return np.all(np.abs(r) <= a * M)


# -- the base methods' steps ------------------------------------------------------------------------------------------


def _kicks_and_drifts(split, step, y, orbit, known, first):
    q, p, lost_q, lost_p = y
    evaluations = 0
    for k in range(len(split.a)):
        if split.a[k] != 0:
            q, lost_q = add(q, lost_q, scale(split.a[k] * split.h, velocity(split.dT, p)))
        if split.b[k] != 0:
            p, lost_p = add(p, lost_p, scale(-split.b[k] * split.h, split.dV(q)))
            evaluations += 1
    return State(q, p, lost_q, lost_p), evaluations, 0, SOLVED


def _substeps(split, step, y, orbit, known, first):
    return parametric.advance(step.implicit, y, orbit, known, first)


_partitioned = chosen(_substeps, _kicks_and_drifts)


def _one_stage(explicit, step, y, orbit, known, first):
    return _partitioned(step.split, step, y, orbit, known, first)


def _explicit(explicit, step, y, orbit, known, first):
    dq, dp = runge_kutta.increment(explicit.field, explicit.tableau, explicit.h, y, orbit)
    return advanced(y, dq, dp), len(explicit.tableau) - 1, 0, SOLVED


#: The base method's step: explicit Runge-Kutta, explicit kicks and drifts, or substeps with stage equations;
#: (explicit, step, y, orbit, known, first) -> (y, evaluations, Newton solves, status).
advance = chosen(_one_stage, _explicit)


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


class Closing(NamedTuple):
    """The last part of a symmetric projection: x = G(y + x)^T mu."""

    pull: Callable
    q: Any
    p: Any
    mu: Any


@inlined
def closing(x, e):
    """G(y + x)^T mu."""
    dq, dp = e.pull(plus(e.q, head(x)), plus(e.p, tail(x)), e.mu)
    return join(dq, dp)


solve_closing = solver(closing)


@inlined
def onto(step, y, last):
    """(g(y), whether it is at round-off, or as near as it gets, by its ``last`` size)."""
    value, M = step.constraint(y.q, y.p)
    r = minus(value, step.target)
    eps = step.eps
    return r, within(r, eps, M) or (size(r) >= 0.5 * last and within(r, SLACK * eps, M))


def _standard(mirror, step, y, orbit, counts):
    y1, n, used, status = advance(step.explicit, step, y, orbit, counts.steps, True)
    counts.gradient += n
    counts.newton += used
    r, kept = onto(step, y1, np.inf)
    mu = scale(0.0, step.target)
    if status != SOLVED or kept:
        return y1, mu, True, status
    A = step.gram(y1.q, y1.p)
    counts.gradient += 1
    reach = size(y1.q) + size(y1.p)
    last = np.inf
    for _ in range(LIMIT):
        mu, regular = corrected(mu, r, A, orbit.work)
        dq, dp = step.pull(y1.q, y1.p, mu)
        counts.gradient += 1
        if not (regular and size(dq) + size(dp) <= reach):
            break
        end = advanced(y1, dq, dp)
        r, kept = onto(step, end, last)
        if kept:
            return end, mu, True, status
        last = size(r)
    return y1, scale(0.0, step.target), False, status


def _symmetric(mirror, step, y, orbit, counts):
    ring = LEVELS * step.stages  # where the memory keeps the multipliers of earlier steps
    zero = scale(0.0, step.target)
    A0 = mirror(y.q, y.p)
    A = A0
    counts.gradient += 1
    attempt, k, last = PREDICTED, 0, np.inf
    x = join(orbit.zero, orbit.zero)
    mu = predict(orbit.memory, ring, step.stages, counts.steps, zero)
    while True:
        dq, dp = step.pull(y.q, y.p, mu)
        counts.gradient += 1
        y1, n, used, status = advance(step.explicit, step, advanced(y, dq, dp), orbit, counts.steps, k == 0)
        counts.gradient += n
        counts.newton += used
        if attempt == UNPROJECTED:
            return y1, mu, False, status
        reach = size(y1.q) + size(y1.p)
        x, n, _, closed = solve_closing(Closing(step.pull, y1.q, y1.p, mu), x, reach, step.eps, orbit.work)
        counts.gradient += n
        good = status == SOLVED and closed == SOLVED and size(x) <= reach
        if good:
            end = advanced(y1, head(x), tail(x))
            r, kept = onto(step, end, last)
            if kept:
                remember(orbit.memory, ring, step.stages, counts.steps, mu)
                return end, mu, True, status
            last = size(r)
            if k == 0:
                A = plus(A0, step.gram(end.q, end.p))
                counts.gradient += 1
            mu, good = corrected(mu, r, A, orbit.work)
            k += 1
        if not good or k == LIMIT:
            attempt, k, last = attempt + 1, 0, np.inf
            mu = zero
            x = scale(0.0, x)
            if attempt == UNPROJECTED:
                remember(orbit.memory, ring, step.stages, counts.steps, mu)


#: One projected step, symmetric where ``mirror`` is given; (mirror, step, y, orbit, counts) -> (y, mu, whether the step
#: is projected, status of the base's step).
project = chosen(_standard, _symmetric)


def run(step, orbit, samples, counts):
    """The kernel; the parameter is the multiplier of H, NaN for a fallback."""
    y = opened(orbit)
    for row in range(len(samples.q)):
        multiplier = np.nan
        for _ in range(samples.every):
            y, mu, found, status = project(step.mirror, step, y, orbit, counts)
            if status != SOLVED:
                return row, status
            counts.steps += 1
            multiplier = mu[0]
            if not found:
                counts.fallbacks += 1
                multiplier = np.nan
        keep(samples, row, y)
        samples.parameter[row, 0] = multiplier
    close(orbit, y)
    return len(samples.q), 0


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
    inner = FAMILIES[base.family].prepare(base, system, arithmetic, fills=False)
    kinds = {"explicit": runge_kutta.RungeKutta, "split": splitting.Splitting, "implicit": parametric.Parametric}
    bases = {name: inner.step if isinstance(inner.step, kind) else None for name, kind in kinds.items()}
    invariants = (system.H, *(system.invariants if onto == "invariants" else ()))
    m = len(invariants)
    constraint, gram, pull = functions(system, invariants, arithmetic)
    stages = len(inner.step.a) if bases["split"] else inner.stages

    def begin(step, q, p):
        known = {name: base._replace(h=step.h, eps=step.eps) for name, base in bases.items() if base is not None}
        return step._replace(target=constraint(q, p)[0], **known)

    target = value([0] * m, system.d, arithmetic)
    return Prepared(
        run,
        Projection(gram if symmetric else None, constraint, gram, pull, **bases, stages=stages, target=target),
        max(inner.width, m),
        stages,
        implicit=inner.implicit,
        hessian=inner.hessian,
        linear=max(inner.width, m, 2 * system.d if symmetric else 0),
        begin=begin,
        missed=MISSED,
    )
