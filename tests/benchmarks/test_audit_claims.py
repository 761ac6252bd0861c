"""The audit's claims in words, what decides on them, and the cells of its table, from fabricated rows.

`test_judge` has the decisions.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from phasebench.benchmarks.audit import claims as audit
from phasebench.benchmarks.audit.table import TEXTS, cell
from phasebench.benchmarks.judge.evidence import round_off
from phasebench.reference.peers import Claims
from support.planted import control

ROW = {"status": "ok", "problem": "a", "reason": "", "value": 1.0, "low": 0.5, "high": 1.5}
DEFECT = {"value": 1.23456e-5, "floor": 2e-13, "classical": 3e-4, "own": 4e-6, "h": 0.05, "steps": 20.0}
TEXT = "1.23e-05, floor 2e-13, rk4 0.0003, own error 4e-06"
ENERGY = {"value": 1.2e-3, "slope": 2e-9, "low": -1e-9, "high": 5e-9, "time": 1000.0, "steps": 1e4, "scale": 1.0}


def judge_claim(claims: Claims, *rows: dict, measure: str, **peer) -> dict:
    """The audit's verdict on a peer's only claim, from fabricated rows of this measure."""
    who = replace(control("rk4"), claims=claims, **peer)
    (found,) = audit.judgements(who, "1.5", [ROW | {"peer": who.id, "measure": measure} | r for r in rows])
    return found


@pytest.mark.parametrize(
    ("name", "row", "text"),
    [
        ("order", {"value": 3.987}, "3.99 [0.50, 1.50] (a)"),
        ("order", {"value": None, "reason": "no window"}, "no window (a)"),
        ("order", {"status": "diverged", "reason": "it fell"}, "diverged (a: it fell)"),
        ("symplectic", DEFECT, f"{TEXT} (a, h = 0.05, 20 steps)"),
        ("reversible", DEFECT | {"falls_as": 2.96}, f"{TEXT}, falls as h^3.0 (a, h = 0.05, 20 steps)"),
        ("reversible", {"value": 2e-9, "tol": 1e-10}, "2e-09 at tol 1e-10 (a)"),
        ("energy", ENERGY, "max 1.2e-03, slope 2.0e-09 [-1.0e-09, 5.0e-09] to t = 1000 (a)"),
    ],
)
def test_text_of_a_row(name, row, text):
    assert audit.text(name, ROW | row) == text


@pytest.mark.parametrize(
    ("claims", "words"),
    [
        (Claims(order=4), "order 4"),
        (Claims(symplectic=True), "symplectic"),
        (Claims(symplectic=False), "not symplectic"),
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
    failed = judge_claim(claims, {}, {"status": "timeout", "reason": "it did not return"}, measure="cost")
    assert (failed["verdict"], failed["reason"]) == ("not judged", "it did not return")
    absent = judge_claim(claims, {"status": "skipped", "reason": "no such package"}, measure="package")
    assert (absent["verdict"], absent["reason"]) == ("not judged", "skipped: no such package")


def test_adaptive_peer_is_judged_by_energy_alone():
    found = judge_claim(Claims(order=4), {}, measure="order", adaptive=True)
    assert (found["verdict"], found["reason"][:20]) == ("not judged", "the step is adaptive")
    row = ENERGY | {"slope": 0.0, "value": 0.0}
    assert judge_claim(Claims(energy="round-off"), row, measure="energy", adaptive=True)["verdict"] == "holds"


@pytest.mark.parametrize(
    ("values", "verdict", "seen", "reason"),
    [
        ((2.0, None, 2.0), "holds", "0, 2", ""),
        ((1.0, 2.0, None), "holds in part", "0, 1", ""),
        ((1.0, 3.0), "contradicted", "0, 1", ""),
        ((1.0, None), "not judged", "0, 1", "it differs on one problem alone"),
        ((None, None), "not judged", "0, 1", "no window tells"),
    ],
)
def test_orders_are_judged_on_all_problems_together(values, verdict, seen, reason):
    rows = [
        {"problem": str(k), "value": x, "low": x and x - 0.01, "high": x and x + 0.01} for k, x in enumerate(values)
    ]
    found = judge_claim(Claims(order=2), *rows, measure="order")
    assert (found["verdict"], found["problems"], found["reason"]) == (verdict, seen, reason)


KEPT, BROKEN = DEFECT | {"value": 1e-13}, DEFECT


def test_problems_that_decide_on_a_structure_are_named():
    for claimed, problem in ((True, "b"), (False, "b")):
        rows = [KEPT, BROKEN | {"problem": "b"}]
        found = judge_claim(Claims(symplectic=claimed), *rows, measure="symplecticity")
        assert (found["verdict"], found["problems"]) == ("contradicted" if claimed else "holds", problem)


def test_understated_energy_names_the_longest_run():
    rows = [ROW | ENERGY | {"value": 1e-3, "slope": 0.0, "low": -1.0, "high": 1.0, "time": t} for t in (1e3, 2e3, 1e3)]
    verdict, seen, why = audit.decision("energy", "drift", rows)
    assert (verdict, len(seen), why) == ("understated", 3, "as far as t = 2000 tells")


def test_preserved_but_unclaimed_structures_are_remarked():
    rows = [ROW | KEPT | {"peer": p, "measure": "symplecticity", "problem": q} for p in ("b", "a") for q in "xy"]
    rows += [ROW | r | {"peer": "c", "measure": "symplecticity"} for r in (KEPT, BROKEN)]
    claimed = [{"peer": "a", "property": "symplectic", "claim": "symplectic"}]
    said = "symplectic on the problems here, which is not claimed: "
    assert audit.remarks(rows, claimed) == [f"{said}b"]
    assert audit.remarks(rows, [c | {"claim": "not symplectic"} for c in claimed]) == [f"{said}b, a"]
    assert audit.remarks(rows[-2:], []) == []


# -- the terminal ------------------------------------------------------------------------------------------------------

LONG = {"measure": "energy", "status": "ok", "problem": "pendulum", "scale": 1.0, "steps": 1000, "time": 10.0}
LIMIT = round_off(LONG)


@pytest.mark.parametrize(
    ("value", "slope", "half", "word"),
    [
        (LIMIT, 0.0, 1e-30, "round-off"),
        (0.5 * LIMIT, 1.0, 1e-3, "round-off"),
        (1.01 * LIMIT, 0.0, 1e-30, "bounded"),
        (1e-3, 3e-5, 1e-9, "drifts"),
        (1e-3, 3e-5, 2e-5, "open"),
        (0.3, 1e-9, 2e-9, "large"),
    ],
)
def test_energy_error_is_round_off_up_to_its_law(value, slope, half, word):
    text = cell([LONG | {"value": value, "slope": slope, "low": slope - half, "high": slope + half}], "energy")
    assert text == f"pendulum {value:.0e} {word} {slope:+.0e} +- {half:.0e}"


def test_stability_cell_names_unstable_windows():
    rows = {"status": "ok", "value": 2.7, "unconditional": False, "scanned": 7.0, "grows": 0.0, "reason": ""}
    text = TEXTS["stability"]
    assert text(rows | {"intervals": "0..2.7 2.98..3.98"}) == "2.7; unstable on 2.7 to 2.98, then from 3.98"
    assert text(rows | {"intervals": "0..2.7"}) == "2.7"
    assert text(rows | {"value": 0.0, "intervals": "", "grows": 0.118}) == "0 (x 1.118 a step at 0.5)"
    assert text(rows | {"value": 10.0, "unconditional": True}) == "none up to 10"
    assert text(rows | {"value": 7.0, "reason": "Newton", "intervals": "0..7"}) == "7, the last that could be taken"
