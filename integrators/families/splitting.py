r"""Splitting methods for a separable H = T(p) + V(q): kicks and drifts, one kernel for every table of coefficients.

.. math::
    p \leftarrow p - b_k h\,\nabla V(q),\qquad q \leftarrow q + a_k h\,\nabla T(p),\qquad k = 0, 1, \dots

Before the drift over :math:`a_k h` the step kicks over :math:`b_k h`; ``a[0]`` is zero, ``b[0]`` the first kick.  The
last kick of a step and the first of the next act at the same q: they are one kick, taken apart again where a row is
stored, so that a Stormer-Verlet step costs one gradient.

Reference: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.5 and V.3.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine import filling
from phasebench.integrators.engine.kernel import Prepared, numbers
from phasebench.integrators.engine.vector import State, close, held, keep, moved, of, rows

#: Above this many degrees of freedom arrays are faster than tuples: from d = 10 to 18 by 5 to 40 %, below by none.
MOST = 10


class Splitting(NamedTuple):
    """Drifts of a and kicks of b, fractions of h: the first kick, then drift k and kick k, k = 1, 2, ...

    ``dT`` is the function grad T; None where that is p itself, and 1 / m_i where it is p_i / m_i.
    """

    dT: Callable | np.ndarray | None
    dV: Callable
    a: np.ndarray
    b: np.ndarray
    h: float = 0.0
    eps: float = 0.0


def run(step, orbit, samples, counts):
    """The kernel."""
    q, p, lost_q, lost_p = held(orbit)
    h = step.h
    first = step.b[0] * h
    last = len(step.a) - 1
    gradient, velocity = rows(orbit.state, 4, 5, orbit.zero)
    gradient = of(step.dV, q, gradient)
    evaluations = 1
    for row in range(len(samples.q)):
        if first != 0:
            p, lost_p = moved(p, lost_p, -first, gradient)
        for _ in range(samples.every):
            for k in range(1, last + 1):
                velocity = of(step.dT, p, velocity)
                q, lost_q = moved(q, lost_q, step.a[k] * h, velocity)  # exp(a_k h A), a drift
                kick = step.b[k] * h
                if k == last:
                    kick += first
                if kick != 0:
                    gradient = of(step.dV, q, gradient)
                    evaluations += 1
                    p, lost_p = moved(p, lost_p, -kick, gradient)  # exp(b_k h B), a kick
        if first != 0:
            p, lost_p = moved(p, lost_p, first, gradient)
        keep(samples, row, State(q, p, lost_q, lost_p))
    close(orbit, State(q, p, lost_q, lost_p))
    counts.steps += len(samples.q) * samples.every
    counts.gradient += evaluations
    return len(samples.q), 0


def _prepared(parts, system, arithmetic, fills):
    """From (is a kick, fraction) in their order: neighbours of a kind are one."""
    rows = [[0, 0]]
    for kick, fraction in parts:
        if kick:
            rows[-1][1] += fraction
        elif rows[-1][1] == 0 and len(rows) > 1:
            rows[-1][0] += fraction
        else:
            rows.append([fraction, 0])
    a, b = (numbers(column, arithmetic) for column in zip(*rows, strict=True))
    masses = getattr(system, "inverse_masses", None) if fills else None
    system = filling.twin(system, arithmetic, MOST) if fills else system
    dT = numbers(masses, arithmetic) if masses else system.grad_T(arithmetic)
    step = Splitting(dT, system.grad_V(arithmetic), a, b)
    return Prepared(run, step, 1, 2, implicit=False, arrays=system.fills)


def from_substeps(substeps, system, arithmetic, fills=True):
    """The splitting that substeps (c, mu, lambda) of symplectic Euler methods are: lambda = 1 kicks first."""
    parts = []
    for c, _, lam in substeps:
        parts += [(True, c), (False, c)] if lam == 1 else [(False, c), (True, c)]
    return _prepared(parts, system, arithmetic, fills)


def prepare(method, system, arithmetic, fills=True):
    """Of data (a, b): a kick of b_k, then a drift of a_k, for each k; either tuple may begin or end with a zero."""
    a, b = method.data
    parts = [part for drift, kick in zip_longest(a, b, fillvalue=0) for part in ((True, kick), (False, drift))]
    return _prepared([(kick, fraction) for kick, fraction in parts if fraction != 0], system, arithmetic, fills)
