"""Which integrators to try first: how many times slower than the fastest each was in stored measurements.

`prior.csv` has, for each problem and power of ten of the error, a factor for each integrator: the time of its cheapest
run that met the error, over that of the cheapest integrator.  `build` computes it from the stored comparison of all
integrators (`studies.trade`).  It only orders the search: an integrator is advised after it was run.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import exp, floor, log, log10
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from phasebench.benchmarks.store.shipped import ShippedTable

if TYPE_CHECKING:
    import pandas as pd

#: Decades of the error: the exponents of ten.
DECADES = tuple(range(-13, 0))
#: The largest factor stored, also of an integrator that missed the error; the factor if no problem has rows.
LARGEST, UNKNOWN = 30.0, 6.0
#: The factor of an integrator that took no part in the measurements: low, so that it is tried early.
NEW = 1.5
#: In place of a problem's id: the line only says that the integrator took part in the measurements.
ANY = "any"


class Prior(NamedTuple):
    """How much slower than the cheapest each integrator was, by problem, exponent of ten of the error, and integrator.

    ``competitors`` are the ids of the integrators that were measured.
    """

    factors: dict[str, dict[int, dict[str, float]]]
    competitors: frozenset[str]


def decade(accuracy: float) -> int:
    """Exponent of the largest power of ten up to the accuracy, clipped to `DECADES`."""
    return min(max(floor(log10(accuracy) + 1e-9), DECADES[0]), DECADES[-1])


def factors(problem_id: str, accuracy: float, ids: Iterable[str]) -> dict[str, float]:
    """Integrator -> expected time over that of the cheapest: as stored, or the geometric mean over all problems."""
    at, ids, (all_, competitors) = decade(accuracy), list(ids), TABLE.load()
    if problem_id in all_ and at in all_[problem_id]:
        here = all_[problem_id][at]
        return {id: here.get(id, LARGEST if id in competitors else NEW) for id in ids}
    tables = [t[at] for t in all_.values() if at in t]
    known = {id: _mean([t[id] for t in tables if id in t], len(tables)) for id in ids}
    return {id: known[id] if id in competitors or not tables else NEW for id in ids}


def _mean(values: list[float], tables: int) -> float:
    """The geometric mean of stored factors; without one, `LARGEST`, as it met the error on none of the ``tables``."""
    if not values:
        return UNKNOWN if not tables else LARGEST
    return exp(sum(map(log, values)) / len(values))


def build(rows: pd.DataFrame, competitors: Iterable[str] = ()) -> list[dict[str, object]]:
    """Compute the lines of `prior.csv` from the successful runs, a DataFrame (scene, problem, id, error, seconds).

    A problem with several scenes gets their geometric mean; an integrator that misses the error in a scene counts as
    `LARGEST` there.  ``competitors`` are all integrators that took part: each gets a line with the problem `ANY`.
    """
    lines = [{"problem": ANY, "decade": 0, "integrator": id, "factor": LARGEST} for id in sorted(competitors)]
    for problem, members in rows.groupby("problem", sort=True):
        for at in DECADES:
            shares = [s for _, scene in members.groupby("scene") if (s := _shares(scene, 10.0**at))]
            for id in sorted({id for s in shares for id in s}):
                factor = _mean([min(s.get(id, LARGEST), LARGEST) for s in shares], len(shares))
                if factor < LARGEST:
                    lines.append({"problem": problem, "decade": at, "integrator": id, "factor": round(factor, 2)})
    return lines


def _shares(rows: pd.DataFrame, error: float) -> dict[str, float]:
    """Integrator -> time of its cheapest run that meets the error, over that of the cheapest integrator."""
    cheapest = rows[rows["error"] <= error].groupby("id")["seconds"].min()
    return {} if cheapest.empty else (cheapest / cheapest.min()).to_dict()


def parse(lines: list[dict[str, str]]) -> Prior:
    """Read the lines of `prior.csv`; return how many times slower than the fastest each integrator was (`Prior`)."""
    found: dict[str, dict[int, dict[str, float]]] = {}
    for row in lines:
        if row["problem"] != ANY:
            there = found.setdefault(row["problem"], {}).setdefault(int(row["decade"]), {})
            there[row["integrator"]] = float(row["factor"])
    return Prior(found, frozenset(row["integrator"] for row in lines))


TABLE = ShippedTable(Path(__file__).with_name("prior.csv"), build, parse)


def is_stored(problem_id: str) -> bool:
    """True if measurements of the problem are stored."""
    return problem_id in TABLE.load().factors
