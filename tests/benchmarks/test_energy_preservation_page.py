"""Whether the energy is kept on every step: every step counts, each largest error stands beside its own run."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.energy_preservation import page


def run(scheme="scheme-iv", h=0.01, without=0, error=np.nan, good=1e-15, problem="pendulum") -> dict:
    row = {"problem": problem, "scheme": scheme, "status": "ok", "h": h, "steps": round(1000 / h)}
    return row | {"without a root": without, page.WITHOUT: error, page.WITH: good}


def kept(*rows):
    return page.kept({"energy_preservation": pd.DataFrame(rows)}.get)


def test_no_step_size_is_left_out():
    """One step without a root at the longest step fails, and is counted of all steps."""
    found = kept(run(), run(h=0.2, without=1, error=1e-5))
    assert not found.holds
    assert "with h from 0.01 to 0.2" in found.text
    assert "1 of 105000 steps have none, with an error up to 1.00e-05 (scheme-iv on pendulum, h = 0.2)" in found.text
    assert found.text.endswith("; with h ≤ 0.05 none of 100000 steps is without a root.")
    assert "1 of 105000 steps have none" in found.short


@pytest.mark.parametrize("h", [0.01, 0.2])
@pytest.mark.parametrize(
    ("change", "holds"), [({}, True), ({"good": 1e-9}, False), ({"without": 1, "error": 0.1}, False)]
)
def test_a_step_that_does_not_keep_the_energy_fails_at_any_size(h, change, holds):
    assert kept(run("scheme-v", 0.02), run(h=h, **change)).holds is holds


def test_the_largest_errors_are_told_with_their_own_runs():
    found = kept(
        run(h=0.2, without=5, error=1e-5, good=1e-16),
        run("scheme-v", 0.05, without=2, error=1e-8, good=3e-15, problem="kepler"),
        run(h=0.02, without=1, error=1e-7, good=2e-16),
    )
    assert "at most 3.00e-15 (scheme-v on kepler, h = 0.05)" in found.text
    assert "8 of 75000 steps have none, with an error up to 1.00e-05 (scheme-iv on pendulum, h = 0.2)" in found.text
    assert "3 of 70000 steps have none, with an error up to 1.00e-07 (scheme-iv on pendulum, h = 0.02)" in found.text


def test_a_run_that_failed_and_another_scheme_do_not_count():
    other = [run(h=0.2, without=9, error=1.0) | {"status": "diverged"}, run("scheme-iv-v", 0.2, without=9, error=1.0)]
    found = kept(run(), *other)
    assert found.holds
    assert found.text.endswith("none of 100000 steps is without a root.")
    assert kept(*other) is None
