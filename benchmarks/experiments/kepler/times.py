"""What an orbit costs each of the compared: all settings of all of them on an orbit in one cell, in turns."""

from __future__ import annotations

from math import ceil, nan

from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, content

from . import comparison
from .comparison import ECCENTRICITIES, LADDER, PROBLEMS
from .runs import Setting, orbit_clock

#: Steps of a timed run, at least; orbits of an adaptive one; rounds.
STEPS, ORBITS, ROUNDS = 1_500, 10, 9
TABLE = "kepler_times"


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each orbit; none of the quick tier."""
    return [] if quick else [_cell(name, e) for name in PROBLEMS for e in ECCENTRICITIES]


def _cell(name: str, e: float) -> Cell:
    records = [c.record for c in comparison.contenders()]
    known = (comparison.MU, comparison.AT, LADDER, tuple(comparison.TOLERANCES.items()))
    return Cell(
        "kepler",
        (TABLE,),
        {"problem": name, "e": e},
        measured,
        (name, e),
        content("times", Problem(name, (("e", e),)), *records, *known, code=[__name__]),
        frozenset({name, *(r.id for r in records), *(getattr(r, "package", "") for r in records)}),
        ALONE,
        own=True,
    )


def _settings(c: Integrator) -> list[Setting]:
    return comparison.tolerances(c) if c.adaptive else [comparison.steps(n) for n in LADDER]


def measured(name: str, e: float) -> Rows:
    """The microseconds of an orbit, of every setting; those that do not get through have none."""
    made, exact, _ = comparison.orbit(name, e)

    def work(c: Integrator, setting: Setting):
        orbits = ORBITS if c.adaptive else ceil(STEPS / setting.per_orbit)
        timed = orbit_clock(c, made, exact.period, setting, orbits)
        return lambda: timed() / orbits if timed is not None else nan

    todo = {(c.label, s.name): work(c, s) for c in comparison.contenders() for s in _settings(c)}
    rows = []
    for (label, setting), seconds in in_turns(todo, ROUNDS).items():
        row = {"problem": name, "e": e, "method": label, "setting": setting}
        found = median(1e6 * seconds)
        rows.append(row | {"us per orbit": found.value, "us, low": found.low, "us, high": found.high})
    return {TABLE: rows}
