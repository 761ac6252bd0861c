"""Checks of models of a physical system: modelling errors are known, and the full models end at the true values."""

from __future__ import annotations

from phasebench.benchmarks.experiments.models import measure
from phasebench.benchmarks.experiments.models.page import KNOWN

#: Largest distance of a full model's finest run from the true value.
FULL = 1e-9


def cells(quick: bool = False) -> list:
    """List the measurements (`Cell`), one for each scene (a physical system, a time span and a quantity)."""
    return measure.cells(quick)


def vague(rows) -> list[str]:
    """Messages about models whose modelling error is known less well than to the share `KNOWN` of itself.

    Full models are listed if their values at the end are farther than `FULL` from the true ones.
    """
    out = []
    for r in rows:
        where = f"{r['scene']}, {r['model']}"
        if r["full"] and not r["integration"] <= FULL:
            out.append(f"{where}: {r['integration']:.1e} from what is true")
        elif not r["full"] and not r["integration"] + r["uncertainty"] <= KNOWN * r["modelling error"]:
            out.append(f"{where}: {r['modelling error']:.1e}, integrated to {r['integration']:.1e}")
    return out


def bench_known(measured_rows):
    """Integration errors are far below modelling errors, and full models end at the true values."""
    wrong = vague(measured_rows(measure.MODELS))
    assert not wrong, "\n".join(wrong)
