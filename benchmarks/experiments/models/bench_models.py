"""Models: every modelling error is known, the full models end where they must; advice's table is re-recorded."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.advice import models
from phasebench.benchmarks.experiments.models import measure
from phasebench.benchmarks.experiments.models.page import KNOWN

#: The full models' finest integrations end this near to what is true.
FULL = 1e-9


def cells(quick: bool = False) -> list:
    """A cell for each scene."""
    return measure.cells(quick)


def vague(rows) -> list[str]:
    """Models of which the error is not known to a part `KNOWN`, and full ones that end elsewhere."""
    out = []
    for r in rows:
        where = f"{r['scene']}, {r['model']}"
        if r["full"] and not r["integration"] <= FULL:
            out.append(f"{where}: {r['integration']:.1e} from what is true")
        elif not r["full"] and not r["integration"] + r["uncertainty"] <= KNOWN * r["modelling error"]:
            out.append(f"{where}: {r['modelling error']:.1e}, integrated to {r['integration']:.1e}")
    return out


def bench_known(measured):
    """Integration errors are far below the modelling errors."""
    wrong = vague(measured(measure.MODELS))
    assert not wrong, "\n".join(wrong)


def bench_advice(outcome, complete, update):
    """What `advise` knows of models is re-recorded with the tables where all of them were measured."""
    if not update or not (complete(measure.MODELS) and complete(measure.RUNS)):
        pytest.skip("the models of advice are stored with --update-tables where all of them are measured")
    models.keep(list(models.made(*(pd.DataFrame(outcome.rows(t)) for t in (measure.MODELS, measure.RUNS)))))
