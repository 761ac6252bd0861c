r"""Splitting methods for H = H_1 + ... + H_n, a sum of parts with exact flows.

With the step of order 1 through all parts, and its adjoint,

.. math::
    \chi_h = e^{h H_n}\cdots e^{h H_1},\qquad \chi^*_h = e^{h H_1}\cdots e^{h H_n},

a step is a composition :math:`\chi^{(*)}_{c_s h}\cdots\chi^{(*)}_{c_1 h}`; that of Strang, :math:`\chi^*_{h/2}
\chi_{h/2}`, has order 2.  A splitting of two parts with weights a, b is such a composition, whose order conditions are
the same, so that its coefficients serve here (`coefficients.fractions.substeps`).

Neighbouring flows of the same part are merged.  A processed method is :math:`P K^n P^{-1}` with K, P such compositions,
see `processed`; P is applied where integration starts from a row of output, and undone where a row is stored.

Every flow is symplectic, and so is their product.  Each flow counts as an evaluation.

Sources: R. I. McLachlan, SIAM J. Sci. Comput. 16 (1995) 151-168 (compositions with the adjoint); Y. Wang, W. Sun, F.
Liu, X. Wu, Astrophys. J. 907 (2021) 66; S. Blanes, F. Casas, A. Murua, Acta Numerica 33 (2024), section 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import mpmath
import numpy as np

from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.stepping.codes import SOLVED
from phasebench.integrators.stepping.kernel import Carry, Prepared, freeze, numbers
from phasebench.integrators.stepping.loop import loop
from phasebench.integrators.values.vector import inline, read_state, update

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.systems.parts import SplitHamiltonian
    from phasebench.integrators.values.kinds import Function, Number

#: Orbits may be integrated side by side.
IN_LANES = True


class Parts(NamedTuple):
    """The data of a splitting into parts with exact flows.

    Attributes
    ----------
    flows : for each part, the function (q, p, time) -> increments (dq, dp) by its flow
    part, a : the flows of a step in turn: the number of the part, and the time as a fraction of h
    before, before_a : the same for the processor (the change of variables P), which is applied where integration starts
        from a row of output; empty if there is none
    after, after_a : the same for the inverse of the processor
    h, eps : the step size and the unit round-off, set by the run
    """

    flows: tuple[Any, ...]
    part: np.ndarray
    a: np.ndarray
    before: np.ndarray
    before_a: np.ndarray
    after: np.ndarray
    after_a: np.ndarray
    h: float = 0.0
    eps: float = 0.0


class PartsState(NamedTuple):
    """The state (q, p) of a splitting into parts.

    Attributes
    ----------
    q, p : the state
    lost_q, lost_p : what rounding lost of each (compensation)
    flows : number of flows that are evaluated but not yet added to the counts
    """

    q: Any
    p: Any
    lost_q: Any
    lost_p: Any
    flows: int


@inline
def flow(flows: tuple[Function, ...], parts: np.ndarray, fractions: np.ndarray, y: PartsState, h: Number) -> PartsState:
    """The state after flows of single parts in turn, which start at the state y.

    ``flows`` has the function of each part, ``parts`` are the numbers of the parts, and ``fractions`` the times as
    fractions of h.
    """
    for k in range(len(parts)):
        dq, dp = flows[parts[k]](y.q, y.p, fractions[k] * h)
        q, p, lost_q, lost_p = update(y, dq, dp)
        y = PartsState(q, p, lost_q, lost_p, y.flows)
    return y


def begin(method: Parts, carry: Carry, counts: np.record) -> PartsState:
    """Read the state from ``carry``, where the last call of the kernel (loop over steps) left it."""
    y = read_state(carry)
    return PartsState(y.q, y.p, y.lost_q, y.lost_p, 0)


def start(method: Parts, y: PartsState) -> PartsState:
    """Apply the processor, a change of variables that `finish` undoes, if there is one.

    Its flows, and those of its inverse, are counted by the next step.
    """
    y = flow(method.flows, method.before, method.before_a, y, method.h)
    return PartsState(y.q, y.p, y.lost_q, y.lost_p, y.flows + 2 * len(method.before))


def step(method: Parts, y: PartsState, carry: Carry, counts: np.record) -> tuple[PartsState, int]:
    """Take all flows of a step in turn; returns (state, `SOLVED`).

    The flows are added to ``counts`` as evaluations; ``carry`` is not used.
    """
    y = flow(method.flows, method.part, method.a, y, method.h)
    counts.gradient += len(method.part) + y.flows
    return PartsState(y.q, y.p, y.lost_q, y.lost_p, 0), SOLVED


def finish(method: Parts, y: PartsState) -> PartsState:
    """Undo the processor, the change of variables that `start` applied, before a row of output is stored."""
    return flow(method.flows, method.after, method.after_a, y, method.h)


run = loop(step, begin, start, finish)


def flows(substeps: Iterable[Sequence[Any]], n: int) -> tuple[list[int], list[Any]]:
    """List the flows of single parts that make the given substeps through n parts, merging neighbours of the same part.

    A substep (c, mu, lambda) has the length c h and goes through all parts, from the first to the last if lambda = 1,
    from the last to the first if lambda = 0; mu is not used.  Returns (numbers of the parts, times as fractions of h).
    """
    parts: list[int] = []
    fractions: list[Any] = []
    for c, _, lam in substeps:
        for k in range(n) if lam == 1 else reversed(range(n)):
            if parts and parts[-1] == k:
                fractions[-1] = fractions[-1] + c
            else:
                parts.append(k)
                fractions.append(c)
    return parts, fractions


def prepare(method: Method, system: SplitHamiltonian, arithmetic: str) -> Prepared:
    """Prepare the kernel (compiled loop over steps) of a splitting into parts, for a system of such parts.

    ``method.data`` is (substeps (c, mu, lambda) of a step, substeps of the processor, () if there is none), as for
    `flows`.
    """
    n = len(system.parts)
    with mpmath.workdps(DIGITS):
        step, before = (flows(substeps, n) for substeps in method.data)
        after = list(reversed(before[0])), [-c for c in reversed(before[1])]
    rows = [x for parts, a in (step, before, after) for x in (freeze(np.array(parts, int)), numbers(a, arithmetic))]
    found = tuple(system.part_flow(k, arithmetic) for k in range(n))
    return Prepared(run, Parts(found, *rows), 1, 1, implicit=False)
