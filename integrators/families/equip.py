r"""EQUIP: Gauss methods with a parameter that is chosen in each step so that the energy is H0.

With the orthonormal Legendre polynomials at the Gauss nodes, :math:`P_{ij} = P_{j-1}(c_i)`, the Gauss method is
:math:`A = P X_s P^{-1}`, and

.. math::
    A(\alpha) = P\,(X_s - \alpha V)\,P^{-1},\qquad V = e_s e_{s-1}^T - e_{s-1} e_s^T .

Every fixed alpha gives a symplectic, symmetric method of order 2s - 2, so every quadratic invariant is kept; alpha is
the root of :math:`E(\alpha) = H(y_1(\alpha)) - H_0` next to zero.  As E(0) is O(h^(2s+1)) and the slope of E is
O(h^(2s-1)), the root is O(h^2), and the method has the order 2s of Gauss.

In the form of `collocation`, :math:`A_{ij}/b_j` loses :math:`\alpha S_{ij}`, with the skew :math:`S = P V P^T`; for
each alpha the tableau is written anew, in Nystrom form where T is quadratic, the conditions of symplecticity being
imposed.

Where the slope of E passes through zero a step may have no root: it is taken with alpha = 0 and counted as a fallback.
The target stays H0, so that a later step wins the energy back.

Source: L. Brugnano, F. Iavernaro, D. Trigiante, SIAM J. Numer. Anal. 50 (2012) 2897-2916.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients import tableaus
from phasebench.integrators.coefficients.quadrature import legendre
from phasebench.integrators.engine.codegen import DOUBLE
from phasebench.integrators.engine.energy_model import FIRST, Attempt, Search
from phasebench.integrators.engine.kernel import Orbit, array, numbers
from phasebench.integrators.engine.root import finder
from phasebench.integrators.engine.solve import LEVELS, SOLVED
from phasebench.integrators.engine.vector import State, advanced, apart, chosen, close, jit, keep, opened, size

from . import collocation
from .parametric import unknown

SEARCH = Search(radius=0.5, first=0.01, near=0.1, ratio=1.5, points=16, branches=False, slack=8.0)
MISSED = "have no parameter near 0 that keeps the energy and were taken as Gauss's method"


class Equip(NamedTuple):
    """The tableau in use, which is written for each alpha; A_ij / b_j, S_ij and b of the Gauss method."""

    energy: Callable
    tableau: collocation.Collocation
    A: np.ndarray
    S: np.ndarray
    b: np.ndarray
    search: Search
    H0: float = 0.0
    h: float = 0.0
    eps: float = 0.0


class Step(NamedTuple):
    """A step from the state y; v is that of `collocation.Equations`."""

    step: Equip
    y: State
    v: Any
    orbit: Orbit
    counts: np.record


def _write_kicks(field, step, alpha):
    t, A, S, b = step.tableau, step.A, step.S, step.b
    stages = len(b)
    for i in range(stages):
        c = 0.0
        for j in range(stages):
            c = c + (A[i, j] - alpha * S[i, j]) * b[j]
        t.weights[0, i] = 1.0 - c
        t.c[i, 0] = 1.0 - t.weights[0, i]
    for i in range(stages):
        for j in range(i, stages):
            a = 0.0
            for m in range(stages):
                a = a + (A[i, m] - alpha * S[i, m]) * b[m] * (A[m, j] - alpha * S[m, j])
            t.A_q[i, j] = a
            t.A_q[j, i] = a - t.c[i, 0] + t.c[j, 0]
            t.A_p[i, j] = t.A_q[i, j]
            t.A_p[j, i] = t.A_q[j, i]


def _write_both(field, step, alpha):
    t = step.tableau
    for i in range(len(step.b)):
        for j in range(i, len(step.b)):
            a = step.A[i, j] - alpha * step.S[i, j]
            t.A_q[i, j], t.A_p[i, j] = a, a
            t.A_q[j, i], t.A_p[j, i] = 1.0 - a, 1.0 - a


#: Write the tableau at alpha (and the weights of q where ``field`` is None).
write = chosen(_write_kicks, _write_both)


@jit
def attempt(alpha, start, ease, e):
    """Take the step with alpha.

    The stages start from earlier steps' or from the last attempt's, which was taken with an alpha nearby.
    """
    apart()
    step, y, counts, zero = e.step, e.y, e.counts, e.orbit.zero
    field, stages = step.tableau.field, len(step.b)
    equations = collocation.Equations(
        step.tableau, y.q, y.p, e.v, e.orbit.memory, zero, unknown(field, zero), stages, counts
    )
    at = LEVELS * stages
    write(field, step, alpha)
    if start == FIRST:
        collocation.extrapolate(equations, at)
    span = size(y.q) + size(y.p)
    sweeps, newton, status = collocation.solve(equations, at, span, ease * step.eps, e.orbit.work)
    counts.gradient += (sweeps + newton) * stages
    counts.newton += min(newton, 1)
    if status != SOLVED:
        return Attempt(y, np.inf, step.eps, status)
    dq, dp = collocation.moves(field, equations, at)
    new = advanced(y, dq, dp)
    H, magnitude = step.energy(new.q, new.p)
    return Attempt(new, H - step.H0, step.eps * magnitude, status)


find = finder(attempt)


def run(step, orbit, samples, counts):
    """The kernel; the parameter is alpha, NaN for a fallback."""
    y = opened(orbit)
    field, dT, memory = step.tableau.field, step.tableau.dT, orbit.memory
    stages, like = len(step.b), unknown(field, orbit.zero)
    for row in range(len(samples.q)):
        alpha, found = 0.0, True
        for _ in range(samples.every):
            v = collocation.drift(field, dT, y.p, step.h)
            alpha, found, result = find(step.search, orbit.state, 4, np.nan, Step(step, y, v, orbit, counts))
            if result.status != SOLVED:
                return row, result.status
            y = result.y
            collocation.copy(memory, LEVELS * stages, counts.steps % LEVELS * stages, stages, like)
            counts.steps += 1
            if not found:
                counts.fallbacks += 1
        keep(samples, row, y)
        samples.parameter[row, 0] = alpha if found else np.nan
    close(orbit, y)
    return len(samples.q), 0


def skew(s: int, nodes):
    """S = P V P^T at the nodes, as a list of rows."""
    P = [legendre(s, c) for c in nodes]
    return [[a[s - 1] * b[s - 2] - a[s - 2] * b[s - 1] for b in P] for a in P]


def prepare(method, system, arithmetic):
    """Of data (s,); the Nystrom form where T is quadratic."""
    (s,) = method.data
    inner = collocation.stage_by_stage(replace(method, data=("gauss", s)), system, arithmetic)
    energy = system.energy(arithmetic)
    with mpmath.workdps(40 if arithmetic == DOUBLE else mpmath.mp.dps + 10):
        A, _, b, c = tableaus.runge_kutta("gauss", s)
        A = array(([A[i, j] / b[j] for j in range(s)] for i in range(s)), arithmetic)
        S = array(skew(s, c), arithmetic)

    def begin(step, q, p):
        return step._replace(H0=energy(q, p)[0], tableau=step.tableau._replace(h=step.h, eps=step.eps))

    step = Equip(energy, inner.step, A, S, numbers(b, arithmetic), SEARCH)
    return replace(inner, run=run, step=step, begin=begin, missed=MISSED)
