"""Costs over the number d of degrees of freedom: time of a step beside plain C and REBOUND, memory, compilation."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import linregress, t

from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.store.cells import ALONE, Cell, Rows, Unavailable, content
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import method
from phasebench.reference.peers import particles

from .c import Loop
from .systems import SYSTEMS, Large

COSTS, MADE = "large", "large_made"
#: Approximate degrees of freedom at which costs are measured; exponents are fitted from `MANY` on.
SIZES = (2, 4, 8, 16, 24, 64, 128, 256, 512, 1024, 2048, 4096, 10_000)
MANY = 64
#: Degrees of freedom at which functions are derived from a formula, until that takes longer than `PATIENCE` seconds,
#: and those at which they are compiled from loops.
DERIVED, PATIENCE, BY_HAND = (8, 16, 32, 64, 128, 256, 512), 10.0, (32, 512, 10_000)
#: Seconds of a timed run, rounds; number of steps after which ends are compared with C, and their largest difference.
SECONDS, ROUNDS, FEW, APART = 4e-3, 11, 3, 1e-10
CONFIDENCE = 0.95


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each system and number d of degrees of freedom, one for compiling each.

    The list is empty if ``quick``.
    """
    if quick:
        return []
    sizes = [(s.name, d) for s in SYSTEMS.values() for d in sorted({s.size(d) for d in SIZES})]
    return [_cell(COSTS, {"system": n, "d": d}, costs, (n, d)) for n, d in sizes] + [
        _cell(MADE, {"system": n}, measure_rows, (n,)) for n in SYSTEMS
    ]


def _cell(table: str, key: dict, measure: Callable, arguments: tuple) -> Cell:
    system = SYSTEMS[key["system"]]
    made_of = content(table, *arguments, method(system.method), code=[__name__, system.module.__name__])
    return Cell(
        "large",
        (table,),
        key,
        measure,
        arguments,
        made_of,
        frozenset({"large", system.name, system.method}),
        ALONE,
        own=True,
    )


def costs(name: str, d: int) -> Rows:
    """Measure the cost of a step of a system with d degrees of freedom, by this project, C and REBOUND.

    The three are timed in alternating rounds, REBOUND on gravitating bodies only.  Returns one row, by table name:
    medians in nanoseconds a step and ratios of times with intervals, the memory of a run in kB, and the distance from
    C's end state.

    Raises
    ------
    Unavailable
        Without a C compiler.
    RuntimeError
        If C ends at another state than this project: it then integrates another system.
    """
    system = SYSTEMS[name]
    problem = system.fastest_form(d)
    run = prepare(problem, system.method)
    try:
        loop = Loop(system.C, system.method)
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    start = np.array([problem.q0, problem.p0])
    apart = difference(system, run, loop, start)
    if not apart < APART:
        raise RuntimeError(f"{name} of d = {d}: C ends {apart:.1e} elsewhere after {FEW} steps")
    steps = enough(lambda n: loop.run(*start, system.h, n, system.constants(d))[0])
    work = {"ours": _clock(lambda: run(system.h, steps))}
    work["C"] = lambda: loop.run(*start, system.h, steps, system.constants(d))[0]
    if system.pairs:
        work["REBOUND"] = rebound(system, d, steps)
    times = in_turns(work, ROUNDS)
    row = {"system": name, "d": d, "method": system.method, "values": run.values, "steps": steps}
    for who, seconds in times.items():
        m = median(seconds / steps * 1e9)
        row |= {f"ns, {who}": m.value, f"ns, {who}, low": m.low, f"ns, {who}, high": m.high}
    for who in ("C", "REBOUND"):
        if who in times:
            r = ratio(times["ours"], times[who])
            row |= {f"ours / {who}": r.value, f"ours / {who}, low": r.low, f"ours / {who}, high": r.high}
    return {COSTS: [row | {"kB": array_bytes(run) / 1e3, "difference from C": apart}]}


def difference(system: Large, run: PreparedRun, loop: Loop, start: np.ndarray) -> float:
    """Return the largest relative distance between our state and that of C after a few steps from ``start``.

    ``start`` is an array (2, d) of q and p; q and p are each compared in the max norm.
    """
    d = start.shape[1]
    q, p, _ = run(system.h, FEW)
    _, x, v = loop.run(*start, system.h, FEW, system.constants(d))
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in ((q, x), (p, v)))


def enough(seconds: Callable[[int], float]) -> int:
    """Return a number of steps, a power of two of at most 2^20, that takes at least `SECONDS`.

    ``seconds`` runs a number of steps and returns the time that they take.
    """
    steps = 1
    while seconds(steps) < SECONDS and steps < 2**20:
        steps *= 2
    return steps


def _clock(run: Callable[[], object]) -> Callable[[], float]:
    """Return a function without arguments that calls ``run`` and returns the seconds that this takes."""

    def seconds() -> float:
        started = time.perf_counter()
        run()
        return time.perf_counter() - started

    return seconds


def rebound(system: Large, d: int, steps: int) -> Callable[[], float]:
    """Return a function that times ``steps`` steps of REBOUND's leapfrog with direct summation, in seconds.

    Each call continues from the state at which the last one ended.
    """
    N = d // system.unit
    setting = particles.Setting(particles.GRAVITY, (1.0 / N,) * N, 3, 0, (1.0,) * d)
    sim, _ = particles.build(setting, *system.start(d), "leapfrog")
    sim.dt = system.h
    return _clock(lambda: sim.steps(steps))


def array_bytes(run: PreparedRun) -> int:
    """Return the number of bytes of the arrays that a prepared run holds: state, memory of earlier steps, work."""
    carry = run._layout.carry
    return sum(a.nbytes for a in (carry.state, carry.memory, carry.work, run._start, run._end))


# -- making a system's functions ---------------------------------------------------------------------------------------


def measure_rows(name: str) -> Rows:
    """Measure the seconds to make the functions of the system ``name`` (H and its derivatives) from scratch.

    Returns a row for each number d of degrees of freedom and each route: derived from a formula, or from hand-written
    loops.
    """
    system, rows = SYSTEMS[name], []
    for d in DERIVED:
        seconds = getting_ready(lambda d=d: system.from_formula(d))
        rows.append({"system": name, "route": "formula", "d": system.size(d), "seconds": seconds})
        if seconds > PATIENCE:
            break
    for d in BY_HAND:
        size = system.size(d)
        seconds = getting_ready(lambda d=size: system.by_hand(d))
        rows.append({"system": name, "route": "loops", "d": size, "seconds": seconds})
    return {MADE: rows}


def getting_ready(make: Callable[[], SimpleNamespace]) -> float:
    """Return the seconds to make a system and compile its energy and gradient (or field), from an empty cache.

    ``make`` builds the problem and has no arguments.
    """
    with nothing_kept():
        started = time.perf_counter()
        system = make().system
        system.energy()
        (system.grad_V if system.separable else system.field)()
        return time.perf_counter() - started


@contextmanager
def nothing_kept() -> Iterator[None]:
    """Context manager that runs its block with an empty cache of compiled functions."""
    from phasebench.integrators.compile import codegen
    from phasebench.integrators.systems import hand

    before, ready = os.environ.get("PHASEBENCH_CACHE"), dict(codegen._ready)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["PHASEBENCH_CACHE"] = folder
        codegen._ready.clear()
        hand._compile.cache_clear()
        try:
            yield
        finally:
            codegen._ready.update(ready)
            if before is None:
                del os.environ["PHASEBENCH_CACHE"]
            else:
                os.environ["PHASEBENCH_CACHE"] = before


# -- exponents ---------------------------------------------------------------------------------------------------------


def exponent(d: ArrayLike, cost: ArrayLike) -> tuple[float, float, float]:
    """Fit cost ~ d^e by least squares on logarithms: (e, low, high), a 95 % interval; NaN for fewer than 3 points."""
    x, y = np.log(np.asarray(d, float)), np.log(np.asarray(cost, float))
    if len(x) < 3:
        return float("nan"), float("nan"), float("nan")
    line = linregress(x, y)
    half = t.ppf((1 + CONFIDENCE) / 2, len(x) - 2) * line.stderr
    return float(line.slope), float(line.slope - half), float(line.slope + half)


__all__ = ["COSTS", "MADE", "MANY", "SIZES", "TUPLE_LIMIT", "cells", "costs", "exponent", "measure_rows"]
