"""Measure the cost of a step of one orbit: in SIMD lanes against the scalar kernel, and on all cores against one.

SIMD lanes carry several orbits side by side in a vector register, the scalar kernel one orbit at a time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate, warm
from phasebench.integrators.ensemble import cores, integrate_ensemble
from phasebench.integrators.registry import method

from . import ceiling

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.timing import Median
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.ensemble import Ensemble
    from phasebench.integrators.record import Method

TABLE = "ensembles"
#: Orbits of an ensemble, alternating rounds of timing, orbits whose ends are compared with the scalar kernel's.
ORBITS, ROUNDS, COMPARED = 1024, 11, 16
SPREAD = 0.01
H = 0.01
#: (problem, method, parameters, steps): some 0.1 s on one core, so that starting threads costs nothing beside it.
CASES = (
    ("henon-heiles:box", "stormer-verlet", (), 100_000),
    ("henon-heiles:box", "blanes-moan-srkn11b", (), 10_000),
    ("henon-heiles:box", "scheme-i", (("lam", "1/3"),), 20_000),
    ("henon-heiles:box", "rk4", (), 20_000),
    ("pendulum", "stormer-verlet", (), 60_000),
    ("pendulum", "scheme-i", (("lam", "1/3"),), 15_000),
    ("kepler", "stormer-verlet", (), 50_000),
    ("kepler", "scheme-iii", (("lam", "1/3"),), 6000),
)
#: (problem, method, steps, orbits) for a method without lanes, which gains from the cores alone.
ALONE_CASES = (("henon-heiles:box", "avf", 100_000, 8),)
#: Label of the row with the best possible speed-up (`ceiling`).
CEILING = "(a bare loop)"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), also if ``quick``: one for each method on each problem, one for a bare loop.

    The bare loop runs on all cores without memory access; its speed-up is the limit for any ensemble.
    """
    in_lanes = [(*case, ORBITS) for case in CASES]
    alone = [(name, id, (), steps, n) for name, id, steps, n in ALONE_CASES]
    return [_cell(*case) for case in (*in_lanes, *alone)] + [_ceiling_cell()]


def _cell(name: str, id: str, parameters: tuple, steps: int, n: int) -> Cell:
    chosen = method(id, **dict(parameters))
    return Cell(
        "ensembles",
        (TABLE,),
        {"problem": problem(name).label, "method": chosen.label},
        measure_rows,
        (name, id, parameters, steps, n),
        content(TABLE, chosen, ProblemKey(name), steps, n, code=[__name__]),
        frozenset({name.partition(":")[0], id, TABLE}),
        ALONE,
        own=True,
        quick=(name, id) == CASES[0][:2],
    )


def _ceiling_cell() -> Cell:
    return Cell(
        "ensembles",
        (TABLE,),
        {"problem": "", "method": CEILING},
        ceiling_row,
        (),
        content(TABLE, CEILING, code=[ceiling.__name__]),
        frozenset({TABLE}),
        ALONE,
        own=True,
    )


def ceiling_row() -> Rows:
    """Measure the speed-up of a bare loop without memory access on all cores, the limit for any ensemble: one row."""
    available = cores()
    row = {"problem": "", "method": CEILING, "in lanes": False, "cores": available, "status": "ok"}
    return {TABLE: [row | _with_interval("speed-up", ceiling.speed_up(available, ROUNDS))]}


def starts(found: Problem, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw n initial states within `SPREAD` of the problem's own: (Q, P), arrays (n, d)."""
    random = np.random.default_rng(0)
    return tuple(np.array(x) + SPREAD * random.uniform(-1, 1, (n, found.system.d)) for x in (found.q0, found.p0))


def measure_rows(name: str, id: str, parameters: tuple, steps: int, n: int) -> Rows:
    """Measure nanoseconds per step of one orbit: by the scalar kernel, in an ensemble on one core, on all cores.

    ``name`` is the problem, ``id`` and ``parameters`` (pairs of name and value) are the method's, and ``n`` is the
    number of orbits, each of ``steps`` steps.  Returns one row, by table name, which also compares end states with the
    scalar kernel's.
    """
    found, chosen = problem(name), method(id, **dict(parameters))
    Q, P = starts(found, n)

    def ensemble(threads: int) -> Callable[[], float]:
        return lambda: integrate_ensemble(found, chosen, Q, P, h=H, steps=steps, threads=threads).seconds / (n * steps)

    available = cores()
    first = integrate_ensemble(found, chosen, Q, P, h=H, steps=steps)  # compiles, and is compared
    single = warm(found, chosen, h=H, steps=steps)
    work = {"scalar": _clock(single, steps), "one": ensemble(1), "all": ensemble(available)}
    times = in_turns(work, ROUNDS)
    row = {"problem": found.label, "method": chosen.label, "orbits": n, "steps": steps, "h": H}
    row |= {"in lanes": bool(first.in_lanes.all()), "cores": available}
    for key, column in (("scalar", "ns scalar"), ("one", "ns ensemble"), ("all", "ns all cores")):
        row |= _with_interval(column, median(1e9 * times[key]))
    row |= _with_interval("gain", ratio(times["scalar"], times["one"]))
    row |= _with_interval("speed-up", ratio(times["one"], times["all"]))
    stopped = sorted({*first.status.tolist()} - {"ok"})
    return {
        TABLE: [row | _differences(found, chosen, first, Q, P, steps) | {"status": stopped[0] if stopped else "ok"}]
    }


def _clock(run: Callable[[], object], steps: int) -> Callable[[], float]:
    """Make a function that calls ``run``, which takes ``steps`` steps, once and returns the seconds per step."""

    def seconds() -> float:
        began = time.perf_counter()
        run()
        return (time.perf_counter() - began) / steps

    return seconds


def _with_interval(column: str, value: Median) -> dict:
    """Make the columns of a measured value: ``column`` itself, and the ends of its confidence interval."""
    return {column: value.value, f"{column}, low": value.low, f"{column}, high": value.high}


def _differences(found: Problem, chosen: Method, ensemble: Ensemble, Q: np.ndarray, P: np.ndarray, steps: int) -> dict:
    """Compare end states of the first `COMPARED` orbits of an ensemble with the scalar kernel's from the same starts.

    ``found`` is the problem, ``chosen`` the method, and ``ensemble`` the result of ``steps`` steps from the starts Q,
    P, arrays (n, d).  Returns columns of a row: how many orbits are compared, how many agree to the last bit, the
    largest difference.
    """
    same, largest = 0, 0.0
    for i in range(min(COMPARED, len(Q))):
        s = integrate(found, chosen, h=H, steps=steps, q0=Q[i], p0=P[i], save_every=0)
        away = max(np.abs(s.q[-1] - ensemble.q[i]).max(), np.abs(s.p[-1] - ensemble.p[i]).max())
        same += bool(away == 0)
        largest = max(largest, float(away))
    return {"compared": min(COMPARED, len(Q)), "to the last bit": same, "largest difference": largest}
