"""What would show a fault of this suite holds on the rows that were measured, for every study."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.page.study import Claim, Study
from phasebench.benchmarks.page.verdict import MISSING, PASS
from phasebench.benchmarks.store.cells import Cell
from phasebench.benchmarks.store.run import Outcome
from phasebench.benchmarks.studies.index import found

STUDIES = tuple(found().values())
CHECKED = [
    pytest.param(study, claim, id=f"{study.id}-{name}")
    for study in STUDIES
    for name, claim in [*((n, c) for n, c in study.claims.items() if c.fault or c.checked), *study.checks.items()]
]


def cells(quick: bool = False) -> list[Cell]:
    """All measurements of all studies."""
    return [cell for study in STUDIES for cell in study.cells(quick)]


@pytest.mark.parametrize(("study", "claim"), CHECKED)
def bench_claim(outcome: Outcome, complete: Callable[[str], bool], study: Study, claim: Claim) -> None:
    """Rows that this run measured bear the claim out, and none of the study's cells failed."""
    failed = outcome.failures(lambda cell: cell.experiment == study.id)
    assert not failed, "cells that could not be measured:\n" + "\n".join(failed)
    of = study.page.tables if callable(claim.table) else (claim.table,)
    if claim.whole and not all(map(complete, of)):
        pytest.skip("a part of its table is measured in this run")
    verdict = claim(lambda name: pd.DataFrame(outcome.rows(name)).replace("", np.nan))
    if verdict is None or verdict.outcome == MISSING:
        pytest.skip("none of its rows is measured in this run")
    assert verdict.outcome == PASS, verdict.row()
