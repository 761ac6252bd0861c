"""Tables of pages on fabricated rows: exceptions of the matrix, the talks' statements."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.matrix import page as matrix
from phasebench.benchmarks.experiments.talks import statements_page as talks
from phasebench.benchmarks.experiments.talks.judging import (
    CONTRADICTED,
    HOLDS,
    MISSING,
    UNTESTABLE,
    WHERE,
    Judgement,
)
from phasebench.benchmarks.page.page import ROWS, conclusion
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count

# -- the matrix --------------------------------------------------------------------------------------------------------

CELL = {
    "method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": False, "symmetric": False,
    "energy_class": "drift", "quadratic_class": "drift", "symplecticity": 1.0, "reversibility": 1.0, "energy": 1.0,
    "quadratic": 1.0, "reason": None,
}  # fmt: skip


def cells(*changes: dict):
    return {"matrix": pd.DataFrame([CELL | c for c in changes])}.get


def test_exceptions_of_a_method_share_a_line():
    short = [
        {"method": "avf", "declared_order": 2, "order": x, "problem": p} for x, p in ((1.25, "fpu"), (1.5, "kepler"))
    ]
    higher = [{"order": x, "problem": p} for x, p in ((4.5, "fpu"), (6.0, "toda"))]
    shown = matrix.table(cells(*short, *higher, {"order": 4.1}))
    assert shown.frame.to_numpy().tolist() == [
        ["avf", "fpu and kepler", "order 1.25, declared 2", "NOT EXPLAINED"],
        ["rk4", "toda and fpu", "order 6.00, declared 4", "more than declared"],
    ]
    assert shown.caption.startswith("The 2 quantities that fall short, then the 2 orders above")
    assert matrix.table(cells({})) is None


def test_unexplained_cells_come_first():
    known = {"method": "gauss-equip-2", "energy_class": "round-off", "energy": 1e-9, "fallbacks": 2}
    open_ = {"method": "avf", "declared_order": 2, "order": 1.0}
    shown = matrix.table(cells(known, open_)).frame
    assert shown["method"].tolist() == ["avf", "gauss-equip-2"]


def test_full_table_has_every_pair_on_small_problems():
    pairs = [{"problem": "kepler"}, {"problem": "fpu"}, {"reason": "requires: separable"}, {"method": "avf"}]
    whole = matrix.PAGE.whole(cells(*pairs))
    assert whole[["method", "problem", "declared"]].to_numpy().tolist() == [
        ["rk4", "kepler", 4],
        ["avf", "pendulum", 4],
    ]


# -- the talks ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def section(monkeypatch):
    """A made-up talk of one section: six statements, one for each verdict and a second that holds."""
    statements = [
        SimpleNamespace(
            where=f"({k})", kind="remark", words=f"w{k}", page="p", judgement=lambda data, v=v: Judgement(v, "seen")
        )
        for k, v in enumerate((HOLDS, UNTESTABLE, WHERE, MISSING, CONTRADICTED, HOLDS))
    ]
    one = SimpleNamespace(
        id="s", talk="first", question="q?", statements_of="statements", statements=statements, tables=()
    )
    monkeypatch.setattr(talks, "SECTIONS", [one])
    return one


def test_statements_are_counted_by_verdict(section):
    found = talks.PAGE.judge({}.get)
    assert [(v.outcome, v.measured, v.where) for v in found] == [
        (FINDING, Count(1, 6), "(4)"),
        (FINDING, Count(1, 6), "(2)"),
        (FINDING, Count(1, 6), "(3)"),
    ]
    assert re.findall(r"\d+", talks.PAGE.answer({}.get)) == ["6", "2", "1", "1", "4"]
    section.statements = section.statements[:1]
    assert conclusion(talks.PAGE, {}.get)[0] == PASS


def test_exceptions_are_sorted_by_severity(section):
    shown = talks.exceptions({}.get).frame
    assert list(shown) == ["talk", "where", "kind", "says", "verdict", "measured", "shown on"]
    assert shown["verdict"].tolist() == [CONTRADICTED, MISSING, WHERE, UNTESTABLE]
    whole = talks.PAGE.whole({}.get)
    assert list(whole) == ["talk", "where", "kind", "says", "verdict", "measured"]
    assert whole["where"].tolist() == [f"({k})" for k in range(6)]
    section.statements = [section.statements[2]] * (ROWS - 1) + [section.statements[4]] * 3
    assert talks.exceptions({}.get).frame["verdict"].tolist() == [CONTRADICTED] * 3 + [WHERE] * (ROWS - 3)


def test_page_of_a_section_has_all_its_statements(section):
    made_ = talks._page(section)
    shown = made_.table({}.get).frame
    assert list(shown) == ["where", "kind", "says", "verdict", "measured", "shown on"]
    assert shown["where"].tolist() == [f"({k})" for k in range(6)]
    assert set(shown["shown on"]) == {"[p](p.md)"}
    assert made_.judge({}.get)[0].outcome == FINDING
    section.statements = section.statements[1:2]
    assert made_.table({}.get) is None
    assert made_.judge({}.get) == []


def test_at_most_three_places_are_named(section):
    wrong = section.statements[4]
    section.statements = [SimpleNamespace(**vars(wrong) | {"where": f"({k})"}) for k in range(5)]
    contradicted, _, _ = talks.PAGE.judge({}.get)
    assert contradicted.where == "(0); (1); (2) and 2 more"
