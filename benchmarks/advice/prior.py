"""Whom to try first: how much dearer than the cheapest each integrator was, on scenes that were measured before.

`prior.csv` has, for each problem and power of ten of the error, the integrators with the factor by which the cheapest
run of each that met it was dearer than the cheapest of all.  It is made from the rows of the trade (`made`) and orders
the search; what is advised is run, whatever the prior says.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from functools import cache
from math import exp, floor, log, log10
from pathlib import Path

PATH = Path(__file__).with_name("prior.csv")
#: Powers of ten of errors that are told apart.
DECADES = tuple(range(-13, 0))
#: Factors above it are not kept; it is taken for one who did not get there, and for whom there is no row.
LARGEST, UNKNOWN = 30.0, 6.0


@cache
def stored() -> dict[str, dict[int, dict[str, float]]]:
    """Problem -> power of ten -> integrator -> factor; empty where nothing is stored."""
    found: dict[str, dict[int, dict[str, float]]] = {}
    if PATH.exists():
        with PATH.open(newline="", encoding="utf-8") as stream:
            for row in csv.DictReader(stream):
                there = found.setdefault(row["problem"], {}).setdefault(int(row["decade"]), {})
                there[row["integrator"]] = float(row["factor"])
    return found


def decade(accuracy: float) -> int:
    """The power of ten of errors that meet an accuracy."""
    return min(max(floor(log10(accuracy) + 1e-9), DECADES[0]), DECADES[-1])


def factors(problem_id: str, accuracy: float, ids: Iterable[str]) -> dict[str, float]:
    """Integrator -> how many times dearer than the cheapest it is to be expected, on this problem or on any."""
    at, all_, ids = decade(accuracy), stored(), list(ids)
    if problem_id in all_ and at in all_[problem_id]:
        here = all_[problem_id][at]
        return {id: here.get(id, LARGEST) for id in ids}
    tables = [t[at] for t in all_.values() if at in t]
    return {id: _mean([t[id] for t in tables if id in t], len(tables)) for id in ids}


def _mean(values: list[float], tables: int) -> float:
    """The geometric mean over the problems on which it ran; of one that nobody ran that of the unknown."""
    if not values:
        return UNKNOWN if not tables else LARGEST
    return exp(sum(map(log, values)) / len(values))


def made(rows) -> list[dict[str, object]]:
    """The lines of `prior.csv` from rows (scene, problem, id, error, seconds) of runs that ended well.

    Of a problem with several scenes the geometric mean; who did not get there in one counts as `LARGEST` in it.
    """
    lines = []
    for problem, members in rows.groupby("problem", sort=True):
        for at in DECADES:
            shares = [s for _, scene in members.groupby("scene") if (s := _shares(scene, 10.0**at))]
            for id in sorted({id for s in shares for id in s}):
                factor = _mean([min(s.get(id, LARGEST), LARGEST) for s in shares], len(shares))
                if factor < LARGEST:
                    lines.append({"problem": problem, "decade": at, "integrator": id, "factor": round(factor, 2)})
    return lines


def _shares(rows, error: float) -> dict[str, float]:
    """Integrator -> the seconds of its cheapest run that meets an error over those of the cheapest of all."""
    cheapest = rows[rows["error"] <= error].groupby("id")["seconds"].min()
    return {} if cheapest.empty else (cheapest / cheapest.min()).to_dict()


def keep(lines: list[dict[str, object]]) -> None:
    """Store the lines, whole or not at all."""
    from phasebench.benchmarks.rows.tables import write_lines

    write_lines(PATH, lines)
    stored.cache_clear()


def is_stored(problem_id: str) -> bool:
    """Whether rows of a problem are stored."""
    return problem_id in stored()


__all__ = ["DECADES", "LARGEST", "UNKNOWN", "decade", "factors", "is_stored", "keep", "made"]
