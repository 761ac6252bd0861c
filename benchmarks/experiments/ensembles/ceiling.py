"""The best speed-up that a machine's cores give, by a compiled loop that needs no main memory and no Python."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import types

from phasebench.benchmarks.measure.timing import Median, in_turns, ratio
from phasebench.integrators.compile import machine
from phasebench.integrators.stepping.kernel import entry

#: Number of oscillators (they fit into the first-level cache), steps (some 0.1 s in all), and step size.
WIDTH, STEPS, H = 64, 4_000_000, 0.01


def _loop(state: np.ndarray, steps: int, h: float) -> None:
    """Take leapfrog steps of independent oscillators in place; state is an array (2, n) of q and p."""
    for _ in range(steps):
        for i in range(state.shape[1]):
            state[1, i] -= h * state[0, i]
            state[0, i] += h * state[1, i]


def compile_loop() -> Callable:
    """Compile the leapfrog loop `_loop` to a function (state, steps, h) that releases the interpreter's lock."""
    signature = types.void(types.Array(types.float64, 2, "C"), types.int64, types.float64)
    return entry(machine.load_or_compile(_loop, signature, {"nogil": True, "error_model": "numpy"}, "ceiling"))


def speed_up(cores: int, rounds: int, steps: int = STEPS) -> Median:
    """Measure how much more work the leapfrog loop does in a second on ``cores`` threads than on one.

    Both run in ``rounds`` alternating rounds of ``steps`` steps; returns the ratio with its interval.
    """
    loop = compile_loop()

    def work() -> None:
        loop(np.ones((2, WIDTH)), steps, H)

    def on(threads: int) -> Callable[[], float]:
        def seconds() -> float:
            began = time.perf_counter()
            others = [pool.submit(work) for _ in range(threads - 1)]
            work()
            for other in others:
                other.result()
            return (time.perf_counter() - began) / threads

        return seconds

    with ThreadPoolExecutor(max(1, cores - 1)) as pool:
        times = in_turns({"one": on(1), "all": on(cores)}, rounds)
    return ratio(times["one"], times["all"])
