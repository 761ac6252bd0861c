"""The drift of an oscillating error: known slopes, coverage of its interval, controls."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import drift as module
from phasebench.benchmarks.measure import drift_coverage, metrics
from phasebench.benchmarks.measure.changes import changes
from phasebench.benchmarks.measure.drift import drift, split

T = np.arange(4000) * 0.05


def swing(t, periods, phase=0.3):
    """An oscillation with a third harmonic, of amplitude 1e-3, over ``periods`` periods."""
    angle = 2 * np.pi * periods * t / t[-1] + phase
    return 1e-3 * (np.cos(angle) + 0.2 * np.cos(3 * angle))


@pytest.mark.parametrize("t", [T, T[:300]], ids=["long", "short"])
@pytest.mark.parametrize("periods", [2.3, 7.7, 31.4, 66.6])
def test_drift_below_a_million_times_larger_oscillation(t, periods):
    slope = 1e-9 / t[-1]
    for sign in (-1, 0, 1):
        found = drift(t, swing(t, periods) + sign * slope * t)
        assert abs(found.value - sign * slope) < 1e-3 * slope
        assert found.low <= found.value <= found.high
        assert found.high - found.low < 0.01 * slope
        naive = metrics.slope(t, swing(t, periods) + sign * slope * t)
        assert abs(naive.value) > 10 * slope, "the control: a line through all points is led astray"


def test_two_close_frequencies_are_resolved():
    found = drift(T, swing(T, 12.0) + swing(T, 16.5) + 1e-12 * T)
    assert found.low <= 1e-12 <= found.high
    assert found.high < 2e-12


def test_drift_is_linear_and_reproducible():
    e = swing(T, 9.1) + 1e-6 * np.sin(T**1.5)
    one, again, more = drift(T, e), drift(T, e), drift(T, 8 * e + 3)
    assert one == again
    assert more.value == pytest.approx(8 * one.value, rel=1e-4)
    assert more.high - more.low == pytest.approx(8 * (one.high - one.low), rel=1e-4)


@pytest.mark.parametrize("kind", drift_coverage.KINDS)
@pytest.mark.parametrize("points", [400, 1500])
def test_interval_covers_the_true_drift(kind, points):
    found = [drift_coverage.coverage(kind, periods, points, drawn=60) for periods in (3, 20)]
    # At 95.75 % coverage, fewer than 105 of 120 draws are covered with probability 1e-4.
    assert sum(r["covered"] for r in found) * 60 >= 105
    if drift_coverage.KINDS[kind].oscillation:
        assert found[0]["covered by the line"] < 0.6, "the control: the line through all points"


def test_intervals_are_neither_too_narrow_nor_too_wide(monkeypatch):
    hits = sum(drift_coverage.coverage("with both and a drift", p, 400, drawn=150)["covered"] for p in (5, 40)) / 2
    assert hits >= 0.93
    lone = drift_coverage.coverage("random walk alone", 0, 400, drawn=200)["covered"]
    assert 0.9 <= lone <= 0.99
    monkeypatch.setattr(module, "WEIGHTS", (1.0, 1e-9, 1e-9, 1e-300))
    assert drift_coverage.coverage("random walk alone", 0, 400, drawn=60)["covered"] < 0.8, (
        "the control: white noise only"
    )


@pytest.mark.parametrize(("kind", "periods"), [("white noise alone", 0), ("with white noise", 20)])
@pytest.mark.parametrize("points", [60, 500, 5000])
def test_a_climb_that_is_sure_by_a_line_is_seen(monkeypatch, kind, periods, points):
    """At 97 % power, fewer than 36 of some 42 draws are seen with probability 1e-3; a quarter of the climb is not."""
    assert drift_coverage.coverage(kind, periods if points > 60 else 0, points, drawn=50)["seen"] > 0.86
    monkeypatch.setattr(drift_coverage, "CLIMB", 2.0)
    monkeypatch.setattr(drift_coverage, "SURE", 0.0)
    assert drift_coverage.coverage(kind, periods if points > 60 else 0, points, drawn=40)["seen"] < 0.5, "the control"


def test_a_climb_in_noise_is_no_oscillation():
    """500 points of noise 0.3 with a climb of 5 over the run."""
    t = np.linspace(0, 1, 500)
    for seed in range(40):
        noise = 0.3 * np.random.default_rng(seed).standard_normal(500)
        assert drift(t, noise + 5 * t).low > 0
        assert drift(t, noise).high < 2


# -- jumps and onsets --------------------------------------------------------------------------------------------------


def wobble(seed: int, n: int, periods: float | None = None):
    """(generator, times, an oscillation with noise of a twentieth of its size)."""
    g = np.random.default_rng(seed)
    t = np.linspace(0, 300, n)
    angle = 2 * np.pi * (periods or g.uniform(4, 40)) * t / t[-1] + g.uniform(0, 6)
    return g, t, np.cos(angle) + 0.3 * np.cos(2 * angle) + 0.05 * g.standard_normal(n)


@pytest.mark.parametrize("n", [200, 3000])
def test_a_jump_is_named_with_time_and_size(n):
    named = 0
    for seed in range(20):
        g, t, e = wobble(seed, n)
        at, size = g.uniform(45, 255), g.choice([-17, -3, 4, 17])
        found, slope = changes(t, e + size * (t >= at))
        near = [abs(c.time - at) < 4 and abs(c.size / size - 1) < 0.1 and c.kind == "jump" for c in found]
        named += near == [True] and slope.low <= 0 <= slope.high
    assert named >= 17


@pytest.mark.parametrize("n", [200, 3000])
def test_an_onset_is_named_with_time_and_slope(n):
    named = 0
    for seed in range(20):
        g, t, e = wobble(seed, n)
        at = g.uniform(100, 255)
        found, _ = changes(t, e + 0.5 * np.maximum(t - at, 0))
        named += [abs(c.time - at) < 12 and abs(c.size / 0.5 - 1) < 0.2 and c.kind == "onset" for c in found] == [True]
    assert named >= 16


@pytest.mark.parametrize("kind", ["with white noise", "peaked", "random walk alone", "white noise alone", "bursts"])
@pytest.mark.parametrize("points", [150, 3000])
def test_noise_and_bursts_are_no_changes(kind, points):
    named = 0
    for seed in range(40):
        t, oscillation, noise = drift_coverage.series(kind, 12, points, np.random.default_rng(seed))
        named += bool(changes(t, oscillation + noise)[0])
    # At 1 %, more than 3 of 40 are named with probability 1e-3.
    assert named <= 3


def test_a_pulse_after_which_the_level_returns_is_no_jump():
    for seed in range(10):
        g, t, e = wobble(seed, 400)
        pulse = 8 * np.exp(-(((t - g.uniform(60, 240)) / 3) ** 2))
        assert not changes(t, e + pulse)[0]


def test_too_slow_oscillation_is_taken_for_a_drift():
    assert drift_coverage.coverage("oscillation", 0.5, 400, drawn=30)["covered"] < 0.75


def test_noise_has_no_spectral_line():
    generator = np.random.default_rng(5)
    noise = generator.standard_normal((40, 512))
    lines = [sum(split(T[:512], x)[1].size > 0 for x in draws) for draws in (noise, np.cumsum(noise, axis=1))]
    # A random walk seems to have one in 2 %; its columns are fitted along with the slope.
    assert lines[0] == 0
    assert lines[1] <= 4


@pytest.mark.parametrize("rate", [3, 10, 30, 100, 300])
def test_decaying_error_has_no_drift_larger_than_itself(rate):
    for swinging in (0, 200):
        e = np.exp(-rate * T / T[-1]) * (1 + 0.3 * np.cos(swinging * T / T[-1]))
        found = drift(T, e)
        assert abs(found.value) * T[-1] < e.max()
        assert max(abs(found.low), abs(found.high)) * T[-1] < 3


def test_constant_series_has_no_drift():
    found = drift(T, np.zeros(len(T)))
    assert (found.value, found.low, found.high) == (0, 0, 0)


def test_too_few_points_are_refused():
    with pytest.raises(ValueError, match="too few"):
        drift(np.arange(47.0), np.zeros(47))
    assert drift(np.arange(48.0), 2 * np.arange(48.0)).value == pytest.approx(2)


# -- methods -----------------------------------------------------------------------------------------------------------


def pendulum(step, h, steps):
    """(t, H - H0) of the pendulum, started at rest from 2 radians, by a step function (q, p, h) -> (q, p)."""
    q, p = 2.0, 0.0
    H = [-np.cos(q)]
    for _ in range(steps):
        q, p = step(q, p, h)
        H.append(p * p / 2 - np.cos(q))
    return np.arange(steps + 1) * h, np.array(H) - H[0]


def verlet(q, p, h):
    p -= h / 2 * np.sin(q)
    q += h * p
    return q, p - h / 2 * np.sin(q)


def euler(q, p, h):
    return q + h * p, p - h * np.sin(q)


def rk4(q, p, h):
    def f(q, p):
        return p, -np.sin(q)

    a = f(q, p)
    b = f(q + h / 2 * a[0], p + h / 2 * a[1])
    c = f(q + h / 2 * b[0], p + h / 2 * b[1])
    d = f(q + h * c[0], p + h * c[1])
    return tuple(x + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, x in enumerate((q, p)))


def test_stormer_verlet_does_not_drift_others_do():
    t, e = pendulum(verlet, 0.1, 4000)
    found = drift(t, e)
    assert found.low <= 0 <= found.high
    assert max(-found.low, found.high) * t[-1] < 1e-7 * abs(e).max()
    for step, h in ((rk4, 0.1), (euler, 0.001)):
        t, e = pendulum(step, h, 4000)
        found = drift(t, e)
        assert found.low * found.high > 0, step
        assert abs(found.value) * t[-1] > 0.3 * abs(e).max()
