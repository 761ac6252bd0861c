r"""Explicit Runge-Kutta methods, the non-geometric controls.

.. math::
    k_i = f\Bigl(y + h\sum_{j<i} a_{ij} k_j\Bigr),\qquad y \leftarrow y + h\sum_i b_i k_i .

Source: W. Kutta, Z. Math. Phys. 46 (1901) 435-453; L. Euler, Institutiones calculi integralis (1768).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine import filling
from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import (
    State,
    axpy,
    by_kind,
    close,
    halves,
    head,
    held,
    in_place,
    inlined,
    join,
    keep,
    load,
    moved,
    plus,
    store,
    tail,
    writes,
)

#: Above this many degrees of freedom arrays are faster than tuples: at d = 16 and 18 by 5 to 13 %, at 12 by none.
MOST = 14


class RungeKutta(NamedTuple):
    """The field f and the tableau: the rows of A, then b."""

    field: Callable
    tableau: np.ndarray
    h: float = 0.0
    eps: float = 0.0


@inlined
def _after(tableau, i, j):
    """The next j with a_ij other than zero, or i."""
    j += 1
    while j < i and tableau[i, j] == 0:
        j += 1
    return j


def _total(tableau, i, h, memory, zero):
    """Two terms at a time, in their order, so that the sum is written half as often."""
    last, n = len(tableau) - 1, 2 * len(zero)
    j = _after(tableau, i, -1)
    a = tableau[i, j] * h if j < i else 0.0
    for r in range(n):
        memory[last, r] = a * memory[j, r] if j < i else 0.0
    j = _after(tableau, i, j)
    while j < i:
        k = _after(tableau, i, j)
        a, b = tableau[i, j] * h, tableau[i, k] * h if k < i else 0.0
        if k < i:
            for r in range(n):
                memory[last, r] = memory[last, r] + a * memory[j, r] + b * memory[k, r]
        else:
            for r in range(n):
                memory[last, r] = memory[last, r] + a * memory[j, r]
        j = _after(tableau, i, k)
    return halves(memory, last, zero)


@in_place(_total)
def total(tableau, i, h, memory, zero):
    """(dq, dp) = h sum_j a_ij k_j, j < i, where k_j is row j of the memory; arrays are the row after the last k."""
    both = join(zero, zero)
    x = both
    for j in range(i):
        if tableau[i, j] != 0:
            x = axpy(tableau[i, j] * h, load(memory, j, both), x)
    return head(x), tail(x)


def evaluate(field, q, p, dq, dp, h, memory, i):
    """Write the field at (q + dq, p + dp) into row i of the memory; arrays dq and dp are written over."""
    dq, dp = field(plus(q, dq), plus(p, dp), h, 0.0)
    store(memory, i, join(dq, dp))


@inlined
def _moved_there(q, p, dq, dp):
    """Write the state (q + dq, p + dp) over its increments."""
    for k in range(len(q)):
        dq[k], dp[k] = q[k] + dq[k], p[k] + dp[k]


def _evaluate_arrays(field, q, p, dq, dp, h, memory, i):
    def returned(field, q, p, dq, dp, h, memory, i):
        n = len(q)
        _moved_there(q, p, dq, dp)
        slope_q, slope_p = field(dq, dp, h, 0.0)
        for k in range(n):
            memory[i, k], memory[i, n + k] = slope_q[k], slope_p[k]

    def written(field, q, p, dq, dp, h, memory, i):
        _moved_there(q, p, dq, dp)
        slope_q, slope_p = halves(memory, i, q)
        field(dq, dp, h, 0.0, slope_q, slope_p)

    return written if writes(field) else returned


by_kind(evaluate, lambda *types: evaluate, _evaluate_arrays)


@in_place(None)
def increment(field, tableau, h, y, orbit):
    """(dq, dp) = h sum b_i k_i of one step from y."""
    memory, stages = orbit.memory, len(tableau) - 1
    for i in range(stages):
        dq, dp = total(tableau, i, h, memory, orbit.zero)
        evaluate(field, y.q, y.p, dq, dp, h, memory, i)
    return total(tableau, stages, h, memory, orbit.zero)


def run(step, orbit, samples, counts):
    """The kernel."""
    q, p, lost_q, lost_p = held(orbit)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            dq, dp = increment(step.field, step.tableau, step.h, State(q, p, lost_q, lost_p), orbit)
            q, lost_q = moved(q, lost_q, 1.0, dq)
            p, lost_p = moved(p, lost_p, 1.0, dp)
        keep(samples, row, State(q, p, lost_q, lost_p))
    close(orbit, State(q, p, lost_q, lost_p))
    counts.steps += len(samples.q) * samples.every
    counts.gradient += len(samples.q) * samples.every * (len(step.tableau) - 1)
    return len(samples.q), 0


def prepare(method, system, arithmetic, fills=True):
    """The tableau's kernel."""
    system = filling.twin(system, arithmetic, MOST) if fills else system
    step = RungeKutta(system.field(arithmetic), array(method.data, arithmetic))
    return Prepared(run, step, 2 * system.d, len(step.tableau), implicit=False, arrays=system.fills)
