"""Tables of pages on fabricated rows: exceptions of the matrix, the catalogue, the talks' statements."""

from __future__ import annotations

import re
from itertools import product
from types import SimpleNamespace

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.catalogue import describe
from phasebench.benchmarks.experiments.catalogue import page as catalogue
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
from phasebench.benchmarks.page.verdict import FAIL, FINDING, LIST, PASS, Count
from phasebench.integrators.registry import METHODS

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


# -- the catalogue -----------------------------------------------------------------------------------------------------


def test_families_are_counted_by_declared_properties():
    shown = catalogue.METHODS_PAGE.table({}.get).frame.set_index("family")
    families = list(dict.fromkeys(m.family for m in METHODS))
    assert list(shown.index) == [f.replace("_", " ") for f in families][:ROWS]
    for family in families[:ROWS]:
        members, line = [m for m in METHODS if m.family == family], shown.loc[family.replace("_", " ")]
        assert line["methods"] == len(members)
        for column in ("symplectic", "symmetric"):
            assert int(line[column]) == len([m for m in members if getattr(m, column)])
        assert int(line["energy to round-off"]) == len([m for m in members if m.energy == "round-off"])
        assert line["such as"].startswith(members[0].id)
    assert len(catalogue.METHODS_PAGE.whole({}.get)) == len(METHODS)


def test_methods_have_their_known_properties():
    """One method of each kind, with its properties from the textbooks."""
    lines = {line["method"]: line for line in describe.methods()}
    assert len(lines) == len(METHODS)
    for id, symmetric, symplectic in (
        ("stormer-verlet", "yes", "yes"),
        ("symplectic-euler-p", "no", "yes"),
        ("itoh-abe", "no", "no"),
        ("avf", "yes", "no"),
    ):
        assert (lines[id]["symmetric"], lines[id]["symplectic"]) == (symmetric, symplectic)
    assert (lines["rk4"]["requires"], lines["rk4"]["parameters"]) == ("-", "-")
    assert lines["itoh-abe"]["requires"] == "canonical"
    assert lines["scheme-i"]["parameters"] == "lam=1/3"


def test_answer_counts_methods_by_property(monkeypatch):
    same = {"family": "f", "symplectic": True, "symmetric": True, "energy": "bounded"}
    other = {"family": "g", "symplectic": False, "symmetric": True, "energy": "round-off"}
    monkeypatch.setattr(catalogue, "METHODS", [SimpleNamespace(**x) for x in (same, same, other, other, other)])
    assert re.findall(r"\d+", catalogue.METHODS_PAGE.answer({}.get)) == ["5", "2", "2", "5", "3"]
    assert conclusion(catalogue.METHODS_PAGE, {}.get)[0] == LIST


@pytest.fixture
def problems(monkeypatch):
    """A function that replaces the registered problems by made-up ones, each (d, length of the text of H)."""

    def make(*of: tuple[int, int], source: str = "someone"):
        made = []
        for d, letters in of:
            q = tuple(float(k) for k in range(d))
            orbits = [SimpleNamespace(name=f"o{k}", q=q, p=q) for k in range(d)]
            system = SimpleNamespace(H="x" * letters, d=d, traits={"separable": d > 4})
            made.append(SimpleNamespace(id=f"of-{d}", orbits=orbits, source=source, system=system, invariants=["L"]))
        monkeypatch.setattr(catalogue, "_problems", lambda: tuple(made))
        return catalogue.PROBLEMS_PAGE

    return make


def test_formulae_of_problems_are_shown_and_cut(problems):
    longest = catalogue.LONGEST
    shown = problems((4, longest), (5, longest + 1)).table({}.get).frame
    assert shown["H (or invariant)"].tolist() == [
        f"`{'x' * longest}`", f"`{'x' * (longest // 2)} … (see its module)`",
    ]  # fmt: skip
    assert shown["separable"].tolist() == ["no", "yes"]
    assert shown["d"].tolist() == [4, 5]
    assert shown["invariants"].tolist() == [1, 1]
    many = problems(*((1, 1) for _ in range(ROWS + 3))).table({}.get).frame
    assert len(many) == ROWS


def test_orbits_show_four_numbers_of_their_state(problems):
    whole = problems((4, 1), (5, 1)).whole({}.get)
    assert len(whole) == 9
    for column in ("q0", "p0"):
        assert whole[column].iloc[0] == "0.0, 1.0, 2.0, 3.0"
        assert whole[column].iloc[-1] == "0.0, 1.0, 2.0, 3.0, …"


def test_problems_and_orbits_are_counted(problems):
    page = problems((4, 1), (5, 1))
    assert re.findall(r"\d+", page.answer({}.get)) == ["2", "9", "4", "5", "1"]
    assert conclusion(page, {}.get)[0] == LIST


def tables(*changes: dict) -> dict:
    row = {"table": "t", "declared order": 4, "order": 4, "polished residual": 1e-50, "published residual": 1e-20}
    return {"coefficients": pd.DataFrame([row | c for c in changes])}


def test_tables_of_coefficients_must_have_their_order():
    good = catalogue.orders(tables({}, {"polished residual": 1e-45}).get)
    assert (good.outcome, good.measured, good.where) == (PASS, Count(2, 2), "")
    bad = catalogue.orders(tables({}, {"table": "u", "order": 3}).get)
    assert (bad.outcome, bad.measured, bad.where) == (FAIL, Count(1, 2), "u")


def test_residuals_of_polished_coefficients_must_vanish():
    good = catalogue.polished_residuals(tables({}, {"table": "u", "polished residual": catalogue.ZERO}).get)
    assert (good.outcome, good.measured, good.where) == (PASS, catalogue.ZERO, "u")
    assert catalogue.polished_residuals(tables({}, {"polished residual": 1.1 * catalogue.ZERO}).get).outcome == FAIL


def test_smallest_error_constant_of_each_kind_is_shown():
    more = {"stages": 3, "sum of sizes": 2.0}
    every = product(("splitting", "nystrom", "composition"), (6, 4), ("0.5, 7", "0.25", "1.0"))
    rows = [
        {"kind": k, "declared order": o, "error constant": c, "table": f"{k[0]}{o} {c}"} | more for k, o, c in every
    ]
    shown = catalogue.COEFFICIENTS_PAGE.table(tables(*rows).get).frame
    assert shown["table"].tolist() == [f"{k}{o} 0.25" for k in "snc" for o in (6, 4)]
    assert shown["kind"].tolist()[0] == catalogue.KINDS["splitting"]
    many = catalogue.COEFFICIENTS_PAGE.table(tables(*(rows[0] | {"declared order": k} for k in range(30))).get).frame
    assert many["order"].tolist() == list(range(ROWS))


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
