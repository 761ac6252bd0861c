"""The metrics on synthetic data with known answers, with controls."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import metrics

H = 0.1 / 2.0 ** np.arange(10)


def test_order_of_a_pure_power():
    o = metrics.order(H, 3 * H**2)
    assert o.value == pytest.approx(2, abs=1e-12)
    assert (o.points, o.first, o.last) == (10, H[0], H[-1])


def test_order_needs_no_sorting():
    shuffled = np.random.default_rng(1).permutation(len(H))
    assert metrics.order(H[shuffled], H[shuffled] ** 3 * (1 + H[shuffled])) == metrics.order(H, H**3 * (1 + H))


@pytest.mark.parametrize("p", [1, 2, 4, 6])
def test_order_excludes_coarse_steps_and_round_off(p):
    h = 0.2 / 1.5 ** np.arange(16)
    noise = 10.0 ** (-2 * p - 4)
    error = h**p * (1 + 60 * h**2) + noise * (1 + 0.3 * np.sin(37.0 * np.arange(len(h))))
    o = metrics.order(h, error, noise=10 * noise)
    assert abs(o.value - p) < 0.1
    assert o.first < h[0]
    assert o.points >= 3
    everything = np.polyfit(np.log(h), np.log(error), 1)[0]
    assert abs(everything - p) > 0.1, "the control: all points together mislead"


def test_order_excludes_errors_up_to_the_noise():
    """Control: without the noise the constant errors of round-off fit best."""
    error = np.maximum(H, H[4]) ** 2
    assert metrics.order(H, error, noise=1.5 * error[4]).value == pytest.approx(2)
    assert metrics.order(H, error).value == pytest.approx(0, abs=1e-9)


def test_slope_interval_covers_the_truth():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        s = metrics.slope(np.log(H), np.log(H**2) + 0.1 * rng.standard_normal(len(H)))
        inside += s.low <= 2 <= s.high
    assert 0.9 < inside / 200 < 0.99


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_order_of_too_few_points_is_nan(kept):
    o = metrics.order(H, np.where(np.arange(len(H)) < kept, H**2, 0.0))
    assert o.points == 0
    assert np.isnan(o.value)


def test_order_excludes_nonfinite_and_saturated_errors():
    error = H**2
    error[0], error[-1] = np.nan, np.inf
    assert metrics.order(H, error).points == 8
    saturated = np.concatenate([np.full(6, 1.0), H[6:] ** 2])
    assert metrics.order(H, saturated, ceiling=0.5).value == pytest.approx(2)
    assert metrics.order(H, saturated).value == pytest.approx(0, abs=1e-9), "the control: the flat part fits as well"


def test_order_window_ends_at_a_rejected_point():
    error = H**2
    error[4] = np.nan
    o = metrics.order(H, error)
    assert (o.points, o.first) == (5, H[5])


def test_slope_refuses_two_points():
    with pytest.raises(ValueError, match="at least 3"):
        metrics.slope([0, 1], [0, 1])
    with pytest.raises(ValueError, match="shapes"):
        metrics.order([1, 2, 3], [1, 2])


def test_invariant_error_is_the_largest_and_the_last():
    e = metrics.invariant_error(np.array([2.0, 2.5, 1.0, 1.75]))
    assert (e.max, e.end) == (1.0, -0.25)
    assert np.isnan(metrics.invariant_error(np.array([2.0, np.nan, 2.0])).max)


def test_refinement_difference_is_the_maximum_norm():
    assert metrics.refinement_difference([1.0, 2.0, 3.0], [1.5, 2.0, 2.25]) == 0.75


def test_order_prefers_the_finer_of_two_equal_windows():
    h = 0.1 / 2.0 ** np.arange(11)
    error = h**2
    error[5] = np.nan
    assert metrics.order(h, error).first == h[6]


def test_three_points_are_enough_for_an_order():
    o = metrics.order(H[:3], H[:3] ** 2)
    assert (o.points, o.value) == (3, pytest.approx(2))
