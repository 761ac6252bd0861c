"""Metrics on synthetic data with known answers, defects of maps, and how an invariant's series is judged."""

from __future__ import annotations

import gmpy2
import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import conservation, linear_stability, metrics, step_map
from phasebench.integrators.compile import codegen

H = 0.1 / 2.0 ** np.arange(10)

# -- orders ------------------------------------------------------------------------------------------------------------


def without(*places, errors=H**2):
    """Errors of order 2 of which some are unknown."""
    errors = errors.copy()
    errors[list(places)] = np.nan
    return errors


@pytest.mark.parametrize(
    ("h", "error", "more", "value", "points", "first"),
    [
        (H, 3 * H**2, {}, 2, 10, H[0]),
        (H[::-1], H[::-1] ** 2, {}, 2, 10, H[0]),
        (H[:3], H[:3] ** 2, {}, 2, 3, H[0]),
        (H, without(4), {}, 2, 5, H[5]),  # the window ends there
        (0.1 / 2.0 ** np.arange(11), without(5, errors=(0.1 / 2.0 ** np.arange(11)) ** 2), {}, 2, 5, 0.1 / 64),
        (H, np.where(np.arange(10) == 9, np.inf, without(0)), {}, 2, 8, H[1]),
        (H, np.maximum(H, H[4]) ** 2, {"noise": 1.5 * H[4] ** 2}, 2, 4, H[0]),
        (H, np.maximum(H, H[4]) ** 2, {}, 0, 6, H[4]),  # the control: the constant errors of round-off fit best
        (H, np.concatenate([np.full(6, 1.0), H[6:] ** 2]), {"ceiling": 0.5}, 2, 4, H[6]),
        (H, np.concatenate([np.full(6, 1.0), H[6:] ** 2]), {}, 0, 6, H[0]),
    ],
)
def test_order_of_a_window(h, error, more, value, points, first):
    found = metrics.order(h, error, **more)
    assert found.value == pytest.approx(value, abs=1e-9)
    assert (found.points, found.first) == (points, pytest.approx(first, rel=1e-15))


@pytest.mark.parametrize("p", [1, 2, 4, 6])
def test_order_excludes_coarse_steps_and_round_off(p):
    h = 0.2 / 1.5 ** np.arange(16)
    noise = 10.0 ** (-2 * p - 4)
    error = h**p * (1 + 60 * h**2) + noise * (1 + 0.3 * np.sin(37.0 * np.arange(len(h))))
    o = metrics.order(h, error, noise=10 * noise)
    assert abs(o.value - p) < 0.1
    assert o.first < h[0]
    assert o.points >= 3
    assert abs(np.polyfit(np.log(h), np.log(error), 1)[0] - p) > 0.1, "the control: all points together mislead"


def test_order_of_too_few_points_is_nan():
    o = metrics.order(H, np.where(np.arange(len(H)) < 2, H**2, 0.0))
    assert o.points == 0
    assert np.isnan(o.value)
    with pytest.raises(ValueError, match="at least 3"):
        metrics.slope([0, 1], [0, 1])


def test_slope_interval_covers_the_truth():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        s = metrics.slope(np.log(H), np.log(H**2) + 0.1 * rng.standard_normal(len(H)))
        inside += s.low <= 2 <= s.high
    assert 0.9 < inside / 200 < 0.99


def test_errors_of_an_invariant_and_differences():
    e = metrics.invariant_error(np.array([2.0, 2.5, 1.0, 1.75]))
    assert (e.max, e.end) == (1.0, -0.25)
    assert np.isnan(metrics.invariant_error(np.array([2.0, np.nan, 2.0])).max)
    assert metrics.refinement_difference([1.0, 2.0, 3.0], [1.5, 2.0, 2.25]) == 0.75


def test_conservation_of_a_drifting_invariant():
    t = np.linspace(0.0, 100.0, 401)
    drifts = conservation.conservation(t, 5.0 + 1e-3 * t + 1e-4 * np.sin(3 * t), 2.0)
    assert drifts["value"] == pytest.approx(0.1, rel=0.01)
    assert drifts["low"] <= 1e-3 <= drifts["high"]
    assert (drifts["time"], drifts["scale"]) == (100.0, 2.0)
    assert abs(conservation.conservation(t, 5.0 + 1e-4 * np.sin(3 * t), 2.0)["slope"]) < 1e-6


# -- defects of maps ---------------------------------------------------------------------------------------------------


def rotation(angle):
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def shear(*more):
    out = np.eye(4)
    out[:2, 2:] = [[1.0, 0.3 + sum(more)], [0.3, -2.0]]
    return out


@pytest.mark.parametrize(
    ("matrix", "defect"),
    [
        (shear(), 0),
        (shear(0.5), 0.5),  # not symmetric
        (rotation(0.7), 0),
        (1.1 * rotation(0.7), 0.21),
        (np.diag([2.0, 0.5, 1.0, 1.0]), 1),  # it keeps the volume, which is not enough
        (np.diag([2.0, 1.0, 0.5, 1.0]), 0),
    ],
)
def test_symplecticity_defect_of_a_matrix(matrix, defect):
    assert step_map.symplecticity_defect(matrix) == pytest.approx(defect, abs=1e-15)


def test_jacobian():
    y = np.array([0.3, -0.8])
    exact = np.array([[np.cos(0.3) * -0.8, np.sin(0.3)], [3 * 0.3**2, 0], [0, 1]])
    found = step_map.jacobian(lambda y: np.array([np.sin(y[0]) * y[1], y[0] ** 3, y[1]]), y)
    assert np.abs(found - exact).max() < 1e-11
    with mpmath.workdps(40):
        z = np.array([mpmath.mpf("0.3"), mpmath.mpf("-0.8")], dtype=object)
        delta = mpmath.mp.eps ** mpmath.mpf("0.2")
        M = step_map.jacobian(lambda x: np.array([mpmath.sin(x[0]) * x[1]]), z, delta=delta)
        assert abs(M[0, 0] - mpmath.cos(z[0]) * z[1]) < 1e-30


def kick_and_drift(sin, cos):
    """A kick and a drift of two coupled pendulums, a symplectic map of y = (q, p), array (4,)."""

    def step(y):
        q, p = y[:2], y[2:]
        p = p - np.array([sin(q[0]) * cos(q[1]), sin(q[1]) * cos(q[0])]) / 10
        return np.concatenate([q + p / 10, p])

    return step


def stretch(*by):
    """The diagonal linear map with these factors."""
    return lambda y: codegen.vector(by) * y


def test_pair_defect_vanishes_only_for_symplectic_maps():
    with codegen.precision(30):
        y = codegen.vector(("0.3", "-0.8", "1.1", "0.5"))
        assert step_map.pair_defect(kick_and_drift(gmpy2.sin, gmpy2.cos), y) < 1e-17
        assert step_map.pair_defect(stretch(2, 4, 0.5, 0.25), y) < 1e-17
        once, twice = (float(step_map.pair_defect(stretch(k, 1, 1, 1), y)) for k in (2, 3))
        assert 0 < once <= 1
        assert twice == pytest.approx(2 * once, rel=1e-9)
        assert step_map.pair_defect(stretch(2, 0.5, 4, 0.25), y) > 0.01, "the control: volume is not enough"
    y, pairs = y.astype(float), np.random.default_rng(3).uniform(0.5, 1.0, (3, 2, 4))
    assert max(step_map.pair_symplecticity(kick_and_drift(np.sin, np.cos), y, pairs, 1e-3, 2e-3)) < 1e-11
    value, noise = step_map.pair_symplecticity(lambda x: np.array([2, 0.5, 4, 0.25]) * x, y, pairs, 1e-3, 2e-3)
    assert value > 0.01 > 1e-11 > noise
    assert np.isnan(step_map.pair_symplecticity(lambda x: np.nan * x, y, pairs, 1e-3)[0])


def test_symplecticity_has_a_defect_and_a_noise():
    shear, y = np.array([[1.0, 0.3], [0.0, 1.0]]), np.array([0.4, -0.2])
    assert max(step_map.symplecticity(lambda x: shear @ x, y, 1e-3, 2e-3)) < 1e-12
    value, noise = step_map.symplecticity(lambda x: 1.1 * shear @ x, y, 1e-3, 2e-3)
    assert value == pytest.approx(0.21)
    assert noise < 1e-12
    rough = step_map.symplecticity(lambda x: x + 1e-6 * np.sin(1e4 * x), y, 1e-3, 2e-3)
    assert rough[1] > 1e-5, "what differences cannot tell is noise"


def test_return_distance_is_relative_to_the_state():
    there, back, y = (lambda x: 2 * x), (lambda x: x / 2 + [0.0, 0.5]), np.array([3.0, 4.0])
    assert step_map.return_distance(there, back, y) == 0.5
    assert step_map.return_distance(there, back, y, sizes=np.array([1.0, 5.0])) == pytest.approx(0.1)


def test_two_steps_are_the_square_of_one_matrix():
    assert linear_stability.is_square(rotation(0.3), rotation(0.6))
    assert not linear_stability.is_square(rotation(0.3), rotation(0.6) + 2e-9)
