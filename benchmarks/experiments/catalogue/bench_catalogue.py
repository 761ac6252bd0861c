"""Checks of the orders of published coefficient tables, and of tables in the sources of packages."""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue.cells import cells  # noqa: F401
from phasebench.benchmarks.experiments.catalogue.transcribed_page import measured_orders
from phasebench.benchmarks.page.verdict import PASS


def bench_coefficients(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that every published table of coefficients has the order that it declares.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    wrong = [r for r in measured_rows("coefficients") if r["order"] != r["declared order"]]
    assert not wrong, wrong


def bench_transcribed(measured_rows: Callable[[str], list[dict]]) -> None:
    """Check that integrations with each table transcribed from a package have the order that order conditions show.

    ``measured_rows`` is a fixture: table name -> rows.
    """
    verdict = measured_orders(lambda name: pd.DataFrame(measured_rows(name)))
    if verdict is None:
        pytest.skip("none of its rows is measured in this run")
    assert verdict.outcome == PASS, verdict
