r"""Relaxation Runge-Kutta methods, which conserve H by adjusting the length of the step.

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

The difference t_n - n h is kept from step to step in ``carry.state``, in a row that is not used by q and p.

Sources: D. I. Ketcheson, SIAM J. Numer. Anal. 57 (2019) 2850-2870; H. Ranocha, M. Sayyari, L. Dalcin, M. Parsani,
D. I. Ketcheson, SIAM J. Sci. Comput. 42 (2020) A612-A638.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.integrators.records.projection import relaxation_method as relaxation_method
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import OWN, Carry, Prepared, keep_energy
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values.vector import State, inline, scale, unroll, update

from . import runge_kutta

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.hamiltonian import Hamiltonian
    from phasebench.integrators.values.kinds import Number, Value

LIMIT = 20
#: Largest distance of the root from 1.
RADIUS = 0.5
#: H this many times its round-off off is accepted if the iteration no longer converges.
SLACK = 64.0
MISSED = "have no relaxation near 1 and were taken as the base method's"


#: Where the state's spare rows keep by how much the last step was longer than it should be.
AHEAD = OWN, 0


class Relaxation(NamedTuple):
    """The data of an explicit Runge-Kutta method with relaxation.

    Attributes
    ----------
    field : the vector field (q', p')
    energy : the function (q, p) -> (H, size of its terms), which sets the unit of its round-off
    tableau : rows of A, then b
    adjust_time : True if the state belongs to the relaxed time, False if each step counts as h
    H0 : the energy to conserve, that of the initial state
    h, eps : the step size and the unit round-off, set by the run
    """

    field: Callable
    energy: Callable
    tableau: np.ndarray
    adjust_time: bool
    H0: float = 0.0
    h: float = 0.0
    eps: float = 0.0


@unroll(lambda d: "  return " + " + ".join(f"x[{i}] * y[{i}]" for i in range(d)))
def dot(x, y):
    """The scalar product x . y."""
    return np.sum(x * y)


@inline
def root(step: Relaxation, y: State, dq: Value, dp: Value) -> tuple[Number, bool, int]:
    """Find the factor gamma nearest 1 of a step's increment with H(y + gamma (dq, dp)) = H0, by Newton's method.

    Returns (gamma, True if found, number of evaluations of the field).
    """
    gamma = 1.0
    last = np.inf
    for k in range(LIMIT):
        end = update(y, scale(gamma, dq), scale(gamma, dp))
        H, M = step.energy(end.q, end.p)
        E = H - step.H0
        if abs(E) <= step.eps * M or (abs(E) >= 0.5 * last and abs(E) <= SLACK * step.eps * M):
            return gamma, True, k
        last = abs(E)
        rate_q, rate_p = step.field(end.q, end.p, 1.0, 0.0)
        slope = dot(rate_q, dp) - dot(rate_p, dq)  # grad H = (-p', q')
        if slope == 0:
            return 1.0, False, k + 1
        gamma = gamma - E / slope
        if not abs(gamma - 1) <= RADIUS:
            return 1.0, False, k + 1
    return 1.0, False, LIMIT


def step(method: Relaxation, y: State, carry: Carry, counts: np.record) -> tuple[State, int]:
    """Take one step from the state y; returns (state, `SOLVED`).

    ``counts.parameter`` becomes gamma, the factor of the base method's increment with which the energy is H0.  If there
    is none near 1 it becomes NaN, and the step is that of the base method and counted in ``counts.fallbacks``.
    """
    length = method.h - carry.state[AHEAD]
    dq, dp = runge_kutta.increment(method.field, method.tableau, length, y, carry)
    gamma, found, n = root(method, y, dq, dp)
    counts.gradient += n + len(method.tableau) - 1
    if not found:
        counts.fallbacks += 1
    counts.parameter = gamma if found else np.nan
    carry.state[AHEAD] = (gamma - 1) * length if method.adjust_time else 0.0 * length
    return update(y, scale(gamma, dq), scale(gamma, dp)), SOLVED


run = loop(step, parameter=True)


def prepare(method: Method, system: Hamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of an explicit Runge-Kutta method with relaxation.

    ``method.data`` is (base method, True to adjust the time).
    """
    base, adjust_time = method.data
    inner = runge_kutta.prepare(base, system, arithmetic, fills=False)
    energy = system.energy(arithmetic)
    step = Relaxation(inner.step.field, energy, inner.step.tableau, bool(adjust_time))
    return Prepared(run, step, inner.width, inner.stages, implicit=False, begin=keep_energy(energy), missed=MISSED)
