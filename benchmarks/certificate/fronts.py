"""Fronts of the trade, stored: the fewest evaluations with which an integrator of the trade meets an error on a scene.

`fronts.csv` is made from the rows of the trade (`made`), which has runs of those that came within a factor 2 of the
cheapest in time.  One whose work is not in its evaluations of the gradient (that solves a Kepler or a linear part, or
that tells none) is not counted.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from functools import cache
from math import isfinite, log
from pathlib import Path
from typing import Any, NamedTuple

from phasebench.benchmarks.problems.questions import BY_ID, Question
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID as METHODS

PATH = Path(__file__).with_name("fronts.csv")
#: The scenes, each told by its state at the end: nonlinear all, the last of an H that is not T(p) + V(q).
SCENES = ("kepler-orbit", "henon-heiles-chaotic", "pendulum-short", "double-pendulum-chaotic")
#: The errors at which a step is compared.
ERRORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
#: Traits that a method uses in place of gradients.
OTHER_WORK = ("Kepler part", "linear fast part")
#: No error above this is that of round-off.
ROUND_OFF = 1e-8


class Cheapest(NamedTuple):
    """Who meets an error with the fewest evaluations of the gradient, and how many."""

    integrator: str
    evaluations: float


def needed(runs: Iterable[tuple[float, float]], wanted: float) -> float | None:
    """The evaluations with which an error is met, between two runs as a power of the error; None where none meets it.

    Parameters
    ----------
    runs : (evaluations, error) of each; the run that decides is the first after the last that misses, so that an
        error that is small by chance is none.  Past the least error, small errors that miss are round-off.
    wanted : the error
    """
    runs = sorted((x, e) for x, e in runs if isfinite(e))
    if not runs or min(e for _, e in runs) > wanted:
        return None
    least = min(range(len(runs)), key=lambda k: runs[k][1])
    last = max((k for k, (_, e) in enumerate(runs) if e > wanted and (k < least or e > ROUND_OFF)), default=-1)
    if last == len(runs) - 1:
        return None
    more, fine = runs[last + 1]
    if last < 0:
        return more
    fewer, coarse = runs[last]
    share = log(coarse / wanted) / log(coarse / max(fine, 1e-300))
    return min(more, fewer * (more / fewer) ** share)


def made(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The lines of `fronts.csv` from the runs of the trade: scene, integrator, id, evaluations, status, error."""
    runs: dict[str, dict[str, list[tuple[float, float]]]] = {scene: {} for scene in SCENES}
    for row in rows:
        if row["scene"] in runs and _counts(row):
            there = runs[row["scene"]].setdefault(row["integrator"], [])
            there.append((float(row["evaluations"]), float(row["error"])))
    lines = []
    for scene, by in runs.items():
        for wanted in ERRORS:
            told = [(x, name) for name, part in by.items() if (x := needed(part, wanted)) is not None]
            if told:
                evaluations, name = min(told)
                lines.append({"scene": scene, "error": wanted, "integrator": name, "evaluations": round(evaluations)})
    return lines


def _counts(row) -> bool:
    method = METHODS.get(row["id"])
    gradients = method is None or not set(method.requires) & set(OTHER_WORK)
    return gradients and row.get("status") == OK and float(row["evaluations"]) > 0 and row["error"] not in ("", None)


@cache
def stored() -> dict[str, dict[float, Cheapest]]:
    """Scene -> error -> who meets it with the fewest evaluations; empty where nothing is stored."""
    found: dict[str, dict[float, Cheapest]] = {}
    if PATH.exists():
        with PATH.open(newline="", encoding="utf-8") as stream:
            for row in csv.DictReader(stream):
                best = Cheapest(row["integrator"], float(row["evaluations"]))
                found.setdefault(row["scene"], {})[float(row["error"])] = best
    return found


def keep(lines: list[dict[str, Any]]) -> None:
    """Store the lines, whole or not at all."""
    from phasebench.benchmarks.rows.tables import write_lines

    write_lines(PATH, lines)
    stored.cache_clear()


def question(scene: str) -> Question:
    """What a scene asks."""
    return BY_ID[scene]
