r"""Symmetric methods with variable steps: splittings and Gauss's methods with Hairer and Soderlind's controller.

The splittings are those of a separable H: Stormer-Verlet and its compositions.

Time is a function of a fictitious time in which steps are of the constant length h,

.. math::
    \frac{dt}{d\tau} = \sigma(q) = \Bigl(\sum_k r_k(q)^{-3}\Bigr)^{-1/2},

with the distances :math:`r_k` to the singularities, declared or found in H, softened ones among them; so h is the step
in time where one distance is 1 and the others are much larger.  Of a wall, at which orbits arrive with any speed, the
time to reach it and to turn there count in the place of :math:`r^{-3}` (`singularities.density`).

The density :math:`\rho` of the steps follows
:math:`1/\sigma` as a variable of its own, by the leapfrog rule,

.. math::
    \rho_{1/2} = \frac{1}{\sigma(q_0)} + \frac h2 G(y_0),\qquad
    y_{n+1} = \Phi_{h/\rho_{n+1/2}}(y_n),\qquad \rho_{n+3/2} = \rho_{n+1/2} + h\,G(y_{n+1}),\qquad
    G = \sigma \dot q \cdot \nabla \frac1\sigma .

With a symmetric :math:`\Phi` the map of :math:`(y, \rho)` in fictitious time is symmetric, and reversible where the
system is: the energy does not drift, as it does if steps are chosen by past steps alone.  It is not symplectic.

A row of output, the state at a multiple of h in time, is reached by a shorter step from the last state before it.  The
orbit goes on from that last state, so that it does not depend on which rows are stored; the shorter step is no part of
the reversible map.

Several orbits may be integrated side by side in SIMD lanes.  Each has a clock of its own, and an orbit that has reached
its row waits for the others.

The run ends if the density leaves the neighbourhood of :math:`1/\sigma` (by the factor `FAR`), or if a step is too
short to change the time.

Source: E. Hairer, G. Soderlind, SIAM J. Sci. Comput. 26 (2005) 1838-1851; E. Hairer, C. Lubich, G. Wanner,
Geometric Numerical Integration (2006), VIII.3.2; stages in lanes: see `stage_lanes`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np
from numba import types

from phasebench.integrators.coefficients.quadrature import gauss_legendre
from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.stepping.codes import OUT_OF_STEP, SOLVED
from phasebench.integrators.stepping.kernel import OWN, Prepared, array
from phasebench.integrators.stepping.loop import time_loop
from phasebench.integrators.systems import singularities
from phasebench.integrators.values.lanes import combine, polynomial, put, take
from phasebench.integrators.values.masks import number, retire_lanes, where
from phasebench.integrators.values.vector import (
    State,
    add_product,
    dispatch_on_none,
    forbid_inlining,
    inline,
    jit,
    size,
    velocity,
)

from . import gauss_lanes, splitting, stage_lanes
from .gauss_lanes import pad_square
from .lane_rows import FREE
from .stage_lanes import B, C, begin, end, equations, solve

if TYPE_CHECKING:
    from phasebench.integrators.families.stage_lanes import Equations
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Condition, Function, Number

#: Orbits may be integrated side by side.
IN_LANES = True
#: A density farther from 1 / sigma than this factor is lost.
FAR = 1e3


class Adaptive(NamedTuple):
    """The data of a method with variable steps, based on a Gauss method or on a splitting; unused fields are None.

    Attributes
    ----------
    method : the coefficients of the Gauss method, with stages in SIMD lanes; None for a splitting
    dT, dV : for a splitting the gradients of T(p) and V(q), where ``dT`` is None if grad T is p itself; both None for a
        Gauss method
    a, b : the lengths of a splitting's drifts and kicks as fractions of a step; None for a Gauss method
    inverse : the matrix from values of the field at the nodes to the coefficients of the polynomial through them, made
        by `inverse_of`; None for a splitting
    monitor : the function (q, p) -> (1 / sigma, G): the wanted density of steps and its rate of change in fictitious
        time
    h, eps : the step size in fictitious time and the unit round-off, set by the run
    """

    method: stage_lanes.Lanes | None
    dT: Callable | None
    dV: Callable | None
    a: np.ndarray | None
    b: np.ndarray | None
    inverse: np.ndarray | None
    monitor: Callable
    h: float = 0.0
    eps: float = 0.0


class Clock(NamedTuple):
    """The time of the last step's end, and what the step-size control remembers.

    Attributes
    ----------
    t, lost : the time and its rounding error (compensation)
    density : the density rho of the next step, whose length is h / rho
    last : the length of the last step
    """

    t: float
    lost: float
    density: float
    last: float


#: Where the state's spare rows keep the clock between calls.
TIME, LOST, DENSITY, LAST = (OWN, 0), (OWN, 1), (OWN + 1, 0), (OWN + 1, 1)


@inline
def predict(e: Equations, first: int, at: int, ratio: Number) -> None:
    """Get starting values of a step's stage increments: extrapolate the polynomials through f of the last step.

    e are the stage equations of the step, f is the vector field (or -grad V if only increments of p are unknown).  The
    values h b_i f at the nodes are written to the rows from ``at`` on of ``e.memory``, a component of f in each row.
    The polynomials' coefficients are in the rows from ``first`` on (see `remember`); ``ratio`` is this step's length
    over the last one's.
    """
    nodes = e.step.nodes
    z = 1.0 + ratio * take(nodes, C, e.like)
    weights = e.h * take(nodes, B, e.like)
    for k in range(e.stages):
        put(e.memory, at + k, weights * polynomial(take(e.memory, first + k, e.like), z, e.like), e.like)


@inline
def remember(e: Equations, first: int, inverse: np.ndarray) -> None:
    """Store the polynomials through f at the nodes of the step just taken, for `predict` in the next step.

    e are the stage equations of that step; f, the vector field or -grad V, has been evaluated at its nodes.  Each
    component of f has a polynomial, whose coefficients go to a row of ``e.memory``, from the row ``first`` on.
    ``inverse`` is the matrix from values at the nodes to coefficients.
    """
    zero = 0.0 * take(e.step.nodes, C, e.like)
    for k in range(e.stages):
        f = take(e.memory, e.stages + k, e.like)
        put(e.memory, first + k, combine(zero, f, 1.0, inverse, 0, e.like), e.like)


@jit
def kicks_and_drifts(step: Adaptive, y: State, dt: Number) -> tuple[State, int]:
    """Take a step of length dt of a splitting from the state y; returns (the state after it, evaluations of grad V)."""
    forbid_inlining()
    q, p, lost_q, lost_p = y
    evaluations = 0
    for k in range(len(step.a)):
        if k > 0:
            q, lost_q = add_product(q, lost_q, step.a[k] * dt, velocity(step.dT, p))  # exp(a_k dt A), a drift
        if step.b[k] != 0:
            p, lost_p = add_product(p, lost_p, -step.b[k] * dt, step.dV(q))  # exp(b_k dt B), a kick
            evaluations += 1
    return State(q, p, lost_q, lost_p), evaluations


def _split(method, step, carry, y, clock, dt, counts):
    y, evaluations = kicks_and_drifts(step, y, dt)
    return y, evaluations, SOLVED


def _gauss(method, step, carry, y, clock, dt, counts):
    e = equations(method, carry, dt)
    first = e.base + FREE
    at = first + e.stages
    begin(method.inverse_mass, e, y)
    predict(e, first, at, dt / clock.last)
    sweeps, newton, status = solve(e, at, size(y.q) + size(y.p), step.eps, carry.work)
    counts.newton += min(newton, 1)
    return end(e, at, y, carry.zero), (sweeps + newton) * method.stages, status


def _remember_field(method, step, carry, dt):
    e = equations(method, carry, dt)
    remember(e, e.base + FREE, step.inverse)


#: Take a step of length dt from y: (its end, evaluations, status).
attempt = dispatch_on_none(_split, _gauss)
#: Store what the next step starts from.
settle = dispatch_on_none(lambda method, step, carry, dt: None, _remember_field)


@inline
def read_clock(step: Adaptive, carry: Carry, y: State) -> Clock:
    """Return the `Clock` (time, density of steps) that the last call of the kernel left in ``carry``.

    At the start of a run it is a new clock, whose density is computed at the state y.
    """
    rows = carry.state
    clock = Clock(rows[TIME], rows[LOST], rows[DENSITY], rows[LAST])
    if clock.density == 0:
        rate, change = step.monitor(y.q, y.p)
        density = rate + 0.5 * step.h * change
        clock = Clock(clock.t, clock.lost, density, step.h / density)
    return clock


@inline
def tick(step: Adaptive, clock: Clock, dt: Number, y: State) -> tuple[Clock, Condition]:
    """Advance the clock by a step of length dt that has ended at the state y; returns (new clock, True if it is valid).

    It is valid if its density of steps is within the factor `FAR` of 1 / sigma, the density that the distances to the
    singularities require at y, and if the step has changed the time.
    """
    rate, change = step.monitor(y.q, y.p)
    t = (clock.t + clock.lost) + dt
    lost = (dt + clock.lost) - (t - clock.t)
    density = clock.density + step.h * change
    return Clock(t, lost, density, dt), (density < FAR * rate) & (FAR * density > rate) & (abs(dt) > step.eps * abs(t))


@inline
def plan_step(step: Adaptive, clock: Clock, until: Number) -> tuple[Number, Number, Condition]:
    """Return (length of the next step, time left until ``until``, True if the step ends before ``until``)."""
    dt = step.h / clock.density
    left = (until - clock.t) - clock.lost
    return dt, left, (abs(dt) < abs(left)) & (left * step.h > 0)


@inline
def select_going(going: Condition, y: State, clock: Clock, following: State, later: Clock) -> tuple[State, Clock]:
    """Choose the state and clock of each SIMD lane: after a step in the lanes ``going``, before it in the others.

    ``following`` and ``later`` are the state and clock after the step, y and ``clock`` those before.  Returns (state,
    clock).
    """
    y = State(
        where(going, following.q, y.q),
        where(going, following.p, y.p),
        where(going, following.lost_q, y.lost_q),
        where(going, following.lost_p, y.lost_p),
    )
    t, lost = where(going, later.t, clock.t), where(going, later.lost, clock.lost)
    return y, Clock(t, lost, where(going, later.density, clock.density), where(going, later.last, clock.last))


@inline
def wind(
    step: Adaptive, carry: Carry, y: State, clock: Clock, until: Number, counts: np.record
) -> tuple[State, Clock, int]:
    """Take steps from the state y until the next one would pass the time ``until``; returns (state, clock, status).

    ``clock`` has the time and the density of steps at y; steps and evaluations are added to ``counts``.  The status is
    `SOLVED`, or why the run ends before that time.
    """
    dt, _, going = plan_step(step, clock, until)
    while going:
        following, evaluations, status = attempt(step.method, step, carry, y, clock, dt, counts)
        counts.gradient += evaluations * number(going)
        if status != SOLVED:
            return y, clock, status
        settle(step.method, step, carry, dt)
        counts.steps += number(going)
        later, kept = tick(step, clock, dt, following)
        y, clock = select_going(going, y, clock, following, later)
        q, alive = retire_lanes(going, kept, y.q)
        if not alive:
            return y, clock, OUT_OF_STEP
        y = State(q, y.p, y.lost_q, y.lost_p)
        dt, _, going = plan_step(step, clock, until)
    return y, clock, SOLVED


@inline
def reach(
    method: Adaptive, carry: Carry, y: State, clock: Clock, until: Number, every: int, counts: np.record
) -> tuple[State, Clock, State, int]:
    """Step to the last state before the time ``until``, and from there to the state at that time, a row of output.

    ``clock`` has the time and the density of steps at y.  Returns (last state, its clock, state at that time, status),
    as `loop.time_loop` requires; ``every`` is not used.
    """
    there = y
    y, clock, status = wind(method, carry, y, clock, until, counts)
    if status == SOLVED:
        _, left, _ = plan_step(method, clock, until)
        there, evaluations, status = attempt(method.method, method, carry, y, clock, left, counts)
        counts.gradient += evaluations * number(size(y.q) < np.inf)
    return y, clock, there, status


@inline
def leave(carry: Carry, clock: Clock) -> None:
    """Store the clock (time, density of steps) in the carry, for the next call of the kernel."""
    rows = carry.state
    rows[TIME], rows[LOST], rows[DENSITY], rows[LAST] = clock.t, clock.lost, clock.density, clock.last


run = time_loop(read_clock, reach, leave)


# -- the functions and numbers that it is handed ----------------------------------------------------------------------


def monitor(system: Hamiltonian, arithmetic: str) -> Function:
    """Make the function (q, p) -> (1 / sigma, G) that controls the lengths of steps.

    1 / sigma is the density of steps that the distances to the singularities of H require, G is sigma times the time
    derivative of 1 / sigma.
    """
    T = codegen.value_type(system.d)

    def results() -> list:
        square, rate = singularities.density(system)
        return [sp.sqrt(square), rate / (2 * square)]

    distances = singularities.steering_distances(system)
    kind = f"density of {', '.join(map(sp.srepr, distances))}"
    if any(singularities.is_wall(system, r) for r in distances):
        kind += ", walls by their approach"
    return system.make_function(
        kind, [("q", system.q), ("p", system.p)], results, types.UniTuple(types.float64, 2)(T, T), arithmetic
    )


def is_gauss(method: Method) -> bool:
    """True if the steps of this variable-step method are those of a Gauss method, False if of a splitting.

    The record of the former has one item of ``data``, its number of stages.
    """
    return len(method.data) == 1


def digits(arithmetic: str) -> int:
    """Decimal digits with which coefficients are computed: 40 for doubles, else 10 more than mpmath's precision."""
    return 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10


def coefficients(s: int) -> mpmath.matrix:
    """The matrix from values at Gauss's s nodes to coefficients of the polynomial through them, lowest power first."""
    return mpmath.matrix([[c**k for k in range(s)] for c, _ in gauss_legendre(s, mpmath.mp.dps)]) ** -1


def inverse_of(s: int, step: stage_lanes.Lanes, arithmetic: str) -> np.ndarray:
    """The transposed matrix of `coefficients` as an array, padded with zeros to as many rows and columns as SIMD lanes.

    s is the number of nodes; the number of lanes is that of ``step``, the data of the Gauss method.
    """
    with mpmath.workdps(digits(arithmetic)):
        inverse = coefficients(s)
        return array(pad_square(([inverse[k, j] for k in range(s)] for j in range(s)), len(step.like)), arithmetic)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a variable-step method, with its coefficients, for a system.

    ``method.data`` is (s,) for Gauss's method of s stages, (1, substeps) for a splitting, with the substeps of
    `splitting.from_substeps`.  Raises InvalidInput if the distances to the singularities are not formulae.
    """
    if not all(isinstance(r, sp.Expr) for r in singularities.steering_distances(system)):
        raise InvalidInput(f"method '{method.id}' requires the distances to the singularities as formulae")
    if not is_gauss(method):
        _, substeps = method.data
        split = splitting.from_substeps(substeps, system, arithmetic, fills=False).step
        whole = Adaptive(None, split.dT, split.dV, split.a, split.b, None, monitor(system, arithmetic))
        return Prepared(run, whole, 1, 3, implicit=False, apart=True)
    (s,) = method.data
    step = gauss_lanes.build_lanes(s, system, arithmetic)
    inverse = inverse_of(s, step, arithmetic)
    whole = Adaptive(step, None, None, None, None, inverse, monitor(system, arithmetic))
    width, stages = gauss_lanes.room(step, system.d)
    unknowns = stage_lanes.components(step.inverse_mass, system.d)
    return Prepared(run, whole, width, max(3, stages), linear=len(step.like) * unknowns)
