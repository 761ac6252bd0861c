"""The talks, statement by statement: none is left out, every verdict is a function of rows, every check can fail."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.experiments.talks import checks, statements_page
from phasebench.benchmarks.experiments.talks.judging import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.experiments.talks.statement import KINDS
from phasebench.benchmarks.experiments.talks.statements import FIRST, SECOND, SECTIONS
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.problems import PROBLEMS
from phasebench.integrators.registry import BY_ID

DATA = Path(report.__file__).resolve().parents[1] / "reports"
ALL = [(section, s) for section in SECTIONS for s in section.statements]
IDS = [f"{section.id}-{i}-{s.where}" for i, (section, s) in enumerate(ALL)]
#: What the committed rows say of those that do not plainly hold.
KNOWN = {
    "Fig. 4.1, names": CONTRADICTED,
    "Scheme IV, heading": CONTRADICTED,
    "Table 2, Scheme IV": CONTRADICTED,
    "Results, 2": WHERE,
    "Scheme IV": WHERE,
    "Scheme V": WHERE,
    "(23)": WHERE,
    "Remark": WHERE,
    "(26), Theorem (1)": WHERE,
    "Theorem (2)": WHERE,
    "Background": UNTESTABLE,
    "Remarks II, 2": UNTESTABLE,
}
#: Columns of numbers that a statement may be judged by, and what makes it fail.
BAD = {
    "value": 1e3,
    "defect": 1.0,
    "order": 17.0,
    "energy": 1.0,
    "symplecticity": 1.0,
    "units": 99.0,
    "largest": 1.0,
    "median": 9.0,
    "status": "diverged",
    "invariant error": 1.0,
    "angular momentum error": 1.0,
    "energy error": 1.0,
    "two-form": 1.0,
    "total energy error": 1.0,
    "x": "1 2 3 4",
    "y": "2 1 1 1",
}


class Tables:
    """The committed tables, each through a function of the table."""

    def __init__(self, change=lambda frame: frame):
        self.data, self.change, self.known = report.Data(DATA), change, {}

    def __call__(self, name):
        if name not in self.known:
            frame = self.data(name)
            self.known[name] = None if frame is None else self.change(frame.copy())
        return self.known[name]


def corrupted(frame, error=1e-9):
    """Every number that a statement may be judged by is wrong; an energy error too small or too large."""
    frame = frame.assign(energy_error=error) if "energy_error" in frame else frame
    for column in ("area", "measure"):
        if column in frame:
            frame[column] = range(len(frame))
    for column, value in BAD.items():
        if column in frame and (column != "status" or "figure" in frame):
            frame[column] = value
    return frame


@pytest.fixture(scope="module")
def tables():
    return Tables()


@pytest.fixture(scope="module")
def wrong():
    return Tables(corrupted), Tables(lambda frame: corrupted(frame, 1e9))


# -- none is left out --------------------------------------------------------------------------------------------------


def numbers(talk) -> set[int]:
    """The equation numbers of the rows, ranges filled."""
    found = set()
    for section, s in ALL:
        if section.talk == talk:
            for first, last in re.findall(r"\((\d+)\)(?:–\((\d+)\))?", s.where):
                found |= set(range(int(first), int(last or first) + 1))
    return found


def test_every_number_of_the_introduction_has_its_row():
    where = {s.where for section, s in ALL if section.talk == FIRST}
    numbered = "Theorem 1, Definition 2.1, Definition 2.2, Theorem 2.3, Theorem 2.4, Lemma 2.5, Definition 3.1, "
    numbered += "Theorem 3.1, Theorem 3.2, Fig. 2.1, Fig. 4.1, Explicit Euler, Implicit Euler, Implicit midpoint, "
    numbered += "Symplectic Euler, Area preservation, Results, 1, Results, 2, Results, 3, Invariants, Flow"
    assert set(re.split(r", (?!\d)", numbered)) <= where


def test_every_equation_of_the_second_talk_has_its_row():
    assert set(range(1, 31)) <= numbers(SECOND)
    where = " ".join(s.where for section, s in ALL if section.talk == SECOND)
    for table in ("Table 1, Scheme I", "Table 1, Scheme II", "Table 1, Scheme III", *map("Table 2, {}".format, THREE)):
        assert table in where
    assert len([s for _, s in ALL if s.kind == "theorem" and s.where.startswith(("Theorem (", "(26)"))]) >= 5


THREE = ("AVF", "Scheme IV", "Scheme V")


def test_rows_are_whole():
    assert {s.kind for _, s in ALL} <= set(KINDS)
    assert all(s.where and s.words and s.words != s.where for _, s in ALL)
    assert {s.page for _, s in ALL} <= {p.id for p in report.PAGES}
    assert all(len(section.statements) <= ROWS for section in SECTIONS)
    assert len({(section.talk, s.where, s.words) for section, s in ALL}) == len(ALL)


def test_every_system_and_method_that_the_talks_name_is_registered():
    assert {"pendulum", "kepler", "outer-solar-system", "fpu", "lotka-volterra", "henon-heiles"} <= set(PROBLEMS)
    assert {"perturbed-kepler", "nls", "klein-gordon"} <= set(PROBLEMS)
    named = "explicit-euler implicit-euler symplectic-euler-p symplectic-euler-q implicit-midpoint scheme-i scheme-ii "
    named += "scheme-i-adjoint generating-function scheme-iii scheme-iv scheme-v avf pavf gonzalez hbvm-4-2 cpg-2 "
    named += "gauss-2 lobatto-iiia-iiib-3 variational-gauss-2 rk4-projected-energy gauss-equip-2 scheme-iii-yoshida-4"
    assert set(named.split()) <= set(BY_ID)


def test_every_check_is_used(tables):
    """A statement is not measured without its check; no check is measured for nothing."""
    asked = set()

    class Watched:
        def __call__(self, name):
            return Column(asked) if name == checks.TABLE else tables(name)

    for _, s in ALL:
        s.judged(Watched())
    assert asked == {c.id for c in checks.CHECKS}


class Column:
    """A table that notes which checks are looked for, and has none."""

    def __init__(self, asked):
        self.asked = asked

    def __contains__(self, name):
        return True

    def __getitem__(self, key):
        return self if key == "check" else pd.DataFrame()

    def isin(self, values):
        self.asked |= set(values)
        return "none"


# -- both ways ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("statement", [s for _, s in ALL], ids=IDS)
def test_the_committed_rows_say_what_is_known(statement, tables):
    found = statement.judged(tables)
    expected = KNOWN.get(statement.where, HOLDS)
    if statement.where in ("Background", "(22)", "Energy", "Remarks I, 1"):  # several of that place
        assert found.verdict in (HOLDS, WHERE, UNTESTABLE)
    else:
        assert found.verdict == expected
    assert found.measured
    assert len(found.measured) <= 200


@pytest.mark.parametrize("statement", [s for _, s in ALL], ids=IDS)
def test_wrong_rows_change_the_verdict(statement, tables, wrong):
    before, *after = (statement.judged(t).verdict for t in (tables, *wrong))
    if before in (UNTESTABLE, CONTRADICTED):
        assert set(after) == {before}
    else:
        assert CONTRADICTED in after


@pytest.mark.parametrize(
    ("where", "table", "column", "value"),
    [
        ("Scheme IV, heading", "multiprecision", "order", 1.0),
        ("Table 2, Scheme IV", "printed", "units", 0.3),
        ("Fig. 4.1, names", "talk_checks", "value", -1.0),
        ("Results, 2", "talk_checks", "value", 0.0),
        ("Remark", "pde", "invariant error", 1e-15),
    ],
)
def test_better_rows_would_let_it_hold(where, table, column, value, tables):
    statement = next(s for _, s in ALL if s.where == where)
    better = tables(table).assign(**{column: value})
    if where == "Fig. 4.1, names":
        better["control"] = 1.0

    def data(name):
        return better if name == table else tables(name)

    assert statement.judged(tables).verdict != HOLDS
    assert statement.judged(data).verdict == HOLDS


def test_steps_without_a_root_are_a_condition(tables):
    statement = next(s for _, s in ALL if s.where == "Scheme IV")
    assert statement.judged(tables).verdict == WHERE
    none = {"energy_preservation": "without a root", "pde": "fallbacks"}
    assert statement.judged(lambda name: tables(name).assign(**{none[name]: 0})).verdict == HOLDS


def test_nothing_is_said_without_rows():
    for _, s in ALL:
        assert s.judged(lambda name: None).verdict in (MISSING, UNTESTABLE)
    assert [v for page in statements_page.PAGES for v in page.judged(lambda name: None)] == []
    assert statements_page.exceptions(lambda name: None) is None


# -- the page ----------------------------------------------------------------------------------------------------------


def rows(*verdicts) -> pd.DataFrame:
    return pd.DataFrame([{"where": f"({i})", "says": "x", "verdict": v} for i, v in enumerate(verdicts)])


def test_the_sentences_follow_the_rows():
    good, bad = rows(HOLDS, UNTESTABLE, HOLDS), rows(HOLDS, CONTRADICTED, WHERE, MISSING)
    for verdict, said in (
        (statements_page.contradicted, "Contradicted: (1) (x)."),
        (statements_page.counted, "not measured: 1"),
        (statements_page.conditional, "Only under a condition: (2) (x)."),
    ):
        assert verdict(good).holds
        assert not verdict(bad).holds
        assert said in verdict(bad).text
        assert said not in verdict(good).text
        assert verdict(rows(MISSING, UNTESTABLE)) is None
    assert statements_page.counted(good).text.startswith("2 of 3 statements hold; holds where a condition is met: 0")


def test_what_does_not_hold_stands_first(tables):
    table = statements_page.exceptions(tables).frame
    verdicts = list(table["verdict"])
    assert len(verdicts) <= ROWS
    assert HOLDS not in verdicts
    assert verdicts == sorted(verdicts, key=[CONTRADICTED, MISSING, WHERE, UNTESTABLE].index)
    everything = statements_page.everything(tables)
    assert (everything["verdict"] != HOLDS).sum() == len(table)
    assert len(everything) == len(ALL)


# -- the checks --------------------------------------------------------------------------------------------------------

#: Those that compile no kernel, and two that do.
QUICK = (*(c.id for c in checks.CHECKS if not c.methods), "form-third", "adjoint")


@pytest.fixture(scope="module")
def measured():
    found = [row for id in QUICK for row in checks.measured(id)[checks.TABLE]]
    return pd.DataFrame(found)


@pytest.mark.parametrize("id", QUICK)
def test_a_check_measures_what_the_committed_row_says(id, measured, tables):
    now = measured[measured["check"] == id].iloc[0]
    then = tables(checks.TABLE)
    then = then[then["check"] == id].iloc[0]
    assert now["control"] == pytest.approx(then["control"], rel=1e-6, abs=1e-12)
    assert now["value"] == pytest.approx(then["value"], rel=1e-6, abs=1e-9)
    assert now["what"] == then["what"]
    assert now["against"] == then["against"]


def test_checks_are_cells():
    cells = checks.cells()
    assert [c.key["check"] for c in cells] == [c.id for c in checks.CHECKS]
    assert len({c.content for c in cells}) == len(cells)
    assert checks.cells(quick=True) == []
