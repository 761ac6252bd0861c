"""The audit's page on fabricated findings: what is counted, what is quoted, which is the worst, what was left out."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.audit import page
from phasebench.benchmarks.experiments.audit.statements import SEVERITIES
from phasebench.benchmarks.page.page import ROWS

WORDS = ("contradicted", "holds in part", "understated", "holds", "not judged")


def audited(*peers: str, away: tuple[str, ...] = ()) -> pd.DataFrame:
    """Integrators that were audited, and those of packages that are not there."""
    rows = [{"peer": p, "package": p.partition("-")[0], "status": "ok", "reason": ""} for p in peers]
    rows += [{"peer": p, "package": "gone", "status": "skipped", "reason": "no such package"} for p in away]
    rows += [{"peer": "rk4", "package": page.OWN, "status": "ok", "reason": ""}]
    return pd.DataFrame(rows).assign(measure="package", version="1.2")


def claimed(*of: tuple[str, str, str], package: str = "p") -> pd.DataFrame:
    """(peer, property, verdict) each."""
    rows = [{"peer": p, "property": what, "claim": f"its {what}", "verdict": v} for p, what, v in of]
    more = {"package": package, "version": "1.2", "measured": "2.1 (a); 2.2 (b)", "command": "phasebench audit"}
    return pd.DataFrame(rows).assign(**more)


def data(**tables):
    return tables.get


def test_claims_are_counted_by_what_came_of_them():
    of = [(f"p-{k}", "order", WORDS[k]) for k in range(5)] + [
        ("p-5", "order", "holds"),
        ("q-1", "order", "contradicted"),
    ]
    said = page.claims(data(audit=audited(*(f"p-{k}" for k in range(6))), audit_claims=claimed(*of)))
    assert said.text.startswith("Of 5 claims of order")
    assert "2 hold, 1 hold on some problems only, 1 are understated, 1 contradicted, of p: p-0 (" in said.text
    assert said.text.endswith("1 could not be judged."), "what was not audited is not counted"
    assert said.short == "1 of 5 claims are contradicted, of p; 1 hold in part."
    assert not said.holds


@pytest.mark.parametrize(
    ("packages", "whose"),
    [("pp", "all of p"), ("pqp", "2 of p and 1 of q"), ("qp", "1 of p and 1 of q"), ("p", "of p")],
)
def test_whose_claims_are_contradicted_is_said_in_the_index_too(packages, whose):
    peers = [f"{name}-{k}" for k, name in enumerate(packages)]
    of = claimed(*((peer, "order", "contradicted") for peer in peers), ("r-9", "order", "holds"))
    table = of.assign(package=of["peer"].str.partition("-")[0])
    said = page.claims(data(audit=audited(*peers, "r-9"), audit_claims=table))
    n = len(packages)
    assert said.short == f"{n} of {n + 1} claims are contradicted, {whose}."
    assert f"{n} contradicted, {whose}: p" in said.text or f"{n} contradicted, {whose}: q" in said.text
    fine = page.claims(data(audit=audited("r-9"), audit_claims=table))
    assert fine.short == "0 of 1 claims are contradicted."


@pytest.mark.parametrize(
    ("verdict", "holds"),
    [("contradicted", False), ("holds in part", False), ("understated", True), ("holds", True)],
)
def test_a_claim_that_does_not_hold_everywhere_is_a_finding(verdict, holds):
    said = page.claims(data(audit=audited("p-1"), audit_claims=claimed(("p-1", "order", verdict))))
    assert said.holds == holds
    assert ("hold in part" in said.short) == (verdict == "holds in part")
    assert ("p-1 (its order)" in said.text) == (verdict == "contradicted")


def test_two_that_contradict_and_hold_in_part_do_not_make_up_for_each_other():
    both = claimed(("p-1", "order", "contradicted"), ("p-1", "energy", "holds in part"))
    assert not page.claims(data(audit=audited("p-1"), audit_claims=both)).holds
    assert page.claims(data(audit=audited("p-1"), audit_claims=claimed(("p-1", "order", "not judged")))) is None


# -- statements of the documentation -----------------------------------------------------------------------------------


def stated(*of: tuple[str, str, str], **more) -> pd.DataFrame:
    """(package, verdict, severity) each."""
    rows = [{"package": p, "verdict": v, "severity": s, "script": f"of_{p}"} for p, v, s in of]
    same = {"version": "3", "said": "it is exact", "where": "mod:f", "link": "http://x", "shows": "0.1"}
    return pd.DataFrame(rows).assign(**(same | {"mend": "say so", "covers": "", "printed": "0.1"} | more))


def test_statements_are_counted_and_the_worst_is_named():
    mild, worst = SEVERITIES[-1], SEVERITIES[0]
    rows = stated(
        ("a", "contradicted", mild), ("b", "contradicted", worst), ("c", "understated", worst), ("d", "holds", "")
    )
    said = page.statements(data(audit_statements=rows))
    assert said.text == (
        "Of 4 statements of documentation, each with a script, 1 hold, 2 are contradicted (1 of a and 1 of b), 1 "
        "understated, "
        f"0 not judged; the worst: b, {worst} (of_b)."
    )
    assert not said.holds
    assert said.short == "2 of 4 statements of documentation are contradicted (1 of a and 1 of b)."
    good = page.statements(data(audit_statements=rows.tail(2)))
    assert good.holds
    assert good.text.endswith("0 not judged.")
    assert not page.statements(data(audit_statements=rows.head(1))).holds
    assert page.statements(data(audit_statements=stated(("a", "not judged", "")))) is None
    assert page.statements(data(audit_statements=stated(("a", "holds", ""), ("b", "understated", "")))) is not None


@pytest.mark.parametrize(
    ("text", "where", "quoted"),
    [
        ("exact", "mod:f", "exact"),
        ("order = 4", "pack:Solver.order", "Solver.order = 4"),
        ("order = 4", "pack:Solver.digits", "order = 4"),
        ("x" * page.QUOTED, "mod:f", "x" * page.QUOTED),
        ("word " * 9 + "worse", "mod:f", ("word " * 9).strip() + " …"),
    ],
    ids=["short", "attribute", "another", "just", "long"],
)
def test_statements_are_quoted_by_their_first_words(text, where, quoted):
    shown = page.table(data(audit_statements=stated(("a", "contradicted", "harmless"), said=text, where=where)))
    assert shown.frame["said"].tolist() == [f"[“{quoted}”](http://x)"]


def test_the_table_has_the_worst_first_and_no_claim_twice():
    severities = (SEVERITIES[-1], SEVERITIES[0])
    rows = [(f"{v[0]}{k}", v, s) for v in ("understated", "contradicted", "holds") for k, s in enumerate(severities)]
    found = audited("p-1", "p-2", away=("gone-1", "gone-2"))
    told = claimed(("p-1", "order", "contradicted"), ("p-1", "energy", "understated"), ("p-2", "order", "holds"))
    shown = page.table(data(audit_statements=stated(*rows, covers="p-1:order"), audit=found, audit_claims=told))
    assert shown.frame[["package", "verdict", "measured"]].to_numpy().tolist() == [
        ["c1 3", f"contradicted: {SEVERITIES[0]}", "0.1"],
        ["c0 3", f"contradicted: {SEVERITIES[-1]}", "0.1"],
        ["u1 3", f"understated: {SEVERITIES[0]}", "0.1"],
        ["u0 3", f"understated: {SEVERITIES[-1]}", "0.1"],
        ["p 1.2", "understated", "2.1 (a)"],
        ["gone", "skipped", "no such package"],
    ]
    assert shown.frame["said"].iloc[-1] == "gone-1 and gone-2"
    assert "more are in" not in shown.caption
    plain = page.table(data(audit_statements=stated(("a", "contradicted", ""))))
    assert plain.frame["verdict"].tolist() == ["contradicted"]
    assert page.table(data(audit_statements=stated(("a", "holds", "")))) is None


@pytest.mark.parametrize(("count", "more"), [(ROWS, ""), (ROWS + 2, "2 more are in")])
def test_what_the_table_cannot_show_is_said(count, more):
    shown = page.table(data(audit_statements=stated(*((f"p{k}", "contradicted", "") for k in range(count)))))
    assert shown.frame["package"].tolist() == [f"p{k} 3" for k in range(ROWS)]
    assert ("more are in" in shown.caption) == bool(more)
    assert more in shown.caption


# -- what was audited --------------------------------------------------------------------------------------------------


def test_what_was_audited_and_what_was_not_is_said():
    controls = claimed(("rk4", "order", "holds"), ("rk4", "energy", "holds"), package=page.OWN)
    left = pd.DataFrame({"package": ["p", "p", "p", "q"], "name": ["Solver (new)", "Solver (old)", "mode x = 3", None]})
    tables = {"audit": audited("p-1", "p-2", "q-1", away=("gone-1",)), "audit_claims": controls}
    said = page.covered(data(**tables, audit_unregistered=left))
    assert said.holds
    assert said.text == (
        "3 integrators of 2 packages were audited (p 1.2 and q 1.2); not audited: gone (1 integrators); of p Solver "
        "and mode x (data/audit_unregistered.csv). Of the 2 declarations of the controls (rk4, this project's) 2 come "
        "out as declared."
    )
    assert "what the packages have besides was not looked up." in page.covered(data(**tables)).text
    nothing = page.covered(data(audit=audited("p-1"), audit_claims=controls, audit_unregistered=left.tail(1)))
    assert "not audited: nothing. Of" in nothing.text
    assert page.covered(data(audit=audited(), audit_claims=controls)) is None
    assert page.covered(data(audit=tables["audit"])) is None
    alone = page.covered(data(audit=tables["audit"], audit_claims=claimed(("p-1", "order", "holds"))))
    assert alone.holds
    assert "controls" not in alone.text


def test_a_control_that_does_not_come_out_is_a_finding():
    controls = claimed(("rk4", "order", "holds"), ("rk4", "energy", "contradicted"), package=page.OWN)
    said = page.covered(data(audit=audited("p-1"), audit_claims=controls))
    assert not said.holds
    assert said.text.endswith("1 come out as declared, not rk4 (its energy).")
    assert said.short == "1 declarations of controls do not come out."


def test_a_row_keeps_what_it_has_and_names_what_it_lacks():
    rows = page.records(pd.DataFrame({"value": [1.5, float("nan")], "reason": ["late", None], "on": [None, "kepler"]}))
    assert rows == [{"value": 1.5, "reason": "late", "on": None}, {"value": None, "reason": "", "on": "kepler"}]
