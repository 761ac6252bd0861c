"""The page of methods for constraints: its verdicts follow the rows; the plain RATTLE of its tolerances."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.experiments.constraints import measure, page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from support.pages import outcomes

ROW = {"problem": measure.SPHERE, "bound": True, "constraint": 1e-16, "hidden constraint": 1e-16, "error": 1e-15}
MANIFOLD = [
    ROW | {"method": "rattle"},
    ROW | {"method": "shake", "hidden constraint": 1e-4},
    ROW | {"method": "rk4", "bound": False, "constraint": 1e-5},
    ROW | {"method": "lobatto-iiia-iiib-constrained-6", "problem": measure.CARTESIAN},
]
DRIFT = [{"method": "rattle", "problem": measure.SPHERE, "low": -1e-18, "high": 1e-18, "slope": 0.0, "steps": 10}]
LOOSE = [{"tolerance": 1e-4, "slope": -1e-7}]


def judged(manifold=MANIFOLD, drift=DRIFT, loose=LOOSE):
    tables = {measure.MANIFOLD: manifold, measure.DRIFT: drift, measure.TOLERANCE: loose}
    return outcomes(page.PAGE.verdicts, tables)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [PASS, PASS, PASS, PASS, FINDING]),
        ({"manifold": [MANIFOLD[0] | {"constraint": 1e-9}, *MANIFOLD[1:]]}, [FAIL, PASS, PASS, PASS, FINDING]),
        (
            {"manifold": [*MANIFOLD[:2], MANIFOLD[2] | {"constraint": 1e-16}, MANIFOLD[3]]},
            [PASS, FAIL, PASS, PASS, FINDING],
        ),
        ({"manifold": [*MANIFOLD[:3], MANIFOLD[3] | {"error": 1e-9}]}, [PASS, PASS, FAIL, PASS, FINDING]),
        ({"drift": [DRIFT[0] | {"low": -1e-9, "high": 1e-9}]}, [PASS, PASS, PASS, PASS, FINDING]),
        ({"drift": [*DRIFT, DRIFT[0] | {"low": 1e-10, "high": 1e-9}]}, [PASS, PASS, PASS, FAIL, FINDING]),
        ({"loose": [LOOSE[0] | {"slope": 1e-17}]}, [PASS, PASS, PASS, PASS, PASS]),
    ],
)
def test_verdicts_follow_the_rows(changed, expected):
    assert judged(**changed) == expected


def test_plain_rattle_iterated_to_round_off_is_rattle():
    made = problem(measure.SPHERE)
    energy, iterations = measure.loose_rattle.py_func(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-15)
    s = integrate(made, "rattle", h=0.05, steps=20)
    assert np.abs(energy - s.energy()).max() < 1e-14
    loose, fewer = measure.loose_rattle.py_func(np.array(made.q0), np.array(made.p0), 0.05, 20, 1, 1e-4)
    assert np.abs(loose - s.energy()).max() > 1e-9
    assert fewer < iterations


def test_gauss_s_stages_in_lanes_run_with_five_constraints():
    butane = problem("butane")
    ends = [integrate(butane, id, h=0.01, steps=20) for id in ("gauss-6", "dop853")]
    assert all(s.status == "ok" for s in ends)
    assert np.abs(ends[0].q[-1] - ends[1].q[-1]).max() < 1e-12
    assert np.abs(ends[0].q[-1] - butane.q0).max() > 1e-2
