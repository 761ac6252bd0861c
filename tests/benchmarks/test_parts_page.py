"""The page of splittings through many parts: its verdicts follow the rows."""

from __future__ import annotations

import pytest

from phasebench.benchmarks.experiments.parts import measure, page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS
from support.pages import outcomes

ROW = {"problem": "kerr", "split": True, "h": 1.0, "order": 4.0, "declared": 4, "error": 1e-6}
ACCURACY = [
    ROW | {"method": "abc-4", "error": 1e-9},
    ROW | {"method": "abc-yoshida-4"},
    ROW | {"method": "abc-2", "order": 2.0, "declared": 2},
    ROW | {"method": "implicit-midpoint", "split": False, "error": 2e-6},
]
ENERGY = [
    {"method": "abc-2", "problem": "kerr", "split": True, "status": "ok", "first": 1.0, "all": 1.1},
    {"method": "rk4", "problem": "kerr", "split": False, "status": "ok", "first": 1.0, "all": 9.0},
]


def judged(accuracy=ACCURACY, energy=ENERGY):
    return outcomes(page.PAGE.verdicts, {measure.ACCURACY: accuracy, measure.ENERGY: energy})


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [PASS] * 5),
        ({"energy": [ENERGY[0] | {"all": 3.0}, ENERGY[1]]}, [FINDING, PASS, PASS, PASS, PASS]),
        ({"energy": [ENERGY[0] | {"status": "diverged"}, ENERGY[1]]}, [FINDING, PASS, PASS, PASS, PASS]),
        ({"energy": [ENERGY[0], ENERGY[1] | {"all": 1.5}]}, [PASS, FAIL, PASS, PASS, PASS]),
        ({"accuracy": [ACCURACY[0] | {"order": 3.0}, *ACCURACY[1:]]}, [PASS, PASS, FAIL, PASS, PASS]),
        ({"accuracy": [ACCURACY[0] | {"error": 1e-7}, *ACCURACY[1:]]}, [PASS, PASS, PASS, FINDING, PASS]),
        ({"accuracy": [*ACCURACY[:3], ACCURACY[3] | {"error": 1e-7}]}, [PASS, PASS, PASS, PASS, FINDING]),
    ],
)
def test_verdicts_follow_the_rows(changed, expected):
    assert judged(**changed) == expected
