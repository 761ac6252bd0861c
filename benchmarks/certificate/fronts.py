"""The fewest gradient evaluations with which a known integrator meets an error on a scene, stored in `fronts.csv`.

A scene is a problem with a span and a quantity whose error counts.  `build` computes the lines from the stored
comparison of all integrators (`studies.trade`), which keeps the runs of integrators that take at most twice the
cheapest time.  Integrators whose work is not gradient evaluations (they solve a Kepler or a linear part exactly, or
report no count) are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from phasebench.benchmarks.ladder.bracket import evaluations_for
from phasebench.benchmarks.store.shipped import ShippedTable
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID as METHODS

#: The scenes, each judged by its end state: all nonlinear, the last with an H that is not T(p) + V(q).
SCENES = ("kepler-orbit", "henon-heiles-chaotic", "pendulum-short", "double-pendulum-chaotic")
#: The errors at which a step is compared.
ERRORS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10)
#: Traits that a method uses in place of gradients.
OTHER_WORK = ("Kepler part", "linear fast part")


class Cheapest(NamedTuple):
    """The integrator that meets an error with the fewest evaluations of the gradient, and their number."""

    integrator: str
    evaluations: float


def build(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Compute the lines of `fronts.csv` from stored runs (scene, integrator, id, evaluations, status, error)."""
    runs: dict[str, dict[str, list[tuple[float, float]]]] = {scene: {} for scene in SCENES}
    for row in rows:
        if row["scene"] in runs and _counts(row):
            there = runs[row["scene"]].setdefault(row["integrator"], [])
            there.append((float(row["evaluations"]), float(row["error"])))
    lines = []
    for scene, by in runs.items():
        for wanted in ERRORS:
            told = [(x, name) for name, part in by.items() if (x := evaluations_for(part, wanted)) is not None]
            if told:
                evaluations, name = min(told)
                lines.append({"scene": scene, "error": wanted, "integrator": name, "evaluations": round(evaluations)})
    return lines


def _counts(row: Mapping[str, Any]) -> bool:
    method = METHODS.get(row["id"])
    gradients = method is None or not set(method.requires) & set(OTHER_WORK)
    return gradients and row.get("status") == OK and float(row["evaluations"]) > 0 and row["error"] not in ("", None)


def parse(lines: list[dict[str, str]]) -> dict[str, dict[float, Cheapest]]:
    """Scene -> error -> the integrator with the fewest evaluations, from the lines of `fronts.csv`."""
    found: dict[str, dict[float, Cheapest]] = {}
    for row in lines:
        best = Cheapest(row["integrator"], float(row["evaluations"]))
        found.setdefault(row["scene"], {})[float(row["error"])] = best
    return found


TABLE = ShippedTable(Path(__file__).with_name("fronts.csv"), build, parse)
