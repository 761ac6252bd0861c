"""Verdicts on the talks' statements: thresholds, controls, conditions, and the worst of several."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.talks import general, judging
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE, Judgement


def test_check_needs_a_control_that_fails():
    row = {"check": "poincare", "value": 1e-14, "control": 1e-14, "what": "a", "against": "b"}
    judge = judging.check("poincare", 1e-10)
    assert judge(lambda name: pd.DataFrame([row])).verdict == CONTRADICTED
    assert judge(lambda name: pd.DataFrame([row | {"control": 0.1}])).verdict == HOLDS
    assert judge(lambda name: pd.DataFrame([row | {"value": float("nan")}])).verdict == MISSING


def of(**columns):
    """A page's data: a function that returns a table with these columns for every name."""
    return lambda name: pd.DataFrame(columns)


EQUIP = {"id": "equip-box", "two-form, round-off": 1e-16}
WAVE = {"method": "scheme-iv", "status": "ok", "h": 0.1, "t_end": 10.0, "fallbacks": 0}
BOTH = {"method": list(general.TUNED)}
PAIR = {"method": ["avf", "pavf"]}
STEPS = {"scheme": "scheme-iv", "status": "ok", "without a root": 0, "steps": 100}
KEPLER = {"scheme": "scheme-v", "problem": "perturbed-kepler"}
#: (judge, rows within the threshold, rows beyond it)
EDGES = {
    "printed": (judging.printed_entries("avf", 2), {"units": [0.5, 0.59]}, {"units": [0.5, 0.61]}),
    "an entry is missing": (judging.printed_entries("avf", 2), {"units": [0.5, 0.5]}, {"units": [0.5]}),
    "order above": (judging.order(["avf"], 2), {"order": [2.0, 2.09]}, {"order": [2.0, 2.11]}),
    "order below": (judging.order(["avf"], 2), {"order": [2.0, 1.91]}, {"order": [2.0, 1.89]}),
    "defect": (judging.has(["avf"], "symmetry"), {"defect": [0.0, 9e-23]}, {"defect": [0.0, 2e-22]}),
    "no defect": (judging.has(["avf"], "symmetry", False), {"defect": [1.0, 2e-22]}, {"defect": [1.0, 9e-23]}),
    "energy": (judging.keeps_energy(["avf", "pavf"]), PAIR | {"energy": [0.0, 9e-12]}, PAIR | {"energy": [0.0, 2e-11]}),
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
        WAVE | BOTH | {"invariant": "mass", "invariant error": [0.0, 9e-12]},
        WAVE | BOTH | {"invariant": "mass", "invariant error": [0.0, 2e-11]},
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
def test_thresholds(name):
    judge, good, bad = EDGES[name]
    for rows, expected in ((good, HOLDS), (bad, CONTRADICTED)):
        size = max(len(v) for v in rows.values() if isinstance(v, list))
        columns = {"order": [2.0] * size} | WHOSE | rows
        assert judge(of(**columns)).verdict == expected


# -- texts -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("judge", "rows", "text"),
    [
        (judging.has(["avf"], "symmetry"), {"defect": [0.0, 9e-26]}, "defect of symmetry up to 9.0e-26 (2 maps)"),
        (judging.has(["avf"], "symmetry", False), {"defect": [0.5]}, "defect of symmetry of avf at least 0.5 (1 map)"),
        (judging.order(["avf"], 2), {"order": [2.0, 1.91]}, "order 1.910 to 2.000 (2 measurements)"),
        (judging.order(["avf"], 2), {"order": [2.0]}, "order 2.000 (1 measurement)"),
        (
            judging.keeps_energy(["avf", "pavf"]),
            PAIR | {"energy": [1e-13, 2e-13]},
            "energy error on henon-heiles up to 2.0e-13 (2 methods)",
        ),
        (
            judging.printed_entries("avf", 3),
            {"units": [0.5, 0.6, 0.7], "order": [9.0, 2.0, float("nan")]},
            "2 of 3 entries within 0.6 of the last digit; measured order 2.00",
        ),
        (
            judging.printed_entries("avf", 1),
            {"units": [0.5], "order": [None]},
            "1 of 1 entries within 0.6 of the last digit",
        ),
    ],
)
def test_measured_text_names_the_quantity(judge, rows, text):
    assert judge(of(**WHOSE | rows)).measured == text


def test_incomplete_energies_are_missing():
    judge = judging.keeps_energy(["avf", "pavf"])
    assert judge(of(**WHOSE | {"energy": [1e-13]})).verdict == MISSING
    assert judge(of(**WHOSE | PAIR | {"energy": [1e-13, float("nan")]})).verdict == MISSING
    assert judge(lambda name: None).verdict == MISSING


MIDPOINT = {"method": ["implicit-midpoint", "avf", "gauss-2"], "problem": "toda", "energy": [1e-4, 1e-13, float("nan")]}


@pytest.mark.parametrize(
    ("columns", "verdict", "text"),
    [
        ({"symplecticity": [1e-30, 1.0, 1.0]}, HOLDS, "2 methods run; midpoint: energy error 1.0e-04, defect 1.0e-30"),
        ({"symplecticity": [1e-20, 0.0, 0.0]}, CONTRADICTED, "energy error 1.0e-04, defect 1.0e-20"),
        ({"symplecticity": float("nan")}, HOLDS, "2 methods run; midpoint: energy error 1.0e-04"),
        ({"symplecticity": float("nan"), "energy": 1e-3}, CONTRADICTED, "3 methods run"),
        ({"symplecticity": 0.0, "method": "avf"}, MISSING, ""),
        ({"symplecticity": 0.0, "problem": "other"}, MISSING, ""),
    ],
)
def test_midpoint_rule_decides_for_a_problem(columns, verdict, text):
    found = judging.system("toda")(of(**MIDPOINT | columns))
    assert found.verdict == verdict
    assert text in found.measured


CURVE = {"figure": "kepler", "panel": "a long", "curve": ["x", "y"], "status": "ok", "t_end": [50.0, 100.0]}


@pytest.mark.parametrize(
    ("judge", "values", "verdict", "text"),
    [
        (judging.curves("kepler", "energy_error", 0.5), [0.1, 0.5], HOLDS, "energy error up to 0.5"),
        (judging.curves("kepler", "energy_error", 0.5), [0.1, 0.6], CONTRADICTED, "energy error up to 0.6"),
        (judging.curves("kepler", "energy_error", 0.5, ["x"]), [0.1, 0.6], HOLDS, "x: energy error up to 0.1"),
        (
            judging.curves("kepler", "energy_error", 0.5, panel="long"),
            [0.1, 0.2],
            HOLDS,
            "long: energy error up to 0.2",
        ),
        (judging.curves("kepler", "energy_error", 0.5, panel="short"), [0.1, 0.2], MISSING, ""),
        (judging.curves("kepler", "energy_error", 0.5, above=True), [0.6, 0.7], HOLDS, "energy error at least 0.6"),
        (judging.curves("kepler", "energy_error", 0.5, above=True), [0.5, 9.0], CONTRADICTED, "at least 0.5"),
        (judging.curves("kepler", "largest", 0.5), [0.1, float("nan")], HOLDS, "error of invariants up to 0.1"),
        (judging.curves("kepler", "largest", 0.5, panel="long"), [0.1, 0.2], HOLDS, "error of long up to 0.2"),
        (judging.curves("kepler", "spread", 0.5, ["x"]), [0.1, 0.2], HOLDS, "spread up to 0.1"),
        (judging.curves("other", "spread", 0.5), [0.1, 0.2], MISSING, ""),
    ],
)
def test_curves_are_bounded_on_one_side(judge, values, verdict, text):
    columns = {"energy_error": values, "largest": values, "spread": values}
    found = judge(of(**CURVE | columns))
    assert (found.verdict, text in found.measured) == (verdict, True)
    assert found.measured == text or verdict == CONTRADICTED


def test_curves_of_lotka_volterra_name_their_invariant():
    judge = judging.curves("lotka-volterra", "energy_error", 0.5)
    assert (
        judge(of(**CURVE | {"figure": "lotka-volterra", "energy_error": [0.1, 0.2]})).measured
        == "change of I up to 0.2"
    )


def test_every_orbit_must_reach_its_end():
    judge = judging.completed_runs("kepler", 2)
    assert judge(of(**CURVE)) == Judgement(HOLDS, "2 of 2 orbits to t = 100")
    assert judge(of(**CURVE | {"status": ["ok", "diverged"]})) == Judgement(CONTRADICTED, "1 of 2 orbits to t = 100")
    assert judging.completed_runs("kepler", 3)(of(**CURVE)).verdict == CONTRADICTED
    assert judging.completed_runs("kepler", 1)(of(**CURVE)).verdict == HOLDS
    assert judge(of(**CURVE | {"figure": "other"})).verdict == MISSING


def test_check_and_its_control_have_separate_bounds():
    row = {"check": ["a"], "value": -2.0, "control": -3.0, "what": "x", "against": "y"}
    assert judging.check("a", 2.0)(of(**row)) == Judgement(HOLDS, "x: -2; y: -3")
    assert judging.check("a", 1.9)(of(**row)).verdict == CONTRADICTED
    assert judging.check("a", 2.0, least=3.0)(of(**row)).verdict == CONTRADICTED
    assert judging.check("a", 2.0, least=2.9)(of(**row)).verdict == HOLDS
    assert judging.check("b", 2.0)(of(**row)) == judging.NOTHING
    assert judging.untestable("no number")(None) == Judgement(UNTESTABLE, "no number")


def judge_constant(verdict, text="1"):
    return lambda data: Judgement(verdict, text)


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
def test_worst_of_several_verdicts_counts(parts, expected):
    assert judging.every(*map(judge_constant, parts))(None).verdict == expected


def test_thresholds_are_stated():
    for threshold in ("up to a defect of 1e-22 (40 digits)", "within 0.1", "kept up to 1e-11", "within 0.6 of its"):
        assert threshold in judging.KEPT_TEXT


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
def test_condition_is_stated(inside, outside, expected):
    found = judging.where(judge_constant(inside), judge_constant(outside), "x > 0")(None)
    assert found.verdict == expected
    assert ("x > 0" in found.measured) == (expected == WHERE)
