"""Measures of the studies of extremes where the answer is known: theory in two ways, known orbits, hand-made maps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.studies.extremes import multistep
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE

# -- multistep methods -------------------------------------------------------------------------------------------------


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
    rows = pd.DataFrame(multistep.steps("quinlan-tremaine-8", 0.0)).assign(method="quinlan-tremaine-8")
    assert list(multistep.lost(rows)) == list(multistep.unstable(rows)) == [True, False]
    assert multistep.foretold(rows).all()
    assert multistep.spans(pd.Series([59.5, 60.0, 60.5, 90.0])) == "59.5 to 60.5, 90"


def test_the_control_drifts(monkeypatch):
    monkeypatch.setattr(multistep, "SHORT", 100)
    monkeypatch.setattr(multistep, "WINDOWS", 60)
    assert multistep.long(multistep.CONTROL, multistep.OFF)["high"] < -1e-11, "its interval excludes 0"
