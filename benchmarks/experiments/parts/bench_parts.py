"""Checks of splittings of H into many parts: orders are as declared, and energies are bounded.

The energy of an ordinary Runge-Kutta method (the control) must grow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.parts.measure import cells  # noqa: F401
from phasebench.benchmarks.experiments.parts.page import bounded, grows, orders
from phasebench.benchmarks.page.verdict import PASS


@pytest.mark.parametrize("verdict", [bounded, grows, orders])
def bench_parts(measured_rows: Callable[[str], list[dict]], verdict: Callable[..., Any]) -> None:
    """Test that splittings have bounded energies and declared orders, and that the energy of RK4, the control, grows.

    ``verdict`` is the function of the report page that judges one of these three; ``measured_rows`` is a fixture: table
    name -> rows.
    """
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
