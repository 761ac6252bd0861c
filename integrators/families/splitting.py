r"""Splitting methods for a separable H = T(p) + V(q): kicks and drifts, one kernel for every table of coefficients.

.. math::
    p \leftarrow p - b_k h\,\nabla V(q),\qquad q \leftarrow q + a_k h\,\nabla T(p),\qquad k = 0, 1, \dots

``plan[0]`` = (0, b_0) is the first kick, ``plan[k]`` = (a_{k-1}, b_k) the drift and the kick that follow.  The last
kick of a step and the first of the next act at the same q: they are one kick, taken apart again where a row is
stored, so that a Stormer-Verlet step costs one gradient.

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.5 and V.3.
"""

from __future__ import annotations

from itertools import zip_longest

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import add, close, opened, scale, store, velocity


def run(dT, dV, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q and P, each after ``every`` steps; returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    stages = len(plan)
    first = plan[0, 1] * h
    last = stages - 1
    gradient = dV(q)
    evaluations = 1
    for row in range(len(Q)):
        if first != 0:
            p, cp = add(p, cp, scale(-first, gradient))
        for _ in range(every):
            for k in range(1, stages):
                q, cq = add(q, cq, scale(plan[k, 0] * h, velocity(dT, p)))
                kick = plan[k, 1] * h
                if k == last:
                    kick += first
                if kick != 0:
                    gradient = dV(q)
                    evaluations += 1
                    p, cp = add(p, cp, scale(-kick, gradient))
        if first != 0:
            p, cp = add(p, cp, scale(first, gradient))
        store(Q, row, q)
        store(P, row, p)
    close(state, q, p, cq, cp)
    counts[0] += len(Q) * every
    counts[1] += evaluations
    return len(Q), 0


def _prepared(parts, system, arithmetic):
    """From (is a kick, fraction) in their order: neighbours of a kind are one; rows (drift, kick that follows)."""
    rows = [[0, 0]]
    for kick, fraction in parts:
        if kick:
            rows[-1][1] += fraction
        elif rows[-1][1] == 0 and len(rows) > 1:
            rows[-1][0] += fraction
        else:
            rows.append([fraction, 0])
    functions = (system.grad_T(arithmetic), system.grad_V(arithmetic))
    return Prepared(run, functions, array(rows, arithmetic), array([[0]], arithmetic), 1, 1, implicit=False)


def from_substeps(substeps, system, arithmetic):
    """The splitting that substeps (c, mu, lambda) of symplectic Euler methods are: lambda = 1 kicks first."""
    parts = []
    for c, _, lam in substeps:
        parts += [(True, c), (False, c)] if lam == 1 else [(False, c), (True, c)]
    return _prepared(parts, system, arithmetic)


def prepare(method, system, arithmetic):
    """Of data (a, b): a kick of b_k, then a drift of a_k, for each k; either tuple may begin or end with a zero."""
    a, b = method.data
    parts = [part for drift, kick in zip_longest(a, b, fillvalue=0) for part in ((True, kick), (False, drift))]
    return _prepared([(kick, fraction) for kick, fraction in parts if fraction != 0], system, arithmetic)
