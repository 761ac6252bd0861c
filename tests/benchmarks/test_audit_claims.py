"""Verdicts of the audit on fabricated rows: their texts, failed runs, and values near a threshold."""

from __future__ import annotations

from dataclasses import replace

import pytest

from phasebench.benchmarks.experiments.audit import claims as audit
from phasebench.benchmarks.judge.evidence import round_off
from phasebench.reference.peers import Claims
from support.planted import control

ROW = {"status": "ok", "problem": "a", "reason": "", "value": 1.0, "low": 0.5, "high": 1.5}


def judge_claim(claims: Claims, *rows: dict, measure: str, **peer) -> dict:
    """The audit's verdict on a peer's only claim, from fabricated rows of this measure."""
    who = replace(control("rk4"), claims=claims, **peer)
    (found,) = audit.judgements(who, "1.5", [ROW | {"peer": who.id, "measure": measure} | r for r in rows])
    return found


# -- texts -------------------------------------------------------------------------------------------------------------


def test_order_text_has_the_interval_or_the_reason():
    assert audit.order_text(ROW | {"value": 3.987}) == "3.99 [0.50, 1.50] (a)"
    assert audit.order_text(ROW | {"value": None, "reason": "no window"}) == "no window (a)"


def test_defect_text_has_its_comparisons():
    row = ROW | {"value": 1.23456e-5, "floor": 2e-13, "classical": 3e-4, "own": 4e-6, "h": 0.05, "steps": 20.0}
    text = "1.23e-05, floor 2e-13, rk4 0.0003, own error 4e-06"
    assert audit.structure_text(row) == f"{text} (a, h = 0.05, 20 steps)"
    assert audit.structure_text(row | {"falls_as": 2.96}) == f"{text}, falls as h^3.0 (a, h = 0.05, 20 steps)"
    assert audit.structure_text(ROW | {"value": 2e-9, "tol": 1e-10}) == "2e-09 at tol 1e-10 (a)"


def test_energy_text_has_the_slope():
    row = ROW | {"value": 1.2e-3, "slope": 2e-9, "low": -1e-9, "high": 5e-9, "time": 1000.0}
    assert audit.energy_text(row) == "max 1.2e-03, slope 2.0e-09 [-1.0e-09, 5.0e-09] to t = 1000 (a)"


@pytest.mark.parametrize(
    ("claims", "words"),
    [
        (Claims(order=4), "order 4"),
        (Claims(symplectic=True), "symplectic"),
        (Claims(symplectic=False), "not symplectic"),
        (Claims(reversible=True), "reversible"),
        (Claims(reversible=False), "not reversible"),
        (Claims(energy="bounded"), "bounded energy error"),
        (Claims(energy="drift"), "energy drifts"),
        (Claims(energy="round-off"), "energy error: round-off"),
    ],
)
def test_text_of_a_claim(claims, words):
    found = judge_claim(claims, {}, measure="nothing of it")
    assert found["claim"] == words
    assert (found["verdict"], found["reason"]) == ("not judged", "it was not measured")
    assert (found["version"], found["measured"], found["problems"]) == ("1.5", "", "")


def test_adaptive_peer_is_judged_by_energy_alone():
    found = judge_claim(Claims(order=4), {}, measure="order", adaptive=True)
    assert (found["verdict"], found["reason"][:20]) == ("not judged", "the step is adaptive")
    row = {"steps": 100.0, "scale": 1.0, "time": 10.0, "slope": 0.0, "value": 0.0}
    assert judge_claim(Claims(energy="round-off"), row, measure="energy", adaptive=True)["verdict"] == "holds"


# -- orders ------------------------------------------------------------------------------------------------------------


def orders(*values: float | None) -> list[dict]:
    """Fabricated rows of orders measured +-0.01 on problems 0, 1, ...; None: no range of steps showed an order."""
    more = ({"low": x - 0.01, "high": x + 0.01} if x else {"reason": "no window"} for x in values)
    return [{"problem": str(k), "value": x} | m for k, (x, m) in enumerate(zip(values, more, strict=True))]


@pytest.mark.parametrize(
    ("values", "verdict", "seen", "reason"),
    [
        ((2.0, None, 2.0), "holds", "0, 2", ""),
        ((1.0, 2.0, None), "holds in part", "0, 1", ""),
        ((1.01, 0.98), "contradicted", "0, 1", ""),
        ((1.0, 3.0), "contradicted", "0, 1", ""),
        ((3.0, 4.0, None), "understated", "0, 1", ""),
        ((1.0, None), "not judged", "0, 1", "it differs on one problem alone"),
        ((2.12, 2.5), "not judged", "0, 1", "no window tells"),
        ((None, None), "not judged", "0, 1", "no window tells"),
    ],
)
def test_orders_are_judged_on_all_problems_together(values, verdict, seen, reason):
    found = judge_claim(Claims(order=2), *orders(*values), measure="order")
    assert (found["verdict"], found["problems"], found["reason"]) == (verdict, seen, reason)


# -- structure and energy ----------------------------------------------------------------------------------------------

SEEN = {"floor": 1e-12, "classical": 1e-5, "own": 1e-5, "h": 0.1, "steps": 1.0}
KEPT, BROKEN, OPEN = SEEN | {"value": 1e-12}, SEEN | {"value": 1e-6}, SEEN | {"value": 1e-12, "own": 1e-12}
FAILED = {"status": "diverged", "reason": "it fell", "problem": "lost"}


@pytest.mark.parametrize(
    ("claimed", "rows", "verdict", "problems"),
    [
        (True, (KEPT, OPEN), "holds", "0"),
        (True, (OPEN, OPEN), "not judged", "0, 1"),
        (True, (KEPT, BROKEN), "contradicted", "1"),
        (False, (BROKEN, KEPT), "holds", "0"),
        (False, (KEPT, FAILED), "understated", "0"),
        (False, (KEPT, OPEN), "not judged", "0, 1"),
    ],
)
@pytest.mark.parametrize("what", ["symplectic", "reversible"])
def test_structure_is_judged_where_it_can_be_seen(what, claimed, rows, verdict, problems):
    given = [{"problem": str(k)} | r for k, r in enumerate(rows)]
    measure = {"symplectic": "symplecticity", "reversible": "reversibility"}[what]
    found = judge_claim(Claims(**{what: claimed}), *given, measure=measure)
    assert (found["verdict"], found["problems"]) == (verdict, problems)
    assert ("nothing could be seen above the floor" in found["reason"]) == (verdict == "not judged")


ENERGY = {"steps": 1e4, "scale": 1.0, "time": 1000.0, "slope": 0.0, "low": -1.0, "high": 1.0}
LAW = 1e4 * 2.0**-52
STAYS, GROWS = ENERGY | {"value": 1e-3}, ENERGY | {"value": 1e-3, "slope": 1e-6, "low": 9e-7, "high": 1.1e-6}
SMALL = ENERGY | {"value": LAW}


@pytest.mark.parametrize(
    ("claimed", "rows", "verdict"),
    [
        ("bounded", (STAYS,), "holds"),
        ("bounded", (STAYS, GROWS), "contradicted"),
        ("bounded", (FAILED, STAYS), "holds"),
        ("bounded", (FAILED, GROWS), "contradicted"),
        ("bounded", (GROWS | {"value": LAW},), "holds"),
        ("round-off", (SMALL,), "holds"),
        ("round-off", (SMALL | {"value": 1.01 * LAW},), "not judged"),
        ("round-off", (SMALL | {"value": 10 * round_off(ENERGY)},), "not judged"),
        ("round-off", (SMALL | {"value": 10.1 * LAW},), "contradicted"),
        ("drift", (GROWS,), "holds"),
        ("drift", (GROWS, STAYS), "holds"),
        ("drift", (STAYS, FAILED), "understated"),
        ("drift", (STAYS, SMALL), "not judged"),
        ("drift", (SMALL,), "not judged"),
        ("drift", (STAYS | {"slope": None},), "not judged"),
    ],
)
def test_energy_claims_are_judged_by_slope_and_size(claimed, rows, verdict):
    given = [{"problem": str(k)} | r for k, r in enumerate(rows)]
    # An unknown slope has no text, so the decision is made without one.
    found = audit.decision("energy", claimed, [ROW | r for r in given])
    assert found[0] == verdict
    if verdict == "understated":
        assert found[2] == "as far as t = 1000 tells"
    if verdict == "not judged":
        assert "too short to tell" in found[2]


def test_understated_energy_names_the_longest_run():
    longer = STAYS | {"time": 2000.0}
    verdict, seen, why = audit.decision("energy", "drift", [ROW | r for r in (STAYS, longer, STAYS)])
    assert (verdict, len(seen), why) == ("understated", 3, "as far as t = 2000 tells")


# -- unclaimed structures ----------------------------------------------------------------------------------------------


def test_preserved_but_unclaimed_structures_are_remarked():
    rows = [ROW | KEPT | {"peer": p, "measure": "symplecticity", "problem": q} for p in ("b", "a") for q in "xy"]
    rows += [ROW | r | {"peer": "c", "measure": "symplecticity"} for r in (KEPT, BROKEN)]
    claimed = [{"peer": "a", "property": "symplectic", "claim": "symplectic"}]
    said = "symplectic on the problems here, which is not claimed: "
    assert audit.remarks(rows, claimed) == [f"{said}b"]
    assert audit.remarks(rows, []) == [f"{said}b, a"]
    denied = [c | {"claim": "not symplectic"} for c in claimed]
    assert audit.remarks(rows, denied) == [f"{said}b, a"]
    assert audit.remarks(rows[-2:], []) == []
