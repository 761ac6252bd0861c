r"""Explicit Runge-Kutta methods, the non-geometric controls.

.. math::
    k_i = f\Bigl(y + h\sum_{j<i} a_{ij} k_j\Bigr),\qquad y \leftarrow y + h\sum_i b_i k_i .

Source: W. Kutta, Z. Math. Phys. 46 (1901) 435-453; L. Euler, Institutiones calculi integralis (1768).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from phasebench.integrators.engine.kernel import Prepared, array
from phasebench.integrators.engine.vector import (
    advanced,
    axpy,
    close,
    head,
    inlined,
    join,
    keep,
    load,
    opened,
    store,
    tail,
)


class RungeKutta(NamedTuple):
    """The field f and the tableau: the rows of A, then b."""

    field: Callable
    tableau: np.ndarray
    h: float = 0.0
    eps: float = 0.0


@inlined
def increment(field, tableau, h, y, orbit):
    """h sum b_i k_i of one step from y, the components of q before those of p."""
    both = join(orbit.zero, orbit.zero)
    stages = len(tableau) - 1
    x = both
    for i in range(stages + 1):
        x = both
        for j in range(i):
            if tableau[i, j] != 0:
                x = axpy(tableau[i, j] * h, load(orbit.memory, j, both), x)
        if i < stages:
            dq, dp = field(axpy(1.0, head(x), y.q), axpy(1.0, tail(x), y.p), h, 0.0)  # k_i
            store(orbit.memory, i, join(dq, dp))
    return x


def run(step, orbit, samples, counts):
    """The kernel."""
    y = opened(orbit)
    for row in range(len(samples.q)):
        for _ in range(samples.every):
            x = increment(step.field, step.tableau, step.h, y, orbit)
            y = advanced(y, head(x), tail(x))
        keep(samples, row, y)
    close(orbit, y)
    counts.steps += len(samples.q) * samples.every
    counts.gradient += len(samples.q) * samples.every * (len(step.tableau) - 1)
    return len(samples.q), 0


def prepare(method, system, arithmetic):
    """The tableau's kernel."""
    step = RungeKutta(system.field(arithmetic), array(method.data, arithmetic))
    return Prepared(run, step, 2 * system.d, len(step.tableau), implicit=False)
