"""Checks of methods for constraints: they stay on the manifold, and RATTLE's energy does not drift."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.constraints.measure import cells  # noqa: F401
from phasebench.benchmarks.experiments.constraints.page import drift, kept, left, same
from phasebench.benchmarks.page.verdict import PASS


@pytest.mark.parametrize("verdict", [kept, left, same, drift])
def bench_constraints(measured_rows: Callable[[str], list[dict]], verdict: Callable[..., Any]) -> None:
    """Check one verdict of the report page, a function of the measured tables; skip it if nothing was measured.

    The verdicts: methods keep constraints and energy, and the control, an ordinary method, leaves the manifold.
    """
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
