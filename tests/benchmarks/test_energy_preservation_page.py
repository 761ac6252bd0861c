"""The page on energy preservation: every step counts, and each largest error is shown with its own run."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.energy_preservation import page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count


def run(scheme="scheme-iv", h=0.01, without=0, error=np.nan, good=1e-15, problem="pendulum") -> dict:
    row = {"problem": problem, "scheme": scheme, "status": "ok", "h": h, "steps": round(1000 / h)}
    return row | {"without a root": without, page.WITHOUT: error, page.WITH: good}


def verdicts(*rows):
    """(verdict on the conservation of energy, verdict on the existence of a root in each step) from fabricated rows."""
    data = {"energy_preservation": pd.DataFrame(rows)}.get
    return page.energy_conservation(data), page.root_existence(data)


def test_every_step_size_counts():
    """One step without a root at the longest h is a finding, out of the steps at all h."""
    kept, rooted = verdicts(run(), run(h=0.2, without=1, error=1e-5))
    assert kept.outcome == PASS
    assert (rooted.outcome, rooted.measured) == (FINDING, Count(104999, 105000))
    assert rooted.where.startswith("scheme-iv on pendulum, h = 0.2")


@pytest.mark.parametrize("h", [0.01, 0.2])
@pytest.mark.parametrize(
    ("change", "outcomes"),
    [({}, (PASS, PASS)), ({"good": 1e-9}, (FAIL, PASS)), ({"without": 1, "error": 0.1}, (PASS, FINDING))],
)
def test_step_that_changes_the_energy_counts(h, change, outcomes):
    assert tuple(v.outcome for v in verdicts(run("scheme-v", 0.02), run(h=h, **change))) == outcomes


def test_largest_error_is_shown_with_its_own_run():
    rows = (
        run(h=0.2, without=5, error=1e-5, good=1e-16),
        run("scheme-v", 0.05, without=2, error=1e-8, good=3e-15, problem="kepler"),
        run(h=0.02, without=1, error=1e-7, good=2e-16),
    )
    kept, rooted = verdicts(*rows)
    assert (kept.measured, kept.where) == (3e-15, "scheme-v on kepler, h = 0.05")
    assert rooted.measured == Count(74992, 75000)
    said = page.answer({"energy_preservation": pd.DataFrame(rows)}.get)
    assert all(number in said for number in ("3.0e-15", "8 of 75000", "1.0e-05"))


def test_failed_runs_and_other_schemes_do_not_count():
    other = [run(h=0.2, without=9, error=1.0) | {"status": "diverged"}, run("scheme-iv-v", 0.2, without=9, error=1.0)]
    kept, rooted = verdicts(run(), *other)
    assert (kept.outcome, rooted.outcome) == (PASS, PASS)
    assert rooted.measured == Count(100000, 100000)
    assert verdicts(*other) == (None, None)
    assert page.answer({"energy_preservation": pd.DataFrame(other)}.get) is None
