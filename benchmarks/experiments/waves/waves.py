"""Measure methods on semi-discretized wave equations: errors of energy and of a quadratic invariant, and the cost."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK, SKIPPED, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

METHODS = ("stormer-verlet", "implicit-midpoint", "scheme-iii", "scheme-iv", "scheme-v", "avf", "cohen-hairer-2", "rk4")
#: Problem -> (steps h, end time); the largest frequency is 4 / dx^2 (nls), or about 2 / dx (klein-gordon).
RUNS = {"nls:plane-wave": ((0.01, 0.005), 40.0), "nls:soliton": ((0.01,), 20.0), "klein-gordon": ((0.05, 0.025), 100.0)}
#: An error of fewer units of round-off than this counts as round-off.
UNITS = 1000
REPEATS = 3


def _row(name: str, id: str, N: int, h: float, t_end: float) -> dict:
    made, chosen = problem(name, N=N), method(id)
    system = made.system
    ((invariant, expression),) = made.invariants.items()
    row = {"problem": made.label, "N": N, "d": system.d, "method": chosen.label, "h": h, "t_end": t_end}
    row |= {"invariant": invariant, "energy class": chosen.energy, "quadratic class": chosen.quadratic}
    lack = chosen.lacks(system)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    s = integrate(made, chosen, h=h, t_end=t_end)
    row |= {"status": s.status, "reason": s.reason, "fallbacks": s.counts["fallbacks"], "newton": s.counts["newton"]}
    if s.status != OK:
        return row
    # Schemes IV and V change the energy on steps without a root, and restore it later.
    good = (
        np.concatenate([[True], ~np.isnan(s.parameter)]) if chosen.family == "schemes_iv_v" else np.full(len(s.q), True)
    )
    H, value = (system.observe(e, s.q, s.p) for e in (system.H, expression))
    size = system.energy()(s.q[0], s.p[0])[1]
    steps = s.counts["steps"]
    run = prepare(made, chosen)
    return row | {
        "energy error": float(np.abs(H - H[0])[good].max()),
        "energy error, steps without a root": float(np.abs(H - H[0])[~good].max()) if not good.all() else np.nan,
        "energy is kept": bool(np.abs(H - H[0])[good].max() < UNITS * np.finfo(float).eps * size),
        "invariant error": float(np.abs(value - value[0]).max()),
        "invariant is kept": bool(np.abs(value - value[0]).max() < UNITS * np.finfo(float).eps * abs(value[0])),
        "evaluations per step": s.counts["gradient"] / steps,
        "seconds": statistics.median(_seconds(lambda: run(s.h, steps)) for _ in range(REPEATS)),
    }


def _seconds(run: Callable[[], object]) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


#: Number of mesh points.
N = 64


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method and step on each wave equation.

    The list is empty if ``quick``: code for so many degrees of freedom takes long to compile.
    """
    return [] if quick else [_cell(name, id, h) for name in RUNS for id in METHODS for h in RUNS[name][0]]


def _cell(name: str, id: str, h: float) -> Cell:
    chosen, made = method(id), ProblemKey(name, (("N", N),))
    return Cell(
        "waves",
        ("pde",),
        {"problem": problem(name, N=N).label, "method": chosen.label, "h": h},
        measure_rows,
        (name, id, h),
        content("pde", chosen, made, h, RUNS[name][1], code=[__name__]),
        frozenset({made.id, id}),
        ALONE,
        own=True,
    )


def measure_rows(name: str, id: str, h: float) -> Rows:
    """Measure the method ``id`` on the semi-discretized wave equation ``name`` with step h.

    Returns {"pde": [row]} with the errors of the energy and of the equation's quadratic invariant (mass or charge), the
    evaluations per step and the time of an integration.
    """
    return {"pde": [_row(name, id, N, h, RUNS[name][1])]}
