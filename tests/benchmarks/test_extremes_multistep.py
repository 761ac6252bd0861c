"""Unstable steps of multistep methods on Kepler's orbit: the theory in two ways, against runs, and the verdicts."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extremes import multistep, multistep_page
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE


@pytest.mark.parametrize(("order", "N"), [(8, 10.0), (8, 59.5), (8, 60.0), (10, 40.0), (12, 33.5), (14, 132.0)])
def test_both_theories_agree_on_the_circle(order, N):
    """The closed form, and the eigenvalues of the product of all steps."""
    table = QUINLAN_TREMAINE[order]
    one, other = multistep.circular_rate(table, N), multistep.floquet_rate(table, N, 0.0)
    assert one > 0.01
    # the closed form has the radius of the recursion's own circle, the product the exact one
    assert one == pytest.approx(other, rel=0.35 if N < 60 else 0.01)


def test_a_resonance_of_two_parasitic_roots_is_found():
    """Roots of order 8 at 72 and 60 degrees: twice the orbit's angle is their difference with 60 steps an orbit."""
    assert multistep.circular_rate(QUINLAN_TREMAINE[8], 60.0) > 0.05
    assert abs(multistep.circular_rate(QUINLAN_TREMAINE[8], 62.0)) < 1e-6
    assert abs(multistep.floquet_rate(QUINLAN_TREMAINE[8], 62.0, 0.0)) < 1e-3
    assert multistep.floquet_rate(QUINLAN_TREMAINE[8], 90.0, 0.2) > 0.01


def test_points_are_on_keplers_orbit():
    t = np.linspace(0, 2 * np.pi, 9)
    q = multistep.orbit(0.2, t)
    assert np.abs(q[[0, -1]] - [0.8, 0]).max() < 1e-14
    assert np.abs(q[4] - [-1.2, 0]).max() < 1e-14
    E = np.arccos(np.clip(q[1, 0] + 0.2, -1, 1))
    assert pytest.approx(t[1], abs=1e-13) == E - 0.2 * np.sin(E)


def test_runs_are_lost_where_theory_says_so(monkeypatch):
    monkeypatch.setattr(multistep, "ORBITS", 600)
    monkeypatch.setattr(multistep, "steps_asked", lambda table: np.array([60.0, 62.0]))
    rows = pd.DataFrame(multistep.measure_steps("quinlan-tremaine-8", 0.0)["extremes_multistep"])
    assert list(multistep_page.lost(rows)) == [True, False]
    assert list(rows["rate"] * 600 > multistep_page.SURE) == [True, False]


def test_the_control_drifts(monkeypatch):
    monkeypatch.setattr(multistep, "SHORT", 100)
    monkeypatch.setattr(multistep, "WINDOWS", 60)
    (row,) = multistep.measure_long(multistep.CONTROL, multistep.OFF)["extremes_multistep_drift"]
    assert row["high"] < -1e-11, "its interval excludes 0"


# -- verdicts on fabricated rows ---------------------------------------------------------------------------------------


def rows(*lines) -> pd.DataFrame:
    """Rows of (method, order, e, N, rate, first, largest)."""
    return pd.DataFrame(lines, columns=["method", "order", "e", "N", "rate", "first", "largest"]).assign(status="ok")


RIGHT = rows(
    ("a", 8, 0.0, 50.0, 0.1, 1e-9, 1e-3),
    ("a", 8, 0.0, 51.0, 0.0, 1e-9, 2e-9),
    ("a", 8, 0.0, 52.0, 0.01, 1e-9, 2e-9),  # theory does not decide in so many orbits
    ("a", 8, 0.2, 50.0, 0.1, 1e-9, np.nan),
    ("a", 8, 0.2, 51.0, 0.1, 1e-2, 2e-2),  # far from the exact orbit
    ("a", 8, 0.2, 60.0, 0.1, 1e-9, 0.5),
    ("b", 10, 0.0, 70.0, 0.1, 1e-9, 1e-3),
    ("b", 10, 0.2, 71.0, 0.1, 1e-9, 1e-3),
    ("b", 10, 0.2, 72.0, 0.1, 1e-9, 1e-3),
)


def read(found) -> tuple:
    return found.measured, found.outcome


def test_verdicts_count_what_theory_foretells():
    data = {"extremes_multistep": RIGHT}.get
    assert read(multistep_page.circle(data)) == (Count(3, 3), PASS)
    assert read(multistep_page.ellipse(data)) == (Count(4, 4), PASS)
    assert read(multistep_page.by_order(data)) == (Count(2, 2), PASS)
    assert read(multistep_page.by_frequencies(data)) == (Count(2, 2), PASS)


def test_verdicts_see_what_theory_does_not_foretell():
    wrong = pd.concat([RIGHT, rows(("a", 8, 0.0, 80.0, 0.0, 1e-9, 1e-3), ("a", 8, 0.2, 80.0, 0.1, 1e-9, 1e-9))])
    data = {"extremes_multistep": wrong.reset_index(drop=True)}.get
    assert read(multistep_page.circle(data)) == (Count(3, 4), FINDING)
    assert read(multistep_page.ellipse(data)) == (Count(4, 5), FINDING)
    assert read(multistep_page.by_order(data)) == (Count(1, 2), FINDING)
    assert read(multistep_page.by_frequencies(data)) == (Count(1, 2), FINDING)


def test_growth_off_the_resonances():
    def table(low):
        line = {"N": multistep.OFF, "low": low, "high": 1.0, "growth low": -1.0, "growth high": 1.0, "slope": 0.5}
        return pd.DataFrame([{"method": "a"} | line, {"method": multistep.CONTROL} | line])

    kept, grown = (multistep_page.bounded({"extremes_multistep_drift": table(low)}.get) for low in (-1.0, 0.5))
    assert read(kept) == (Count(2, 2), PASS)
    assert read(grown) == (Count(1, 2), FINDING)


def test_neighbours_on_the_grid_are_one_range():
    assert multistep_page.spans(np.array([59.5, 60.0, 60.5, 90.0])) == "59.5 to 60.5, 90"
