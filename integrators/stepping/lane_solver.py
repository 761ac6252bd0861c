"""The fixed point of `solve.solver` for values of lanes: every lane stops at the step at which it would stop alone.

A lane that is at its end keeps its value while the others go on.  One that the fixed point does not solve becomes NaN,
and stays so: its orbit is integrated again by the scalar kernel, which has Newton's method.
"""

from __future__ import annotations

import numpy as np

from phasebench.integrators.values.masks import alike, count, select
from phasebench.integrators.values.vector import distance, scale, size


def lane_solver(G, share: float, limit: int, solved: int, not_finite: int):
    """Make the solver of x = G(x, arguments) in lanes; arguments and results are those of `solve.solver`'s function.

    Evaluations of all lanes are added up. The status is ``solved`` if any lane is.
    """

    def solve(arguments, x, span, eps, work):
        active = (size(x) < np.inf) & (span < np.inf)
        last = alike(np.inf, span)
        growth = alike(0.0, span)
        evaluations = 0
        k = 0
        while active:
            evaluations += count(active)
            new = G(x, arguments)
            delta = distance(new, x)
            x = select(active, new, x)
            k += 1
            unit = eps * size(x)
            falls = delta < last
            near = falls & (last < np.inf) & (delta * delta <= share * unit * (last - delta))
            done = (delta == 0) | near | (~falls & (delta <= 64 * (unit + eps * span)))
            growth = select(falls, growth, growth + 1.0)
            lost = ~(delta < np.inf) | (growth >= 2)
            if k >= limit:
                lost = lost | (delta > 0.5 * last)
            last = delta
            x = select(active & ~done & lost, scale(np.nan, x), x)
            active = active & ~done & ~lost
        return x, evaluations, 0, solved if (size(x) < np.inf) & (span < np.inf) else not_finite

    return solve
