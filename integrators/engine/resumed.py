r"""The fixed point of stage equations that are solved again and again with a parameter that changes a little.

As `solve.solver`, but what is known from before is used.  With :math:`\theta` the rate at which changes fall, the error
that remains after a change :math:`\delta` is about :math:`\delta\theta/(1 - \theta)`.  Two evaluations show the rate.
Where it is known one evaluation is enough: from the last solution of these equations, or as the ratio of the first
change to the last one of the solution that this one starts from, which is one iterate before it but for the
parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .solve import FIXED_POINT_LIMIT, SHARE, SOLVED
from .vector import apart, distance, inlined, jit, size


class Known(NamedTuple):
    """The rate of changes, or with a ``change`` before the first one, by how much their ratio may be below it."""

    rate: float
    change: float


class Solved(NamedTuple):
    """The solution; its last change and its rate, not below its round-off; evaluations, Newton used (0, 1), status."""

    x: object
    change: float
    rate: float
    evaluations: int
    newton: int
    status: int


def resumer(G, solve):
    """The solver of x = G(x, arguments), where ``solve`` is that of `solve.solver`, for what does not contract.

    It is a function (arguments, start, known, rough, span, eps, work) -> `Solved`; an error of x up to ``rough`` will
    do, where 0 is to round-off.
    """

    @jit
    def solve_anew(arguments, x, span, eps, work):
        apart()
        return solve(arguments, x, span, eps, work)

    @inlined
    def resume(arguments, x, known, rough, span, eps, work):
        start, last, k = x, np.inf, 0
        after, before = known.rate, 1.0
        while True:
            new = G(x, arguments)
            delta = distance(new, x)
            x = new
            k += 1
            unit = eps * size(x)
            if not delta < last:
                if delta <= 64 * (unit + eps * span):
                    return Solved(x, delta, 1.0, k, 0, SOLVED)
                break
            if k > 1:
                after, before = delta, last
            elif known.change > 0:
                after, before = delta + known.rate * known.change, known.change
            if delta * after <= (SHARE * unit + rough) * (before - after):
                return Solved(x, delta, (after + unit) / before, k, 0, SOLVED)
            if k >= FIXED_POINT_LIMIT and delta > 0.5 * last:
                break
            last = delta
        x, n, used, status = solve_anew(arguments, start, span, eps, work)
        return Solved(x, 0.0, 1.0, k + n, used, status)

    return resume
