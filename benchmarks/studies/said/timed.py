"""Published speed-ups of REBOUND's integrators: WHFast512 beside WHFast, TRACE beside MERCURIUS and IAS15.

The integrators on one problem are timed in turns.  The problem of close encounters is that of REBOUND's example on
TRACE: the giant planets with `HEAVIER` times their masses, with the orbital elements of this suite's solar system.

Source: P. Javaheri, H. Rein, D. Tamayo, Open J. Astrophys. 6 (2023); T. Lu, D. M. Hernandez, H. Rein, Mon. Not. R.
Astron. Soc. 533 (2024) 3708.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.conservation import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import planetary, problem, solar_system
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, Unavailable
from phasebench.integrators.driver import OK

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.benchmarks.problems.planetary import PlanetarySystem

VECTORS, ENCOUNTERS = "printed_numbers_vectors", "printed_numbers_encounters"
PROBLEM = "solar-system"
#: Steps in days; (WHFast, WHFast512) pairs; steps of a timed run; rounds.
STEPS, TIMED, ROUNDS = (3.0, 6.0), 20_000, 11
PAIRS = {
    "without corrector": ("rebound-whfast-plain", "rebound-whfast512"),
    "corrector 17": ("rebound-whfast-corrector-17", "rebound-whfast512-corrector-17"),
}
IDS = tuple(id for pair in PAIRS.values() for id in pair)
#: Heavier giants: the factor of their masses, the step as a share of Jupiter's period, the years, the integrators.
HEAVIER, SHARE, YEARS = 50.0, 0.002, 600.0
GIANTS = ("jupiter", "saturn", "uranus", "neptune")
TRACE, RIVALS = "rebound-trace", ("rebound-mercurius", "rebound-ias15")


def heavier() -> PlanetarySystem:
    """The Sun and the giant planets with `HEAVIER` times their masses, on the orbits of the solar system."""
    table = solar_system.table()
    members = tuple(replace(b, mass=b.mass * HEAVIER) for b in table.members if b.name in GIANTS)
    return planetary.of_bodies(replace(table, members=(table.members[0], *members)), "heavier giants")


def _able(made: Problem, ids: Iterable[str]) -> dict:
    """Id -> integrator; raises Unavailable, with the reason, if one cannot run the problem on this machine."""
    found = {id: integrator(id) for id in ids}
    for id, chosen in found.items():
        lack = chosen.lacks(made) if chosen.installed else "its package is not installed"
        if lack:
            raise Unavailable(f"{id}: {lack}")
    return found


def vectors(h: float) -> list[dict]:
    """WHFast's time of a step of h days over WHFast512's (``gain``), a row for each of `PAIRS`."""
    made = problem(PROBLEM)
    found = _able(made, IDS)
    clocks = {id: clock.clock(c, made, t_end=h * TIMED, steps=TIMED) for id, c in found.items()}
    times = in_turns(clocks, ROUNDS)
    rows = []
    for name, (one, eight) in PAIRS.items():
        gain = ratio(times[one], times[eight])
        row = {"corrector": name, "h": h, "gain": gain.value, "low": gain.low, "high": gain.high}
        rows.append(row | {"ns a step": median(times[eight]).value / TIMED * 1e9})
    return rows


def encounters() -> list[dict]:
    """An integrator's time over TRACE's on close encounters of heavy giants, and its energy error."""
    made = heavier()
    found, span = _able(made, (TRACE, *RIVALS)), YEARS * 365.25
    h = SHARE * 365.25 * float(solar_system.PLANETS["jupiter"][1]) ** 1.5
    steps = 100 * round(span / h / 100)
    runs, clocks = {}, {}
    for id, c in found.items():
        runs[id] = c.run(made, h=h, steps=steps, save_every=steps // 100)
        if runs[id].status != OK and id != "rebound-mercurius":
            raise RuntimeError(f"{id}: {runs[id].reason}")
        clocks[id] = clock.clock(c, made, t_end=h * steps, steps=1 if c.adaptive else steps)
    times = in_turns(clocks, ROUNDS)
    rows = []
    for id, s in runs.items():
        more = ratio(times[id], times[TRACE])
        row = {"integrator": id, "h": h, "times TRACE": more.value, "low": more.low, "high": more.high}
        row |= {"seconds": median(times[id]).value, "status": s.status}
        rows.append(row | {"energy error": energy_error(made, s.q, s.p)})
    return rows


def least(rows: pd.DataFrame) -> str:
    """Where the gain is smallest."""
    row = rows.loc[rows["gain"].idxmin()]
    return f"least {number(row['gain'])} ({row['corrector']}, h = {number(row['h'])})"


def accuracies(rows: pd.DataFrame, every: pd.DataFrame) -> str:
    """The energy error of a rival beside TRACE's."""
    ours = every.set_index("integrator")["energy error"].get(TRACE)
    return f"energy error {number(rows['energy error'].iloc[0])}, TRACE's {number(ours)}"


def _needs(*ids: str) -> tuple:
    return (*(integrator(id).record for id in ids), ProblemKey(PROBLEM))


RUNS = (
    Runs(VECTORS, vectors, over(h=STEPS), lambda h: _needs(*IDS), ALONE, own=True),
    Runs(ENCOUNTERS, encounters, over(), lambda: _needs(TRACE, *RIVALS), ALONE, own=True),
)
