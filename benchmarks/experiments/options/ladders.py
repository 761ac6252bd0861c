"""Options that change the step map: for each setting, the error at the end against time, over ever smaller steps.

- composition order: symmetric compositions of Stormer-Verlet of order 2 to 10;
- generating function: the order r, at the parameter lambda = 1/3, and at 1/2, where an odd r gives the order r + 1;
- energy: methods that keep the energy to round-off: Schemes IV and V (methods that are symplectic at a fixed
  parameter, which is chosen in each step to keep H) and compositions of them, projection, relaxation.

The error is that of the end state against a certified one; the time is that of a prepared run, in turns with all
others.  The energy error is the largest over a run with the same step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasebench.benchmarks.measure.quantities import scale
from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content, states
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.record import Method
from phasebench.integrators.registry import method
from phasebench.reference.certificates import stored

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.prepared import PreparedRun
    from phasebench.reference.certificates.stored import End

#: On disk, the tables of this experiment are named `knobs_*`, and the option's column is `knob`.
TABLE, ROUNDS = "knobs_ladders", 7
#: Number of rows of a run from which its energy error is computed.
ROWS = 200
COMPOSITION, GENERATING, ENERGY = "composition order", "generating function", "energy"
Setting = tuple[str, dict]


class Ladder(NamedTuple):
    """An option and an orbit, with the numbers of steps of the runs to make: ``fewest`` * 2^(k/2), k = 0, 1, ....

    Attributes
    ----------
    option : a key of `SETTINGS`
    problem : id and orbit, such as "henon-heiles:box"
    t_end : end time, at which there is a certified state
    fewest : smallest number of steps
    rungs : how many numbers of steps there are
    """

    option: str
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
#: Option -> name of a setting -> (method id, parameters).
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


def settings_of(option: str) -> dict[str, Method]:
    """Return the settings of an option: name of the setting -> the method with that setting."""
    return {name: method(id, **values) for name, (id, values) in SETTINGS[option].items()}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each option and orbit; none if ``quick``."""
    return [] if quick else [_cell(k) for k in range(len(LADDERS))]


def _cell(k: int) -> Cell:
    ladder = LADDERS[k]
    methods = settings_of(ladder.option)
    made = ProblemKey(ladder.problem)
    needs = content("ladder", tuple(ladder), ROUNDS, *methods.values(), made, states(made.id), code=[__name__])
    names = frozenset({ladder.problem.partition(":")[0], *(m.id for m in methods.values())})
    key = {"knob": ladder.option, "scene": ladder.problem}
    return Cell("options", (TABLE,), key, measure_rows, (k,), needs, names, ALONE, own=True)


def numbers_of_steps(ladder: Ladder) -> list[int]:
    """Return the numbers of steps of the runs of ``ladder``, ascending."""
    return [round(ladder.fewest * 2 ** (k / 2)) for k in range(ladder.rungs)]


def measure_rows(k: int) -> Rows:
    """Measure error and time of an option's settings on an orbit, ``LADDERS[k]``: a row for each setting and step size.

    Failed runs have no time.  Raises Unavailable if the orbit has no certified state at the end.
    """
    ladder = LADDERS[k]
    made = problem(ladder.problem)
    end = stored.end(made, ladder.t_end)
    if end is None:
        raise Unavailable(f"no certified state of {ladder.problem} at {ladder.t_end:g}")
    rows, work = [], {}
    for name, record in settings_of(ladder.option).items():
        run = prepare(made, record)
        for steps in numbers_of_steps(ladder):
            row = _rung(made, record, ladder.t_end, steps, end)
            rows.append({"knob": ladder.option, "scene": ladder.problem, "setting": name, "method": record.label} | row)
            if row["status"] == OK:
                work[len(rows) - 1] = _call(run, row["h"], steps)
    for number, seconds in time_in_turns(work, ROUNDS).items():
        rows[number] |= dict(zip(("us", "us, low", "us, high"), median(1e6 * seconds), strict=True))
    return {TABLE: rows}


def _call(run: PreparedRun, h: float, steps: int) -> Callable[[], object]:
    return lambda: run(h, steps)


def _rung(made: Problem, record: Method, t_end: float, steps: int, end: End) -> dict:
    """Run a method once on the problem ``made``: a row of status, errors, gradient evaluations and fallbacks.

    ``record`` describes the method; ``end`` is the certified end state.  Fallbacks are steps in which a method finds no
    parameter that keeps the energy.
    """
    h = t_end / steps
    run = integrate(made, record, h=h, steps=steps, save_every=max(1, steps // ROWS))
    with np.errstate(all="ignore"):
        H = made.system.observe(made.system.H, run.q, run.p)
        energy = float(np.abs(H - H[0]).max()) / scale(made)
        error = float(np.abs(np.concatenate([run.q[-1] - end.q, run.p[-1] - end.p])).max())
    row = {"h": h, "steps": steps, "status": run.status, "error": error if run.status == OK else None}
    row |= {"energy error": energy, "gradients": run.counts["gradient"], "fallbacks": run.counts["fallbacks"]}
    return row | {"uncertainty": float(end.uncertainty)}
