"""What one row tells, on its lines and beside them; a certificate's words and offers on fabricated tables."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.certificate import evidence, judge
from phasebench.benchmarks.certificate.verdicts import CONTRADICTED, HOLDS, UNJUDGED, Judged, Tables, in_words

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
def test_a_structure_is_kept_to_a_hundred_floors_where_a_thousand_could_be_seen(value, own, classical, kept):
    row = {"value": value, "floor": 1.0, "own": own, "classical": classical}
    assert evidence.kept(row) is kept
    assert evidence.kept(row | {"status": "diverged"}) is None
    assert evidence.kept(row | {"floor": np.nan}) is None
    alone = {k: v for k, v in row.items() if k != "classical"}
    assert evidence.kept(alone) is (False if value > 100 else True if own > 1000 else None)


@pytest.mark.parametrize(
    ("slope", "half", "value", "bounded"),
    [
        (0.1, 0.01, 1.0, True),  # what it adds up to is a tenth of the error
        (0.11, 0.01, 1.0, None),
        (0.5, 0.01, 1.0, None),
        (0.51, 0.01, 1.0, False),
        (-0.51, 0.01, 1.0, False),
        (0.9, 0.9, 1.0, True),  # 0 is the end of its interval
        (-0.9, 0.9, 1.0, True),
        (0.9, 0.89, 1.0, False),
        (0.0, 0.01, 25.0, True),  # just a quarter of the energies' size
        (0.0, 0.01, 26.0, None),
        (14.0, 14.0, 26.0, False),
        (13.0, 0.01, 26.0, None),  # just half of it
    ],
)
def test_an_error_is_bounded_or_drifts_by_what_its_slope_adds_up_to(slope, half, value, bounded):
    row = {"slope": slope, "low": slope - half, "high": slope + half, "time": 1.0, "value": value, "scale": 100.0}
    assert evidence.bounded(row) is bounded
    assert evidence.bounded(row | {"status": "diverged"}) is None
    assert evidence.bounded(row | {"slope": None}) is None
    longer = row | {"slope": slope / 8, "time": 8.0, "low": row["low"] / 8, "high": row["high"] / 8}
    assert evidence.bounded(longer) is bounded, "a slope is of a unit of time"


def test_round_off_grows_with_the_root_of_the_steps_and_with_the_energies():
    row = {"scale": 3.0, "steps": 10_000}
    assert evidence.round_off(row) == pytest.approx(100 * 2.0**-52 * 3.0 * 100)
    assert evidence.round_off(row | {"steps": 400}) == pytest.approx(evidence.round_off(row) / 5)


@pytest.mark.parametrize(
    ("value", "half", "agrees"),
    [
        (2.09, 0.5, True),
        (1.91, 0.5, True),
        (3.0, 0.85, False),
        (3.0, 0.95, None),  # its interval reaches the claimed one
        (1.0, 0.85, False),
        (1.0, 0.95, None),
        (2.5, 0.01, None),  # between two orders
        (3.09, 0.01, False),
        (3.11, 0.01, None),
    ],
)
def test_an_order_agrees_or_is_another_one(value, half, agrees):
    row = {"value": value, "low": value - half, "high": value + half}
    assert evidence.agrees(row, 2) is agrees
    assert evidence.agrees(row | {"status": "diverged"}, 2) is None
    assert evidence.agrees(row | {"value": np.nan}, 2) is None


@pytest.mark.parametrize(("value", "low", "high"), [(3.0, 2 + 0.1, 3.9), (1.0, 0.1, 2 - 0.1), (0.1, 0.0, 0.2)])
def test_an_interval_that_just_reaches_the_gate_and_an_order_just_as_far_from_a_whole_one_tell_nothing(
    value, low, high
):
    assert evidence.agrees({"value": value, "low": low, "high": high}, 2) is None


def test_what_is_no_number_is_not_there():
    row = {"a": 1.0, "b": np.nan, "c": None, "d": 3}
    assert [k for k in "abcde" if evidence.has(row, k)] == ["a", "d"]


# -- the certificate's judge -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("order", 4, "order 4"),
        ("stability", 2.5, "stability 2.5"),
        ("tolerance", "many", "tolerance many"),
        ("energy", "bounded", "energy: bounded"),
        ("bilinear", "preserved", "bilinear invariants: preserved"),
        ("symplectic", True, "symplectic"),
        ("symmetric", False, "not symmetric"),
    ],
)
def test_a_claim_in_words(name, value, words):
    assert in_words(name, value) == words


def test_a_verdict_as_json_has_it():
    whole = Judged("order", "order 2", HOLDS, 2.01, (2.0, 2.02), ("tao",), "so")
    assert whole.row() == {
        "claim": "order 2", "verdict": "holds", "measured": 2.01, "interval": [2.0, 2.02], "on": ["tao"], "why": "so",
    }  # fmt: skip
    assert Judged("order", "order 2", UNJUDGED).row()["interval"] is None
    assert Tables().of("order") == []


@pytest.mark.parametrize(
    ("limit", "claimed", "verdict"),
    [
        (201.0, 200.0, HOLDS),  # half a per cent
        (201.1, 200.0, CONTRADICTED),
        (198.9, 200.0, CONTRADICTED),
        (None, 9.94, CONTRADICTED),
        (None, 9.96, UNJUDGED),
        (None, 10.0 * (1 - judge.NEAR), UNJUDGED),
    ],
)
def test_a_stability_limit_is_as_claimed_or_farther_than_was_looked(limit, claimed, verdict):
    row = {"on": "oscillator", "limit": limit, "scanned": 10.0, "reason": ""}
    found = judge.stability(claimed, Tables({"stability": [row]}))
    assert found.verdict == verdict
    assert found.measured == limit
    assert ("h omega = 10" in found.why) == (limit is None)
    assert (f"the limit is {limit:.6g}" in found.why) if limit and verdict != HOLDS else True


def order_row(on: str, value: float, separable: bool = True, terms=(1e-17,) * 8) -> dict:
    row = {"on": on, "value": value, "low": value - 0.01, "high": value + 0.01, "separable": separable}
    return row | {"terms": list(terms), "clean": round(value)}


def test_of_order_one_there_is_no_term_to_be_cut():
    found = judge.order(1, Tables({"order": [order_row("a", 1.0, terms=(1e-17, 0.3))]}))
    assert found.verdict == HOLDS
    assert (found.measured, found.interval, found.on) == (1.0, (0.99, 1.01), ("a",))


def test_terms_below_the_claimed_order_alone_are_cut_and_the_largest_is_named():
    higher = order_row("b", 4.0, False, terms=(1e-17, 1e-17, 1e-3, 1e-17, 0.3))
    assert judge.order(2, Tables({"order": [order_row("a", 2.0), higher]})).verdict == HOLDS
    cut = [order_row(on, 2.0, terms=(1e-17, size, 0.3)) for on, size in (("z", 1e-11), ("a", 1e-9), ("y", 1e-10))]
    found = judge.order(2, Tables({"order": cut}))
    assert (found.verdict, found.on) == (CONTRADICTED, ("a",))
    assert "a term of 1.0e-09 is left: coefficients of 9 digits" in found.why
    just = order_row("a", 2.0, terms=(1e-17, judge.ROUNDED, 0.3))
    assert judge.order(2, Tables({"order": [just]})).verdict == HOLDS


@pytest.mark.parametrize(("open_", "verdict"), [(1, HOLDS), (2, HOLDS), (3, UNJUDGED)])
def test_an_order_needs_half_of_the_systems_of_each_kind(open_, verdict):
    rows = [order_row(f"s{k}", 2.5 if k < open_ else 2.0, separable) for separable in (True, False) for k in range(4)]
    assert judge.order(2, Tables({"order": rows})).verdict == verdict
    one_kind = [r | {"separable": True} for r in rows[:4]] + rows[4:]
    one_kind[4:] = [order_row(f"t{k}", 2.0, False) for k in range(4)]
    assert judge.order(2, Tables({"order": one_kind})).verdict == verdict


def test_the_worst_of_all_tolerances_counts():
    rows = [
        {"on": "a", "tolerances": [1e-4, 1e-8], "errors": [3e-4, 1e-8]},
        {"on": "b", "tolerances": [1e-4, 1e-8], "errors": [1e-4, 5e-8]},
    ]
    found = judge.tolerance(5.0000001, Tables({"tolerance": rows}))
    assert found.verdict == HOLDS
    assert (found.on, found.measured) == (("b",), pytest.approx(5.0))
    assert judge.tolerance(4.9, Tables({"tolerance": rows})).verdict == CONTRADICTED


def part(value: float, slope: float = 0.0) -> dict:
    return {"value": value, "slope": slope, "low": slope - 1e-12, "high": slope + 1e-12, "scale": 1.0, "steps": 2500,
            "time": 500.0}  # fmt: skip


def test_what_is_measured_is_offered_as_it_would_be_claimed():
    kept = {"on": "a", "value": 1e-16, "floor": 1e-13, "own": 1e-2, "h": 0.5, "separable": True}
    long = {"on": "a", "status": "ok", "reason": "", "energy": part(1e-4, 2e-7), "bilinear": part(1e-14)}
    orders = [order_row("a", 2.0), order_row("b", 4.0, False)]
    tables = Tables({"order": orders, "symplectic": [kept], "symmetric": [kept | {"value": 1.0}], "long": [long]})
    # A defect at its floor beside an energy that drifts is not offered as symplectic.
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
def test_nothing_else_is_judged_of_what_is_no_step(name, verdict, measured, gross):
    found = [Judged("runs", "", HOLDS), Judged(name, "", verdict, measured)]
    assert judge.gross_failure(found) == gross
