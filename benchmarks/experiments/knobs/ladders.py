"""Knobs that change what a step is: a ladder of steps for each setting, the error at the end against the time it takes.

- composition order: symmetric compositions of Stormer-Verlet of order 2 to 10;
- generating function: the order r, at lambda = 1/3, and at 1/2, where an odd r gives the order r + 1;
- energy: methods that keep it to round-off: Schemes IV and V with compositions, projection, relaxation.

The error is that of the end state against a certified one, the time that of a prepared run, in turns with all others.
The energy error is the largest of a run of the same steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import interleaved, median
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, Unavailable, content
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method
from phasebench.reference.certificates import stored

TABLE, ROUNDS = "knobs_ladders", 7
#: Rows of a run from which its energy error is told.
ROWS = 200
COMPOSITION, GENERATING, ENERGY = "composition order", "generating function", "energy"
Setting = tuple[str, dict]


class Ladder(NamedTuple):
    """A knob on an orbit to a certified time: from the fewest steps on, each rung with 2^(1/2) times as many."""

    knob: str
    problem: str
    t_end: float
    fewest: int
    rungs: int


LADDERS = (
    Ladder(COMPOSITION, "henon-heiles:box", 100.0, 30, 19),
    Ladder(COMPOSITION, "perturbed-kepler", 10.0, 20, 19),
    Ladder(GENERATING, "pendulum:swinging", 100.0, 100, 14),
    Ladder(GENERATING, "lotka-volterra-log:4-2", 12.0, 40, 14),
    Ladder(ENERGY, "henon-heiles:box", 100.0, 60, 14),
    Ladder(ENERGY, "perturbed-kepler", 10.0, 60, 14),
)
#: Knob -> what a setting is called -> a method and its parameters.
SETTINGS: dict[str, dict[str, Setting]] = {
    COMPOSITION: {
        "2": ("stormer-verlet", {}),
        "4": ("suzuki-4", {}),
        "6": ("kahan-li-6", {}),
        "8": ("kahan-li-8", {}),
        "10": ("sofroniou-spaletta-10", {}),
    },
    GENERATING: {
        **{f"r = {r}, λ = 1/3": ("generating-function", {"order": r, "lam": "1/3"}) for r in range(1, 7)},
        **{f"r = {r}, λ = 1/2": ("generating-function", {"order": r, "lam": "1/2"}) for r in (1, 3, 5)},
    },
    ENERGY: {
        id: (id, {})
        for id in (
            "scheme-iv",
            "scheme-v",
            "scheme-v-suzuki-4",
            "scheme-v-kahan-li-6",
            "rk4-projected-energy",
            "stormer-verlet-symmetric-projection",
            "suzuki-4-symmetric-projection",
            "rk4-relaxation",
            "dop853-relaxation",
        )
    },
}


def chosen(knob: str) -> dict[str, Method]:
    """The methods of a knob by its settings."""
    return {name: method(id, **values) for name, (id, values) in SETTINGS[knob].items()}


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each knob and orbit."""
    return [] if quick else [_cell(k) for k in range(len(LADDERS))]


def _cell(k: int) -> Cell:
    ladder = LADDERS[k]
    methods = chosen(ladder.knob)
    needs = content("ladder", tuple(ladder), ROUNDS, *methods.values(), Problem(ladder.problem), code=[__name__])
    names = frozenset({ladder.problem.partition(":")[0], *(m.id for m in methods.values())})
    key = {"knob": ladder.knob, "scene": ladder.problem}
    return Cell("knobs", (TABLE,), key, measured, (k,), needs, names, ALONE, own=True)


def numbers_of_steps(ladder: Ladder) -> list[int]:
    """The numbers of steps, rising."""
    return [round(ladder.fewest * 2 ** (k / 2)) for k in range(ladder.rungs)]


def measured(k: int) -> Rows:
    """The rows of a knob on an orbit: a setting and a step each; those that did not arrive have no time."""
    ladder = LADDERS[k]
    made = problem(ladder.problem)
    end = stored.end(made, ladder.t_end)
    if end is None:
        raise Unavailable(f"no certified state of {ladder.problem} at {ladder.t_end:g}")
    rows, work = [], {}
    for name, record in chosen(ladder.knob).items():
        run = prepare(made, record)
        for steps in numbers_of_steps(ladder):
            row = _rung(made, record, ladder.t_end, steps, end)
            rows.append({"knob": ladder.knob, "scene": ladder.problem, "setting": name, "method": record.label} | row)
            if row["status"] == OK:
                work[len(rows) - 1] = _call(run, row["h"], steps)
    for number, seconds in interleaved(work, ROUNDS).items():
        rows[number] |= dict(zip(("us", "us, low", "us, high"), median(1e6 * seconds), strict=True))
    return {TABLE: rows}


def _call(run, h: float, steps: int):
    return lambda: run(h, steps)


def _rung(made, record: Method, t_end: float, steps: int, end) -> dict:
    """What a run of so many steps reaches, and what it takes."""
    h = t_end / steps
    run = integrate(made, record, h=h, steps=steps, save_every=max(1, steps // ROWS))
    with np.errstate(all="ignore"):
        H = made.system.observe(made.system.H, run.q, run.p)
        energy = float(np.abs(H - H[0]).max()) / scale(made)
        error = float(np.abs(np.concatenate([run.q[-1] - end.q, run.p[-1] - end.p])).max())
    row = {"h": h, "steps": steps, "status": run.status, "error": error if run.status == OK else None}
    row |= {"energy error": energy, "gradients": run.counts["gradient"], "fallbacks": run.counts["fallbacks"]}
    return row | {"uncertainty": float(end.uncertainty)}
