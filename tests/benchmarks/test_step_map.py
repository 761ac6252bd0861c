"""Defects of maps with known answers and controls; how a time series of an invariant is judged."""

from __future__ import annotations

import gmpy2
import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import conservation, linear_stability, step_map
from phasebench.integrators.compile import codegen


def _rotation(angle):
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def test_symplecticity_defect():
    shear = np.eye(4)
    shear[:2, 2:] = [[1.0, 0.3], [0.3, -2.0]]
    assert step_map.symplecticity_defect(shear) < 1e-15
    assert step_map.symplecticity_defect(_rotation(0.7)) < 1e-15
    shear[0, 3] += 0.5
    assert step_map.symplecticity_defect(shear) == pytest.approx(0.5), "the control: that shear is not symmetric"
    assert step_map.symplecticity_defect(1.1 * _rotation(0.7)) == pytest.approx(0.21)
    with pytest.raises(ValueError, match="shape"):
        step_map.symplecticity_defect(np.eye(3))


def test_symplecticity_defect_needs_more_than_volume():
    area = np.diag([2.0, 0.5, 1.0, 1.0])
    assert np.linalg.det(area) == 1
    assert step_map.symplecticity_defect(area) == pytest.approx(1), "volume is not enough"
    assert step_map.symplecticity_defect(np.diag([2.0, 1.0, 0.5, 1.0])) == 0


def test_jacobian():
    def f(y):
        return np.array([np.sin(y[0]) * y[1], y[0] ** 3, y[1]])

    y = np.array([0.3, -0.8])
    exact = np.array([[np.cos(0.3) * -0.8, np.sin(0.3)], [3 * 0.3**2, 0], [0, 1]])
    assert np.abs(step_map.jacobian(f, y) - exact).max() < 1e-11
    with mpmath.workdps(40):
        z = np.array([mpmath.mpf("0.3"), mpmath.mpf("-0.8")], dtype=object)
        M = step_map.jacobian(
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
    assert step_map.reversibility_defect(verlet, y) < 1e-15
    assert step_map.reversibility_defect(euler, y) > 1e-4


def _kick_and_drift(y):
    """A kick and a drift of two coupled pendulums, a symplectic map of y = (q, p), array (4,)."""
    q, p = y[:2], y[2:]
    p = p - np.array([gmpy2.sin(q[0]) * gmpy2.cos(q[1]), gmpy2.sin(q[1]) * gmpy2.cos(q[0])]) / 10
    return np.concatenate([q + p / 10, p])


def _stretch(*by):
    """The diagonal linear map with these factors."""
    return lambda y: codegen.vector(by) * y


def test_pair_defect_vanishes_only_for_symplectic_maps():
    with codegen.precision(30):
        y = codegen.vector(("0.3", "-0.8", "1.1", "0.5"))
        assert step_map.pair_defect(_kick_and_drift, y) < 1e-17, "differences over the cube root of the round-off"
        assert step_map.pair_defect(_stretch(2, 4, 0.5, 0.25), y) < 1e-17
        once, twice = (float(step_map.pair_defect(_stretch(k, 1, 1, 1), y)) for k in (2, 3))
        assert 0 < once <= 1
        assert twice == pytest.approx(2 * once, rel=1e-9)
        assert step_map.pair_defect(_stretch(2, 0.5, 4, 0.25), y) > 0.01, "the control: volume is not enough"


def test_symplecticity_has_a_defect_and_a_noise():
    shear, y = np.array([[1.0, 0.3], [0.0, 1.0]]), np.array([0.4, -0.2])
    value, noise = step_map.symplecticity(lambda x: shear @ x, y, 1e-3, 2e-3)
    assert max(value, noise) < 1e-12
    value, noise = step_map.symplecticity(lambda x: 1.1 * shear @ x, y, 1e-3, 2e-3)
    assert value == pytest.approx(0.21)
    assert noise < 1e-12
    assert step_map.symplecticity(lambda x: shear @ x, y, 1e-3)[1] == 0, "of one displacement nothing changes"
    rough = step_map.symplecticity(lambda x: x + 1e-6 * np.sin(1e4 * x), y, 1e-3, 2e-3)
    assert rough[1] > 1e-5, "what differences cannot tell is noise"


def test_symplecticity_from_pairs_of_vectors():
    y, pairs = np.array([0.3, -0.8, 1.1, 0.5]), np.random.default_rng(3).uniform(0.5, 1.0, (3, 2, 4))

    def kicked(y):
        p = y[2:] - 0.1 * np.sin(y[:2]) * np.cos(y[1::-1])
        return np.concatenate([y[:2] + 0.1 * p, p])

    assert max(step_map.pair_symplecticity(kicked, y, pairs, 1e-3, 2e-3)) < 1e-11
    value, noise = step_map.pair_symplecticity(lambda x: np.array([2, 0.5, 4, 0.25]) * x, y, pairs, 1e-3, 2e-3)
    assert value > 0.01, "the control: volume is not enough"
    assert noise < 1e-11
    assert np.isnan(step_map.pair_symplecticity(lambda x: np.nan * x, y, pairs, 1e-3)[0])


def test_return_distance_is_relative_to_the_state():
    there, back, y = (lambda x: 2 * x), (lambda x: x / 2 + [0.0, 0.5]), np.array([3.0, 4.0])
    assert step_map.return_distance(there, back, y) == 0.5
    assert step_map.return_distance(there, back, y, sizes=np.array([1.0, 5.0])) == pytest.approx(0.1)
    assert step_map.return_distance(there, lambda x: x / 2, y) == 0


def test_conservation_of_a_drifting_invariant():
    t = np.linspace(0.0, 100.0, 401)
    drifts = conservation.conservation(t, 5.0 + 1e-3 * t + 1e-4 * np.sin(3 * t), 2.0)
    assert drifts["value"] == pytest.approx(0.1, rel=0.01)
    assert drifts["low"] <= 1e-3 <= drifts["high"]
    assert (drifts["time"], drifts["scale"]) == (100.0, 2.0)
    stays = conservation.conservation(t, 5.0 + 1e-4 * np.sin(3 * t), 2.0)
    assert abs(stays["slope"]) < 1e-6


def test_two_steps_are_the_square_of_one_matrix():
    one = _rotation(0.3)
    assert linear_stability.is_square(one, _rotation(0.6))
    assert not linear_stability.is_square(one, _rotation(0.6) + 2e-9)
