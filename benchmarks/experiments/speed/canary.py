"""Times of 20 kernels beside a loop that no code here changes: whether stored times still describe the code.

The ratios of both times depend little on the machine, so that a quick run on any machine can compare them with the
stored ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from phasebench.benchmarks.measure.timing import ratio, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

TABLE, PROBLEM = "canary", "henon-heiles:chaotic"
H, STEPS, ROUNDS = 0.01, 10_000, 15
#: Kernels of many families, cheap ones and dear ones.
METHODS = (
    "explicit-euler",
    "symplectic-euler-p",
    "stormer-verlet",
    "pefrl",
    "blanes-moan-s6",
    "chin-4a",
    "rk4",
    "dop853",
    "implicit-midpoint",
    "scheme-i",
    "scheme-ii",
    "scheme-iii",
    "scheme-iv",
    "scheme-v",
    "avf",
    "gauss-4",
    "gauss-8",
    "gauss-equip-4",
    "hbvm-2-1",
    "quinlan-tremaine-8",
)
#: Stored times describe the code if the median of new ratio / stored ratio is within this factor.
SAME = 1.15


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements, one for each kernel; all are part of a quick run."""
    return [_cell(id) for id in METHODS]


def _cell(id: str) -> Cell:
    needs = content(TABLE, method(id), ProblemKey(PROBLEM), H, STEPS, code=[__name__])
    return Cell("speed", (TABLE,), {"method": id}, measure_rows, (id,), needs, frozenset({id}), ALONE, True, True)


def measure_rows(id: str) -> Rows:
    """Measure the time of a step of a method over that of the yardstick: one row, by table name."""
    run = prepare(problem(PROBLEM), id)
    yardstick(H, STEPS)
    both = time_in_turns({"it": lambda: run(H, STEPS), "yardstick": lambda: yardstick(H, STEPS)}, ROUNDS)
    found = ratio(both["it"], both["yardstick"])
    return {TABLE: [{"method": id, "ratio": found.value, "ratio, low": found.low, "ratio, high": found.high}]}


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


def change(measured: list[dict], stored: Callable[[str], float | None]) -> float | None:
    """The median of new ratio / stored ratio over the measured kernels, or None if none is stored."""
    both = [(row["ratio"], stored(row["method"])) for row in measured]
    factors = [new / old for new, old in both if old]
    return float(np.median(factors)) if factors else None
