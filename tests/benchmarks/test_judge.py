"""The judge's thresholds on single fabricated rows of evidence, and the certificate's verdicts on fabricated tables."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.judge import checks, decide, evidence, judge
from phasebench.benchmarks.judge.checks import CHECKS
from phasebench.benchmarks.judge.decide import AUDIT, CERTIFICATE
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.requirements import ROUNDED
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, IN_PART, UNDERSTATED, UNJUDGED, Judgement, worst
from support.evidence import order_row, part

# -- evidence ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "own", "classical", "kept"),
    [
        (100.0, 1001.0, 1001.0, True),
        (100.1, 1001.0, 1001.0, False),
        (1.0, 1000.0, 1001.0, None),
        (1.0, 1001.0, 1000.0, None),
        (100.1, 1.0, 1.0, False),
    ],
)
def test_structure_is_kept_up_to_a_hundred_floors(value, own, classical, kept):
    row = {"value": value, "floor": 1.0, "own": own, "classical": classical}
    assert evidence.keeps_structure(row) is kept
    assert evidence.keeps_structure(row | {"status": "diverged"}) is None
    assert evidence.keeps_structure(row | {"floor": np.nan}) is None
    alone = {k: v for k, v in row.items() if k != "classical"}
    assert evidence.keeps_structure(alone) is (False if value > 100 else True if own > 1000 else None)


@pytest.mark.parametrize(
    ("slope", "half", "value", "bounded"),
    [
        (0.01, 0.001, 1.0, True),  # it adds up to a hundredth of the error
        (0.011, 0.001, 1.0, False),
        (-0.011, 0.001, 1.0, False),
        (0.9, 0.9, 1.0, True),  # 0 is an end of its interval
        (-0.9, 0.9, 1.0, True),
        (0.9, 0.89, 1.0, None),  # not clear
        (0.9, 0.37, 1.0, None),
        (0.9, 0.35, 1.0, False),
        (0.0, 0.01, 25.0, True),  # exactly a quarter of the energy scale
        (0.0, 0.01, 26.0, None),
        (14.0, 14.0, 26.0, None),
        (13.0, 0.01, 26.0, False),
        (1e-12, 0.0, 1e-11, True),  # round-off may drift
    ],
)
def test_error_is_bounded_or_drifts_by_its_slope(slope, half, value, bounded):
    row = {"slope": slope, "low": slope - half, "high": slope + half, "time": 1.0, "value": value, "scale": 100.0}
    row["steps"] = 1
    assert evidence.is_bounded(row) is bounded
    assert evidence.is_bounded(row | {"status": "diverged"}) is None
    assert evidence.is_bounded(row | {"slope": None}) is None
    longer = row | {"slope": slope / 8, "time": 8.0, "low": row["low"] / 8, "high": row["high"] / 8}
    assert evidence.is_bounded(longer) is bounded, "a slope is of a unit of time"


def test_round_off_grows_with_the_root_of_the_steps():
    row = {"scale": 3.0, "steps": 10_000}
    assert evidence.round_off(row) == pytest.approx(100 * 2.0**-52 * 3.0 * 100)
    assert evidence.round_off(row | {"steps": 400}) == pytest.approx(evidence.round_off(row) / 5)


@pytest.mark.parametrize(
    ("value", "half", "agrees"),
    [
        (2.09, 0.5, True),
        (1.91, 0.5, True),
        (3.0, 0.85, False),
        (3.0, 0.95, None),  # its interval reaches the claimed order
        (1.0, 0.85, False),
        (1.0, 0.95, None),
        (2.5, 0.01, None),  # between two orders
        (3.09, 0.01, False),
        (3.11, 0.01, None),
    ],
)
def test_order_agrees_or_differs(value, half, agrees):
    row = {"value": value, "low": value - half, "high": value + half}
    assert evidence.agrees(row, 2) is agrees
    assert evidence.agrees(row | {"status": "diverged"}, 2) is None
    assert evidence.agrees(row | {"value": np.nan}, 2) is None


@pytest.mark.parametrize(("value", "low", "high"), [(3.0, 2 + 0.1, 3.9), (1.0, 0.1, 2 - 0.1), (0.1, 0.0, 0.2)])
def test_interval_that_reaches_the_gate_gives_no_verdict(value, low, high):
    assert evidence.agrees({"value": value, "low": low, "high": high}, 2) is None


def test_missing_value_of_a_row():
    row = {"a": 1.0, "b": np.nan, "c": None, "d": 3}
    assert [k for k in "abcde" if evidence.has(row, k)] == ["a", "d"]


# -- verdicts of a certificate -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("order", 4, "order 4"),
        ("stability", 2.5, "stability 2.5"),
        ("tolerance", 50, "tolerance 50"),
        ("energy", "bounded", "energy: bounded"),
        ("bilinear", "preserved", "bilinear invariants: preserved"),
        ("symplectic", True, "symplectic"),
        ("symmetric", False, "not symmetric"),
    ],
)
def test_text_of_a_claim(name, value, words):
    assert CHECKS[name].claim(value) == words


def test_json_of_a_verdict():
    whole = Judgement(HOLDS, 2.01, (2.0, 2.02), ("tao",), "so", "order", "order 2")
    assert whole.row() == {
        "claim": "order 2", "verdict": "holds", "measured": 2.01, "interval": [2.0, 2.02], "on": ["tao"], "why": "so",
    }  # fmt: skip
    assert Judgement(UNJUDGED).row()["interval"] is None
    assert Judgement(UNJUDGED).row()["verdict"] == "not-judged"
    assert Tables().of("order") == []


@pytest.mark.parametrize(
    ("limit", "claimed", "verdict"),
    [
        (201.0, 200.0, HOLDS),  # off by 0.5 %
        (201.1, 200.0, CONTRADICTED),
        (198.9, 200.0, CONTRADICTED),
        (None, 9.94, CONTRADICTED),
        (None, 9.96, UNJUDGED),
        (None, 10.0 * (1 - checks.NEAR), UNJUDGED),
    ],
)
def test_stability_limit_within_the_scanned_range(limit, claimed, verdict):
    row = {"on": "oscillator", "limit": limit, "scanned": 10.0, "reason": ""}
    found = checks.stability(claimed, Tables({"stability": [row]}))
    told = "stable as far as h omega = 10" if limit is None else "" if verdict == HOLDS else f"the limit is {limit:.6g}"
    assert (found.verdict, found.measured, found.why) == (verdict, limit, told)


def test_order_one_has_no_coefficient_to_check():
    found = checks.order(1, Tables({"order": [order_row("a", 1.0, terms=(1e-17, 0.3))]}))
    assert found.verdict == HOLDS
    assert (found.measured, found.interval, found.on) == (1.0, (0.99, 1.01), ("a",))


def test_nonzero_low_order_terms_contradict_an_order():
    higher = order_row("b", 4.0, False, terms=(1e-17, 1e-17, 1e-3, 1e-17, 0.3))
    assert checks.order(2, Tables({"order": [order_row("a", 2.0), higher]})).verdict == HOLDS
    cut = [order_row(on, 2.0, terms=(1e-17, size, 0.3)) for on, size in (("z", 1e-11), ("a", 1e-9), ("y", 1e-10))]
    found = checks.order(2, Tables({"order": cut}))
    assert (found.verdict, found.on) == (CONTRADICTED, ("a",))
    assert "a term of 1.0e-09 is left: coefficients of 9 digits" in found.why
    just = order_row("a", 2.0, terms=(1e-17, ROUNDED, 0.3))
    assert checks.order(2, Tables({"order": [just]})).verdict == HOLDS


@pytest.mark.parametrize(("open_", "verdict"), [(1, HOLDS), (2, HOLDS), (3, UNJUDGED)])
def test_order_needs_half_of_the_systems_of_each_kind(open_, verdict):
    rows = [order_row(f"s{k}", 2.5 if k < open_ else 2.0, separable) for separable in (True, False) for k in range(4)]
    assert checks.order(2, Tables({"order": rows})).verdict == verdict
    one_kind = rows[:4] + [order_row(f"t{k}", 2.0, False) for k in range(4)]
    assert checks.order(2, Tables({"order": one_kind})).verdict == verdict


def test_worst_of_all_tolerances_counts():
    rows = [
        {"on": "a", "tolerances": [1e-4, 1e-8], "errors": [3e-4, 1e-8]},
        {"on": "b", "tolerances": [1e-4, 1e-8], "errors": [1e-4, 5e-8]},
    ]
    found = checks.tolerance(5.0000001, Tables({"tolerance": rows}))
    assert found.verdict == HOLDS
    assert (found.on, found.measured) == (("b",), pytest.approx(5.0))
    assert checks.tolerance(4.9, Tables({"tolerance": rows})).verdict == CONTRADICTED


def test_measured_properties_are_offered_as_claims():
    kept = {"on": "a", "value": 1e-16, "floor": 1e-13, "own": 1e-2, "h": 0.5, "separable": True}
    long = {"on": "a", "status": "ok", "reason": "", "energy": part(1e-4, 2e-7), "bilinear": part(1e-14)}
    orders = [order_row("a", 2.0), order_row("b", 4.0, False)]
    tables = Tables({"order": orders, "symplectic": [kept], "symmetric": [kept | {"value": 1.0}], "long": [long]})
    # A symplectic defect at its floor is not offered if the energy drifts.
    assert judge.offers({}, tables) == ["order=2", "energy=drift", "bilinear=preserved"]
    claims = {"order": 2, "symplectic": True, "energy": "bounded", "bilinear": "preserved"}
    assert judge.offers(claims, tables) == []
    assert judge.offers({}, Tables({"order": [order_row("a", 0.01)]})) == []
    assert judge.offers({}, Tables({"order": [order_row("a", 0.01), order_row("b", 2.0, False)]})) == []
    assert judge.offers({}, Tables({"order": [order_row("a", 1.0)]})) == ["order=1"]
    bounded = Tables({"long": [long | {"energy": part(1e-4), "bilinear": part(1e-4)}]})
    assert judge.offers({}, bounded) == ["energy=bounded"]


@pytest.mark.parametrize(
    ("name", "verdict", "measured", "gross"),
    [
        ("runs", CONTRADICTED, None, "it does not run"),
        ("stateless", CONTRADICTED, None, ""),
        ("consistent", UNJUDGED, None, "it was not seen to be a step of the systems"),
        ("consistent", CONTRADICTED, "in words", "it was not seen to be a step of the systems"),
        ("consistent", CONTRADICTED, 0.9, "it was not seen to be a step of the systems"),
        ("consistent", CONTRADICTED, 1e-10, ""),
        ("consistent", HOLDS, 0.0, ""),
    ],
)
def test_gross_failure_ends_the_judgement(name, verdict, measured, gross):
    found = [Judgement(HOLDS, name="runs"), Judgement(verdict, measured, name=name)]
    assert judge.gross_failure(found) == gross


def test_worst_of_several_verdicts():
    assert worst([HOLDS, UNJUDGED, CONTRADICTED]) == CONTRADICTED
    assert worst([HOLDS, UNJUDGED]) == UNJUDGED
    assert worst([HOLDS, HOLDS]) == HOLDS


# -- standards of certificate and audit --------------------------------------------------------------------------------


def verdicts(decision, claimed, rows) -> tuple[str, str]:
    """(verdict of a certificate, verdict of an audit) that a decision rule gives on a claimed value from these rows."""
    rows = [{"status": "ok"} | r for r in rows]
    return decision(claimed, rows, CERTIFICATE)[0], decision(claimed, rows, AUDIT)[0]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((2.0, 2.0), (HOLDS, HOLDS)),
        ((1.0, 1.0), (CONTRADICTED, CONTRADICTED)),
        ((3.0, 3.0), (CONTRADICTED, UNDERSTATED)),
        ((1.0, 2.0), (CONTRADICTED, IN_PART)),
        ((1.0,), (CONTRADICTED, UNJUDGED)),
        ((2.0, 2.5, 2.5), (UNJUDGED, HOLDS)),
    ],
)
def test_order_by_both_standards(values, expected):
    assert verdicts(decide.order, 2, [order_row(str(k), x) for k, x in enumerate(values)]) == expected


SEEN = {"floor": 1e-13, "own": 1e-2}
KEPT, BROKEN, OPEN = SEEN | {"value": 1e-16}, SEEN | {"value": 1e-3}, SEEN | {"value": 1e-16, "own": 1e-12}


@pytest.mark.parametrize(
    ("claimed", "rows", "expected"),
    [
        (True, (KEPT, KEPT), (HOLDS, HOLDS)),
        (True, (KEPT, OPEN), (UNJUDGED, HOLDS)),
        (True, (KEPT, BROKEN), (CONTRADICTED, CONTRADICTED)),
        (False, (KEPT, BROKEN), (HOLDS, HOLDS)),
        (False, (KEPT, KEPT), (CONTRADICTED, UNDERSTATED)),
        (False, (KEPT, OPEN), (UNJUDGED, UNJUDGED)),
    ],
)
def test_structure_by_both_standards(claimed, rows, expected):
    assert verdicts(decide.structure, claimed, rows) == expected


TINY, STAYS, DRIFTS, LOST = part(1e-14), part(1e-4), part(1e-4, 2e-7), {"status": "diverged"}


@pytest.mark.parametrize(
    ("claimed", "rows", "expected"),
    [
        ("bounded", (TINY, STAYS), (HOLDS, HOLDS)),
        ("bounded", (STAYS, LOST), (UNJUDGED, HOLDS)),
        ("bounded", (STAYS, DRIFTS), (CONTRADICTED, CONTRADICTED)),
        ("round-off", (TINY, STAYS), (CONTRADICTED, CONTRADICTED)),
        ("drift", (STAYS, DRIFTS), (HOLDS, HOLDS)),
        ("drift", (STAYS, STAYS), (CONTRADICTED, UNDERSTATED)),
        ("drift", (STAYS, TINY), (CONTRADICTED, UNJUDGED)),
        ("none", (DRIFTS,), (UNJUDGED, UNJUDGED)),
    ],
)
def test_conservation_by_both_standards(claimed, rows, expected):
    assert verdicts(decide.conservation, claimed, rows) == expected
