"""The drift of an oscillating error: known slopes, coverage of its interval, controls."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import drift as module
from phasebench.benchmarks.measure import drift_coverage, metrics
from phasebench.benchmarks.measure.changes import changes
from phasebench.benchmarks.measure.drift import drift

T = np.arange(4000) * 0.05


def swing(t, periods, phase=0.3):
    """An oscillation with a third harmonic, of amplitude 1e-3, over ``periods`` periods."""
    angle = 2 * np.pi * periods * t / t[-1] + phase
    return 1e-3 * (np.cos(angle) + 0.2 * np.cos(3 * angle))


@pytest.mark.parametrize(("t", "periods"), [(T, 2.3), (T, 66.6), (T[:300], 7.7)])
def test_drift_below_a_million_times_larger_oscillation(t, periods):
    slope = 1e-9 / t[-1]
    for sign in (-1, 0, 1):
        found = drift(t, swing(t, periods) + sign * slope * t)
        assert abs(found.value - sign * slope) < 1e-3 * slope
        assert found.low <= found.value <= found.high
        assert found.high - found.low < 0.01 * slope
        naive = metrics.slope(t, swing(t, periods) + sign * slope * t)
        assert abs(naive.value) > 10 * slope, "the control: a line through all points is led astray"


@pytest.mark.parametrize("kind", drift_coverage.KINDS)
def test_interval_covers_the_true_drift(kind):
    drawn = 8 if "peaked" in kind else 40  # a dear one
    found = [drift_coverage.coverage(kind, periods, 400, drawn=drawn) for periods in (3, 20)]
    # At 95.75 % coverage, fewer than 69 of 80 draws are covered with probability 1e-4, than 12 of 16 with 1e-3.
    assert sum(r["covered"] for r in found) * drawn >= (12 if drawn == 8 else 69)
    if drift_coverage.KINDS[kind].oscillation:
        assert found[0]["covered by the line"] < 0.6, "the control: the line through all points"


def test_intervals_are_neither_too_narrow_nor_too_wide(monkeypatch):
    hits = sum(drift_coverage.coverage("with both and a drift", p, 400, drawn=60)["covered"] for p in (5, 40)) / 2
    assert hits >= 0.9
    lone = drift_coverage.coverage("random walk alone", 0, 400, drawn=80)["covered"]
    assert 0.85 <= lone < 1
    monkeypatch.setattr(module, "WEIGHTS", (1.0, 1e-9, 1e-9, 1e-300))
    assert drift_coverage.coverage("random walk alone", 0, 400, drawn=60)["covered"] < 0.8, (
        "the control: white noise only"
    )


@pytest.mark.parametrize(("kind", "periods", "points"), [("white noise alone", 0, 60), ("with white noise", 20, 500)])
def test_a_climb_that_is_sure_by_a_line_is_seen(monkeypatch, kind, periods, points):
    """At 97 % power, fewer than 36 of some 42 draws are seen with probability 1e-3; a quarter of the climb is not."""
    assert drift_coverage.coverage(kind, periods, points, drawn=50)["seen"] > 0.86
    monkeypatch.setattr(drift_coverage, "CLIMB", 2.0)
    monkeypatch.setattr(drift_coverage, "SURE", 0.0)
    assert drift_coverage.coverage(kind, periods, points, drawn=40)["seen"] < 0.5, "the control"


# -- jumps and onsets --------------------------------------------------------------------------------------------------


def wobble(seed: int, n: int = 200):
    """(generator, times, an oscillation with noise of a twentieth of its size)."""
    g = np.random.default_rng(seed)
    t = np.linspace(0, 300, n)
    angle = 2 * np.pi * g.uniform(4, 40) * t / t[-1] + g.uniform(0, 6)
    return g, t, np.cos(angle) + 0.3 * np.cos(2 * angle) + 0.05 * g.standard_normal(n)


def test_jumps_and_onsets_are_named_with_time_and_size():
    jumps = onsets = 0
    for seed in range(20):
        g, t, e = wobble(seed)
        at, size = g.uniform(45, 255), g.choice([-17, -3, 4, 17])
        found, slope = changes(t, e + size * (t >= at))
        near = [abs(c.time - at) < 4 and abs(c.size / size - 1) < 0.1 and c.kind == "jump" for c in found]
        jumps += near == [True] and slope.low <= 0 <= slope.high
        g, t, e = wobble(seed)
        at = g.uniform(100, 255)
        found, _ = changes(t, e + 0.5 * np.maximum(t - at, 0))
        onsets += [abs(c.time - at) < 12 and abs(c.size / 0.5 - 1) < 0.2 and c.kind == "onset" for c in found] == [True]
    assert (jumps >= 17, onsets >= 16) == (True, True)


@pytest.mark.parametrize("kind", ["with white noise", "peaked", "random walk alone", "white noise alone", "bursts"])
def test_noise_and_bursts_are_no_changes(kind):
    named = 0
    for seed in range(40):
        t, oscillation, noise = drift_coverage.series(kind, 12, 150, np.random.default_rng(seed))
        named += bool(changes(t, oscillation + noise)[0])
    # At 1 %, more than 3 of 40 are named with probability 1e-3.
    assert named <= 3


@pytest.mark.parametrize("rate", [3, 30, 300])
def test_decaying_error_has_no_drift_larger_than_itself(rate):
    for swinging in (0, 200):
        e = np.exp(-rate * T / T[-1]) * (1 + 0.3 * np.cos(swinging * T / T[-1]))
        found = drift(T, e)
        assert abs(found.value) * T[-1] < e.max()
        assert max(abs(found.low), abs(found.high)) * T[-1] < 3


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="too few"):
        drift(np.arange(47.0), np.zeros(47))
    assert drift(np.arange(48.0), 2 * np.arange(48.0)).value == pytest.approx(2)
    alternating = drift(np.arange(400.0), np.where(np.arange(400) % 2, 1e-3, -1e-3))
    assert alternating.low <= 0 <= alternating.high
