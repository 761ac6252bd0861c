"""Times of 20 kernels beside a loop that no code here changes: whether stored times still describe the code.

The ratios of both times depend little on the machine, so that a quick run on any machine can compare them with the
stored ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numba
import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.integrators.prepared import prepare

from .timing import columns, ratio, time_in_turns

TABLE, PROBLEM = "canary", "henon-heiles:chaotic"
H, STEPS, ROUNDS = 0.01, 10_000, 15
#: Kernels of many families, cheap ones and dear ones.
METHODS = (
    *("explicit-euler", "symplectic-euler-p", "stormer-verlet", "pefrl", "blanes-moan-s6", "chin-4a", "rk4", "dop853"),
    *("implicit-midpoint", "scheme-i", "scheme-ii", "scheme-iii", "scheme-iv", "scheme-v", "avf"),
    *("gauss-4", "gauss-8", "gauss-equip-4", "hbvm-2-1", "quinlan-tremaine-8"),
)
#: Stored times describe the code if the median of new ratio / stored ratio is within this factor.
SAME = 1.15


def measure_rows(id: str) -> dict[str, list[dict]]:
    """Measure the time of a step of a method over that of the yardstick: one row, by table name."""
    run = prepare(problem(PROBLEM), id)
    yardstick(H, STEPS)
    both = time_in_turns({"it": lambda: run(H, STEPS), "yardstick": lambda: yardstick(H, STEPS)}, ROUNDS)
    return {TABLE: [{"method": id} | columns("ratio", ratio(both["it"], both["yardstick"]))]}


@numba.njit
def yardstick(h: float, steps: int) -> float:
    """Take steps of the leapfrog on the Henon-Heiles problem, in plain Numba; return the last q1."""
    x, y, u, v = 0.0, 0.1, 0.5, 0.0
    for _ in range(steps):
        u -= 0.5 * h * (x + 2.0 * x * y)
        v -= 0.5 * h * (y + x * x - y * y)
        x += h * u
        y += h * v
        u -= 0.5 * h * (x + 2.0 * x * y)
        v -= 0.5 * h * (y + x * x - y * y)
    return x


def change(measured: Iterable[dict], stored: Callable[[str], float | None]) -> float | None:
    """The median of new ratio / stored ratio over the measured kernels, or None if none is stored."""
    factors = [row["ratio"] / old for row in measured if (old := stored(row["method"]))]
    return float(np.median(factors)) if factors else None
