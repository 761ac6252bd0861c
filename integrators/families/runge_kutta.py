r"""Explicit Runge-Kutta methods, the non-geometric controls.

.. math::
    k_i = f\Bigl(y + h\sum_{j<i} a_{ij} k_j\Bigr),\qquad y \leftarrow y + h\sum_i b_i k_i .

``plan`` has the rows of A, then b.

Source: W. Kutta, Z. Math. Phys. 46 (1901) 435-453; L. Euler, Institutiones calculi integralis (1768).
"""

from __future__ import annotations

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import add, axpy, close, head, inlined, join, load, opened, store, tail


@inlined
def increment(field, plan, h, zero, q, p, memory):
    """h sum b_i k_i of one step from (q, p), the components of q before those of p."""
    both = join(zero, zero)
    stages = len(plan) - 1
    x = both
    for i in range(stages + 1):
        x = both
        for j in range(i):
            if plan[i, j] != 0:
                x = axpy(plan[i, j] * h, load(memory, j, both), x)
        if i < stages:
            dq, dp = field(axpy(1.0, head(x), q), axpy(1.0, tail(x), p), h, 0.0)
            store(memory, i, join(dq, dp))
    return x


def run(field, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    for row in range(len(Q)):
        for _ in range(every):
            x = increment(field, plan, h, zero, q, p, memory)
            q, cq = add(q, cq, head(x))
            p, cp = add(p, cp, tail(x))
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[0] += len(Q) * every
    counts[1] += len(Q) * every * (len(plan) - 1)
    return len(Q), 0


def prepare(method, system, arithmetic):
    """The tableau's kernel."""
    plan = array(method.data, arithmetic)
    return Prepared(
        run, (system.field(arithmetic),), plan, array([[0]], arithmetic), 2 * system.d, len(plan), implicit=False
    )
