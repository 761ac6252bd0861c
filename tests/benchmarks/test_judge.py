"""The judge on fabricated rows of evidence: its thresholds, the verdicts of a certificate and of an audit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phasebench.benchmarks.audit import claims as audit
from phasebench.benchmarks.audit.table import cell
from phasebench.benchmarks.judge import checks, decide, evidence
from phasebench.benchmarks.judge.checks import NEAR
from phasebench.benchmarks.judge.decide import AUDIT, CERTIFICATE
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.judge import gross_failure, judgements, offers, verdict
from phasebench.benchmarks.judge.requirements import ROUNDED, adapts
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, IN_PART, UNDERSTATED, UNJUDGED, Judgement
from phasebench.reference.peers import Claims
from support.evidence import order_row, part
from support.planted import control

NAN = float("nan")

# -- evidence: what one row tells --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "own", "classical", "kept", "alone"),
    [
        (100.0, 1001.0, 1001.0, True, True),
        (100.1, 1001.0, 1001.0, False, False),
        (1.0, 1000.0, 1001.0, None, None),
        (1.0, 1001.0, 1000.0, None, True),
        (100.1, 1.0, 1.0, False, False),
    ],
)
def test_structure_is_kept_up_to_a_hundred_floors(value, own, classical, kept, alone):
    row = {"value": value, "floor": 1.0, "own": own, "classical": classical}
    assert evidence.keeps_structure(row) is kept
    assert evidence.keeps_structure(row | {"status": "diverged"}) is None
    assert evidence.keeps_structure(row | {"floor": np.nan}) is None
    assert evidence.keeps_structure({k: v for k, v in row.items() if k != "classical"}) is alone


@pytest.mark.parametrize(
    ("slope", "half", "value", "bounded"),
    [
        (0.01, 0.001, 1.0, True),  # it adds up to a hundredth of the error
        (-0.011, 0.001, 1.0, False),
        (0.9, 0.9, 1.0, True),  # 0 is an end of its interval
        (-0.9, 0.9, 1.0, True),
        (0.9, 0.89, 1.0, None),  # not clear
        (0.9, 0.35, 1.0, False),
        (0.0, 0.01, 25.0, True),  # exactly a quarter of the energy scale
        (13.0, 0.01, 26.0, False),
        (1e-12, 0.0, 1e-11, True),  # round-off may drift
    ],
)
def test_error_is_bounded_or_drifts_by_its_slope(slope, half, value, bounded):
    row = {"slope": slope, "low": slope - half, "high": slope + half, "time": 1.0, "value": value, "scale": 100.0}
    row["steps"] = 1
    assert evidence.is_bounded(row) is bounded
    assert evidence.is_bounded(row | {"status": "diverged"}) is None
    longer = row | {"slope": slope / 8, "time": 8.0, "low": row["low"] / 8, "high": row["high"] / 8}
    assert evidence.is_bounded(longer) is bounded, "a slope is of a unit of time"


@pytest.mark.parametrize(
    ("value", "half", "agrees"),
    [
        (2.09, 0.5, True),
        (1.91, 0.5, True),
        (3.0, 0.85, False),
        (3.0, 0.9, None),  # its interval reaches the gate
        (1.0, 0.85, False),
        (1.0, 0.9, None),
        (2.5, 0.01, None),  # between two orders
        (3.09, 0.01, False),
        (3.11, 0.01, None),
        (NAN, 0.01, None),
    ],
)
def test_order_agrees_or_differs(value, half, agrees):
    row = {"value": value, "low": value - half, "high": value + half}
    assert evidence.agrees(row, 2) is agrees
    assert evidence.agrees(row | {"status": "diverged"}, 2) is None


LONG = {"measure": "energy", "status": "ok", "problem": "pendulum", "scale": 1.0, "steps": 1000, "time": 10.0}
LIMIT = evidence.round_off(LONG)


@pytest.mark.parametrize(
    ("value", "slope", "half", "word"),
    [
        (LIMIT, 0.0, 1e-30, "round-off"),
        (1.01 * LIMIT, 0.0, 1e-30, "bounded"),
        (1e-3, 3e-5, 1e-9, "drifts"),
        (1e-3, 3e-5, 2e-5, "open"),
        (0.3, 1e-9, 2e-9, "large"),
    ],
)
def test_energy_error_is_round_off_up_to_its_law(value, slope, half, word):
    """100 eps times the energy scale times the root of the steps."""
    assert pytest.approx(100 * 2.0**-52 * 1000**0.5) == LIMIT
    assert word in cell([LONG | {"value": value, "slope": slope, "low": slope - half, "high": slope + half}], "energy")


# -- standards of certificate and audit --------------------------------------------------------------------------------

SEEN = {"floor": 1e-13, "own": 1e-2, "h": 0.5, "separable": True}
KEPT, BROKEN, OPEN = SEEN | {"value": 1e-16}, SEEN | {"value": 1e-3}, SEEN | {"value": 1e-16, "own": 1e-12}
TINY, STAYS, DRIFTS, LOST = part(1e-14), part(1e-4), part(1e-4, 2e-7), {"status": "diverged"}


def rows_of(*orders):
    return [order_row(str(k), x) for k, x in enumerate(orders)]


@pytest.mark.parametrize(
    ("decision", "claimed", "rows", "certificate", "audited"),
    [
        (decide.order, 2, rows_of(1.0, 1.0), CONTRADICTED, CONTRADICTED),
        (decide.order, 2, rows_of(3.0, 3.0), CONTRADICTED, UNDERSTATED),
        (decide.order, 2, rows_of(1.0, 2.0), CONTRADICTED, IN_PART),
        (decide.order, 2, rows_of(1.0), CONTRADICTED, UNJUDGED),
        (decide.order, 2, rows_of(2.0, 2.5, 2.5), UNJUDGED, HOLDS),
        (decide.structure, True, (KEPT, OPEN), UNJUDGED, HOLDS),
        (decide.structure, True, (KEPT, BROKEN), CONTRADICTED, CONTRADICTED),
        (decide.structure, False, (KEPT, BROKEN), HOLDS, HOLDS),
        (decide.structure, False, (KEPT, KEPT), CONTRADICTED, UNDERSTATED),
        (decide.structure, False, (KEPT, OPEN), UNJUDGED, UNJUDGED),
        (decide.conservation, "bounded", (TINY, STAYS), HOLDS, HOLDS),
        (decide.conservation, "bounded", (STAYS, LOST), UNJUDGED, HOLDS),
        (decide.conservation, "bounded", (STAYS, DRIFTS), CONTRADICTED, CONTRADICTED),
        (decide.conservation, "round-off", (TINY, STAYS), CONTRADICTED, CONTRADICTED),
        (decide.conservation, "drift", (STAYS, DRIFTS), HOLDS, HOLDS),
        (decide.conservation, "drift", (STAYS, STAYS), CONTRADICTED, UNDERSTATED),
        (decide.conservation, "drift", (STAYS, TINY), CONTRADICTED, UNJUDGED),
        (decide.conservation, "none", (DRIFTS,), UNJUDGED, UNJUDGED),
    ],
)
def test_decision_by_both_standards(decision, claimed, rows, certificate, audited):
    rows = [{"status": "ok"} | r for r in rows]
    assert decision(claimed, rows, CERTIFICATE)[0] == certificate
    assert decision(claimed, rows, AUDIT)[0] == audited


def judged_by_audit(claims: Claims, *rows: dict, measure: str, **peer) -> tuple[str, str, str]:
    """The audit's (verdict, problems, reason) for a peer's only claim, from fabricated rows of this measure."""
    who = replace(control("rk4"), claims=claims, **peer)
    known = {"status": "ok", "problem": "a", "reason": "", "peer": who.id, "measure": measure}
    (found,) = audit.judgements(who, "1.5", [known | r for r in rows])
    return found["verdict"], found["problems"], found["reason"]


def test_audit_names_problems_and_reasons():
    orders = [{"problem": p, "value": x, "low": x - 0.01, "high": x + 0.01} for p, x in (("a", 1.0), ("b", 2.0))]
    assert judged_by_audit(Claims(order=2), *orders, measure="order")[:2] == (IN_PART, "a, b")
    rows = [KEPT | {"classical": 3e-4, "steps": 20}, BROKEN | {"classical": 3e-4, "steps": 20, "problem": "b"}]
    assert judged_by_audit(Claims(symplectic=True), *rows, measure="symplecticity")[:2] == (CONTRADICTED, "b")
    assert judged_by_audit(Claims(symplectic=True), {}, measure="cost")[0] == "not judged"
    late = {"status": "timeout", "reason": "it did not return"}
    assert judged_by_audit(Claims(order=2), {}, late, measure="cost") == ("not judged", "", "it did not return")
    assert judged_by_audit(Claims(order=4), orders[0], measure="order", adaptive=True)[0] == "not judged"
    assert judged_by_audit(Claims(energy="round-off"), TINY, measure="energy", adaptive=True)[0] == HOLDS


def test_preserved_but_unclaimed_structures_are_remarked():
    rows = [KEPT | {"peer": p, "measure": "symplecticity", "problem": q, "status": "ok"} for p in "ba" for q in "xy"]
    rows += [r | {"peer": "c", "measure": "symplecticity", "problem": "x", "status": "ok"} for r in (KEPT, BROKEN)]
    claimed = [{"peer": "a", "property": "symplectic", "claim": "symplectic"}]
    (said,) = audit.remarks(rows, claimed)
    assert said.endswith(": b")
    assert audit.remarks(rows[-2:], []) == []


# -- verdicts of a certificate -----------------------------------------------------------------------------------------


def tables(**rows) -> Tables:
    """Fabricated measurements of a correct step (tables of rows), some of them replaced."""
    good = {
        "runs": [{"on": "pendulum", "status": "ok", "reason": ""}],
        "state": [{"on": "pendulum", "what": "the same step twice", "value": 0.0}],
        "input": [{"on": "pendulum", "value": 0.0, "later": 0.0}],
        "order": [order_row(), order_row("tao", separable=False)],
    }
    return Tables(good | rows)


def of(name, claims, **rows):
    """The judgement of the claim or requirement ``name``."""
    return next(j for j in judgements(claims, tables(**rows)) if j.name == name)


@pytest.mark.parametrize(
    ("claims", "rows", "outcome"),
    [
        ({"order": 2}, {}, "pass"),
        ({}, {}, "not-judged"),
        ({"order": 2, "symplectic": True}, {}, "not-judged"),  # it was not measured
        ({"order": 3}, {}, "fail"),
        ({"energy": "none"}, {}, "not-judged"),  # it claims nothing
        *(({"order": 2}, {missing: []}, "not-judged") for missing in ("runs", "state", "input", "order")),
        ({}, {"runs": [{"on": "tao", "status": "raised", "reason": "line 3"}]}, "fail"),
        ({}, {"runs": [{"on": "tao", "status": "diverged", "reason": ""}]}, "fail"),
        ({}, {"state": [{"on": "tao", "what": "steps in turns", "value": 2e-13}]}, "fail"),
        ({}, {"input": [{"on": "tao", "value": 1e-16, "later": 0.0}]}, "fail"),
        ({}, {"input": [{"on": "tao", "value": 0.0, "later": 1e-16}]}, "fail"),
        ({}, {"order": [order_row(terms=(2e-13, 1e-17))]}, "fail"),
    ],
)
def test_pass_needs_a_claim_and_every_verdict(claims, rows, outcome):
    assert verdict(judgements(claims, tables(**rows))) == outcome


def test_exception_in_a_later_measurement_is_reported():
    found = tables()
    found.failed["raised"] = "step 700 on dimer"
    assert verdict(judgements({"order": 2}, found)) == "fail"


def orders(*values, **more):
    """Rows of orders on a system that is T + V and on others that are not."""
    return {"order": [order_row(str(k), x, separable=k == 0, **more) for k, x in enumerate(values)]}


def double(constant, doubt):
    row = {k: v for k, v in order_row().items() if k not in ("terms", "clean")}
    return {"order": [row | {"constant": constant, "doubt": doubt}]}


def long_runs(*parts):
    known = {"on": "henon-heiles", "reason": "", "status": "ok"}
    return {"long": [known | (p if "status" in p else {"energy": p}) for p in parts]}


def stable(limit, reason=""):
    return {"stability": [{"on": "oscillator", "limit": limit, "scanned": 10.0, "reason": reason}]}


def adaptive(*errors):
    return {"tolerance": [{"on": "tao", "tolerances": [1e-4, 1e-10], "errors": list(errors)}], "order": []}


def defect(size=1e-16):
    return {"symplectic": [KEPT | {"on": "tao", "value": size}]}


def jump(size):
    return defect() | {"jumps": [{"on": "tao", "value": size, "floor": 1e-13, "h": 0.5}]}


ELSEWHERE = {"on": "tao", "separable": False}
FAILED = {"on": "tao", "status": "failed", "reason": "with -h: no"}
INCONSISTENT = orders(2.0, 2.0, terms=(1.0, 1e-17))


@pytest.mark.parametrize(
    ("name", "claimed", "rows", "expected"),
    [
        ("order", 2, orders(2.0, 4.0), HOLDS),  # the symmetry of one system may raise the order
        ("order", 2, orders(2.0, 1.5), UNJUDGED),  # no evidence on a system that is not T + V
        ("order", 2, {"order": rows_of(2.5, 2.5, 2.0, 2.0)}, HOLDS),
        ("order", 2, {"order": rows_of(2.5, 2.5, 2.5, 2.0)}, UNJUDGED),
        ("order", 2, orders(2.0, 2.0, terms=(1e-17, 1e-11)), CONTRADICTED),  # cut coefficients
        ("order", 2, orders(2.0, 2.0, terms=(1e-17, ROUNDED)), HOLDS),
        ("order", 1, orders(1.0, 1.0, terms=(1e-17, 0.3)), HOLDS),  # it has no such coefficient
        ("consistent", None, double(1e-10, 1e-12), CONTRADICTED),
        ("consistent", None, double(1e-10, 1e-9), HOLDS),
        ("consistent", None, double(0.002, 0.01), UNJUDGED),
        ("consistent", None, adaptive(1e-4, 2e-9), HOLDS),
        ("consistent", None, adaptive(1e-4, 1e-4), CONTRADICTED),
        ("symplectic", True, {"symplectic": [KEPT | {"on": "a"}, FAILED]}, UNJUDGED),
        *(("symplectic", x, {"symplectic": [KEPT | ELSEWHERE]} | INCONSISTENT, UNJUDGED) for x in (True, False)),
        *(("symplectic", True, defect(x), v) for x, v in ((0.9e-13, HOLDS), (2e-13, UNJUDGED), (2e-11, CONTRADICTED))),
        *(("symplectic", True, jump(x), v) for x, v in ((0.0, HOLDS), (2e-13, UNJUDGED), (2e-11, CONTRADICTED))),
        ("symplectic", True, defect() | long_runs(STAYS), HOLDS),
        ("symplectic", True, defect() | long_runs(DRIFTS), UNJUDGED),
        ("bilinear", "preserved", long_runs(STAYS), UNJUDGED),  # it was not measured
        ("stability", 200.0, stable(201.0), HOLDS),  # off by 0.5 %
        ("stability", 200.0, stable(201.1), CONTRADICTED),
        ("stability", 200.0, stable(198.9), CONTRADICTED),
        ("stability", 2.0, stable(2.0, "no matrix"), UNJUDGED),
        ("stability", 9.94, stable(None), CONTRADICTED),
        ("stability", 10.0 * (1 - NEAR), stable(None), UNJUDGED),
        ("tolerance", 20.0000001, adaptive(1e-4, 2e-9), HOLDS),
        ("tolerance", 19.9, adaptive(1e-4, 2e-9), CONTRADICTED),
    ],
)
def test_verdict_on_a_claim(name, claimed, rows, expected):
    assert of(name, {} if claimed is None else {name: claimed}, **rows).verdict == expected


def test_worst_system_is_named():
    cut = [order_row(on, 2.0, terms=(1e-17, size, 0.3)) for on, size in (("z", 1e-11), ("a", 1e-9), ("y", 1e-10))]
    found = checks.order(2, Tables({"order": cut}))
    assert (found.verdict, found.on) == (CONTRADICTED, ("a",))
    rows = [KEPT | {"on": "a"}, BROKEN | ELSEWHERE, BROKEN | ELSEWHERE | {"on": "coupled", "value": 2e-3, "h": 0.25}]
    found = of("symplectic", {"symplectic": True}, symplectic=rows)
    assert found.on == ("tao", "coupled")
    assert found.why.startswith("a defect of 2.0e-03 at h = 0.25 on coupled, floor 1e-13")
    assert "REQUIRES = ('separable',)" in found.why
    row = {"on": "tao", "tolerances": [1e-4, 1e-7, 1e-10], "errors": [1e-4, 1e-3, 2e-9]}
    better = {"on": "quartic", "tolerances": [1e-4, 1e-7, 1e-11], "errors": [1e-4, 1e-6, 1e-9]}
    found = adapts(Tables({"tolerance": [better, row]}))
    assert (found.verdict, found.measured) == (HOLDS, 2e-9), "that of the smallest tolerance"
    assert adapts(Tables({"tolerance": []}, failed={"tolerance": "no run ended"})).why == "no run ended"


def test_measured_properties_are_offered_as_claims():
    long = {"on": "a", "status": "ok", "reason": "", "energy": DRIFTS, "bilinear": TINY}
    found = {"order": [order_row("a"), order_row("b", 4.0, False)], "symplectic": [KEPT | {"on": "a"}], "long": [long]}
    found["symmetric"] = [BROKEN | {"on": "a"}]
    # A symplectic defect at its floor is not offered if the energy drifts.
    assert offers({}, Tables(found)) == ["order=2", "energy=drift", "bilinear=preserved"]
    claims = {"order": 2, "symplectic": True, "energy": "bounded", "bilinear": "preserved"}
    assert offers(claims, Tables(found)) == []
    assert offers({}, Tables({"order": [order_row("a", 0.01), order_row("b", 2.0, False)]})) == []
    assert offers({}, Tables({"order": [order_row("a", 1.0)]})) == ["order=1"]
    assert offers({}, Tables({"long": [long | {"energy": STAYS, "bilinear": STAYS}]})) == ["energy=bounded"]


@pytest.mark.parametrize(
    ("name", "verdict", "measured", "ends"),
    [
        ("runs", CONTRADICTED, None, True),
        ("stateless", CONTRADICTED, None, False),
        ("consistent", UNJUDGED, None, True),
        ("consistent", CONTRADICTED, 0.9, True),
        ("consistent", CONTRADICTED, 1e-10, False),
        ("consistent", HOLDS, 0.0, False),
    ],
)
def test_gross_failure_ends_the_judgement(name, verdict, measured, ends):
    found = [Judgement(HOLDS, name="runs"), Judgement(verdict, measured, name=name)]
    assert bool(gross_failure(found)) is ends
