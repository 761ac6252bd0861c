"""Checks of methods for rigid bodies: rotation matrices stay orthogonal, and orders are as declared.

The fourth-order Runge-Kutta method (the control) must leave the rotations.
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
    """Test that methods for rigid bodies keep rotations and have their orders, and that RK4, the control, does not.

    ``verdict`` is the function of the report page that judges one such statement; ``measured_rows`` is a fixture: table
    name -> rows.
    """
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
