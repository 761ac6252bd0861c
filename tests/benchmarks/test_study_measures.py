"""What only a hand-made case shows of the measures of studies."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.studies import rigid

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
