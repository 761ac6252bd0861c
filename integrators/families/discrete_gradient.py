r"""Gonzalez' midpoint discrete gradient and its compositions, which keep H for every Hamiltonian.

With y = (q, p), the increment x of a step and :math:`\bar y = y + x/2`,

.. math::
    x = h J^{-1}\bigl(\nabla H(\bar y) + a\,x\bigr),\qquad
    a = \frac{H(y + x) - H(y) - \nabla H(\bar y)\cdot x}{x\cdot x} .

The equation makes x orthogonal to the bracket, so that a is also the number for which H(y + x) = H(y).  Here a is found
as that root: for a given a the equation is smooth and solved to round-off, and a is improved by secant steps, the first
with the slope :math:`dH(y + x)/da = -x\cdot x + O(h^3)`, until H equals H0 to round-off.  The quotient itself would
bring the round-off of H, divided by x.x, into every iterate; with H0 as the target in place of H(y), energy errors do
not accumulate.  A substep in which H stays away from H0 is counted as a fallback.

Source: O. Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467, equation (11).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, keep_energy, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.stepping.solve import LEVELS, predict, predict_number, remember, solver
from phasebench.integrators.values.vector import (
    State,
    axpy,
    head,
    inline,
    join,
    scale,
    size,
    tail,
    unroll,
    update,
)

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Largest number of secant steps for a.
LIMIT = 12
MISSED = "do not reach the energy of the start"


class DiscreteGradient(NamedTuple):
    """The data of a composition of Gonzalez' discrete gradient methods.

    Attributes
    ----------
    field : the vector field (q', p')
    energy : the function (q, p) -> (H, size of its terms), which sets the unit of its round-off
    fraction : the lengths of the substeps as fractions of h
    H0 : the energy to conserve, that of the initial state
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    energy: Callable
    fraction: np.ndarray
    H0: float = 0.0
    h: float = 0.0
    eps: float = 0.0


class Increment(NamedTuple):
    """Arguments of the equation for the increment of a substep.

    Attributes
    ----------
    field : the vector field (q', p')
    q, p : the state before the substep
    h : the length of the substep
    a : the coefficient of x in the discrete gradient, held fixed while the equation is solved
    """

    field: Callable
    q: Any
    p: Any
    h: float
    a: float


@unroll(lambda d: "  return " + " + ".join(f"x[{i}] * x[{i}]" for i in range(d)))
def square(x):
    """The scalar product x . x."""
    return np.sum(x * x)


@inline
def increment(x: Value, e: Increment) -> Value:
    """The right-hand side G(x) of the equation x = G(x) of a substep: h J^-1 (grad H(y + x/2) + a x)."""
    dq, dp = e.field(axpy(0.5, head(x), e.q), axpy(0.5, tail(x), e.p), e.h, 0.0)
    return join(scale(e.h, axpy(e.a, tail(x), dq)), scale(e.h, axpy(-e.a, head(x), dp)))


solve_increment = solver(increment)


@inline
def search(
    step: DiscreteGradient, y: State, h: Number, x: Value, a: Number, carry: Carry, counts: np.record
) -> tuple[Value, Number, int]:
    """Take a substep of length h from y to y + x that ends at energy H0: find its increment x and its coefficient a.

    The coefficient is that of x in the discrete gradient, grad H(y + x/2) + a x.  The arguments x and a are starting
    values.  Returns (x, a, status); evaluations are added to ``counts``, and a fallback if the energy is not reached.
    """
    last_a, last = a, step.H0
    span = size(y.q) + size(y.p)
    reached, status = False, SOLVED
    for k in range(LIMIT):
        x, n, used, status = solve_increment(Increment(step.field, y.q, y.p, h, a), x, span, step.eps, carry.work)
        counts.gradient += n
        counts.newton += used
        if status != SOLVED:
            return x, a, status
        end = update(y, head(x), tail(x))
        H, magnitude = step.energy(end.q, end.p)
        error, unit = H - step.H0, step.eps * magnitude
        reached = abs(error) <= unit or (k > 1 and 8 * unit >= abs(error) >= 0.5 * abs(last))
        slope = -square(x)
        if k > 0 and (error - last) / (a - last_a) < 0:
            slope = (error - last) / (a - last_a)
        if reached or a - error / slope == a or not slope < 0:
            break
        last_a, last = a, error
        a = a - error / slope
    if not reached:
        counts.fallbacks += 1
    return x, a, status


def step(method: DiscreteGradient, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y, substep by substep; returns (state, status: `SOLVED` or why a substep failed).

    Starting values are extrapolated from earlier steps, kept in ``carry``; evaluations are added to ``counts``.
    """
    both, memory = join(carry.zero, carry.zero), carry.memory
    stages = len(method.fraction)
    ring = LEVELS * stages  # where the memory keeps the ring of each substep's a
    status = SOLVED
    for s in range(stages):
        x = predict(memory, s, stages, counts.steps, both)
        a = predict_number(memory, ring + s, stages, counts.steps)
        x, a, status = search(method, y, method.fraction[s] * method.h, x, a, carry, counts)
        if status != SOLVED:
            break
        remember(memory, s, stages, counts.steps, x)
        memory[ring + s + counts.steps % LEVELS * stages, 0] = a
        y = update(y, head(x), tail(x))
    return y, status


run = loop(step)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of Gonzalez' discrete gradient for a system.

    ``method.data`` are the substeps as fractions of h.  The energy to conserve, H0, is that of the initial state.
    """
    energy = system.energy(arithmetic)
    step = DiscreteGradient(system.field(arithmetic), energy, numbers(method.data, arithmetic))
    return Prepared(run, step, 2 * system.d, len(step.fraction), begin=keep_energy(energy), missed=MISSED)
