"""Checks of methods for rigid bodies: rotation matrices stay orthogonal, and orders are as declared.

With the fourth-order Runge-Kutta method (the control) the matrices must not stay orthogonal.  Splitting off a symmetric
top must gain accuracy near a symmetric body.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.rigid.measure import cells  # noqa: F401
from phasebench.benchmarks.experiments.rigid.page import gain, kept, left, orders
from phasebench.benchmarks.page.verdict import PASS


@pytest.mark.parametrize("verdict", [kept, left, orders, gain])
def bench_rigid(measured_rows: Callable[[str], list[dict]], verdict: Callable[..., Any]) -> None:
    """Test that methods for rigid bodies keep matrices orthogonal, as RK4 (the control) does not, and converge.

    The orders must be as declared; the gain of splitting off a symmetric top is tested, too.  ``verdict`` is the
    function of the report page that judges one of these; ``measured_rows`` is a fixture: table name -> rows.
    """
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
