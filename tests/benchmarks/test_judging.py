"""The judges of statements: thresholds, controls, conditions, and the worst of several."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.talks import general, judging
from phasebench.benchmarks.experiments.talks.judging import CONTRADICTED, HOLDS, MISSING, WHERE


def test_a_control_that_does_not_fail_is_no_proof():
    row = {"check": "poincare", "value": 1e-14, "control": 1e-14, "what": "a", "against": "b"}
    judge = judging.check("poincare", 1e-10)
    assert judge(lambda name: pd.DataFrame([row])).verdict == CONTRADICTED
    assert judge(lambda name: pd.DataFrame([row | {"control": 0.1}])).verdict == HOLDS
    assert judge(lambda name: pd.DataFrame([row | {"value": float("nan")}])).verdict == MISSING


def of(**columns):
    """data of one table for every name."""
    return lambda name: pd.DataFrame(columns)


EQUIP = {"id": "equip-box", "two-form, round-off": 1e-16}
WAVE = {"method": "scheme-iv", "status": "ok", "h": 0.1, "t_end": 10.0, "fallbacks": 0}
STEPS = {"scheme": "scheme-iv", "status": "ok", "without a root": 0, "steps": 100}
KEPLER = {"scheme": "scheme-v", "problem": "perturbed-kepler"}
#: (judge, rows up to the threshold, rows beyond it)
EDGES = {
    "printed": (judging.printed("avf", 2), {"units": [0.5, 0.59]}, {"units": [0.5, 0.61]}),
    "an entry is missing": (judging.printed("avf", 2), {"units": [0.5, 0.5]}, {"units": [0.5]}),
    "order above": (judging.order(["avf"], 2), {"order": [2.0, 2.09]}, {"order": [2.0, 2.11]}),
    "order below": (judging.order(["avf"], 2), {"order": [2.0, 1.91]}, {"order": [2.0, 1.89]}),
    "defect": (judging.has(["avf"], "symmetry"), {"defect": [0.0, 9e-26]}, {"defect": [0.0, 2e-25]}),
    "no defect": (judging.has(["avf"], "symmetry", False), {"defect": [1.0, 2e-25]}, {"defect": [1.0, 9e-26]}),
    "energy": (judging.keeps_energy(["avf", "pavf"]), {"energy": [0.0, 9e-12]}, {"energy": [0.0, 2e-11]}),
    "two-form": (general.box("two-form", 10.0), EQUIP | {"two-form": [9e-16]}, EQUIP | {"two-form": [0.0, 2e-15]}),
    "total": (
        general.box("total energy error", 1e-11),
        EQUIP | {"total energy error": [9e-12]},
        EQUIP | {"total energy error": [2e-11]},
    ),
    "roots": (
        general.roots("scheme-iv"),
        WAVE | STEPS | {"energy error, steps with a root": [1e-12], "energy error": 0},
        WAVE | STEPS | {"energy error, steps with a root": [2e-11], "energy error": 0},
    ),
    "roots on waves": (
        general.roots("scheme-iv"),
        WAVE | STEPS | {"energy error": [1e-12], "energy error, steps with a root": 0},
        WAVE | STEPS | {"energy error": [2e-11], "energy error, steps with a root": 0},
    ),
    "mass": (
        general.nls_mass,
        WAVE | {"invariant": "mass", "invariant error": [9e-12]},
        WAVE | {"invariant": "mass", "invariant error": [2e-11]},
    ),
    "charge": (
        general.charge,
        WAVE | KEPLER | {"invariant": "charge", "invariant error": [9e-12], "angular momentum error": 0},
        WAVE | KEPLER | {"invariant": "charge", "invariant error": [0.0], "angular momentum error": 2e-11},
    ),
}
WHOSE = {
    "scheme": "avf",
    "method": "avf",
    "property": "symmetry",
    "problem": "henon-heiles",
}


@pytest.mark.parametrize("name", EDGES)
def test_thresholds_are_where_they_are_said_to_be(name):
    judge, good, bad = EDGES[name]
    for rows, expected in ((good, HOLDS), (bad, CONTRADICTED)):
        size = next(len(v) for v in rows.values() if isinstance(v, list))
        columns = {"order": [2.0] * size} | WHOSE | rows
        assert judge(of(**columns)).verdict == expected


def fixed(verdict, text="1"):
    return lambda data: judging.Judgement(verdict, text)


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((HOLDS, HOLDS), HOLDS),
        ((HOLDS, WHERE), WHERE),
        ((WHERE, CONTRADICTED), CONTRADICTED),
        ((HOLDS, MISSING), MISSING),
        ((CONTRADICTED, MISSING), MISSING),
    ],
)
def test_the_worst_of_several_counts(parts, expected):
    assert judging.every(*map(fixed, parts))(None).verdict == expected


@pytest.mark.parametrize(
    ("inside", "outside", "expected"),
    [
        (HOLDS, CONTRADICTED, WHERE),
        (HOLDS, HOLDS, HOLDS),
        (CONTRADICTED, CONTRADICTED, CONTRADICTED),
        (CONTRADICTED, HOLDS, CONTRADICTED),
        (HOLDS, MISSING, MISSING),
    ],
)
def test_a_condition_is_told(inside, outside, expected):
    found = judging.where(fixed(inside), fixed(outside), "x > 0")(None)
    assert found.verdict == expected
    assert ("x > 0" in found.measured) == (expected == WHERE)
