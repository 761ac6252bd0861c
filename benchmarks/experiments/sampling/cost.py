"""The time of an accepted proposal of Hamiltonian Monte Carlo: a run's time divided by its expected acceptance.

The targets, draws and lengths of runs are those of `acceptance`; all methods integrate them as one ensemble on one
thread, in turns.  Few evaluations make a run cheap and its acceptance small: the least time over the numbers of
evaluations tells the best that a method can do.
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
#: Rounds of the timing.
ROUNDS = 9


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each target, in which all methods are timed in turns; none in the quick tier."""
    return [] if quick else [_cell(target) for target in TARGETS]


def _cell(target: str) -> Cell:
    methods = [BY_ID[id] for id in EVALUATIONS]
    needs = content("sampling times", target, *methods, code=[__name__, acceptance.__name__])
    about = frozenset(EVALUATIONS)
    return Cell("sampling", (TABLE,), {"target": target}, measure_rows, (target,), needs, about, ALONE, own=True)


def measure_rows(target: str) -> Rows:
    """The acceptance and the time of a proposal on a target: a row for each method and number of evaluations."""
    of, (q, p) = acceptance.system(target), acceptance.draws(target)
    runs = {
        (id, budget): partial(acceptance.propose, of, q, p, id, budget)
        for id in EVALUATIONS
        for budget in acceptance.budgets(target, id)
    }
    rows = []
    for (id, budget), seconds in time_in_turns(runs, ROUNDS).items():
        accepted = acceptance.acceptance(target, id, budget)["acceptance"]
        cost = median(seconds / DRAWS * 1e9)
        row = {"target": target, "method": id, "budget": budget, "acceptance": accepted}
        row |= {"ns a proposal": cost.value, "ns, low": cost.low, "ns, high": cost.high}
        rows.append(row | {"ns an accepted proposal": cost.value / accepted if accepted else inf})
    return {TABLE: rows}
