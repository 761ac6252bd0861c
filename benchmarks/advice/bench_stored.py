"""Rewrite `prior.csv` and `models.csv`, stored times which `advise` reads, with --update-tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd
import pytest

from phasebench.benchmarks.advice import models, prior
from phasebench.benchmarks.problems.questions import BY_ID
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import METHODS
from phasebench.reference.peers import PEERS

if TYPE_CHECKING:
    from phasebench.benchmarks.store.run import Outcome

#: Names of tables: all runs of the trade (`studies.trade`); the models of scenes and their runs.
RUNS, MODELS = "front_rungs", ("models", "models_runs")


def competition(rows: Iterable[Mapping[str, Any]]) -> tuple[pd.DataFrame, set[str]]:
    """(Successful runs of single orbits, with a column ``problem``; ids of the integrators that took part)."""
    named = {x.id for x in (*METHODS, *PEERS)} - {"heyoka-batch"}
    frame = pd.DataFrame([r for r in rows if r.get("status") == OK and r["id"] in named])
    problems = frame["scene"].map(lambda scene: BY_ID[scene].problem.partition(":")[0])
    return frame.assign(problem=problems), named


def bench_prior(outcome: Outcome, complete: Callable[[str], bool], update: bool) -> None:
    """Write `prior.csv`: each integrator's time over that of the cheapest, by problem and power of ten of the error."""
    if not update or not complete(RUNS):
        pytest.skip("the prior is made with --update-tables where all of the trade is measured")
    prior.TABLE.save(*competition(outcome.rows(RUNS)))


def bench_models(outcome: Outcome, complete: Callable[[str], bool], update: bool) -> None:
    """Write `models.csv`: errors and times of the simplified models that `advise` may suggest."""
    if not update or not all(map(complete, MODELS)):
        pytest.skip("the models of advice are stored with --update-tables where all of them are measured")
    models.TABLE.save(*(pd.DataFrame(outcome.rows(t)) for t in MODELS))
