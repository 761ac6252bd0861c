"""Published speed-ups of REBOUND's integrators: WHFast512 beside WHFast, TRACE beside MERCURIUS and IAS15.

The integrators on one problem are timed in turns.  The problem of close encounters is that of REBOUND's example on
TRACE: the giant planets with `HEAVIER` times their masses, with the orbital elements of this suite's solar system.

Source: P. Javaheri, H. Rein, D. Tamayo, Open J. Astrophys. 6 (2023); T. Lu, D. M. Hernandez, H. Rein, Mon. Not. R.
Astron. Soc. 533 (2024) 3708.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import in_turns, median, ratio
from phasebench.benchmarks.problems import planetary, problem, solar_system
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content
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
#: Heavier giants: the factor of their masses, the step as a share of Jupiter's period, the years, the integrators.
HEAVIER, SHARE, YEARS = 50.0, 0.002, 600.0
GIANTS = ("jupiter", "saturn", "uranus", "neptune")
TRACE, RIVALS = "rebound-trace", ("rebound-mercurius", "rebound-ias15")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each step size of WHFast, one of close encounters; none if ``quick``."""
    if quick:
        return []
    vectors = [
        _cell(VECTORS, {"h": h}, vector_rows, (h,), [id for pair in PAIRS.values() for id in pair]) for h in STEPS
    ]
    return [*vectors, _cell(ENCOUNTERS, {}, encounter_rows, (), [TRACE, *RIVALS])]


def _cell(table: str, key: dict, measure: Callable[..., Rows], arguments: tuple, ids: Sequence[str]) -> Cell:
    records = [integrator(id).record for id in ids]
    needs = content(table, *records, ProblemKey(PROBLEM), TIMED, HEAVIER, SHARE, YEARS, *arguments, code=[__name__])
    names = frozenset({PROBLEM, "rebound", *ids})
    return Cell("printed_numbers", (table,), key, measure, arguments, needs, names, ALONE, own=True)


def heavier() -> PlanetarySystem:
    """Build the problem of the Sun and the giant planets with `HEAVIER` times their masses.

    Their orbital elements are those of the solar system.
    """
    table = solar_system.table()
    members = tuple(replace(b, mass=b.mass * HEAVIER) for b in table.members if b.name in GIANTS)
    return planetary.of_bodies(replace(table, members=(table.members[0], *members)), "heavier giants")


def _able(made: Problem, ids: Iterable[str]) -> dict:
    """Return the integrators with these ids, id -> integrator.

    Raises Unavailable, with the reason, if one of them cannot run the problem ``made`` on this machine.
    """
    found = {id: integrator(id) for id in ids}
    for chosen in found.values():
        if not chosen.installed:
            raise Unavailable(f"{chosen.id}: its package is not installed")
        lack = chosen.lacks(made)
        if lack:
            raise Unavailable(f"{chosen.id}: {lack}")
    return found


def vector_rows(h: float) -> Rows:
    """Time WHFast and WHFast512 at a step of h days: a row for each pair, with and without corrector, by table name.

    ``gain`` is the time of a step by WHFast over that by WHFast512, with the ends of its interval, ``low`` and
    ``high``.
    """
    made = problem(PROBLEM)
    found = _able(made, [id for pair in PAIRS.values() for id in pair])
    clocks = {id: clock.clock(c, made, t_end=h * TIMED, steps=TIMED) for id, c in found.items()}
    times = in_turns(clocks, ROUNDS)
    rows = []
    for name, (one, eight) in PAIRS.items():
        gain = ratio(times[one], times[eight])
        row = {"corrector": name, "h": h, "gain": gain.value, "low": gain.low, "high": gain.high}
        rows.append(row | {"ns a step": median(times[eight]).value / TIMED * 1e9})
    return {VECTORS: rows}


def encounter_rows() -> Rows:
    """Time TRACE, MERCURIUS and IAS15 on close encounters of heavy giants: a row for each, by table name.

    A row has the integrator's time over TRACE's, with its interval, and its energy error.
    """
    made, ids = heavier(), (TRACE, *RIVALS)
    found, span = _able(made, ids), YEARS * 365.25
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
    for id in ids:
        more = ratio(times[id], times[TRACE])
        row = {"integrator": id, "h": h, "times TRACE": more.value, "low": more.low, "high": more.high}
        row |= {"seconds": median(times[id]).value, "status": runs[id].status}
        rows.append(row | {"energy error": energy_error(made, runs[id].q, runs[id].p)})
    return {ENCOUNTERS: rows}
