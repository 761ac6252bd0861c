"""Rewrite the tables that are shipped, the costs of known integrators, with --update-tables from complete rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd
import pytest

from phasebench.benchmarks.advice import models, prior
from phasebench.benchmarks.certificate import fronts, times
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

if TYPE_CHECKING:
    from phasebench.benchmarks.store.run import Outcome


def competition(rows: Iterable[Mapping[str, Any]]) -> tuple[pd.DataFrame, set[str]]:
    """(Successful runs of single orbits, with a column ``problem``; ids of the integrators that took part)."""
    named = {x.id for x in (*METHODS, *PEERS)} - {"heyoka-batch"}
    frame = pd.DataFrame([r for r in rows if r.get("status") == OK and r["id"] in named])
    problems = frame["scene"].map(lambda scene: BY_ID[scene].problem.partition(":")[0])
    return frame.assign(problem=problems), named


#: Name -> (the shipped table, the measured tables that it is made of, their rows -> the arguments of its `build`).
#: "front_rungs" are all runs of the trade (`studies.trade`), "front" the cheapest of each side.
SHIPPED: dict[str, tuple[Any, tuple[str, ...], Callable[..., Iterable]]] = {
    "prior": (prior.TABLE, ("front_rungs",), competition),
    "models": (models.TABLE, ("models", "models_runs"), lambda *rows: map(pd.DataFrame, rows)),
    "fronts": (fronts.TABLE, ("front_rungs",), lambda *rows: rows),
    "times": (times.TABLE, ("front", "front_rungs"), lambda *rows: rows),
}


@pytest.mark.parametrize("name", SHIPPED)
def bench_shipped(name: str, outcome: Outcome, complete: Callable[[str], bool], update: bool) -> None:
    """Write a shipped table; skipped unless ``update`` is set and all its rows are measured."""
    table, measured, arguments = SHIPPED[name]
    if not update or not all(map(complete, measured)):
        pytest.skip(f"{name} is made with --update-tables where all of {', '.join(measured)} is measured")
    table.save(*arguments(*map(outcome.rows, measured)))
