"""The metrics on synthetic data whose answer is known, each with a control that must fail."""

from __future__ import annotations

import gmpy2
import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import metrics
from phasebench.integrators.engine import codegen

H = 0.1 / 2.0 ** np.arange(10)


def test_order_of_a_pure_power():
    o = metrics.order(H, 3 * H**2)
    assert o.value == pytest.approx(2, abs=1e-12)
    assert (o.points, o.first, o.last) == (10, H[0], H[-1])


def test_order_needs_no_sorting():
    shuffled = np.random.default_rng(1).permutation(len(H))
    assert metrics.order(H[shuffled], H[shuffled] ** 3 * (1 + H[shuffled])) == metrics.order(H, H**3 * (1 + H))


@pytest.mark.parametrize("p", [1, 2, 4, 6])
def test_order_leaves_out_the_coarse_end_and_the_round_off(p):
    h = 0.2 / 1.5 ** np.arange(16)
    noise = 10.0 ** (-2 * p - 4)
    error = h**p * (1 + 60 * h**2) + noise * (1 + 0.3 * np.sin(37.0 * np.arange(len(h))))
    o = metrics.order(h, error, noise=10 * noise)
    assert abs(o.value - p) < 0.1
    assert o.first < h[0]
    assert o.points >= 3
    everything = np.polyfit(np.log(h), np.log(error), 1)[0]
    assert abs(everything - p) > 0.1, "the control: all points together mislead"


def test_order_interval_covers_the_truth():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        s = metrics.slope(np.log(H), np.log(H**2) + 0.1 * rng.standard_normal(len(H)))
        inside += s.low <= 2 <= s.high
    assert 0.9 < inside / 200 < 0.99


@pytest.mark.parametrize("kept", [0, 1, 2])
def test_order_of_too_few_points_is_unknown(kept):
    o = metrics.order(H, np.where(np.arange(len(H)) < kept, H**2, 0.0))
    assert o.points == 0
    assert np.isnan(o.value)


def test_order_leaves_out_what_is_not_finite_or_saturated():
    error = H**2
    error[0], error[-1] = np.nan, np.inf
    assert metrics.order(H, error).points == 8
    saturated = np.concatenate([np.full(6, 1.0), H[6:] ** 2])
    assert metrics.order(H, saturated, ceiling=0.5).value == pytest.approx(2)
    assert metrics.order(H, saturated).value == pytest.approx(0, abs=1e-9), "the control: the flat part fits as well"


def test_order_window_does_not_reach_across_a_rejected_point():
    error = H**2
    error[4] = np.nan
    o = metrics.order(H, error)
    assert (o.points, o.first) == (5, H[5])


def test_slope_refuses_two_points():
    with pytest.raises(ValueError, match="at least 3"):
        metrics.slope([0, 1], [0, 1])
    with pytest.raises(ValueError, match="shapes"):
        metrics.order([1, 2, 3], [1, 2])


def test_the_error_of_an_invariant_is_the_greatest_and_the_signed_last():
    e = metrics.invariant_error(np.array([2.0, 2.5, 1.0, 1.75]))
    assert (e.max, e.end) == (1.0, -0.25)
    assert np.isnan(metrics.invariant_error(np.array([2.0, np.nan, 2.0])).max)


def _rotation(angle):
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def test_symplecticity_defect():
    shear = np.eye(4)
    shear[:2, 2:] = [[1.0, 0.3], [0.3, -2.0]]
    assert metrics.symplecticity_defect(shear) < 1e-15
    assert metrics.symplecticity_defect(_rotation(0.7)) < 1e-15
    shear[0, 3] += 0.5
    assert metrics.symplecticity_defect(shear) == pytest.approx(0.5), "the control: that shear is not symmetric"
    assert metrics.symplecticity_defect(1.1 * _rotation(0.7)) == pytest.approx(0.21)
    with pytest.raises(ValueError, match="shape"):
        metrics.symplecticity_defect(np.eye(3))


def test_symplecticity_defect_keeps_q_and_p_apart():
    area = np.diag([2.0, 0.5, 1.0, 1.0])
    assert np.linalg.det(area) == 1
    assert metrics.symplecticity_defect(area) == pytest.approx(1), "volume is not enough"
    assert metrics.symplecticity_defect(np.diag([2.0, 1.0, 0.5, 1.0])) == 0


def test_jacobian():
    def f(y):
        return np.array([np.sin(y[0]) * y[1], y[0] ** 3, y[1]])

    y = np.array([0.3, -0.8])
    exact = np.array([[np.cos(0.3) * -0.8, np.sin(0.3)], [3 * 0.3**2, 0], [0, 1]])
    assert np.abs(metrics.jacobian(f, y) - exact).max() < 1e-11
    with mpmath.workdps(40):
        z = np.array([mpmath.mpf("0.3"), mpmath.mpf("-0.8")], dtype=object)
        M = metrics.jacobian(
            lambda x: np.array([mpmath.sin(x[0]) * x[1], x[0] ** 3, x[1]]), z, delta=mpmath.mp.eps ** mpmath.mpf("0.2")
        )
        assert abs(M[0, 0] - mpmath.cos(z[0]) * z[1]) < 1e-30


def test_reversibility_defect():
    def verlet(y, h=0.1):
        q, p = y[0], y[1] - h / 2 * np.sin(y[0])
        q = q + h * p
        return np.array([q, p - h / 2 * np.sin(q)])

    def euler(y, h=0.1):
        p = y[1] - h * np.sin(y[0])
        return np.array([y[0] + h * p, p])

    y = np.array([0.7, 0.4])
    assert metrics.reversibility_defect(verlet, y) < 1e-15
    assert metrics.reversibility_defect(euler, y) > 1e-4


def test_refinement_difference_is_the_maximum_norm():
    assert metrics.refinement_difference([1.0, 2.0, 3.0], [1.5, 2.0, 2.25]) == 0.75


def test_order_of_two_windows_alike_is_of_the_finer_one():
    h = 0.1 / 2.0 ** np.arange(11)
    error = h**2
    error[5] = np.nan
    assert metrics.order(h, error).first == h[6]


def test_three_points_are_enough_for_an_order():
    o = metrics.order(H[:3], H[:3] ** 2)
    assert (o.points, o.value) == (3, pytest.approx(2))


def _kicked(y):
    """A kick and a drift of two coupled pendulums, q and p of two components each."""
    q, p = y[:2], y[2:]
    p = p - np.array([gmpy2.sin(q[0]) * gmpy2.cos(q[1]), gmpy2.sin(q[1]) * gmpy2.cos(q[0])]) / 10
    return np.concatenate([q + p / 10, p])


def _stretched(*by):
    return lambda y: codegen.vector(by) * y


def test_pair_defect_is_none_of_a_symplectic_map_and_what_is_lost_of_another():
    with codegen.precision(30):
        y = codegen.vector(("0.3", "-0.8", "1.1", "0.5"))
        assert metrics.pair_defect(_kicked, y) < 1e-17, "differences over the cube root of the round-off"
        assert metrics.pair_defect(_stretched(2, 4, 0.5, 0.25), y) < 1e-17
        once, twice = (float(metrics.pair_defect(_stretched(k, 1, 1, 1), y)) for k in (2, 3))
        assert 0 < once <= 1
        assert twice == pytest.approx(2 * once, rel=1e-9)
        assert metrics.pair_defect(_stretched(2, 0.5, 4, 0.25), y) > 0.01, "the control: volume is not enough"
