"""Checks of the measurements on simplified models: modelling errors are known, full models end at the true values."""

from __future__ import annotations

from collections.abc import Callable

from phasebench.benchmarks.experiments.models import measure
from phasebench.benchmarks.experiments.models.page import KNOWN

#: Largest distance of a full model's finest run from the true value.
FULL = 1e-9


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`), also if ``quick``: one for each scene (a system, a time span and a quantity)."""
    return measure.cells(quick)


def vague(rows: list[dict]) -> list[str]:
    """Return messages about the simplified models whose modelling error is uncertain by more than the share `KNOWN`.

    Full models, which have no modelling error, are listed if the integration error of their reference run exceeds
    `FULL`.  ``rows`` are those of the table of models.
    """
    out = []
    for r in rows:
        where = f"{r['scene']}, {r['model']}"
        if r["full"] and not r["integration"] <= FULL:
            out.append(f"{where}: {r['integration']:.1e} from what is true")
        elif not r["full"] and not r["integration"] + r["uncertainty"] <= KNOWN * r["modelling error"]:
            out.append(f"{where}: {r['modelling error']:.1e}, integrated to {r['integration']:.1e}")
    return out


def bench_known(measured_rows: Callable[[str], list[dict]]) -> None:
    """Test that integration errors are far below modelling errors, and that full models end at the true values.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = vague(measured_rows(measure.MODELS))
    assert not wrong, "\n".join(wrong)
