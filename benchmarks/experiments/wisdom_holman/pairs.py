"""Compare Wisdom-Holman splittings with the same ones in REBOUND, at equal steps: energy, end states, cost of a step.

REBOUND's WHFast and SABA use Jacobi coordinates and the same splittings; safe_mode = 0 joins the drifts of neighbouring
steps and applies the corrector only for output, as the methods here always do.  WHFast's sums are not compensated.
"""

from __future__ import annotations

from math import pi

import numpy as np

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import peer

#: Method of this project -> the peer with the same splitting.
PAIRS = {
    "wisdom-holman": "rebound-whfast-plain",
    "wisdom-holman-corrector": "rebound-whfast-corrector-17",
    "wisdom-holman-saba-4": "rebound-saba-4",
    "wisdom-holman-aba-8-6-4": "rebound-saba-8-6-4",
    "wisdom-holman-aba-10-6-4": "rebound-saba-10-6-4",
}
#: Name of a case -> (problem, its parameters, steps, end time).
CASES = {
    "perturbed-kepler, e = 0.2": ("perturbed-kepler", {"e": 0.2}, [2 * pi / n for n in (25, 50, 100)], 2000.0),
    "perturbed-kepler, e = 0.6": ("perturbed-kepler", {"e": 0.6}, [2 * pi / n for n in (50, 100, 200)], 2000.0),
    "outer-solar-system": ("outer-solar-system", {}, [50.0, 100.0, 200.0, 400.0], 500_000.0),
}
ROWS, TIMED, ROUNDS = 200, 5_000, 15


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`); none if ``quick``.

    There is one for each problem, step and pair of integrators, ours and REBOUND's, with the same splitting.
    """
    return [] if quick else [_cell(case, ours, h) for case in CASES for ours in PAIRS for h in CASES[case][2]]


def _cell(case: str, ours: str, h: float) -> Cell:
    name, parameters, _, t_end = CASES[case]
    made = ProblemKey(name, tuple(parameters.items()))
    return Cell(
        "wisdom_holman",
        ("wisdom_holman",),
        {"problem": case, "method": ours, "h": h},
        measure_rows,
        (case, ours, h),
        content("pair", BY_ID[ours], peer(PAIRS[ours]), made, h, t_end, code=[__name__]),
        frozenset({name, ours, "rebound"}),
        ALONE,
        own=True,
    )


def measure_rows(case: str, ours: str, h: float) -> Rows:
    """Run a splitting with step h by this project and by REBOUND, and compare energy errors, positions and times.

    ``case`` is a key of `CASES`, ``ours`` the id of this project's method.  Returns {table: [row]}.  Raises Unavailable
    without REBOUND, RuntimeError if a run fails.
    """
    name, parameters, _, t_end = CASES[case]
    made, both = problem(name, **parameters), {"ours": integrator(ours), "theirs": integrator(PAIRS[ours])}
    every = round(t_end / h / ROWS)
    runs = {who: c.run(made, h=h, steps=every * ROWS, save_every=every) for who, c in both.items()}
    if runs["theirs"].status == SKIPPED:
        raise Unavailable(runs["theirs"].reason)
    for s in runs.values():
        if s.status != OK:
            raise RuntimeError(f"{s.method.label} on {case}: {s.reason}")
    s, r = runs.values()
    times = in_turns({who: clock.clock(c, made, t_end=h * TIMED, steps=TIMED) for who, c in both.items()}, ROUNDS)
    size, paid = np.abs(r.q).max(), ratio(times["ours"], times["theirs"])
    row = {
        "problem": case,
        "method": ours,
        "REBOUND's": PAIRS[ours],
        "h": h,
        "steps": every * ROWS,
        "energy error": energy_error(made, s.q, s.p),
        "REBOUND's energy error": energy_error(made, r.q, r.p),
        "distance of early positions": float(np.abs(s.q[: ROWS // 10] - r.q[: ROWS // 10]).max() / size),
        "distance of end positions": float(np.abs(s.q[-1] - r.q[-1]).max() / size),
        "ns per step": median(times["ours"]).value / TIMED * 1e9,
        "REBOUND's ns per step": median(times["theirs"]).value / TIMED * 1e9,
        "time ratio": paid.value,
        "ratio, low": paid.low,
        "ratio, high": paid.high,
    }
    return {"wisdom_holman": [row]}
