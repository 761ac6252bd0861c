r"""Eight planets: error against evaluations of splittings, and energy errors beside errors of the perihelia's rates.

- **Splittings**: the largest relative energy error over a century, and the distance from the certified state after a
  decade, against the evaluations of the planets' forces on each other.  Those of a corrector, which is applied only
  where a state is stored, are not counted.
- **Perihelia**: the longitude of a perihelion is the direction of :math:`e = v\times L/\mu - r/|r|` about the Sun in
  the ecliptic, and its rate the slope of a line fitted over time.  The error of a rate is the slope of the difference
  from a reference, a run of ABA(10,6,4) with half the step; the reference's uncertainty is the slope of the difference
  between its runs with half and with the whole step.

Source: A. Farres et al., Celest. Mech. Dyn. Astron. 116 (2013) 141; H. Rein, G. Brown, D. Tamayo, Mon. Not. R. Astron.
Soc. 490 (2019) 5122.
"""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content, states
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.reference.certificates import stored

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.benchmarks.problems.planetary import PlanetarySystem
    from phasebench.integrators.solution import Solution

EVALUATIONS, PERIHELIA = "printed_numbers_evaluations", "printed_numbers_perihelia"
PROBLEM, YEAR = "solar-system", 365.25
#: Splittings and their evaluations a step (of REBOUND's: Blanes et al. 2013, table 3).
BEST = "wisdom-holman-aba-10-6-4"
STAGES = {
    "wisdom-holman": 1,
    "wisdom-holman-corrector": 1,
    "wisdom-holman-saba-2": 2,
    "wisdom-holman-saba-4": 4,
    "wisdom-holman-aba-8-6-4": 7,
    BEST: 8,
    "rebound-saba-10-4": 7,
    "rebound-saba-h-8-4-4": 6,
    "rebound-saba-h-8-6-4": 8,
    "rebound-saba-h-10-6-4": 9,
}
#: Days of the runs; stored rows; that of the last certified state; numbers of evaluations.
CENTURY, ROWS, DECADE = 36525.0, 100, 10
LADDER = tuple(round(2400 * 2 ** (k / 2)) for k in range(11))
#: Step in days, length in years and rows of the runs whose perihelia are compared.
STEP, YEARS, LINES = YEAR / 60, 30_000, 3000
PLAIN, CORRECTED = "rebound-whfast-plain", "rebound-whfast-corrector-17"
SECULAR = (
    PLAIN,
    *(f"rebound-whfast-corrector-{n}" for n in (3, 5, 7, 11)),
    CORRECTED,
    "rebound-whfast-modifiedkick",
    "rebound-saba-4",
    *(f"rebound-saba-cm-{n}" for n in (1, 2, 4)),
    "wisdom-holman",
    "wisdom-holman-corrector",
)
ARCSECONDS = 3600.0


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`): one for each splitting, and one for all perihelia; none if ``quick``."""
    if quick:
        return []
    one = [_cell(EVALUATIONS, {"method": id}, evaluations, (id,), (id,), LADDER, STAGES[id]) for id in STAGES]
    return [*one, _cell(PERIHELIA, {}, perihelia, (), (BEST, *SECULAR), STEP, YEARS)]


def _cell(table: str, key: dict, measure: Callable[..., Rows], arguments: tuple, ids: tuple, *parts: object) -> Cell:
    records = [integrator(id).record for id in ids]
    made = ProblemKey(PROBLEM)
    needs = content(table, *records, made, states(made.id), *parts, code=[__name__])
    names = frozenset({PROBLEM, *ids, *(id.partition("-")[0] for id in ids if id.startswith("rebound"))})
    return Cell("printed_numbers", (table,), key, measure, arguments, needs, names)


def _run(made: Problem, id: str, h: float, steps: int, rows: int) -> Solution:
    """Integrate the problem ``made`` by the integrator ``id``, with ``rows`` equally spaced rows of output.

    Raises Unavailable without the integrator's package, RuntimeError if the run fails.
    """
    s = integrator(id).run(made, h=h, steps=steps, save_every=steps // rows)
    if s.status == SKIPPED:
        raise Unavailable(s.reason)
    if s.status != OK:
        raise RuntimeError(f"{id}: {s.reason}")
    return s


def evaluations(id: str) -> Rows:
    """Measure the errors of the splitting ``id`` on eight planets: a row for each step size, by table name.

    A row has the evaluations and the energy error of a century, and the position error after a decade (AU).
    """
    made, rows = problem(PROBLEM), []
    end = stored.end(made, CENTURY * DECADE / ROWS)
    if end is None:
        raise RuntimeError(f"no certified state of {PROBLEM} is stored; phasebench certify {PROBLEM} --update")
    for wanted in LADDER:
        steps = ROWS * max(1, round(wanted / STAGES[id] / ROWS))
        s = _run(made, id, CENTURY / steps, steps, ROWS)
        row = {"method": id, "h": CENTURY / steps, "evaluations": steps * STAGES[id]}
        row |= {
            "energy error": energy_error(made, s.q, s.p),
            "position error": float(np.abs(s.q[DECADE] - end.q).max()),
        }
        rows.append(row | {"uncertainty": end.uncertainty})
    return {EVALUATIONS: rows}


def longitudes(made: PlanetarySystem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Compute the longitudes of all perihelia, array (planets, n), from states q, p, arrays (n, d).

    They are in radians, and continuous in time.
    """
    masses, G = np.array(made.bodies.masses), made.bodies.units.G
    x = q.reshape(len(q), -1, 3)
    v = p.reshape(len(p), -1, 3) / masses[:, None]
    r, u = x[:, 1:] - x[:, :1], v[:, 1:] - v[:, :1]
    mu = G * (masses[0] + masses[1:])[:, None]
    e = np.cross(u, np.cross(r, u)) / mu - r / np.linalg.norm(r, axis=2, keepdims=True)
    return np.unwrap(np.arctan2(e[..., 1], e[..., 0]), axis=0).T


def rate(t: np.ndarray, values: np.ndarray) -> float:
    """Fit a line to angles in radians at times t in days, and return its slope in seconds of arc a year."""
    return float(np.polyfit((t - t.mean()) / YEAR, values - values[0], 1)[0]) * degrees(1.0) * ARCSECONDS


def perihelia() -> Rows:
    """Measure the errors of the rates of all perihelia: a row for each integrator and planet, by table name.

    A row has the relative energy error, the rate, its error and its uncertainty, in seconds of arc a year.
    """
    made = problem(PROBLEM)
    steps = LINES * round(YEARS * YEAR / STEP / LINES)
    true, coarse = (_run(made, BEST, STEP / k, steps * k, LINES) for k in (2, 1))
    exact = longitudes(made, true.q, true.p)
    doubt = longitudes(made, coarse.q, coarse.p) - exact
    rows = []
    for id in SECULAR:
        s = _run(made, id, STEP, steps, LINES)
        off, energy = longitudes(made, s.q, s.p) - exact, energy_error(made, s.q, s.p)
        for k, name in enumerate(made.bodies.names[1:]):
            row = {"method": id, "planet": name, "h": STEP, "years": YEARS, "energy error": energy}
            row |= {"rate": rate(true.t, exact[k]), "rate error": rate(true.t, off[k])}
            rows.append(row | {"uncertainty": abs(rate(true.t, doubt[k]))})
    return {PERIHELIA: rows}
