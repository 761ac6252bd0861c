"""The cost of a step of one orbit: in SIMD lanes against the scalar kernel, and on all cores against one.

SIMD lanes carry several orbits side by side in a vector register, the scalar kernel one orbit at a time.  The most that
the cores can give is measured by a compiled loop that needs no main memory and no Python.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import types

from phasebench.benchmarks.measure.timing import Median, clock, columns, in_turns, median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.compile import machine
from phasebench.integrators.driver import warm
from phasebench.integrators.ensemble import cores, integrate_ensemble
from phasebench.integrators.registry import method as method_of
from phasebench.integrators.stepping.kernel import entry

TABLE = "ensembles"
#: Orbits of an ensemble, alternating rounds of timing, orbits whose ends are compared with the scalar kernel's.
ORBITS, ROUNDS, COMPARED = 1024, 11, 16
SPREAD, H = 0.01, 0.01
BOX, PENDULUM = "henon-heiles:box", "pendulum:swinging"
#: (Problem, method) -> (the method, steps, orbits): some 0.1 s on one core, beside which threads start at no cost.
CASES = {
    (problem, chosen.label): (chosen, steps, orbits)
    for problem, chosen, steps, orbits in (
        (BOX, method_of("stormer-verlet"), 100_000, ORBITS),
        (BOX, method_of("blanes-moan-srkn11b"), 10_000, ORBITS),
        (BOX, method_of("scheme-i", lam="1/3"), 20_000, ORBITS),
        (BOX, method_of("rk4"), 20_000, ORBITS),
        (PENDULUM, method_of("stormer-verlet"), 60_000, ORBITS),
        (PENDULUM, method_of("scheme-i", lam="1/3"), 15_000, ORBITS),
        ("kepler", method_of("stormer-verlet"), 50_000, ORBITS),
        ("kepler", method_of("scheme-iii", lam="1/3"), 6000, ORBITS),
        (BOX, method_of("avf"), 100_000, 8),  # has no lanes and gains from the cores alone
    )
}
#: The label of the bare loop; its oscillators, which fit into the first-level cache, its steps and their size.
BARE = "(a bare loop)"
WIDTH, BARE_STEPS = 64, 4_000_000
KEYS = [{"problem": problem, "method": method} for problem, method in (*CASES, ("", BARE))]


def needs(problem: str, method: str) -> tuple:
    """What a row depends on, besides the code."""
    return () if method == BARE else (*CASES[problem, method], ProblemKey(problem))


def starts(made: Problem, n: int) -> tuple[np.ndarray, np.ndarray]:
    """``n`` initial states within `SPREAD` of the problem's own: (Q, P), arrays (n, d)."""
    random = np.random.default_rng(0)
    return tuple(np.array(x) + SPREAD * random.uniform(-1, 1, (n, made.system.d)) for x in (made.q0, made.p0))


def costs(problem: str, method: str) -> dict:
    """Nanoseconds of an orbit's step by the scalar kernel, in an ensemble on one core and on all; ends compared."""
    row = {"in lanes": False, "cores": cores(), "status": "ok"}
    if method == BARE:
        return row | columns("speed-up", speed_up(cores(), ROUNDS))
    made, (chosen, steps, n) = problem_of(problem), CASES[problem, method]
    Q, P = starts(made, n)

    def ensemble(threads: int) -> Callable[[], float]:
        return lambda: integrate_ensemble(made, chosen, Q, P, h=H, steps=steps, threads=threads).seconds / n

    first = integrate_ensemble(made, chosen, Q, P, h=H, steps=steps)  # compiles, and is compared
    single = warm(made, chosen, h=H, steps=steps)
    times = in_turns({"scalar": clock(single), "one": ensemble(1), "all": ensemble(cores())}, ROUNDS)
    row = {"orbits": n, "steps": steps, "h": H, "in lanes": bool(first.in_lanes.all()), "cores": cores()}
    for key, column in (("scalar", "ns scalar"), ("one", "ns ensemble"), ("all", "ns all cores")):
        row |= columns(column, median(1e9 / steps * times[key]))
    row |= columns("gain", ratio(times["scalar"], times["one"]))
    row |= columns("speed-up", ratio(times["one"], times["all"]))
    alone = integrate_ensemble(made, chosen, Q[:COMPARED], P[:COMPARED], h=H, steps=steps, lanes=False)
    away = np.abs(np.hstack([first.q, first.p])[: len(alone)] - np.hstack([alone.q, alone.p])).max(axis=1)
    stopped = sorted({*first.status.tolist()} - {"ok"})
    row |= {"compared": len(alone), "to the last bit": int((away == 0).sum()), "largest difference": float(away.max())}
    return row | {"status": stopped[0] if stopped else "ok"}


def _leapfrog(state: np.ndarray, steps: int, h: float) -> None:
    for _ in range(steps):
        for i in range(state.shape[1]):
            state[1, i] -= h * state[0, i]
            state[0, i] += h * state[1, i]


def compile_loop() -> Callable:
    """The bare loop: leapfrog steps (state, steps, h) of oscillators in place, without the interpreter's lock."""
    signature = types.void(types.Array(types.float64, 2, "C"), types.int64, types.float64)
    return entry(machine.load_or_compile(_leapfrog, signature, {"nogil": True, "error_model": "numpy"}, "ceiling"))


def speed_up(threads: int, rounds: int, steps: int = BARE_STEPS) -> Median:
    """How much more work the bare loop does in a second on so many threads than on one."""
    loop = compile_loop()

    def work() -> None:
        loop(np.ones((2, WIDTH)), steps, H)

    def together() -> None:
        others = [pool.submit(work) for _ in range(threads - 1)]
        work()
        for other in others:
            other.result()

    with ThreadPoolExecutor(max(1, threads - 1)) as pool:
        times = time_in_turns({"one": work, "all": together}, rounds)
    return ratio(threads * times["one"], times["all"])
