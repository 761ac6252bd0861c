"""The audit's page on fabricated rows: counts, quotations, the worst statement, and what was not audited."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.audit import page
from phasebench.benchmarks.experiments.audit.statements import SEVERITIES
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count
from support.pages import data

WORDS = ("contradicted", "holds in part", "understated", "holds", "not judged")


def audit_rows(*peers: str, away: tuple[str, ...] = ()) -> pd.DataFrame:
    """The audit's rows: audited peers, skipped peers of absent packages (``away``), and the control rk4."""
    rows = [{"peer": p, "package": p.partition("-")[0], "status": "ok", "reason": ""} for p in peers]
    rows += [{"peer": p, "package": "gone", "status": "skipped", "reason": "no such package"} for p in away]
    rows += [{"peer": "rk4", "package": page.OWN, "status": "ok", "reason": ""}]
    return pd.DataFrame(rows).assign(measure="package", version="1.2")


def claims_table(*of: tuple[str, str, str], package: str = "p") -> pd.DataFrame:
    """A fabricated table of judged claims of a package, each (peer, property, verdict)."""
    rows = [{"peer": p, "property": what, "claim": f"its {what}", "verdict": v} for p, what, v in of]
    more = {"package": package, "version": "1.2", "measured": "2.1 (a); 2.2 (b)", "command": "phasebench audit"}
    return pd.DataFrame(rows).assign(**more)


def test_claims_are_counted_by_verdict():
    of = [(f"p-{k}", "order", WORDS[k]) for k in range(5)] + [
        ("p-5", "order", "holds"),
        ("q-1", "order", "contradicted"),
    ]
    found = page.claims(data(audit=audit_rows(*(f"p-{k}" for k in range(6))), audit_claims=claims_table(*of)))
    assert (found.outcome, found.measured) == (FINDING, Count(3, 5))
    assert found.where.startswith("all of p: p-0 (")


@pytest.mark.parametrize(
    ("packages", "whose"),
    [("pp", "all of p"), ("pqp", "2 of p and 1 of q"), ("qp", "1 of p and 1 of q"), ("p", "of p")],
)
def test_packages_with_false_claims_are_named(packages, whose):
    peers = [f"{name}-{k}" for k, name in enumerate(packages)]
    of = claims_table(*((peer, "order", "contradicted") for peer in peers), ("r-9", "order", "holds"))
    tables = {"audit": audit_rows(*peers, "r-9"), "audit_claims": of.assign(package=of["peer"].str.partition("-")[0])}
    found = page.claims(tables.get)
    assert found.measured == Count(1, 1 + len(packages))
    assert found.where.startswith(f"{whose}: p") or found.where.startswith(f"{whose}: q")
    assert f" ({whose})." in page.answer(tables.get)
    fine = page.claims(data(audit=audit_rows("r-9"), audit_claims=tables["audit_claims"]))
    assert (fine.outcome, fine.measured, fine.where) == (PASS, Count(1, 1), "")


@pytest.mark.parametrize(
    ("verdict", "outcome"),
    [("contradicted", FINDING), ("holds in part", FINDING), ("understated", PASS), ("holds", PASS)],
)
def test_claim_that_fails_somewhere_is_a_finding(verdict, outcome):
    found = page.claims(data(audit=audit_rows("p-1"), audit_claims=claims_table(("p-1", "order", verdict))))
    assert found.outcome == outcome
    assert ("p-1 (its order)" in found.where) == (outcome == FINDING)


def test_unjudged_claim_is_not_counted():
    both = claims_table(("p-1", "order", "contradicted"), ("p-1", "energy", "holds in part"))
    assert page.claims(data(audit=audit_rows("p-1"), audit_claims=both)).measured == Count(0, 2)
    assert page.claims(data(audit=audit_rows("p-1"), audit_claims=claims_table(("p-1", "order", "not judged")))) is None


# -- statements of the documentation -----------------------------------------------------------------------------------


def statements_table(*of: tuple[str, str, str], **more) -> pd.DataFrame:
    """A fabricated table of statements quoted from documentation, each (package, verdict, severity)."""
    rows = [{"package": p, "verdict": v, "severity": s, "script": f"of_{p}"} for p, v, s in of]
    same = {"version": "3", "said": "it is exact", "where": "mod:f", "link": "http://x", "shows": "0.1"}
    return pd.DataFrame(rows).assign(**(same | {"mend": "say so", "covers": "", "printed": "0.1"} | more))


def test_statements_are_counted_and_the_worst_is_named():
    mild, worst = SEVERITIES[-1], SEVERITIES[0]
    rows = statements_table(
        ("a", "contradicted", mild), ("b", "contradicted", worst), ("c", "understated", worst), ("d", "holds", "")
    )
    found = page.statements(data(audit_statements=rows))
    assert (found.outcome, found.measured) == (FINDING, Count(2, 4))
    assert found.where == f"1 of a and 1 of b; worst: b, {worst} (of_b)"
    assert page.statements(data(audit_statements=rows.tail(2))).outcome == PASS
    assert page.statements(data(audit_statements=rows.head(1))).outcome == FINDING
    assert page.statements(data(audit_statements=statements_table(("a", "not judged", "")))) is None


@pytest.mark.parametrize(
    ("text", "where", "quoted"),
    [
        ("exact", "mod:f", "exact"),
        ("order = 4", "pack:Solver.order", "Solver.order = 4"),
        ("order = 4", "pack:Solver.digits", "order = 4"),
        ("x" * page.QUOTED, "mod:f", "x" * page.QUOTED),
        ("word " * 9 + "worse", "mod:f", ("word " * (page.QUOTED // 5)).strip() + " …"),
    ],
    ids=["short", "attribute", "another", "just", "long"],
)
def test_statements_are_quoted_by_their_first_words(text, where, quoted):
    shown = page.table(
        data(audit_statements=statements_table(("a", "contradicted", "harmless"), said=text, where=where))
    )
    assert shown.frame["said"].tolist() == [f"[“{quoted}”](http://x)"]


def test_table_has_the_worst_first_and_no_claim_twice():
    severities = (SEVERITIES[-1], SEVERITIES[0])
    rows = [(f"{v[0]}{k}", v, s) for v in ("understated", "contradicted", "holds") for k, s in enumerate(severities)]
    found = audit_rows("p-1", "p-2", away=("gone-1", "gone-2"))
    told = claims_table(("p-1", "order", "contradicted"), ("p-1", "energy", "understated"), ("p-2", "order", "holds"))
    shown = page.table(
        data(audit_statements=statements_table(*rows, covers="p-1:order"), audit=found, audit_claims=told)
    )
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
    plain = page.table(data(audit_statements=statements_table(("a", "contradicted", ""))))
    assert plain.frame["verdict"].tolist() == ["contradicted"]
    assert page.table(data(audit_statements=statements_table(("a", "holds", "")))) is None


@pytest.mark.parametrize(("count", "more"), [(ROWS, ""), (ROWS + 2, "2 more are in")])
def test_caption_counts_the_omitted_rows(count, more):
    shown = page.table(data(audit_statements=statements_table(*((f"p{k}", "contradicted", "") for k in range(count)))))
    assert shown.frame["package"].tolist() == [f"p{k} 3" for k in range(ROWS)]
    assert ("more are in" in shown.caption) == bool(more)
    assert more in shown.caption


# -- coverage ----------------------------------------------------------------------------------------------------------


def test_unaudited_names_are_counted():
    left = pd.DataFrame({"package": ["p", "p", "q"], "name": ["Solver", "mode x = 3", None]})
    rows = statements_table(("a", "contradicted", ""))
    alone = page.table(data(audit_statements=rows)).caption
    assert page.table(data(audit_statements=rows, audit_unregistered=left)).caption.startswith(
        f"{alone} Not audited: 2 "
    )
    assert page.table(data(audit_statements=rows, audit_unregistered=left.tail(1))).caption == alone


def test_contradicted_control_fails():
    good = claims_table(("rk4", "order", "holds"), ("rk4", "energy", "holds"), package=page.OWN)
    bad = claims_table(("rk4", "order", "holds"), ("rk4", "energy", "contradicted"), package=page.OWN)
    found = page.controls(data(audit=audit_rows("p-1"), audit_claims=good))
    assert (found.outcome, found.measured, found.where) == (PASS, Count(2, 2), "")
    found = page.controls(data(audit=audit_rows("p-1"), audit_claims=bad))
    assert (found.outcome, found.measured, found.where) == (FAIL, Count(1, 2), "rk4 (its energy)")
    assert page.controls(data(audit=audit_rows("p-1"), audit_claims=claims_table(("p-1", "order", "holds")))) is None


def test_missing_values_of_a_row_become_none_or_empty():
    rows = page.records(pd.DataFrame({"value": [1.5, float("nan")], "reason": ["late", None], "on": [None, "kepler"]}))
    assert rows == [{"value": 1.5, "reason": "late", "on": None}, {"value": None, "reason": "", "on": "kepler"}]
