"""What is taken for true of a quantity, and how uncertain it is said to be: with references made up for it."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE, ENERGY, quantity
from phasebench.benchmarks.problems import problem
from phasebench.reference.certificates import followed
from phasebench.reference.solvers import taylor

EPS = 2.0**-52
OSCILLATOR = problem("harmonic-oscillator")
#: Of a chaotic orbit: the times at which it is looked at.
LOOKED = replace(ENERGY, values=lambda problem, t, q, p: t, rows=4, kept=False, statistical=True)


def runs(monkeypatch, one: float, other: float, *displaced: float) -> None:
    """References that end in (q, 0), and no certified one."""
    rows = [np.array([[q, 0.0]], dtype=np.longdouble) for q in (one, other, *(displaced or (one,)))]
    found = followed.Followed(followed.TAYLOR, np.array([1.0]), rows[0], rows[1], rows[2:])
    monkeypatch.setattr(followed, "follow", lambda problem, times: found)
    monkeypatch.setattr(truths, "_certified", lambda problem, t_end: None)


def test_two_references_that_agree_leave_the_rounding_of_a_double(monkeypatch):
    runs(monkeypatch, 1e-3, 1e-3)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert list(found.values) == [1e-3, 0.0]
    assert np.spacing(1e-3) / 2 <= found.uncertainty <= 1e-3 * EPS
    angle = truths.truth(OSCILLATOR, quantity(OSCILLATOR, "phase"), 1.0)
    assert np.spacing(pi) / 2 <= angle.uncertainty <= pi * EPS, "an angle is of the size of a turn"


def test_two_references_are_trusted_to_a_few_times_their_distance(monkeypatch):
    runs(monkeypatch, 1.0, 1.001)
    assert truths.truth(OSCILLATOR, END_STATE, 1.0).uncertainty == pytest.approx(3e-3)


def test_two_references_that_agree_are_trusted_to_what_a_rounding_grows_to(monkeypatch):
    """The worst of the displaced runs counts, in the ratio of a rounding to what they were displaced by."""
    runs(monkeypatch, 1.0, 1.0, 1.0 + 1e-5, 1.0 - 1e-4, 1.0)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert found.rounding == pytest.approx(1e-4 * 2.0**-12, rel=1e-9, abs=0)
    assert found.uncertainty == pytest.approx(16 * 1e-4 * 2.0**-12, rel=1e-6, abs=0)
    assert found.source == truths.LONG_DOUBLE


def test_displaced_runs_that_are_lost_are_taken_as_they_are(monkeypatch):
    """Control of the proportion: what no longer grows with the displacement is not scaled down."""
    runs(monkeypatch, 1.0, 1.0, 1.0 + 1e-2)
    assert truths.truth(OSCILLATOR, END_STATE, 1.0).uncertainty == pytest.approx(0.16)


def test_what_is_kept_needs_no_reference():
    found = truths.truth(OSCILLATOR, quantity(OSCILLATOR, "energy"), 1.0)
    assert (list(found.values), found.uncertainty, found.source) == ([0.0], 0.0, truths.NONE)


@pytest.mark.parametrize("y", [0.0, 1e-17, -1e-17, 0.5])
def test_a_certified_angle_is_as_certain_where_it_jumps_by_a_turn(monkeypatch, y):
    made = problem("kepler")
    end = SimpleNamespace(q=np.array([-1.0, y]), p=np.array([0.3, 0.2]), uncertainty=1e-16)
    monkeypatch.setattr(truths, "_certified", lambda problem, t_end: end)
    found = truths.truth(made, quantity(made, "phase"), 1.0)
    assert found.source == truths.CERTIFIED
    assert found.values == pytest.approx([np.arctan2(y, -1.0)])
    assert np.spacing(pi) / 2 <= found.uncertainty < 1e-15


def test_a_certified_quantity_is_as_uncertain_as_its_worst_value(monkeypatch):
    made = problem("kepler")
    end = SimpleNamespace(q=np.array([0.5, 0.5]), p=np.array([0.3, 0.2]), uncertainty=1e-8)
    monkeypatch.setattr(truths, "_certified", lambda problem, t_end: end)
    steep = replace(END_STATE, values=lambda problem, t, q, p: np.array([1000 * q[-1, 0], q[-1, 1]]))
    assert truths.truth(made, steep, 1.0).uncertainty == pytest.approx(1e-5)


@pytest.mark.parametrize("lost", [[np.nan, np.nan], [1.0, np.inf]])
def test_a_reference_that_is_not_finite_has_failed(monkeypatch, lost):
    flow = SimpleNamespace(time=0.5)
    monkeypatch.setattr(taylor, "integrator", lambda *of: flow)
    monkeypatch.setattr(taylor, "start", lambda *state: None)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, None))
    with pytest.raises(taylor.ReferenceFailed, match=r"t = 0\.5: the state is no longer finite"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, "too many steps"))
    with pytest.raises(taylor.ReferenceFailed, match="too many steps"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)


def test_orbits_nearby_are_looked_at_over_the_whole_span():
    found = truths.truth(OSCILLATOR, LOOKED, 2.0)
    assert list(found.values) == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert (found.uncertainty, found.source) == (0.0, truths.ENSEMBLE)


def test_the_uncertainty_of_an_ensemble_is_that_of_its_worst_value():
    still = replace(LOOKED, values=lambda problem, t, q, p: np.array([q[0, 0], 1.0]))
    found = truths.truth(OSCILLATOR, still, 2.0)
    shift = truths.SHIFT * abs(OSCILLATOR.q0[0])
    assert abs(found.values[0] - OSCILLATOR.q0[0]) < shift
    assert 0.5 * shift < found.uncertainty < 2 * shift, "twice the deviation of a uniform number, 2 / sqrt(3)"
