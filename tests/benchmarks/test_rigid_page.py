"""The page of methods for rigid bodies: its verdicts follow the rows; angles and orders."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.experiments.rigid import measure, page
from phasebench.benchmarks.measure.orders import successive
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS
from support.pages import outcomes

ROW = {"bodies": True, "orthogonality": 1e-16, "momentum": 1e-16, "h": 0.1, "order": 2.0, "declared": 2}
ATTITUDE = [
    ROW | {"method": "rigid-dlm", "problem": measure.FREE},
    ROW | {"method": "rigid-dlm", "problem": measure.TOP, "momentum": np.nan},
    ROW | {"method": "rk4", "problem": measure.FREE, "bodies": False, "orthogonality": 1e-5, "order": 4.0},
]
SYMMETRY = [{"delta": d, "axes": 1e-2, "top": d * 1e-2} for d in (0.1, 0.01, 0.001)]
ENERGY = [
    {"method": "rigid-dlm", "symplectic": True, "status": "ok", "first": 1.0, "all": 1.1, "steps": 10},
    {"method": "lie-midpoint", "symplectic": False, "status": "ok", "first": 1.0, "all": 1.2, "steps": 10},
]


def judged(attitude=ATTITUDE, symmetry=SYMMETRY, energy=ENERGY):
    tables = {measure.ATTITUDE: attitude, measure.SYMMETRY: symmetry, measure.ENERGY: energy}
    return outcomes(page.PAGE.verdicts, tables)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [PASS, PASS, PASS, PASS, PASS]),
        ({"attitude": [ATTITUDE[0] | {"momentum": 1e-9}, *ATTITUDE[1:]]}, [FAIL, PASS, PASS, PASS, PASS]),
        ({"attitude": [*ATTITUDE[:2], ATTITUDE[2] | {"orthogonality": 1e-15}]}, [PASS, FAIL, PASS, PASS, PASS]),
        ({"attitude": [ATTITUDE[0] | {"order": 1.5}, *ATTITUDE[1:]]}, [PASS, PASS, FAIL, PASS, PASS]),
        ({"symmetry": [r | {"top": 1e-3} for r in SYMMETRY]}, [PASS, PASS, PASS, FINDING, PASS]),
        ({"energy": [ENERGY[0], ENERGY[1] | {"all": 9.0}]}, [PASS, PASS, PASS, PASS, FINDING]),
    ],
)
def test_verdicts_follow_the_rows(changed, expected):
    assert judged(**changed) == expected


def test_an_angle_is_that_of_the_turn_between_attitudes():
    half = np.radians(15.0)
    q, turn = np.array([1.0, 0, 0, 0]), np.array([np.cos(half), 0, np.sin(half), 0])
    assert measure.angle(q, turn) == pytest.approx(30.0, rel=1e-14)
    assert measure.angle(q, -3 * turn) == pytest.approx(30.0, rel=1e-14), "the same attitude"
    assert measure.angle(q, q) == 0


def test_orders_stop_where_rounding_is_seen():
    found = successive([1e-2, 2.5e-3, 1e-12], [1e-11] * 3)
    assert np.isnan([found[0], found[2]]).all()
    assert found[1] == pytest.approx(2)
