"""Error of the state at an apocentre of the Kepler orbit, after 100.5 revolutions, against the time of a warm run."""

from __future__ import annotations

import statistics
from functools import cache
from math import ceil, pi
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.accuracy import end_state
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK
from phasebench.reference.peers import heyoka, rebound
from phasebench.reference.solvers import taylor

if TYPE_CHECKING:
    from phasebench.integrators.solution import Solution

PROBLEMS = ("kepler", "perturbed-kepler")
ORBITS = 100.5
PER_ORBIT = (30, 50, 100, 300, 1000, 3000)
OURS = (
    integrator("stormer-verlet"),
    integrator("implicit-midpoint"),
    integrator("scheme-i", parameters={"lam": "1/3"}),
    integrator("scheme-ii", parameters={"lam": "1/3"}),
    integrator("scheme-iii", parameters={"lam": "1/3"}),
    integrator("scheme-iv"),
    integrator("scheme-v"),
    integrator("avf"),
    integrator("rk4"),
    integrator("scheme-iii-yoshida-4", parameters={"lam": "1/3"}),
    integrator("scheme-iii-suzuki-4", parameters={"lam": "0"}),
    integrator("scheme-iii-yoshida-6", parameters={"lam": "0"}),
    integrator("scheme-iii-sofroniou-spaletta-8", parameters={"lam": "0"}),
    integrator("scheme-v-suzuki-4"),
    integrator("gauss-6"),
    integrator("gauss-8"),
    integrator("dop853-relaxation"),
    integrator("wisdom-holman-aba-10-6-4"),
)
PEERS = (
    *map(integrator, ("rebound-whfast", "rebound-saba-10-6-4", "rebound-leapfrog", "rebound-leapfrog-8", "rebound-bs")),
    *(integrator(rebound.ias15(mode)) for mode in rebound.ADAPTIVE_MODES),
    *map(integrator, ("heyoka", "heyoka-high-accuracy", heyoka.compact(False), heyoka.compact(True))),
    *map(integrator, ("scipy-dop853-numba", "scipy-lsoda-numba")),
)
TOLERANCES = tuple(10.0**-k for k in range(3, 16, 2))
#: Largest number of rows of a run.
MOST = 5_000
#: A run of at least LONG seconds is timed once, a shorter one ROUNDS times.
LONG, ROUNDS = 0.2, 5


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each integrator on each problem; none if ``quick``."""
    return [] if quick else [_cell(name, k, c) for name in PROBLEMS for k, c in enumerate(_integrators())]


@cache
def _integrators() -> tuple[Integrator, ...]:
    return (*OURS, *PEERS)


def _cell(name: str, position: int, c: Integrator) -> Cell:
    return Cell(
        "kepler",
        ("kepler_cost",),
        {"problem": problem(name).label, "method": c.label},
        measure_rows,
        (name, position),
        content("cost", ProblemKey(name), c.record, ORBITS, PER_ORBIT, TOLERANCES, code=[__name__]),
        frozenset({name, c.id, c.kind}),
        ALONE,
        own=True,
    )


@cache
def _truth(name: str) -> taylor.Reference:
    """Return the Taylor reference of a problem, with its uncertainty, at the end of `ORBITS` revolutions."""
    return taylor.reference(problem(name), [ORBITS * 2 * pi])


def measure_rows(name: str, position: int) -> Rows:
    """Measure the end error and the time of warm runs of an integrator: a row for each step size or tolerance.

    ``name`` is the problem, ``position`` the index of the integrator in `OURS` followed by `PEERS`.  Returns rows by
    table name.
    """
    c, t_end = _integrators()[position], ORBITS * 2 * pi
    rows = []
    if c.adaptive:
        for tol in (t for t in TOLERANCES if t >= c.record.least):
            spaced = {1: {"h": t_end / 200, "steps": 200}, 0: {"h": t_end, "steps": 1}}
            rows.append(_row(name, c, f"tolerance {tol:g}", spaced, tol))
    else:
        for n in PER_ORBIT:
            size = {"h": 2 * pi / n, "steps": round(t_end / (2 * pi / n))}
            rows.append(_row(name, c, f"{n} steps an orbit", {0: size, 1: size}, None))
    return {"kepler_cost": rows}


def _row(name: str, c: Integrator, setting: str, sizes: dict, tol: float | None) -> dict:
    """Measure the error and the time of an integrator at one setting, and return the row of the table.

    ``setting`` is its text, ``tol`` the tolerance (None for a method of fixed step).  ``sizes`` maps 0 (a run without
    output) and 1 (a run with output) to a dict of the step "h" and the number of "steps".
    """
    found, truth = problem(name), _truth(name)

    def run(rows: int) -> Solution:
        size = sizes[rows]
        return c.run(found, **size, save_every=rows * ceil(size["steps"] / MOST), tol=tol)

    row = {"problem": found.label, "e": found.parameters["e"], "orbits": ORBITS}
    row |= {"method": c.label, "kind": c.kind, "setting": setting}
    s = run(1)
    row |= {"status": s.status, "reason": s.reason, "steps": s.counts.get("steps", 0)}
    if s.status != OK:
        return row
    system = found.system
    H, L = (system.observe(x, s.q, s.p) for x in (system.H, found.invariants["angular-momentum"]))
    return row | {
        "error": float(np.abs(end_state(s) - end_state(truth)).max()),
        "reference uncertainty": float(truth.uncertainty[-1]),
        "energy error": float(metrics.invariant_error(H).max),
        "angular momentum error": float(metrics.invariant_error(L).max),
        "seconds": statistics.median(run(0).seconds for _ in range(ROUNDS if s.seconds < LONG else 1)),
    }
