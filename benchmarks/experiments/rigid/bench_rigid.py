"""Checks of methods for rigid bodies: rotations are kept, orders are declared, and the control leaves the rotations."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.rigid.measure import cells  # noqa: F401
from phasebench.benchmarks.experiments.rigid.page import gain, kept, left, orders
from phasebench.benchmarks.page.verdict import PASS


@pytest.mark.parametrize("verdict", [kept, left, orders, gain])
def bench_rigid(measured_rows, verdict):
    """Rotations and orders are as declared, and the control leaves the rotations."""
    found = verdict(lambda name: pd.DataFrame(measured_rows(name)))
    if found is None:
        pytest.skip("none of its rows is measured in this run")
    assert found.outcome == PASS, found
