"""Processed splittings :math:`P K^n P^{-1}` for a separable H = T(p) + V(q): a step costs its kernel K alone.

K here is a `splitting`, the step that is repeated; P, the processor, is a change of variables of drifts and kicks.
``start`` applies P to the state of a row of output, and ``finish`` undoes it where a row is stored: with a row after
every step both are paid in every step.

P and its inverse evaluate gradients in functions that have no counters: ``start`` leaves the number of these
evaluations, of both, in the state, and the first step after it adds that number to the counts.

Reference: J. C. Butcher, Lecture Notes in Math. 109 (1969) 133-139 (effective order); S. Blanes, F. Casas, A. Murua,
SIAM J. Sci. Comput. 27 (2006) 1817-1843.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values.vector import add_product_in_place, apply, inline, rows, view_state

from . import splitting
from .splitting import GRADIENT, VELOCITY

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

#: Orbits may be integrated side by side.
IN_LANES = True


class Processed(NamedTuple):
    """The data of a processed splitting.

    Attributes
    ----------
    dT, dV : as in `splitting.Splitting`: the gradients of T (function, array 1 / m_i or None) and V
    a, b : fractions of h of the drifts and kicks of the kernel K, as in `splitting.Splitting`
    drifts, kicks : fractions of h of the drifts and kicks of the processor P, in turn
    h, eps : the step size and the unit round-off, set by the run
    """

    dT: Callable | np.ndarray | None
    dV: Callable
    a: np.ndarray
    b: np.ndarray
    drifts: np.ndarray
    kicks: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class ProcessedState(NamedTuple):
    """The state (q, p) of a processed splitting.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    gradient, velocity : working memory for a gradient of V and a velocity
    evaluations : number of gradients evaluated but not yet added to the counts
    """

    q: Value
    p: Value
    lost_q: Value
    lost_p: Value
    gradient: Value
    velocity: Value
    evaluations: int


@inline
def drift(method: Processed, y: ProcessedState, h: Number) -> ProcessedState:
    """The state after a drift over the time h, exp(h A): q + h grad T(p)."""
    velocity = apply(method.dT, y.p, y.velocity)
    q, lost_q = add_product_in_place(y.q, y.lost_q, h, velocity)
    return ProcessedState(q, y.p, lost_q, y.lost_p, y.gradient, velocity, y.evaluations)


@inline
def kick(method: Processed, y: ProcessedState, h: Number) -> ProcessedState:
    """The state after a kick over the time h, exp(h B): p - h grad V(q)."""
    gradient = apply(method.dV, y.q, y.gradient)
    p, lost_p = add_product_in_place(y.p, y.lost_p, -h, gradient)
    return ProcessedState(y.q, p, y.lost_q, lost_p, gradient, y.velocity, y.evaluations + 1)


def begin(method: Processed, carry: Carry, counts: np.record) -> ProcessedState:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it.

    Arrays are rows of ``carry`` itself, which steps overwrite.
    """
    y = view_state(carry)
    gradient, velocity = rows(carry.state, GRADIENT, VELOCITY, carry.zero)
    return ProcessedState(y.q, y.p, y.lost_q, y.lost_p, gradient, velocity, 0)


def start(method: Processed, y: ProcessedState) -> ProcessedState:
    """Begin a run at the state y: apply the processor once, then the kick with which the first step begins.

    The number of evaluations, those of `finish` included, is left in the state for `step` to count.
    """
    for k in range(len(method.kicks)):
        if method.drifts[k] != 0:
            y = drift(method, y, method.drifts[k] * method.h)
        if method.kicks[k] != 0:
            y = kick(method, y, method.kicks[k] * method.h)
    inverse = y.evaluations  # it kicks as often
    if method.b[0] != 0:
        y = kick(method, y, method.b[0] * method.h)
        inverse += 1
    return ProcessedState(y.q, y.p, y.lost_q, y.lost_p, y.gradient, y.velocity, y.evaluations + inverse)


def step(method: Processed, y: ProcessedState, carry: Carry, counts: np.record) -> tuple[ProcessedState, int]:
    """Drift and kick in turn; the last kick includes the first one of the next step.  Returns (state, `SOLVED`).

    Evaluations, those that `start` has left in the state among them, are added to ``counts``; ``carry`` is not used.
    """
    last = len(method.a) - 1
    for k in range(1, last + 1):
        y = drift(method, y, method.a[k] * method.h)
        fraction = method.b[k]
        if k == last:
            fraction += method.b[0]
        if fraction != 0:
            y = kick(method, y, fraction * method.h)
    counts.gradient += y.evaluations
    return ProcessedState(y.q, y.p, y.lost_q, y.lost_p, y.gradient, y.velocity, 0), SOLVED


def finish(method: Processed, y: ProcessedState) -> ProcessedState:
    """Undo the first kick of the next step and the processor, before a row is stored; `start` has counted this."""
    if method.b[0] != 0:
        y = kick(method, y, -method.b[0] * method.h)
    for k in range(len(method.kicks) - 1, -1, -1):
        if method.kicks[k] != 0:
            y = kick(method, y, -method.kicks[k] * method.h)
        if method.drifts[k] != 0:
            y = drift(method, y, -method.drifts[k] * method.h)
    return ProcessedState(y.q, y.p, y.lost_q, y.lost_p, y.gradient, y.velocity, 0)


run = loop(step, begin, start, finish)


def prepare(method: Method, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a processed splitting for a system.

    ``method.data`` is ((a, b) of the splitting K, rows (drift, kick) of the processor P), all fractions of h.
    ``fills`` allows functions that write their results into arrays.
    """
    weights, processor = method.data
    made = splitting.prepare(replace(method, data=weights), system, arithmetic, fills)
    drifts, kicks = (numbers(column, arithmetic) for column in zip(*processor, strict=True))
    dT, dV, a, b, *_ = made.step
    return replace(made, run=run, step=Processed(dT, dV, a, b, drifts, kicks))
