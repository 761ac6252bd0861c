"""What only a hand-made case shows of the measures of studies."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies import constraints, hessian_free, rigid
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

# -- constraints -------------------------------------------------------------------------------------------------------


def test_plain_rattle_iterated_to_round_off_is_rattle():
    made = problem(constraints.SPHERE)
    plain = constraints.loose_rattle.py_func
    energy, iterations = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-15)
    s = integrate(made, "rattle", h=0.05, steps=20)
    assert np.abs(energy - s.energy()).max() < 1e-14
    loose, fewer = plain(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-4)
    assert np.abs(loose - s.energy()).max() > 1e-9
    assert fewer < iterations


# -- the energy without the Hessian ------------------------------------------------------------------------------------


def test_partners_have_the_structure_of_the_hessian_free_method():
    """Drifts, kicks and gradients stand at the same places."""
    for free, partner in hessian_free.WITH.items():
        shapes = [[tuple(bool(x) for x in row) for row in BY_ID[id].data[0]] for id in (free, partner)]
        assert shapes[0] == shapes[1], free


def test_chaotic_rows_show_the_drift_of_a_runge_kutta_method():
    rows = {m: hessian_free.chaotic(m, steps=20_000) for m in ("hessian-free-badab", "chin-4a", "rk4")}
    for m in ("hessian-free-badab", "chin-4a"):
        assert rows[m]["failed"] == 0
        assert abs(rows[m]["change"]) < 1e-5
    assert rows["rk4"]["high"] < 0
    assert rows["rk4"]["orbits"] == hessian_free.ORBITS


def test_the_interval_of_a_mean():
    """Student's, for 0, 1, 2: 1 +- 4.3027 / 3^(1/2)."""
    mean, low, high = hessian_free.student(np.array([0.0, 1.0, 2.0]))
    assert (mean, high - mean, mean - low) == pytest.approx((1.0, *[4.302652729911275 / np.sqrt(3)] * 2))


# -- rigid bodies ------------------------------------------------------------------------------------------------------


def test_an_angle_is_that_of_the_turn_between_attitudes():
    half = np.radians(15.0)
    q, turn = np.array([1.0, 0, 0, 0]), np.array([np.cos(half), 0, np.sin(half), 0])
    assert rigid.angle(q, turn) == pytest.approx(30.0, rel=1e-14)
    assert rigid.angle(q, -3 * turn) == pytest.approx(30.0, rel=1e-14), "the same attitude"
    assert rigid.angle(q, q) == 0


def test_orders_stop_where_rounding_is_seen():
    found = successive([1e-2, 2.5e-3, 1e-12], [1e-11] * 3)
    assert np.isnan([found[0], found[2]]).all()
    assert found[1] == pytest.approx(2)
