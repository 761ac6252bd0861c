r"""Flow-composed implicit Runge-Kutta methods: Gauss's methods for perturbed Kepler orbits, along Kepler's flow.

H = A + B as in `wisdom_holman`: A is a sum of Kepler problems and free motions with the flow :math:`\varphi_t`, B the
interaction of positions.  With :math:`y(t) = \varphi_{t}(w(t))` the motion is

.. math::
    \dot w = D\varphi_{-t}\bigl(\varphi_t(w)\bigr)\,J\nabla B\bigl(\varphi_t(w)\bigr) =: F(t, w),

Hamiltonian in w, and slow: F is as small as the perturbation.  A step is

.. math::
    w_0 = \varphi_{h/2}(y_n),\quad
    W_i = w_0 + h\sum_j a_{ij} F(\tau_j, W_j),\quad w_1 = w_0 + h\sum_j b_j F(\tau_j, W_j),\quad
    y_{n+1} = \varphi_{h/2}(w_1),

with Gauss's coefficients and the times :math:`\tau_j = (c_j - \tfrac12) h`.  It is of order 2 s, symmetric and
symplectic, and exact without a perturbation; its error has the perturbation as a factor.

The last flow of a step is merged with the first of the next.  The unknowns are :math:`x_j = h b_j F(\tau_j, W_j)`,
solved by fixed point to round-off from zero; the iteration contracts with the size of the perturbation.  Coefficients
are rounded like those of `collocation`, so that the step is symplectic to the last digit.

Sources: M. Antonana, J. Makazaga, A. Murua, arXiv:1711.06050 (2017) (FCIRK); M. Antonana, E. Alberdi, J. Makazaga,
A. Murua, Celest. Mech. Dyn. Astron. 134 (2022) (s = 8, order 16); the derivative of the flow: `kepler_tangent`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.tableaus import LEVELS, tableau
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.stepping import kepler_flow, kepler_tangent
from phasebench.integrators.stepping.codes import SOLVED, STALLED
from phasebench.integrators.stepping.kepler_flow import add
from phasebench.integrators.stepping.kernel import Prepared, array, numbers
from phasebench.integrators.stepping.solve import fixed_point
from phasebench.integrators.values.vector import inline, jit, load, store

from .wisdom_holman import check_kinetic_energy, convert, drift

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Carry, Samples
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number


class FlowComposed(NamedTuple):
    """The data of a flow-composed implicit Runge-Kutta method (FCIRK).

    Attributes
    ----------
    dB : the gradient of the interaction B with respect to the original coordinates q
    A, b : a_ij / b_j and b_j of Gauss's method
    times : c_j - 1/2, the times of the stages, from the middle of the step, as fractions of h
    dimension : of space, 2 or 3
    masses, mu : masses and gravitational parameters of the Kepler problems; mu = 0 for a free motion
    change, back : the matrices of Q = change q and q = back Q, acting on bodies; Q are the variables of the Kepler
        problems
    series : the table `kepler_flow.constants`
    h, eps : the step size and the unit round-off, set by the run
    """

    dB: Callable
    A: np.ndarray
    b: np.ndarray
    times: np.ndarray
    dimension: int
    masses: np.ndarray
    mu: np.ndarray
    change: np.ndarray
    back: np.ndarray
    series: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class Stages(NamedTuple):
    """Arguments of the stage equations of a step.

    Attributes
    ----------
    step : the data of the method
    state : array whose rows 0 and 1 are q and p of w_0, from which the step starts
    memory : array with the unknowns, overwritten
    zero : a zero of the shape of q
    """

    step: FlowComposed
    state: np.ndarray
    memory: np.ndarray
    zero: Any


#: Rows of the memory: q, p of a stage, and from `BACK` on their changes, transported back; its positions in the
#: original coordinates; the gradient there, and in the new ones; what `kepler_tangent.move` writes; the unknowns.
BACK, POSITION, GRADIENT, KICK, SPANS, UNKNOWN = 2, 4, 5, 6, 7, 8


@jit
def evaluate(e: Stages, i: int, old: int) -> None:
    """Evaluate F(tau_i, W_i), the vector field of the slow variables w, at stage i.

    That is the force of the interaction at the state to which Kepler's flow takes W_i in the time tau_i, transported
    back by the derivative of the flow (formula: see the module).  W_i follows from the unknowns in the rows from
    ``old`` on of ``e.memory``; the q part and the p part of F are written to the rows `BACK` and `BACK` + 1 of it.
    """
    step, state, memory = e.step, e.state, e.memory
    n, bodies, d = step.dimension, len(step.mu), len(e.zero)
    for k in range(d):
        for row in range(2):
            total = state[row, k] * 0
            for m in range(len(step.b)):
                total = total + step.A[i, m] * memory[old + 2 * m + row, k]
            memory[row, k] = state[row, k] + total
    tau = step.times[i] * step.h
    for a in range(bodies):
        kepler_tangent.move(
            memory, a * n, n, step.masses[a], step.mu[a], tau, step.eps, step.series, memory[SPANS], a, bodies
        )
    convert(step.back, memory, 0, n, memory, POSITION)
    store(memory, GRADIENT, step.dB(load(memory, POSITION, e.zero)))
    convert(step.back.T, memory, GRADIENT, n, memory, KICK)
    for k in range(d):
        memory[KICK, k] = -memory[KICK, k]
    for a in range(bodies):
        kepler_tangent.kick_back(
            memory,
            a * n,
            n,
            step.masses[a],
            step.mu[a],
            tau,
            step.eps,
            step.series,
            memory[SPANS],
            a,
            bodies,
            memory[KICK],
            BACK,
        )


@inline
def sweep(e: Stages, rows: tuple[int, int], active: bool) -> tuple[tuple[int, int], Number, Number]:
    """Apply the right-hand side of the stage equations to the unknowns in ``e.memory``.

    They are read in the rows from rows[0] on, and the result is written to the rows from rows[1] on.  Returns (the two
    row numbers exchanged, the distance between unknowns and result, the size of the result), as `fixed_point` requires;
    ``active`` is not used.
    """
    old, new = rows
    step, memory = e.step, e.memory
    delta, length = 0.0, 0.0
    for i in range(len(step.b)):
        evaluate(e, i, old)
        for row in range(2):
            for k in range(len(e.zero)):
                x = step.b[i] * (step.h * memory[BACK + row, k])
                delta += abs(x - memory[old + 2 * i + row, k])
                length += abs(x)
                memory[new + 2 * i + row, k] = x
    return (new, old), delta, length


solve = fixed_point(sweep)


@jit
def perturb(step: FlowComposed, carry: Carry, counts: np.record) -> int:
    """Take the Gauss step of the slow variables w, without Kepler's flow, on the rows of ``carry.state``, in place.

    Returns the status: `SOLVED`, or `STALLED` if the stage equations could not be solved.
    """
    state, memory, zero = carry.state, carry.memory, carry.zero
    s, d = len(step.b), len(zero)
    for row in range(UNKNOWN, UNKNOWN + 2 * s):
        for k in range(d):
            memory[row, k] = state[0, k] * 0
    span = 0.0
    for k in range(d):
        span += abs(state[0, k]) + abs(state[1, k])
    e = Stages(step, state, memory, zero)
    (last, _), sweeps, good = solve(e, (UNKNOWN, UNKNOWN + 2 * s), span, step.eps)
    counts.gradient += sweeps * s
    if not good:
        return STALLED
    for row in range(2):
        for k in range(d):
            total = state[row, k] * 0
            for m in range(s):
                total = total + memory[last + 2 * m + row, k]
            state[row, k], state[2 + row, k] = add(state[row, k], state[2 + row, k], total)
    return SOLVED


def run(step: FlowComposed, carry: Carry, samples: Samples, counts: np.record) -> tuple[int, int]:
    """The kernel: integrate the steps between rows of output and fill the rows; returns (rows filled, status).

    It has a loop of its own, since Kepler flows of neighbouring steps are merged, as in `wisdom_holman`.
    """
    state, memory, zero = carry.state, carry.memory, carry.zero
    n, h = step.dimension, step.h
    lead = h
    if counts.steps == 0:
        convert(step.change, state, 0, n, memory, 0)
        convert(step.back.T, state, 1, n, memory, 1)
        store(state, 0, load(memory, 0, zero))
        store(state, 1, load(memory, 1, zero))
        lead = h / 2
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            drift(step, state, lead)  # phi_h/2, with the last of the step before
            lead = h
            status = perturb(step, carry, counts)
            if status != SOLVED:
                return row, status
            counts.steps += 1
        for i in range(4):
            store(memory, i, load(state, i, zero))
        drift(step, memory, h / 2)
        convert(step.back, memory, 0, n, samples.q, row)
        convert(step.change.T, memory, 1, n, samples.p, row)
    return len(samples.q), SOLVED


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a flow-composed Gauss method.

    ``method.data`` is (number of stages,).  Raises InvalidInput if the kinetic energy is not that of the declared
    Kepler problems.
    """
    (s,) = method.data
    part = system.kepler
    check_kinetic_energy(system)
    digits = 40 if arithmetic == DOUBLE else mpmath.mp.dps + 10
    unit = mpmath.mpf(2) ** (-52 if arithmetic == DOUBLE else 1 - mpmath.mp.prec)
    gauss = tableau("gauss", s, s, False, digits, unit)
    with mpmath.workdps(digits):
        times = [c - mpmath.mpf(1) / 2 for c in gauss.c]
    change = part.matrix
    step = FlowComposed(
        dB=part.interaction(system, arithmetic),
        A=array(gauss.A_q, arithmetic),
        b=numbers([gauss.B[i][i] for i in range(s)], arithmetic),
        times=numbers(times, arithmetic),
        dimension=part.dimension,
        masses=numbers(part.masses, arithmetic),
        mu=numbers(part.mu, arithmetic),
        change=array(change.tolist(), arithmetic),
        back=array(change.inv().tolist(), arithmetic),
        series=array(kepler_flow.constants(arithmetic), arithmetic),
    )
    rows = UNKNOWN + 4 * s
    return Prepared(run, step, system.d, -(-rows // (3 * LEVELS + 1)), linear=1)
