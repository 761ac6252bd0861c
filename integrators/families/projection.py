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
correction is longer than the state; a later step restores the invariants.

Sources: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), IV.4 (Algorithm 4.2) and V.4.1;
E. Hairer, "Symmetric projection methods for differential equations on manifolds", BIT 40 (2000) 726-734.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.records.projection import projection_method as projection_method
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, value
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.newton import gauss
from phasebench.integrators.stepping.solve import LEVELS, predict, remember, solver
from phasebench.integrators.values.vector import (
    State,
    add,
    dispatch_on_none,
    head,
    inline,
    join,
    load,
    minus,
    plus,
    scale,
    size,
    tail,
    unroll,
    update,
    velocity,
)

from . import parametric, runge_kutta, splitting

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Function, Number, Value

#: The families of base methods.
FAMILIES = {"runge_kutta": runge_kutta, "parametric": parametric, "splitting": splitting}
LIMIT = 20
#: An invariant this many times its round-off off is accepted if the iteration no longer converges.
SLACK = 64.0
MISSED = "could not be projected and were taken as the base method's"
#: Starts of a symmetric projection's multipliers, in the order tried: earlier steps', zero; then no projection.
PREDICTED, UNPROJECTED = 0, 2


class Projection(NamedTuple):
    """The data of a projected method: the step of the base method, and the invariants to which it is projected.

    One of ``explicit``, ``split`` and ``implicit`` is the base method, the others are None.

    Attributes
    ----------
    mirror : the function ``gram`` again if the projection is symmetric, else None: it tells the two projections apart
    constraint : the function (q, p) -> (values of the m invariants, m numbers M: the values have a round-off of eps M)
    gram : the function (q, p) -> the matrix G G^T, row by row, with G the Jacobian of the invariants
    pull : the function (q, p, mu) -> the q and the p part of G^T mu
    explicit, split, implicit : the base method as an explicit Runge-Kutta method, a splitting or a one-stage method
    stages : the number of stages or substeps of the base method
    target : the values of the invariants at the start of the run
    h, eps : the step size and the unit round-off, set by the run
    """

    mirror: Callable | None
    constraint: Callable
    gram: Callable
    pull: Callable
    explicit: runge_kutta.RungeKutta | None
    split: splitting.Splitting | None
    implicit: parametric.Parametric | None
    stages: int
    target: Value
    h: float = 0.0
    eps: float = 0.0


@unroll(lambda d: "  return " + " and ".join(f"abs(r[{i}]) <= a * M[{i}]" for i in range(d)))
def within(r, a, M):
    """True if every |r_i| is at most a times |M_i|; False if one is NaN."""
    return np.all(np.abs(r) <= a * M)


# -- the base methods' steps ------------------------------------------------------------------------------------------


def _kicks_and_drifts(split, step, y, carry, known, first):
    q, p, lost_q, lost_p = y
    evaluations = 0
    for k in range(len(split.a)):
        if split.a[k] != 0:
            q, lost_q = add(q, lost_q, scale(split.a[k] * split.h, velocity(split.dT, p)))
        if split.b[k] != 0:
            p, lost_p = add(p, lost_p, scale(-split.b[k] * split.h, split.dV(q)))
            evaluations += 1
    return State(q, p, lost_q, lost_p), evaluations, 0, SOLVED


def _substeps(split, step, y, carry, known, first):
    return parametric.advance(step.implicit, y, carry, known, first)


_partitioned = dispatch_on_none(_substeps, _kicks_and_drifts)


def _one_stage(explicit, step, y, carry, known, first):
    return _partitioned(step.split, step, y, carry, known, first)


def _explicit(explicit, step, y, carry, known, first):
    dq, dp = runge_kutta.increment(explicit.field, explicit.tableau, explicit.h, y, carry)
    return update(y, dq, dp), len(explicit.tableau) - 1, 0, SOLVED


#: The base method's step: explicit Runge-Kutta, explicit kicks and drifts, or substeps with stage equations;
#: (explicit, step, y, carry, known, first) -> (y, evaluations, Newton solves, status).
advance = dispatch_on_none(_one_stage, _explicit)


# -- the projections --------------------------------------------------------------------------------------------------


@inline
def correct(mu: Value, r: Value, A: Value, work: np.ndarray) -> tuple[Value, bool]:
    """Do one Newton correction of the multipliers mu: returns (mu - A^-1 r, True if the matrix A is regular).

    mu and the residual r are vectors (m,); A has its rows one after the other, (m m,); ``work`` is memory for the
    linear equations.
    """
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
    """Arguments of the equation x = G(y + x)^T mu, whose solution x ends a symmetric projection.

    Attributes
    ----------
    pull : the function (q, p, mu) -> G^T mu, with G the Jacobian of the invariants
    q, p : the state y after the step of the base method
    mu : the multipliers
    """

    pull: Callable
    q: Value
    p: Value
    mu: Value


@inline
def closing(x: Value, e: Closing) -> Value:
    """The right-hand side G(y + x)^T mu of the equation for x that ends a symmetric projection.

    G is the Jacobian of the invariants, mu are the multipliers.
    """
    dq, dp = e.pull(plus(e.q, head(x)), plus(e.p, tail(x)), e.mu)
    return join(dq, dp)


solve_closing = solver(closing)


@inline
def constraint_residual(step: Projection, y: State, last: Number) -> tuple[Value, bool]:
    """The errors of the invariants at y: returns (g(y), True if they are at round-off, or near it and stopped falling).

    ``last`` is their size (1-norm) in the iteration before.
    """
    value, M = step.constraint(y.q, y.p)
    r = minus(value, step.target)
    eps = step.eps
    return r, within(r, eps, M) or (size(r) >= 0.5 * last and within(r, SLACK * eps, M))


def _standard(mirror, step, y, carry, counts):
    y1, n, used, status = advance(step.explicit, step, y, carry, counts.steps, True)
    counts.gradient += n
    counts.newton += used
    r, kept = constraint_residual(step, y1, np.inf)
    mu = scale(0.0, step.target)
    if status != SOLVED or kept:
        return y1, mu, True, status
    A = step.gram(y1.q, y1.p)
    counts.gradient += 1
    reach = size(y1.q) + size(y1.p)
    last = np.inf
    for _ in range(LIMIT):
        mu, regular = correct(mu, r, A, carry.work.rows)
        dq, dp = step.pull(y1.q, y1.p, mu)
        counts.gradient += 1
        if not (regular and size(dq) + size(dp) <= reach):
            break
        end = update(y1, dq, dp)
        r, kept = constraint_residual(step, end, last)
        if kept:
            return end, mu, True, status
        last = size(r)
    return y1, scale(0.0, step.target), False, status


def _symmetric(mirror, step, y, carry, counts):
    ring = LEVELS * step.stages  # where the memory keeps the multipliers of earlier steps
    zero = scale(0.0, step.target)
    A0 = mirror(y.q, y.p)
    A = A0
    counts.gradient += 1
    attempt, k, last = PREDICTED, 0, np.inf
    x = join(carry.zero, carry.zero)
    mu = predict(carry.memory, ring, step.stages, counts.steps, zero)
    while True:
        dq, dp = step.pull(y.q, y.p, mu)
        counts.gradient += 1
        y1, n, used, status = advance(step.explicit, step, update(y, dq, dp), carry, counts.steps, k == 0)
        counts.gradient += n
        counts.newton += used
        if attempt == UNPROJECTED:
            return y1, mu, False, status
        reach = size(y1.q) + size(y1.p)
        x, n, _, closed = solve_closing(Closing(step.pull, y1.q, y1.p, mu), x, reach, step.eps, carry.work)
        counts.gradient += n
        good = status == SOLVED and closed == SOLVED and size(x) <= reach
        if good:
            end = update(y1, head(x), tail(x))
            r, kept = constraint_residual(step, end, last)
            if kept:
                remember(carry.memory, ring, step.stages, counts.steps, mu)
                return end, mu, True, status
            last = size(r)
            if k == 0:
                A = plus(A0, step.gram(end.q, end.p))
                counts.gradient += 1
            mu, good = correct(mu, r, A, carry.work.rows)
            k += 1
        if not good or k == LIMIT:
            attempt, k, last = attempt + 1, 0, np.inf
            mu = zero
            x = scale(0.0, x)
            if attempt == UNPROJECTED:
                remember(carry.memory, ring, step.stages, counts.steps, mu)


#: One projected step, a symmetric one unless ``mirror`` is None; (mirror, step, y, carry, counts) -> (y, mu, True if
#: the step is projected, status of the base's step).
project = dispatch_on_none(_standard, _symmetric)


def step(method: Projection, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one projected step from the state y; returns (state, status: `SOLVED` or why the base method failed).

    ``counts.parameter`` becomes the multiplier of H; a step that could not be projected is counted in
    ``counts.fallbacks`` and has the parameter NaN.
    """
    y, mu, found, status = project(method.mirror, method, y, carry, counts)
    if not found:
        counts.fallbacks += 1
    counts.parameter = mu[0] if found else np.nan
    return y, status


run = loop(step, parameter=True)


def functions(
    system: Hamiltonian, invariants: Sequence[sp.Expr], arithmetic: str
) -> tuple[Function, Function, Function]:
    """Make the functions of the invariants that the kernel needs: returns (constraint, gram, pull).

    - constraint(q, p) -> (values, M), both of shape (m,); the values have a round-off of eps M
    - gram(q, p) -> the matrix G G^T, row by row, of shape (m m,); G is the Jacobian of the invariants
    - pull(q, p, mu) -> the q and the p part of G^T mu
    """
    m, y = len(invariants), (*system.q, *system.p)
    mu = [sp.Dummy() for _ in invariants]
    T, Tm, Tmm = (_vector_type(system.d, n) for n in (system.d, m, m * m))
    state = [("q", system.q), ("p", system.p)]
    key = " ".join(map(sp.srepr, invariants))

    def magnitude(e: sp.Expr) -> sp.Expr:
        return sum(sp.Abs(t) for t in sp.Add.make_args(e)) + sum(sp.Abs(x * sp.diff(e, x)) for x in y)

    def products() -> list[list[sp.Expr]]:
        G = sp.Matrix([[sp.diff(e, x) for x in y] for e in invariants])
        return [list(G * G.T)]

    def pull_back() -> list[list[sp.Expr]]:
        total = sum(a * e for a, e in zip(mu, invariants, strict=True))
        return [[sp.diff(total, x) for x in system.q], [sp.diff(total, x) for x in system.p]]

    constraint = system.make_function(
        f"constraint {key}",
        state,
        lambda: [list(invariants), [magnitude(e) for e in invariants]],
        types.Tuple((Tm, Tm))(T, T),
        arithmetic,
    )
    gram = system.make_function(f"gram {key}", state, products, Tmm(T, T), arithmetic)
    pull = system.make_function(
        f"pull {key}", [*state, ("mu", mu)], pull_back, types.Tuple((T, T))(T, T, Tm), arithmetic
    )
    return constraint, gram, pull


def _vector_type(d: int, n: int) -> types.Type:
    """The Numba type of n numbers in a system of d degrees of freedom: a tuple for small d, else an array."""
    tuples = codegen.value_kind(d) == "tuple"
    return types.UniTuple(types.float64, n) if tuples else types.Array(types.float64, 1, "C")


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a projected method, with the functions of the invariants.

    ``method.data`` is (base method, "invariants" to keep all of them, else only H, True for a symmetric projection).
    """
    base, onto, symmetric = method.data
    inner = FAMILIES[base.family].prepare(base, system, arithmetic, fills=False)
    kinds = {"explicit": runge_kutta.RungeKutta, "split": splitting.Splitting, "implicit": parametric.Parametric}
    bases = {name: inner.step if isinstance(inner.step, kind) else None for name, kind in kinds.items()}
    invariants = (system.H, *(system.invariants if onto == "invariants" else ()))
    m = len(invariants)
    constraint, gram, pull = functions(system, invariants, arithmetic)
    stages = len(inner.step.a) if bases["split"] else inner.stages

    target = value([0] * m, system.d, arithmetic)
    return Prepared(
        run,
        Projection(gram if symmetric else None, constraint, gram, pull, **bases, stages=stages, target=target),
        max(inner.width, m),
        stages,
        implicit=inner.implicit,
        hessian=inner.hessian,
        linear=max(inner.width, m, 2 * system.d if symmetric else 0),
        begin=partial(_set_target, constraint, bases),
        missed=MISSED,
    )


def _set_target(constraint: Function, bases: dict[str, Any], step: Projection, q: Value, p: Value) -> Projection:
    """Complete the data ``step`` of a projection for a run from (q, p), and return them.

    The targets become the values of the invariants at (q, p), computed by the function ``constraint``.  ``bases`` maps
    "explicit", "split" and "implicit", fields of `Projection`, to the data of the base method (None in two of them),
    which get the step size h and the unit round-off eps of ``step``.
    """
    known = {name: base._replace(h=step.h, eps=step.eps) for name, base in bases.items() if base is not None}
    return step._replace(target=constraint(q, p)[0], **known)
