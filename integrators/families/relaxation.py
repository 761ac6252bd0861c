r"""Relaxation Runge-Kutta methods, which keep H by the length of the step.

With the increment :math:`d = \sum b_i k_i` of an explicit Runge-Kutta step of length :math:`\ell` from y,

.. math::
    y_1 = y + \gamma\,\ell\,d,\qquad H(y + \gamma\,\ell\,d) = H_0,\qquad t_1 = t + \gamma\,\ell,

with the root :math:`\gamma = 1 + O(h^{p-1})` next to 1, by Newton's method to the round-off of H.  The state belongs to
the relaxed time :math:`t_1`.  As time is n h here, each step aims at the next grid time: its length is
:math:`\ell = (n + 1)h - t_n`, so that :math:`t_{n+1} - (n + 1)h = (\gamma - 1)\,\ell = O(h^p)` never accumulates, and
the row at n h is the state at :math:`t_n`, which is within the method's own error of it.

Without that (``adjust_time`` false) each step counts as h: the incremental direction technique, of order p - 1.

The slope of H(y + gamma l d) at 1 is :math:`\tfrac12 h^2 f^T H'' f` to leading order: where it passes through zero
there may be no root near 1; the step is then taken with gamma = 1 and counted as a fallback.  The target stays H0.

``plan`` is the tableau, ``table`` is [[H0, adjust_time]], the first spare row of ``state`` keeps t_n - n h.

Sources: D. I. Ketcheson, SIAM J. Numer. Anal. 57 (2019) 2850-2870; H. Ranocha, M. Sayyari, L. Dalcin, M. Parsani,
D. I. Ketcheson, SIAM J. Sci. Comput. 42 (2020) A612-A638.
"""

from __future__ import annotations

import numpy as np

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import add, close, head, inlined, opened, scale, store, tail, written
from phasebench.integrators.records.projection import relaxed as relaxed

from . import runge_kutta

LIMIT = 20
#: How far from 1 the root may be.
RADIUS = 0.5
#: H is known to its round-off times this where the iteration can do no better.
SLACK = 64.0
MISSED = "have no relaxation near 1 and were taken as the base method's"


@written(lambda d: "  return " + " + ".join(f"x[{i}] * y[{i}]" for i in range(d)))
def dot(x, y):
    """x . y."""
    return np.sum(x * y)


@inlined
def root(energy, field, H0, x, eps, q, p, cq, cp):
    """(gamma next to 1 with H((q, p) + gamma x) = H0, found, evaluations of the field)."""
    gamma = 1.0
    last = np.inf
    for k in range(LIMIT):
        a = add(q, cq, scale(gamma, head(x)))[0]
        b = add(p, cp, scale(gamma, tail(x)))[0]
        H, M = energy(a, b)
        E = H - H0
        if abs(E) <= eps * M or (abs(E) >= 0.5 * last and abs(E) <= SLACK * eps * M):
            return gamma, True, k
        last = abs(E)
        dq, dp = field(a, b, 1.0, 0.0)
        slope = dot(dq, tail(x)) - dot(dp, head(x))  # grad H = (-p', q')
        if slope == 0:
            return 1.0, False, k + 1
        gamma = gamma - E / slope
        if not abs(gamma - 1) <= RADIUS:
            return 1.0, False, k + 1
    return 1.0, False, LIMIT


def run(energy, field, plan, table, h, every, eps, zero, state, memory, work, Q, P, aux, counts):
    """Fill the rows of Q, P and aux (the last gamma of the row, NaN for a fallback); returns (rows filled, status)."""
    q, p, cq, cp = opened(state, zero)
    offset = state[4, 0]
    H0, adjust = table[0, 0], table[0, 1]
    for row in range(len(Q)):
        gamma, found = 1.0, True
        for _ in range(every):
            length = h - offset
            x = runge_kutta.increment(field, plan, length, zero, q, p, memory)
            gamma, found, n = root(energy, field, H0, x, eps, q, p, cq, cp)
            counts[0] += 1
            counts[1] += n + len(plan) - 1
            if not found:
                counts[3] += 1
            q, cq = add(q, cq, scale(gamma, head(x)))
            p, cp = add(p, cp, scale(gamma, tail(x)))
            offset = adjust * (gamma - 1) * length
        store(Q, row, q)
        store(P, row, p)
        aux[row] = gamma if found else np.nan
    close(state, q, p, cq, cp)
    state[4, 0] = offset
    return len(Q), 0


def prepare(method, system, arithmetic):
    """The tableau's kernel with the energy."""
    base, adjust_time = method.data
    inner = runge_kutta.prepare(base, system, arithmetic)
    energy = system.energy(arithmetic)

    def begin(table, q, p):
        table[0, 0] = energy(q, p)[0]

    return Prepared(
        run,
        (energy, *inner.functions),
        inner.plan,
        array([[0, int(adjust_time)]], arithmetic),
        inner.width,
        inner.slots,
        implicit=False,
        begin=begin,
        missed=MISSED,
    )
