"""What only a hand-made case shows of the measures of studies."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies import constraints, rigid
from phasebench.integrators.driver import integrate

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
