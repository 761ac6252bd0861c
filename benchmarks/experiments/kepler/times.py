"""The time of an orbit for every integrator and setting of the comparison, measured in alternating rounds."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, nan

from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content

from . import comparison
from .comparison import ECCENTRICITIES, LADDER, PROBLEMS
from .runs import Setting, orbit_clock

#: The least steps of a timed run, orbits of an adaptive one, rounds.
STEPS, ORBITS, ROUNDS = 1_500, 10, 9
TABLE = "kepler_times"


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each orbit; none if ``quick``."""
    return [] if quick else [_cell(name, e) for name in PROBLEMS for e in ECCENTRICITIES]


def _cell(name: str, e: float) -> Cell:
    records = [c.record for c in comparison.contenders()]
    known = (comparison.MU, comparison.AT, LADDER, tuple(comparison.TOLERANCES.items()))
    return Cell(
        "kepler",
        (TABLE,),
        {"problem": name, "e": e},
        measure_rows,
        (name, e),
        content("times", ProblemKey(name, (("e", e),)), *records, *known, code=[__name__]),
        frozenset({name, *(r.id for r in records), *(getattr(r, "package", "") for r in records)}),
        ALONE,
        own=True,
    )


def _settings(c: Integrator) -> list[Setting]:
    return comparison.tolerances(c) if c.adaptive else [comparison.steps(n) for n in LADDER]


def measure_rows(name: str, e: float) -> Rows:
    """Time the Kepler orbit of eccentricity e with every integrator and setting: a row for each, by table name.

    A row has the median in microseconds an orbit and its interval; NaN for an integrator that fails.
    """
    made, exact, _ = comparison.orbit(name, e)

    def work(c: Integrator, setting: Setting) -> Callable[[], float]:
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
