"""The time of an accepted proposal of Hamiltonian Monte Carlo: a run's time divided by its expected acceptance.

The targets and draws are those of `acceptance`.  A run is so short that the checks of the call outlast it, and a large
step may send orbits away, which are then slow: so the time of a step is that of a run of `STEPS` small ones, of all
draws as one ensemble on one thread, the methods in turns.  Few evaluations make a run cheap and its acceptance small:
the least time over the numbers of evaluations tells the best that a method can do.
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
