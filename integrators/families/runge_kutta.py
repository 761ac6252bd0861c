r"""Explicit Runge-Kutta methods, which are not symplectic: for comparison.

.. math::
    k_i = f\Bigl(y + h\sum_{j<i} a_{ij} k_j\Bigr),\qquad y \leftarrow y + h\sum_i b_i k_i .

Source: W. Kutta, Z. Math. Phys. 46 (1901) 435-453; L. Euler, Institutiones calculi integralis (1768).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, array
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values import inplace
from phasebench.integrators.values.vector import (
    State,
    add_product_in_place,
    axpy,
    halves,
    head,
    in_place,
    inline,
    join,
    load,
    overload_by_kind,
    plus,
    store,
    tail,
    view_state,
    writes,
)

if TYPE_CHECKING:
    from numba import types

    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Value

#: Orbits may be integrated side by side.
IN_LANES = True
#: Up to this many degrees of freedom values are tuples; at d = 16 and 18 arrays are faster by 5 to 13 %.
MOST = 14


class RungeKutta(NamedTuple):
    """The data of an explicit Runge-Kutta method.

    Attributes
    ----------
    field : the vector field (q', p')
    tableau : array, the rows of the matrix A, then b
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    tableau: np.ndarray
    h: float = 0.0
    eps: float = 0.0


@inline
def _next_nonzero(tableau: np.ndarray, i: int, j: int) -> int:
    """Return the smallest k > j with tableau[i, k] != 0, or i if there is none below i."""
    j += 1
    while j < i and tableau[i, j] == 0:
        j += 1
    return j


def _total(tableau, i, h, memory, zero):
    """Sum (dq, dp) = h sum_j a_ij k_j over j < i, two terms at a time: the form of `total` compiled for arrays."""
    last, n = len(tableau) - 1, 2 * len(zero)
    j = _next_nonzero(tableau, i, -1)
    a = tableau[i, j] * h if j < i else 0.0
    for r in range(n):
        memory[last, r] = a * memory[j, r] if j < i else 0.0
    j = _next_nonzero(tableau, i, j)
    while j < i:
        k = _next_nonzero(tableau, i, j)
        a, b = tableau[i, j] * h, tableau[i, k] * h if k < i else 0.0
        if k < i:
            for r in range(n):
                memory[last, r] = memory[last, r] + a * memory[j, r] + b * memory[k, r]
        else:
            for r in range(n):
                memory[last, r] = memory[last, r] + a * memory[j, r]
        j = _next_nonzero(tableau, i, k)
    return halves(memory, last, zero)


@in_place(_total)
def total(tableau, i, h, memory, zero):
    """Sum the increment (dq, dp) = h sum_j a_ij k_j over j < i that leads to stage i; k_j is row j of the memory.

    The rows of ``tableau`` are those of a, then the weights, so that i = number of stages gives the increment of the
    step. ``zero`` is a zero of the shape of q.  For arrays the result is written to the row after the last k.
    """
    both = join(zero, zero)
    x = both
    for j in range(i):
        if tableau[i, j] != 0:
            x = axpy(tableau[i, j] * h, load(memory, j, both), x)
    return head(x), tail(x)


def evaluate(field, q, p, dq, dp, h, memory, i):
    """Evaluate stage i, f(q + dq, p + dp), and write it to row i of the memory; arrays dq, dp are overwritten."""
    dq, dp = field(plus(q, dq), plus(p, dp), h, 0.0)
    store(memory, i, join(dq, dp))


@inline
def _shift_state(q: Value, p: Value, dq: Value, dp: Value) -> None:
    """Overwrite the arrays dq and dp of increments by q + dq and p + dp."""
    for k in range(len(q)):
        dq[k], dp[k] = q[k] + dq[k], p[k] + dp[k]


def _evaluate_arrays(
    field: types.Type,
    q: types.Type,
    p: types.Type,
    dq: types.Type,
    dp: types.Type,
    h: types.Type,
    memory: types.Type,
    i: types.Type,
) -> Callable:
    def evaluate_returned(field, q, p, dq, dp, h, memory, i):
        n = len(q)
        _shift_state(q, p, dq, dp)
        slope_q, slope_p = field(dq, dp, h, 0.0)
        for k in range(n):
            memory[i, k], memory[i, n + k] = slope_q[k], slope_p[k]

    def evaluate_in_place(field, q, p, dq, dp, h, memory, i):
        _shift_state(q, p, dq, dp)
        slope_q, slope_p = halves(memory, i, q)
        field(dq, dp, h, 0.0, slope_q, slope_p)

    return evaluate_in_place if writes(field) else evaluate_returned


overload_by_kind(evaluate, lambda *types: evaluate, _evaluate_arrays)


@in_place(None)
def increment(field, tableau, h, y, carry):
    """Evaluate the stages of one step of length h from y; returns its increment (dq, dp) = h sum b_i k_i.

    ``tableau`` has the rows of A, then b; the k_i, values of ``field`` at the stages, are kept in ``carry.memory``.
    """
    memory, stages = carry.memory, len(tableau) - 1
    for i in range(stages):
        dq, dp = total(tableau, i, h, memory, carry.zero)
        evaluate(field, y.q, y.p, dq, dp, h, memory, i)
    return total(tableau, stages, h, memory, carry.zero)


def begin(method: RungeKutta, carry: Carry, counts: np.record) -> State:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it.

    Arrays are rows of ``carry`` itself, which steps overwrite.
    """
    return view_state(carry)


def step(method: RungeKutta, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, `SOLVED`)."""
    dq, dp = increment(method.field, method.tableau, method.h, y, carry)
    q, lost_q = add_product_in_place(y.q, y.lost_q, 1.0, dq)
    p, lost_p = add_product_in_place(y.p, y.lost_p, 1.0, dp)
    counts.gradient += len(method.tableau) - 1
    return State(q, p, lost_q, lost_p), SOLVED


run = loop(step, begin)


def prepare(method: Method, system: Hamiltonian, arithmetic: str, fills: bool = True) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of an explicit Runge-Kutta method for a system.

    ``method.data`` is the tableau: rows of A, then b.  ``fills`` allows a field that writes its results into arrays.
    """
    system = inplace.in_place_version(system, arithmetic, MOST) if fills else system
    step = RungeKutta(system.field(arithmetic), array(method.data, arithmetic))
    return Prepared(run, step, 2 * system.d, len(step.tableau), implicit=False, arrays=system.fills)
