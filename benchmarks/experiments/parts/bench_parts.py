"""Checks of splittings through many parts: orders are declared, energies bounded, and the control's grows."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.parts.measure import cells  # noqa: F401
from phasebench.benchmarks.experiments.parts.page import bounded, grows, orders
from phasebench.benchmarks.page.verdict import PASS


@pytest.mark.parametrize("verdict", [bounded, grows, orders])
def bench_parts(measured_rows, verdict):
    """Energies are bounded, orders as declared, and the control's energy grows."""
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
