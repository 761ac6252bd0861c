r"""EQUIP: Gauss methods with a parameter that is chosen in each step so that the energy is H0.

With the orthonormal Legendre polynomials at the Gauss nodes, :math:`P_{ij} = P_{j-1}(c_i)`, the Gauss method is
:math:`A = P X_s P^{-1}`, and

.. math::
    A(\alpha) = P\,(X_s - \alpha V)\,P^{-1},\qquad V = e_s e_{s-1}^T - e_{s-1} e_s^T .

Every fixed alpha gives a symplectic, symmetric method of order 2s - 2, so every quadratic invariant is kept; alpha is
the root of :math:`E(\alpha) = H(y_1(\alpha)) - H_0` nearest zero.  As E(0) is O(h^(2s+1)) and the slope of E is
O(h^(2s-1)), the root is O(h^2), and the method has the order 2s of Gauss.

In the form of `collocation`, :math:`\alpha S_{ij}` is subtracted from :math:`A_{ij}/b_j`, with the skew :math:`S = P V
P^T`.  For each alpha the tableau is written anew, in Nystrom form where T is quadratic, rounded such that its doubles
fulfil the conditions of symplecticity exactly.  Stages are evaluated in SIMD lanes where those of Gauss's methods are.

Where the slope of E passes through zero a step may have no root: it is taken with alpha = 0 and counted as a fallback.
The target stays H0, so that a later step restores the energy.

Source: L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.quadrature import legendre
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.energy_model import FIRST, Attempt, Search
from phasebench.integrators.stepping.kernel import OWN, Carry, Prepared, array, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.root import finder
from phasebench.integrators.stepping.solve import LEVELS
from phasebench.integrators.values.vector import State, dispatch_on_none, inline, size, update

from . import collocation, gauss_lanes, stage_lanes
from .gauss_lanes import serves
from .parametric import unknown

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Function, Number, Value

SEARCH = Search(radius=0.5, first=0.01, near=0.1, ratio=1.5, points=16, slack=8.0)
MISSED = "have no parameter near 0 that keeps the energy and were taken as Gauss's method"


class Equip(NamedTuple):
    """The data of EQUIP, a Gauss method with a parameter alpha that conserves the energy.

    Attributes
    ----------
    f : the vector field or -grad V, evaluated at all stages at once in SIMD lanes; None if stages are evaluated one by
        one
    field : the vector field (the same function as ``f`` in SIMD lanes); None if the unknowns are increments of p alone
        (Nystrom form)
    energy : the function (q, p) -> (H, size of its terms)
    tableau : the coefficients of the step in use, rewritten for each alpha
    A : array (s, s), a_ij / b_j of Gauss's method
    S : the skew array (s, s) that alpha multiplies
    b : the weights of the Gauss rule
    search : limits of the search for alpha
    H0 : the energy to conserve, that of the initial state
    h, eps : the step size and the unit round-off, set by the run
    """

    f: Callable | None
    field: Callable | None
    energy: Callable
    tableau: collocation.Collocation | stage_lanes.Lanes
    A: np.ndarray
    S: np.ndarray
    b: np.ndarray
    search: Search
    H0: float = 0.0
    h: float = 0.0
    eps: float = 0.0


class Step(NamedTuple):
    """Arguments of the search for alpha in one step.

    Attributes
    ----------
    step : the data of the method
    y : the state before the step
    carry : solutions of earlier steps, and memory
    counts : the counters of evaluations
    """

    step: Equip
    y: State
    carry: Carry
    counts: np.record


# -- stages one by one, or in lanes -----------------------------------------------------------------------------------


def _A_in_rows(f, t, i, j, x):
    t.A_q[i, j], t.A_p[i, j] = x, x


def _A_in_lanes(f, t, i, j, x):
    t.A[j, i] = x


def _time_in_rows(f, t, i, late):
    t.weights[0, i], t.c[i, 0] = late, 1.0 - late


def _time_in_lanes(f, t, i, late):
    t.nodes[stage_lanes.LATE, i], t.nodes[stage_lanes.C, i] = late, 1.0 - late


def _move_rows(f, start, eps, e):
    t, y, zero, memory = e.step.tableau, e.y, e.carry.zero, e.carry.memory
    stages, at = len(e.step.b), LEVELS * len(e.step.b)
    v, like = collocation.drift(t.field, t.dT, y.p, t.h), unknown(t.field, zero)
    equations = collocation.Equations(t, y.q, y.p, v, memory, zero, like, stages, e.counts)
    if start == FIRST:
        collocation.extrapolate(equations, at)
    sweeps, newton, status = collocation.solve(equations, at, size(y.q) + size(y.p), eps, e.carry.work)
    dq, dp = collocation.moves(t.field, equations, at)
    return update(y, dq, dp), sweeps, newton, status


def _move_lanes(f, start, eps, e):
    t, y = e.step.tableau, e.y
    equations = stage_lanes.equations(t, e.carry, t.h)
    ring, at = stage_lanes.rows_of(equations)
    stage_lanes.begin(t.inverse_mass, equations, y)
    if start == FIRST:
        stage_lanes.extrapolate(equations, ring, e.counts.steps, at)
    sweeps, newton, status = stage_lanes.solve(equations, at, size(y.q) + size(y.p), eps, e.carry.work)
    return stage_lanes.end(equations, at, y, e.carry.zero), sweeps, newton, status


def _enter_rows(f, e):
    stages, like = len(e.step.b), unknown(e.step.field, e.carry.zero)
    collocation.copy(e.carry.memory, LEVELS * stages, e.counts.steps % LEVELS * stages, stages, like)


def _enter_lanes(f, e):
    equations = stage_lanes.equations(e.step.tableau, e.carry, e.step.h)
    ring, at = stage_lanes.rows_of(equations)
    stage_lanes.enter(equations, ring, e.counts.steps, at)


#: Write A_ij of the stages; 1 - c_i and c_i.
write_A, write_time = dispatch_on_none(_A_in_rows, _A_in_lanes), dispatch_on_none(_time_in_rows, _time_in_lanes)
#: c_i.
time = dispatch_on_none(lambda f, t, i: t.c[i, 0], lambda f, t, i: t.nodes[stage_lanes.C, i])
#: Take the step with the tableau in use: (the state after it, sweeps, sweeps of Newton's method, status).
move = dispatch_on_none(_move_rows, _move_lanes)
#: Store its stages for the start of the next step.
enter = dispatch_on_none(_enter_rows, _enter_lanes)


# -- the tableau at alpha ---------------------------------------------------------------------------------------------


@inline
def round_to_grid(x: Number) -> Number:
    """Round x to a multiple of the round-off of 1, so that sums and differences of such numbers below 2 are exact."""
    return (x + 1.5) - 1.5


def _write_kicks(field, step, alpha):
    t, A, S, b = step.tableau, step.A, step.S, step.b
    stages = len(b)
    for i in range(stages):
        c = 0.0
        for j in range(stages):
            c = c + (A[i, j] - alpha * S[i, j]) * b[j]
        write_time(step.f, t, i, round_to_grid(1.0 - c))
    for i in range(stages):
        for j in range(i, stages):
            a = 0.0
            for m in range(stages):
                a = a + (A[i, m] - alpha * S[i, m]) * b[m] * (A[m, j] - alpha * S[m, j])
            a = round_to_grid(a)
            write_A(step.f, t, i, j, a)
            write_A(step.f, t, j, i, a - time(step.f, t, i) + time(step.f, t, j))


def _write_both(field, step, alpha):
    for i in range(len(step.b)):
        for j in range(i, len(step.b)):
            a = round_to_grid(step.A[i, j] - alpha * step.S[i, j])
            write_A(step.f, step.tableau, i, j, a)
            write_A(step.f, step.tableau, j, i, 1.0 - a)


#: Write the tableau at alpha (and the weights of q where ``field`` is None).
write = dispatch_on_none(_write_kicks, _write_both)


# -- steps ------------------------------------------------------------------------------------------------------------


@inline
def attempt(alpha: Number, start: int, ease: Number, e: Step) -> Attempt:
    """Try the step with the parameter alpha; returns an `Attempt` with the state after it and its energy error.

    ``start`` chooses where the stages start from: the extrapolation from earlier steps (`FIRST`), or the solution of
    the last attempt, whose alpha was near.  ``ease`` is the error that the stages may have, in units of round-off, and
    e has the data of the method and the state before the step.
    """
    step, y, counts = e.step, e.y, e.counts
    write(step.field, step, alpha)
    new, sweeps, newton, status = move(step.f, start, ease * step.eps, e)
    counts.gradient += (sweeps + newton) * len(step.b)
    counts.newton += min(newton, 1)
    if status != SOLVED:
        return Attempt(y, np.inf, step.eps, status)
    H, magnitude = step.energy(new.q, new.p)
    return Attempt(new, H - step.H0, step.eps * magnitude, status)


find = finder(attempt, inline(lambda e: e.carry.state), followed=False)


def step(method: Equip, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y, with the parameter alpha that conserves the energy; returns (state, status).

    If no alpha is found the step is Gauss's (alpha = 0), and is counted in ``counts.fallbacks``; ``counts.parameter``
    becomes alpha, NaN if there is none.
    """
    e = Step(method, y, carry, counts)
    alpha, found, result = find(method.search, carry.state, OWN, np.nan, e, carry.work)
    if result.status != SOLVED:
        return y, result.status
    enter(method.f, e)
    if not found:
        counts.fallbacks += 1
    counts.parameter = alpha if found else np.nan
    return result.y, SOLVED


run = loop(step, parameter=True)


def skew(s: int, nodes: list) -> list:
    """The skew matrix S = P V P^T at s nodes, as a list of rows.

    P_ij is the orthonormal Legendre polynomial of degree j - 1 at node i.  V is zero but for a 1 and a -1 in the last
    two rows and columns.
    """
    P = [legendre(s, c) for c in nodes]
    return [[a[s - 1] * b[s - 2] - a[s - 2] * b[s - 1] for b in P] for a in P]


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of EQUIP for a system.

    ``method.data`` is (s,), the number of stages.  Stages are evaluated side by side in SIMD lanes if the system allows
    it; the Nystrom form is used if T is quadratic.
    """
    (s,) = method.data
    if serves(s, system):
        inner = gauss_lanes.prepare(s, system, arithmetic)
        f, field = inner.step.f, inner.step.f if inner.step.inverse_mass is None else None
    else:
        inner = collocation.prepare_stage_by_stage(replace(method, data=("gauss", s)), system, arithmetic)
        f, field = None, inner.step.field
    energy = system.energy(arithmetic)
    with mpmath.workdps(40 if arithmetic == DOUBLE else mpmath.mp.dps + 10):
        A, _, b, c = runge_kutta("gauss", s)
        A = array(([A[i, j] / b[j] for j in range(s)] for i in range(s)), arithmetic)
        S = array(skew(s, c), arithmetic)

    step = Equip(f, field, energy, inner.step, A, S, numbers(b, arithmetic), SEARCH)
    return replace(inner, run=run, step=step, begin=partial(_set_energy, energy), missed=MISSED, searches=True)


def _set_energy(energy: Function, step: Equip, q: Value, p: Value) -> Equip:
    """Complete the data of EQUIP for a run from the state (q, p); returns the new data.

    H0 becomes the energy of that state, computed by the function ``energy``; the tableau, which a run overwrites, is
    copied.
    """
    t = step.tableau
    tables = {name: x for name, x in t._asdict().items() if isinstance(x, np.ndarray) and x.flags.writeable}
    own = {name: x.copy() for name, x in tables.items()}
    return step._replace(H0=energy(q, p)[0], tableau=t._replace(h=step.h, eps=step.eps, **own))
