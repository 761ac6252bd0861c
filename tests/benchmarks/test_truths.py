"""The true value of an observable and its stated uncertainty, with fabricated references."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import END_STATE, ENERGY
from phasebench.benchmarks.problems import problem
from phasebench.reference.certificates import followed
from phasebench.reference.solvers import taylor

EPS = 2.0**-52
OSCILLATOR = problem("harmonic-oscillator")
#: An observable of a chaotic orbit whose values are the times at which it is evaluated.
LOOKED = replace(ENERGY, values=lambda problem, t, q, p: t, rows=4, kept=False, statistical=True)


def runs(monkeypatch, one: float, other: float, *displaced: float) -> None:
    """Replace the reference by made-up runs that end in (q, 0): one, another, and some from displaced starts.

    The certified state is removed.
    """
    rows = [np.array([[q, 0.0]], dtype=np.longdouble) for q in (one, other, *(displaced or (one,)))]
    found = followed.FollowedOrbit(followed.TAYLOR, np.array([1.0]), rows[0], rows[1], rows[2:])
    monkeypatch.setattr(followed, "follow", lambda problem, times: found)
    monkeypatch.setattr(truths, "_certified_end", lambda problem, t_end: None)


def test_equal_references_leave_the_rounding_of_a_double(monkeypatch):
    runs(monkeypatch, 1e-3, 1e-3)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert list(found.values) == [1e-3, 0.0]
    assert np.spacing(1e-3) / 2 <= found.uncertainty <= 1e-3 * EPS
    angle = truths.truth(OSCILLATOR, quantity(OSCILLATOR, "phase"), 1.0)
    assert np.spacing(pi) / 2 <= angle.uncertainty <= pi * EPS, "an angle is of the size of a turn"


def test_uncertainty_includes_the_growth_of_roundings(monkeypatch):
    """The worst displaced run counts, scaled by the ratio of a rounding to its displacement."""
    runs(monkeypatch, 1.0, 1.0, 1.0 + 1e-5, 1.0 - 1e-4, 1.0)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert found.rounding == pytest.approx(1e-4 * 2.0**-12, rel=1e-9, abs=0)
    assert found.uncertainty == pytest.approx(16 * 1e-4 * 2.0**-12, rel=1e-6, abs=0)
    assert found.source == truths.LONG_DOUBLE


@pytest.mark.parametrize("y", [0.0, 1e-17, -1e-17, 0.5])
def test_certified_angle_near_its_jump(monkeypatch, y):
    made = problem("kepler")
    end = SimpleNamespace(q=np.array([-1.0, y]), p=np.array([0.3, 0.2]), uncertainty=1e-16)
    monkeypatch.setattr(truths, "_certified_end", lambda problem, t_end: end)
    found = truths.truth(made, quantity(made, "phase"), 1.0)
    assert found.source == truths.CERTIFIED
    assert found.values == pytest.approx([np.arctan2(y, -1.0)])
    assert np.spacing(pi) / 2 <= found.uncertainty < 1e-15


@pytest.mark.parametrize("lost", [[np.nan, np.nan], [1.0, np.inf]])
def test_nonfinite_reference_has_failed(monkeypatch, lost):
    flow = SimpleNamespace(time=0.5)
    monkeypatch.setattr(taylor, "integrator", lambda *of: flow)
    monkeypatch.setattr(taylor, "start", lambda *state: None)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, None))
    with pytest.raises(taylor.ReferenceFailed, match=r"t = 0\.5: the state is no longer finite"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, "too many steps"))
    with pytest.raises(taylor.ReferenceFailed, match="too many steps"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)


def test_uncertainty_is_a_multiple_of_their_distance(monkeypatch):
    runs(monkeypatch, 1.0, 1.001)
    assert truths.truth(OSCILLATOR, END_STATE, 1.0).uncertainty == pytest.approx(3e-3)
