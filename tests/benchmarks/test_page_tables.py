"""Tables of pages on fabricated rows: the exceptions of the matrix, the catalogue's lists, the talks' statements."""

from __future__ import annotations

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
from phasebench.benchmarks.page.page import ROWS
from phasebench.integrators.registry import METHODS

# -- the matrix --------------------------------------------------------------------------------------------------------

CELL = {
    "method": "rk4", "problem": "pendulum", "declared_order": 4, "order": 4.0, "symplectic": False, "symmetric": False,
    "energy_class": "drift", "quadratic_class": "drift", "symplecticity": 1.0, "reversibility": 1.0, "energy": 1.0,
    "quadratic": 1.0, "reason": None,
}  # fmt: skip


def cells(*changes: dict):
    return {"matrix": pd.DataFrame([CELL | c for c in changes])}.get


def test_exceptions_of_a_method_stand_on_one_line_with_the_first_that_was_measured():
    short = [
        {"method": "avf", "declared_order": 2, "order": x, "problem": p} for x, p in ((1.25, "fpu"), (1.5, "kepler"))
    ]
    higher = [{"order": x, "problem": p} for x, p in ((4.5, "fpu"), (6.0, "toda"))]
    shown = matrix.table(cells(*short, *higher, {"order": 4.1}))
    assert shown.frame.to_numpy().tolist() == [
        ["avf", "fpu and kepler", "order 1.25, declared 2", "NOT EXPLAINED"],
        ["rk4", "toda and fpu", "order 6.00, declared 4", "more than declared"],
    ]
    assert shown.caption.startswith("The 2 cells that fall short, then the 2 orders above")
    assert matrix.table(cells({})) is None


def test_unexplained_cells_stand_before_those_with_a_reason():
    known = {"method": "gauss-equip-2", "energy_class": "round-off", "energy": 1e-9, "fallbacks": 2}
    open_ = {"method": "avf", "declared_order": 2, "order": 1.0}
    shown = matrix.table(cells(known, open_)).frame
    assert shown["method"].tolist() == ["avf", "gauss-equip-2"]


def test_every_pair_that_was_run_on_the_small_problems_is_in_the_whole_table():
    pairs = [{"problem": "kepler"}, {"problem": "fpu"}, {"reason": "requires: separable"}, {"method": "avf"}]
    whole = matrix.PAGE.whole(cells(*pairs))
    assert whole[["method", "problem", "declared"]].to_numpy().tolist() == [
        ["rk4", "kepler", 4],
        ["avf", "pendulum", 4],
    ]


# -- the catalogue -----------------------------------------------------------------------------------------------------


def test_families_are_counted_by_what_their_methods_declare():
    shown = catalogue.METHODS_PAGE.table({}.get).frame.set_index("family")
    families = list(dict.fromkeys(m.family for m in METHODS))
    assert list(shown.index) == [f.replace("_", " ") for f in families][:ROWS]
    for family in families[:ROWS]:
        members, line = [m for m in METHODS if m.family == family], shown.loc[family.replace("_", " ")]
        assert line["methods"] == len(members)
        for column, declared in (("symplectic", "symplectic"), ("symmetric", "symmetric")):
            assert int(line[column]) == len([m for m in members if getattr(m, declared)])
        assert int(line["energy to round-off"]) == len([m for m in members if m.energy == "round-off"])
        assert line["such as"].startswith(members[0].id)
    assert len(catalogue.METHODS_PAGE.whole({}.get)) == len(METHODS)


def test_methods_are_described_by_what_they_declare():
    """A method of each kind, as the books have them."""
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


@pytest.mark.parametrize("missing", [{"source": ""}, {"cite": ""}])
def test_a_method_without_a_source_or_a_citation_is_a_finding(missing, monkeypatch):
    whole = {"id": "a", "family": "f", "source": "someone", "cite": "x"}
    monkeypatch.setattr(
        catalogue, "METHODS", [SimpleNamespace(**whole), SimpleNamespace(**whole | {"id": "b"} | missing)]
    )
    said = catalogue.sourced({}.get)
    assert not said.holds
    assert said.text == "2 methods of 1 families are registered; without a source: b."
    monkeypatch.setattr(catalogue, "METHODS", [SimpleNamespace(**whole)])
    assert catalogue.sourced({}.get).holds
    assert catalogue.sourced({}.get).text.endswith("every one with its source and citation.")


@pytest.fixture
def problems(monkeypatch):
    """Problems of so many orbits, in as many degrees of freedom, with a formula of that many letters."""

    def make(*of: tuple[int, int], source: str = "someone"):
        made = []
        for d, letters in of:
            q = tuple(float(k) for k in range(d))
            orbits = [SimpleNamespace(name=f"o{k}", q=q, p=q) for k in range(d)]
            system = SimpleNamespace(H="x" * letters, d=d, traits={"separable": d > 4})
            made.append(SimpleNamespace(id=f"of-{d}", orbits=orbits, source=source, system=system, invariants=["L"]))
        monkeypatch.setattr(catalogue, "_made", lambda: tuple(made))
        return catalogue.PROBLEMS_PAGE

    return make


def test_problems_are_shown_with_their_formulae_and_long_ones_cut(problems):
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


def test_orbits_are_shown_with_four_numbers_of_their_state(problems):
    whole = problems((4, 1), (5, 1)).whole({}.get)
    assert len(whole) == 9
    for column in ("q0", "p0"):
        assert whole[column].iloc[0] == "0.0, 1.0, 2.0, 3.0"
        assert whole[column].iloc[-1] == "0.0, 1.0, 2.0, 3.0, …"


def test_a_problem_without_a_source_is_a_finding(problems):
    (good,) = problems((4, 1), (5, 1)).judged({}.get)
    assert good.holds
    assert good.text == "2 problems with 9 orbits are registered, every one with its source."
    (bad,) = problems((4, 1), (5, 1), source="").judged({}.get)
    assert not bad.holds
    assert bad.text.endswith("; without a source: of-4 and of-5.")


def tables(*changes: dict) -> dict:
    row = {"table": "t", "declared order": 4, "order": 4, "polished residual": 1e-50, "published residual": 1e-20}
    return {"coefficients": pd.DataFrame([row | c for c in changes])}


def test_tables_of_coefficients_have_the_order_that_they_declare():
    good = catalogue.orders(tables({}, {"polished residual": 1e-45}).get)
    assert good.holds
    assert "the residuals are at most 1.0e-45" in good.text
    assert "not so" not in good.text
    bad = catalogue.orders(tables({}, {"table": "u", "order": 3}).get)
    assert not bad.holds
    assert "not so u" in bad.text


def test_of_each_kind_and_order_the_least_constant_is_shown():
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


def installed(*changes: dict) -> dict:
    row = {"package": "p", "version": "1", "licence": "MIT", "direct": True, "MB": 1.0}
    return {"dependencies": pd.DataFrame([row | c for c in changes])}


def test_what_is_needed_directly_is_added_up_and_a_weight_is_no_finding():
    rows = installed({}, {"package": "q"}, {"package": "r", "direct": False})
    said = catalogue.licences(rows.get)
    assert (
        said.text == "3 distributions are needed, 2 of them directly; none is under the GPL; each states its licence."
    )
    assert catalogue.weight(rows.get).holds
    shown = catalogue.DEPENDENCIES_PAGE.table(rows.get).frame
    assert shown["direct"].tolist() == ["yes", "yes", "no"]
    many = catalogue.DEPENDENCIES_PAGE.table(installed(*({"package": f"p{k}"} for k in range(30))).get).frame
    assert many["package"].tolist() == [f"p{k}" for k in range(ROWS)]


# -- the talks ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def section(monkeypatch):
    """A talk of one section with a statement of each verdict, and one more that holds."""
    statements = [
        SimpleNamespace(
            where=f"({k})", kind="remark", words=f"w{k}", page="p", judged=lambda data, v=v: Judgement(v, "seen")
        )
        for k, v in enumerate((HOLDS, UNTESTABLE, WHERE, MISSING, CONTRADICTED, HOLDS))
    ]
    one = SimpleNamespace(id="s", talk="first", title="t", statements=statements, tables=())
    monkeypatch.setattr(talks, "SECTIONS", [one])
    return one


def test_statements_are_counted_by_their_verdicts(section):
    contradicted, counted, conditional = talks.PAGE.judged({}.get)
    assert contradicted.text == "Contradicted: (4) (w4)."
    assert contradicted.short == "Contradicted: (4)."
    assert counted.text.startswith(f"2 of 6 statements hold; {WHERE} a condition is met: 1, {CONTRADICTED}: 1")
    assert counted.text.endswith(f", {UNTESTABLE}: 1, {MISSING}: 1.")
    assert conditional.text == "Only under a condition: (2) (w2)."
    assert not any(v.holds for v in (contradicted, counted, conditional))
    section.statements = section.statements[:1]
    assert all(v.holds for v in talks.PAGE.judged({}.get))
    assert talks.PAGE.judged({}.get)[0].short == "No statement is contradicted."


def test_what_does_not_plainly_hold_stands_in_order_of_weight(section):
    shown = talks.exceptions({}.get).frame
    assert list(shown) == ["talk", "where", "kind", "says", "verdict", "measured", "shown on"]
    assert shown["verdict"].tolist() == [CONTRADICTED, MISSING, WHERE, UNTESTABLE]
    whole = talks.PAGE.whole({}.get)
    assert list(whole) == ["talk", "where", "kind", "says", "verdict", "measured"]
    assert whole["where"].tolist() == [f"({k})" for k in range(6)]
    section.statements = [section.statements[2]] * (ROWS - 1) + [section.statements[4]] * 3
    assert talks.exceptions({}.get).frame["verdict"].tolist() == [CONTRADICTED] * 3 + [WHERE] * (ROWS - 3)


def test_the_page_of_a_section_has_all_its_statements(section):
    made_ = talks._page(section)
    shown = made_.table({}.get).frame
    assert list(shown) == ["where", "kind", "says", "verdict", "measured", "shown on"]
    assert shown["where"].tolist() == [f"({k})" for k in range(6)]
    assert set(shown["shown on"]) == {"[p](p.md)"}
    assert made_.judged({}.get)[0].text.startswith("Contradicted: ")
    section.statements = section.statements[1:2]
    assert made_.table({}.get) is None
    assert made_.judged({}.get) == []


def test_at_most_four_contradicted_statements_are_named_and_ten_with_a_condition(section):
    wrong, some = section.statements[4], section.statements[2]
    section.statements = [wrong] * 6 + [some] * 12
    contradicted, _, conditional = talks.PAGE.judged({}.get)
    assert contradicted.text.count("w4") == 4
    assert conditional.text.count("w2") == 10
