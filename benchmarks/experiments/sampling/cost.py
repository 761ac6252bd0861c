"""The time of an accepted proposal of Hamiltonian Monte Carlo: a run's time divided by its expected acceptance.

The targets and draws are those of the module `acceptance`.  A proposal's run is so short that the call's checks take
longer than its steps, and at a large step orbits may escape, which makes them slow.  The time of a step is therefore
measured in a run of `STEPS` small steps, of all draws as one ensemble on one thread, the methods in turns.  Few
evaluations make a run cheap and its acceptance small: a method's best is the least time over the numbers of
evaluations.
"""

from __future__ import annotations

from functools import partial
from math import inf

from phasebench.benchmarks.measure.timing import median, time_in_turns
from phasebench.benchmarks.store.cells import ALONE, Cell, Rows, content
from phasebench.integrators.registry import BY_ID

from . import acceptance
from .acceptance import DRAWS, EVALUATIONS, TARGETS

TABLE = "sampling_times"
#: Steps of a timed run; rounds of the timing.
STEPS, ROUNDS = 2000, 9


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each target, which times all methods in turns; none if ``quick``."""
    return [] if quick else [_cell(target) for target in TARGETS]


def _cell(target: str) -> Cell:
    methods = [BY_ID[id] for id in EVALUATIONS]
    needs = content("sampling times", target, *methods, code=[__name__, acceptance.__name__])
    about = frozenset(EVALUATIONS)
    return Cell("sampling", (TABLE,), {"target": target}, measure_rows, (target,), needs, about, ALONE, own=True)


def measure_rows(target: str) -> Rows:
    """Measure acceptance and time of the proposals on a target of Hamiltonian Monte Carlo: rows, by table name.

    There is a row for each method and number of gradient evaluations, with the nanoseconds of a proposal (and their
    interval) and of an accepted one.
    """
    of, (q, p) = acceptance.system(target), acceptance.draws(target)
    runs = {id: partial(acceptance.propose, of, q, p, id, STEPS * each) for id, each in EVALUATIONS.items()}
    rows = []
    for id, seconds in time_in_turns(runs, ROUNDS).items():
        step = median(seconds / DRAWS / STEPS * 1e9)
        for budget in acceptance.budgets(target, id):
            steps, accepted = budget // EVALUATIONS[id], acceptance.acceptance(target, id, budget)["acceptance"]
            row = {"target": target, "method": id, "budget": budget, "acceptance": accepted}
            row |= {"ns a proposal": steps * step.value, "ns, low": steps * step.low, "ns, high": steps * step.high}
            rows.append(row | {"ns an accepted proposal": steps * step.value / accepted if accepted else inf})
    return {TABLE: rows}
