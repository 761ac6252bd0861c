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

from collections.abc import Sequence
from math import degrees
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.conservation import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey, states
from phasebench.reference.certificates import stored

from .runs import finished

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.planetary import PlanetarySystem
    from phasebench.integrators.solution import Solution

EVALUATIONS, PERIHELIA = "printed_numbers_evaluations", "printed_numbers_perihelia"
PROBLEM, YEAR, ENERGY = "solar-system", 365.25, "energy error"
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


def evaluations(method: str) -> list[dict]:
    """Evaluations and energy error of a century, and position error after a decade (AU), a row for each step."""
    made, rows = problem(PROBLEM), []
    end = stored.end(made, CENTURY * DECADE / ROWS)
    if end is None:
        raise RuntimeError(f"no certified state of {PROBLEM} is stored; phasebench certify {PROBLEM} --update")
    for wanted in LADDER:
        steps = ROWS * max(1, round(wanted / STAGES[method] / ROWS))
        s = finished(made, method, h=CENTURY / steps, steps=steps, save_every=steps // ROWS)
        row = {"h": CENTURY / steps, "evaluations": steps * STAGES[method], ENERGY: energy_error(made, s.q, s.p)}
        rows.append(row | {"position error": float(np.abs(s.q[DECADE] - end.q).max()), "uncertainty": end.uncertainty})
    return rows


def longitudes(made: PlanetarySystem, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Longitudes of all perihelia, (planets, n), in radians and continuous in time, of states q, p (n, d)."""
    masses, G = np.array(made.bodies.masses), made.bodies.units.G
    x = q.reshape(len(q), -1, 3)
    v = p.reshape(len(p), -1, 3) / masses[:, None]
    r, u = x[:, 1:] - x[:, :1], v[:, 1:] - v[:, :1]
    mu = G * (masses[0] + masses[1:])[:, None]
    e = np.cross(u, np.cross(r, u)) / mu - r / np.linalg.norm(r, axis=2, keepdims=True)
    return np.unwrap(np.arctan2(e[..., 1], e[..., 0]), axis=0).T


def rate(t: np.ndarray, values: np.ndarray) -> float:
    """The slope, in seconds of arc a year, of a line fitted to angles in radians at times in days."""
    return float(np.polyfit((t - t.mean()) / YEAR, values - values[0], 1)[0]) * degrees(1.0) * ARCSECONDS


def perihelia() -> list[dict]:
    """The energy error, and rates of all perihelia with error and uncertainty, in seconds of arc a year."""
    made, steps = problem(PROBLEM), LINES * round(YEARS * YEAR / STEP / LINES)

    def run(id: str, finer: int = 1) -> Solution:
        return finished(made, id, h=STEP / finer, steps=steps * finer, save_every=steps * finer // LINES)

    true, coarse = run(BEST, 2), run(BEST)
    exact = longitudes(made, true.q, true.p)
    doubt = longitudes(made, coarse.q, coarse.p) - exact
    rows = []
    for id in SECULAR:
        s = run(id)
        off, energy = longitudes(made, s.q, s.p) - exact, energy_error(made, s.q, s.p)
        for k, name in enumerate(made.bodies.names[1:]):
            row = {"method": id, "planet": name, "h": STEP, "years": YEARS, ENERGY: energy}
            row |= {"rate": rate(true.t, exact[k]), "rate error": rate(true.t, off[k])}
            rows.append(row | {"uncertainty": abs(rate(true.t, doubt[k]))})
    return rows


def lead(rows: pd.DataFrame, column: str, errors: list[float], label: str) -> pd.Series:
    """The fewest evaluations of another method over those of ABA(10,6,4), for each error that one of them reaches.

    ``label`` is a format of {error} and {next}, the other method.
    """
    found = {}
    for error in errors:
        fewest = rows[rows[column] <= error].groupby("method", sort=False)["evaluations"].min().astype(float)
        others = fewest.drop(BEST, errors="ignore")
        if len(fewest):
            named = label.format(error=error, next="no other" if others.empty else others.idxmin())
            found[named] = others.min() / fewest.get(BEST, np.inf) if len(others) else np.inf
    return pd.Series(found, dtype=float)


def gain(rows: pd.DataFrame, column: str, one: str, other: str) -> pd.Series:
    """|A value of the method ``one``| over that of the other, by the rows of the first."""
    first, second = rows[rows["method"] == one], rows[rows["method"] == other].groupby("planet")[column].first()
    return (first[column] / first["planet"].map(second)).abs().dropna()


def _needs(ids: Sequence[str]) -> tuple:
    return (*(integrator(id).record for id in ids), ProblemKey(PROBLEM), states(PROBLEM))


RUNS = (
    Runs(EVALUATIONS, evaluations, over(method=tuple(STAGES)), needs=lambda method: _needs([method])),
    Runs(PERIHELIA, perihelia, over(), needs=lambda: _needs([BEST, *SECULAR])),
)
