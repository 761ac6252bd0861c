"""Measure energy error and cost of every Wisdom-Holman splitting of this project and of REBOUND, at several steps.

From REBOUND: WHFast without and with each corrector, its kernels, the second corrector and other coordinates, all with
safe_mode = 0; WHFast512 if the processor and the build have AVX512; every type of SABA.  All runs on a problem are
timed in turns in one measurement, so that a busy machine slows all of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.records.wisdom_holman import CORRECTORS
from phasebench.integrators.registry import METHODS, method
from phasebench.reference.peers import PEERS, rebound

from .pairs import CASES, ROWS

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

#: Steps of a timed run, enough for one synchronization not to matter; rounds.
TIMED, ROUNDS = 2_500, 11
#: Prefixes of the ids of REBOUND's Wisdom-Holman integrators.
SPLIT = ("rebound-whfast", "rebound-saba")
TABLE = "wisdom_holman_rivals"


def rivals() -> list[Integrator]:
    """List all Wisdom-Holman integrators to compare: this project's, then REBOUND's in all their settings.

    This project's splitting with a symplectic corrector is listed once for each order of the corrector.
    """
    ours = [m for m in METHODS if m.family == "wisdom_holman" and not m.parameters]
    corrected = [method("wisdom-holman-corrector", corrector=n) for n in CORRECTORS]
    theirs = [p for p in PEERS if p.id.startswith(SPLIT)]
    return [Integrator(r) for r in (*ours, *corrected, *theirs, *rebound.TRIED)]


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for all splittings on each problem; none if ``quick``."""
    return [] if quick else [_cell(case) for case in CASES]


def _cell(case: str) -> Cell:
    name, parameters, steps, t_end = CASES[case]
    records = [c.record for c in rivals()]
    return Cell(
        "wisdom_holman",
        (TABLE,),
        {"problem": case},
        measure_rows,
        (case,),
        content("rivals", ProblemKey(name, tuple(parameters.items())), *records, steps, t_end, code=[__name__]),
        frozenset({name, "rebound", *(r.id for r in records)}),
        ALONE,
        own=True,
    )


def measure_rows(case: str) -> Rows:
    """Measure energy error and cost of all Wisdom-Holman splittings on a case, a key of `CASES`, timed in turns.

    Returns {`TABLE`: rows}: a row for each splitting at each step; the cost is in ns per unit of the problem's time.
    """
    name, parameters, steps, _ = CASES[case]
    made = problem(name, **parameters)
    rows = {(c.label, h): _row(case, made, c, h) for c in rivals() for h in steps}
    able = {(c.label, h): c for c in rivals() for h in steps if rows[c.label, h]["status"] == OK}

    clocks = {key: clock.clock(c, made, t_end=key[1] * TIMED, steps=TIMED) for key, c in able.items()}
    times = in_turns(clocks, ROUNDS)
    for (label, h), found in times.items():
        cost = median(found / TIMED / h * 1e9)
        rows[label, h] |= {"ns a unit of time": cost.value, "ns, low": cost.low, "ns, high": cost.high}
    return {TABLE: list(rows.values())}


def _row(case: str, made: Problem, c: Integrator, h: float) -> dict:
    row = {"problem": case, "kind": c.kind, "method": c.label, "h": h}
    lack = c.lacks(made)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    every = round(CASES[case][3] / h / ROWS)
    s = c.run(made, h=h, steps=every * ROWS, save_every=every)
    row |= {"status": s.status, "reason": s.reason}
    return row if s.status != OK else row | {"energy error": energy_error(made, s.q, s.p)}
