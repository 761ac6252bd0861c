"""The talks' statements: all are listed, every verdict is a function of rows, every check can fail."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.experiments.talks import checks, checks_schemes, statements_page
from phasebench.benchmarks.experiments.talks.judging import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.experiments.talks.statement import KINDS
from phasebench.benchmarks.experiments.talks.statements import FIRST, SECOND, SECTIONS
from phasebench.benchmarks.page.page import ROWS
from phasebench.benchmarks.page.verdict import FINDING, PASS, Count
from phasebench.benchmarks.problems import PROBLEMS
from phasebench.integrators.registry import BY_ID
from support.pages import REPORTS

ALL = [(section, s) for section in SECTIONS for s in section.statements]
IDS = [f"{section.id}-{i}-{s.where}" for i, (section, s) in enumerate(ALL)]
#: Verdicts on the committed rows, where they differ from "holds", by the place or the words of a statement.
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
    "Remarks II, 2": UNTESTABLE,
    # Of places with several statements: by the words.
    "geometry of the flow should be kept by methods": UNTESTABLE,
    "special values of λ are of wide practical use": UNTESTABLE,
    "so every quadratic invariant is kept for fixed λ": WHERE,
    "Scheme IV keeps the energy": WHERE,
}
#: Columns that a statement may be judged by, with a value that makes it fail.
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
    """The committed tables by name, each changed by a function."""

    def __init__(self, change=lambda frame: frame):
        self.data, self.change, self.known = report.Data(REPORTS), change, {}

    def __call__(self, name):
        if name not in self.known:
            frame = self.data(name)
            self.known[name] = None if frame is None else self.change(frame.copy())
        return self.known[name]


def corrupt(frame, error=1e-9):
    """A table with all values of the columns in `BAD` replaced by wrong ones, and the energy error by ``error``."""
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
    return Tables(corrupt), Tables(lambda frame: corrupt(frame, 1e9))


# -- completeness ------------------------------------------------------------------------------------------------------


def numbers(talk) -> set[int]:
    """The equation numbers of a talk's statements, ranges expanded."""
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


def test_rows_are_complete():
    assert {s.kind for _, s in ALL} <= set(KINDS)
    assert all(s.where and s.words and s.words != s.where for _, s in ALL)
    assert {s.page for _, s in ALL} <= {p.id for p in report.PAGES}
    assert all(len(section.statements) <= ROWS for section in SECTIONS)
    assert len({(section.talk, s.where, s.words) for section, s in ALL}) == len(ALL)


def test_systems_and_methods_of_the_talks_are_registered():
    assert {"pendulum", "kepler", "outer-solar-system", "fpu", "lotka-volterra", "henon-heiles"} <= set(PROBLEMS)
    assert {"perturbed-kepler", "nls", "klein-gordon"} <= set(PROBLEMS)
    named = "explicit-euler implicit-euler symplectic-euler-p symplectic-euler-q implicit-midpoint scheme-i scheme-ii "
    named += "scheme-i-adjoint generating-function scheme-iii scheme-iv scheme-v avf pavf gonzalez hbvm-4-2 cpg-2 "
    named += "gauss-2 lobatto-iiia-iiib-3 variational-gauss-2 rk4-projected-energy gauss-equip-2 scheme-iii-yoshida-4"
    assert set(named.split()) <= set(BY_ID)


def test_every_check_is_used(tables):
    """Every check that statements look up exists, and every check is looked up."""
    asked = set()

    class Watched:
        def __call__(self, name):
            return Column(asked) if name == checks.TABLE else tables(name)

    for _, s in ALL:
        s.judgement(Watched())
    assert asked == {c.id for c in checks.CHECKS}


class Column:
    """Stand-in for the table of checks: it has no rows and adds the checks that are looked up to the set ``asked``."""

    def __init__(self, asked):
        self.asked = asked

    def __contains__(self, name):
        return True

    def __getitem__(self, key):
        return self if key == "check" else pd.DataFrame()

    def isin(self, values):
        self.asked |= set(values)
        return "none"


# -- verdicts, both ways -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("statement", [s for _, s in ALL], ids=IDS)
def test_verdicts_on_the_committed_rows(statement, tables):
    found = statement.judgement(tables)
    assert found.verdict == KNOWN.get(statement.words, KNOWN.get(statement.where, HOLDS))
    assert found.measured
    assert len(found.measured) <= 200


@pytest.mark.parametrize("statement", [s for _, s in ALL], ids=IDS)
def test_wrong_rows_change_the_verdict(statement, tables, wrong):
    before, *after = (statement.judgement(t).verdict for t in (tables, *wrong))
    if before in (UNTESTABLE, CONTRADICTED):
        assert set(after) == {before}
    else:
        assert CONTRADICTED in after


@pytest.mark.parametrize(
    ("where", "table", "column", "value"),
    [
        ("Scheme IV, heading", "multiprecision", "order", 1.0),
        ("Table 2, Scheme IV", "printed", "units", 0.3),
        ("Results, 2", "talk_checks", "value", 0.0),
        ("Remark", "pde", "invariant error", 1e-15),
    ],
)
def test_better_rows_would_make_a_statement_hold(where, table, column, value, tables):
    statement = next(s for _, s in ALL if s.where == where)
    better = tables(table).assign(**{column: value})

    def data(name):
        return better if name == table else tables(name)

    assert statement.judgement(tables).verdict != HOLDS
    assert statement.judgement(data).verdict == HOLDS


#: Largest value at which the statements of a check hold, by kind: sums and products of a few numbers; of many;
#: Jacobians by differences, also of a flow; differences of these; printed digits; fits.
LIMITS = {
    **dict.fromkeys(("pendulum", "oriented-areas", "lotka-volterra", "special-values", "adjoint", "nystrom"), 1e-14),
    **dict.fromkeys(("form-minus-one", "form-third", "form-three-halves", "form-two", "singular"), 1e-14),
    **dict.fromkeys(("henon-heiles", "kepler-momentum"), 1e-14) | {"henon-heiles-data": 1e-15},
    **dict.fromkeys(("lagrange", "linear-maps", "integrability", "level-curves", "coefficients"), 1e-13),
    **dict.fromkeys(("first-integral", "group"), 1e-12),
    **{"any-parameter": 1e-11, "poincare": 1e-10, "locally-hamiltonian": 1e-10},
    **{"exact-form": 1e-9, "hamilton-jacobi": 1e-8},
    **{"kepler-data": 5e-5, "closed-euler": 0.01, "solvable": 0.1, "damps": 0.999, "momentum": 1e-11},
}


def replace_columns(tables, table, **columns):
    """A function name -> committed table; columns of ``table`` are replaced in all rows, or in those of a ``check``."""
    id = columns.pop("check", None)
    frame = tables(table).copy()
    rows = frame["check"] == id if id else slice(None)
    for column, value in columns.items():
        frame.loc[rows, column.replace("_", " ") if column not in frame else column] = value
    return lambda name: frame if name == table else tables(name)


@pytest.fixture(scope="module")
def asking():
    """{id of a check, a measurement that statements of the talks refer to: the statements that look it up}."""
    found = {}
    for _, s in ALL:
        asked = set()
        s.judgement(lambda name, asked=asked: Column(asked) if name == checks.TABLE else None)
        for id in asked:
            found.setdefault(id, []).append(s)
    return found


#: Checks that are not in `LIMITS`: conditions under which a statement holds, and a check of signs.
OTHERS = {"mass", "degenerate", "closed-midpoint", "species"}


def test_every_check_has_its_limit():
    assert set(LIMITS) == {c.id for c in checks.CHECKS} - OTHERS


@pytest.mark.parametrize("id", LIMITS)
def test_check_holds_exactly_up_to_its_limit(id, tables, asking):
    limit, row = LIMITS[id], tables(checks.TABLE).set_index("check").loc[id]
    assert abs(row["value"]) <= limit
    for s in asking[id]:
        inside, outside = (replace_columns(tables, checks.TABLE, check=id, value=limit * x) for x in (0.999, 1.001))
        assert s.judgement(inside).verdict == s.judgement(tables).verdict
        assert s.judgement(outside).verdict == CONTRADICTED
        seen = 1e-9 if id == "solvable" else limit
        weak, strong = (replace_columns(tables, checks.TABLE, check=id, control=seen * x) for x in (1, 1.001))
        assert s.judgement(weak).verdict == CONTRADICTED, "a control that does not fail"
        assert s.judgement(strong).verdict == s.judgement(tables).verdict


def test_condition_vanishes_with_better_measurements(tables):
    s = next(s for _, s in ALL if s.words == "so every quadratic invariant is kept for fixed λ")
    assert s.judgement(tables).verdict == WHERE
    assert s.judgement(replace_columns(tables, checks.TABLE, check="mass", value=0.0)).verdict == HOLDS
    other = next(s for _, s in ALL if s.where == "Theorem (2)")
    assert other.judgement(replace_columns(tables, checks.TABLE, check="degenerate", value=0.05)).verdict == HOLDS
    for control, verdict in ((1e-9, WHERE), (1.001e-9, HOLDS)):
        seen = replace_columns(tables, checks.TABLE, check="degenerate", value=0.05, control=control)
        assert other.judgement(seen).verdict == verdict


def test_parameters_farthest_from_one_half_decide(tables):
    s = next(s for _, s in ALL if s.where == "Remarks II, 1")
    curves = tables("talk_curves")
    here = curves[(curves["figure"] == "perturbed-kepler-parameter") & (curves["panel"] == "lambda")]
    first = here.index[0]
    assert len(here) > 1

    def judged(**values):
        frame = curves.copy()
        frame.loc[here.index, ["median", "low", "high"]] = 0.5, 0.4, 0.6
        for column, value in values.items():
            frame.loc[first, column] = value
        return s.judgement(lambda name: frame if name == "talk_curves" else tables(name))

    assert judged().verdict == HOLDS
    assert judged(median=0.61).verdict == judged(median=0.39).verdict == CONTRADICTED
    assert "range 0.1 to 0.9" in judged(low=0.1, high=0.9).measured


@pytest.mark.parametrize("column", ["two-form", "total energy error"])
def test_one_bad_row_of_a_box_scheme_contradicts(column, tables):
    table = "multisymplectic"
    s, frame = next(s for _, s in ALL if s.words == "EQUIP multi-symplectic methods"), tables(table)
    equip = frame[frame["id"] == "equip-box"]
    assert s.judgement(tables).verdict == HOLDS
    limit = 10 * equip["two-form, round-off"] if column == "two-form" else pd.Series(1e-11, equip.index)
    for row in equip.index[[0, -1]]:
        for factor, verdict in ((0.999, HOLDS), (1.001, CONTRADICTED)):
            other = frame.copy()
            other.loc[row, column] = factor * limit[row]
            assert s.judgement(lambda name, other=other: other if name == table else tables(name)).verdict == verdict


@pytest.mark.parametrize(
    ("where", "methods"),
    [
        ("Remarks I, 3", "generating-function(lam=1/3, order=6)"),
        ("Remarks I, 3", "scheme-iii-hlw-10(lam=1/3)"),
        ("(18)", "generating-function(lam=1/3, order=2)"),
        ("(18)", "generating-function(lam=1/3, order=3)"),
        ("(18)", "generating-function(lam=1/3, order=4)"),
        ("Compositions", "scheme-iii-yoshida-4(lam=1/3)"),
        ("Compositions", "scheme-iii-yoshida-6(lam=1/3)"),
        ("Remarks II, 3", "scheme-v-yoshida-4"),
        ("Remarks II, 3", "scheme-v-kahan-li-8"),
    ],
)
def test_one_method_of_another_order_contradicts(where, methods, tables):
    s, frame = next(s for _, s in ALL if s.where == where), tables("multiprecision").copy()
    rows = frame["method"] == methods
    assert rows.any()
    assert s.judgement(tables).verdict == HOLDS
    frame.loc[rows, "order"] -= 0.5
    assert s.judgement(lambda name: frame if name == "multiprecision" else tables(name)).verdict == CONTRADICTED


@pytest.mark.parametrize(
    ("where", "table", "column"),
    [
        ("Scheme IV", "energy_preservation", "energy error, steps with a root"),
        ("Scheme IV", "pde", "energy error"),
        ("Remark", "energy_preservation", "angular momentum error"),
    ],
)
def test_worst_of_two_tables_counts(where, table, column, tables):
    s, frame = next(s for _, s in ALL if s.where == where), tables(table).copy()
    assert s.judgement(tables).verdict == WHERE
    here = frame[(frame.get("scheme", frame.get("method")) == "scheme-iv") & frame[column].notna()]
    here = here[
        (here["status"] == "ok") & (here["problem"] == "perturbed-kepler" if column.startswith("ang") else True)
    ]
    for row in here.index[[0, -1]]:
        worse = frame.copy()
        worse.loc[row, column] = 1e-8
        assert s.judgement(lambda name, worse=worse: worse if name == table else tables(name)).verdict == CONTRADICTED


@pytest.fixture
def curve(tables):
    """A function that changes one value of a figure's curves and returns the verdict on a statement about the figure.

    Its arguments: the statement's words; figure, panel, column and row of the value; the new value or a function of the
    old.
    """

    def judged(words, figure, panel, column, row, value):
        s, frame = next(s for _, s in ALL if s.words == words), tables("talk_curves").copy()
        here = frame[(frame["figure"] == figure) & (frame["panel"].astype(str) == panel) & frame[column].notna()]
        before = frame.loc[here.index[row], column]
        frame.loc[here.index[row], column] = value(before) if callable(value) else value
        return s.judgement(lambda name: frame if name == "talk_curves" else tables(name))

    return judged


@pytest.mark.parametrize(
    ("words", "panel", "limit", "above"),
    [
        ("Euler methods from (2, 2) and (4, 8), h = 0.12, leave the level curve", "explicit Euler", 2, True),
        ("Euler methods from (2, 2) and (4, 8), h = 0.12, leave the level curve", "implicit Euler", 2, True),
        ("explicit and implicit Euler are qualitatively wrong", "explicit Euler", 2, True),
        ("explicit and implicit Euler are qualitatively wrong", "implicit Euler", 2, True),
        ("midpoint from (4, 2) and (2, 2), h = 0.12, stays near the level curve", "implicit midpoint", 0.05, False),
        ("symplectic Euler from (4, 2) and (6, 2), h = 0.12, stays in a band", "symplectic Euler", 2, False),
    ],
)
def test_orbit_near_its_level_curve_by_its_invariant(words, panel, limit, above, curve):
    for row in (0, -1):
        for factor in (0.999, 1.001):
            found = curve(words, "lotka-volterra-methods", panel, "energy_error", row, factor * limit)
            assert found.verdict == (HOLDS if (factor > 1) == above else CONTRADICTED)


@pytest.mark.parametrize(
    ("words", "panel"),
    [
        ("the pendulum's flow carries sets without changing their area", "exact flow"),
        ("nonlinear symplectic maps keep areas", "symplectic Euler"),
        ("nonlinear symplectic maps keep areas", "implicit midpoint"),
    ],
)
def test_area_is_preserved_to_round_off_at_all_times(words, panel, curve, tables):
    for row in (1, -1):
        for change, verdict in ((0.9e-11, HOLDS), (1.2e-11, CONTRADICTED)):
            found = curve(words, "pendulum-area", panel, "area", row, lambda area, change=change: area + change)
            assert found.verdict == verdict
    frame = tables("talk_curves").copy()
    lost = (frame["figure"] == "pendulum-area") & (frame["panel"] == "explicit Euler")
    found = curve(words, "pendulum-area", panel, "area", 2, lambda area: area + 5e-12)
    assert found.measured == "change of area up to 5.0e-12; explicit Euler 7.0e-01"
    frame.loc[lost, "area"] = 1.0
    s = next(s for _, s in ALL if s.words == words)
    same = s.judgement(lambda name: frame if name == "talk_curves" else tables(name))
    assert same.verdict == CONTRADICTED, "a control that keeps it too"


def test_flow_preserves_the_measure_of_a_disc(curve):
    words = "the exact flow goes round on level curves of I"
    for change, verdict in ((0.9e-11, HOLDS), (1.2e-11, CONTRADICTED)):
        found = curve(words, "lotka-volterra-flow", "disc", "measure", -1, lambda x, change=change: x + change)
        assert found.verdict == verdict


@pytest.mark.parametrize(
    ("value", "control", "verdict"),
    [(-1.0, 1.0, HOLDS), (0.0, 1.0, CONTRADICTED), (-1.0, 0.0, CONTRADICTED), (0.5, 1.0, CONTRADICTED)],
)
def test_predators_reduce_the_growth_of_the_prey(value, control, verdict, tables):
    s = next(s for _, s in ALL if s.where == "Fig. 4.1, names")
    assert (
        s.judgement(replace_columns(tables, checks.TABLE, check="species", value=value, control=control)).verdict
        == verdict
    )


def test_parallelogram_is_judged_by_three_rows(tables):
    s, frame = next(s for _, s in ALL if s.where == "Fig. 2.1"), tables("talk_curves")
    here = frame[frame["figure"] == "linear-symplectic-map"]
    assert (len(here), s.judgement(tables).verdict) == (3, HOLDS)
    two = frame.drop(index=here.index[-1])
    assert s.judgement(lambda name: two).verdict == MISSING
    same = frame.copy()
    same.loc[here.index[2], ["x", "y"]] = same.loc[here.index[0], ["x", "y"]].to_numpy()
    assert s.judgement(lambda name: same).verdict == CONTRADICTED, "a control that keeps it too"


def test_steps_without_a_root_are_a_condition(tables):
    statement = next(s for _, s in ALL if s.where == "Scheme IV")
    assert statement.judgement(tables).verdict == WHERE
    none = {"energy_preservation": "without a root", "pde": "fallbacks"}
    assert statement.judgement(lambda name: tables(name).assign(**{none[name]: 0})).verdict == HOLDS


def test_no_verdict_without_rows():
    for _, s in ALL:
        assert s.judgement(lambda name: None).verdict in (MISSING, UNTESTABLE)
    assert [v for page in statements_page.PAGES for v in page.judge(lambda name: None)] == []
    assert statements_page.exceptions(lambda name: None) is None


# -- the page ----------------------------------------------------------------------------------------------------------


def rows(*verdicts) -> pd.DataFrame:
    return pd.DataFrame([{"where": f"({i})", "says": "x", "verdict": v} for i, v in enumerate(verdicts)])


@pytest.mark.parametrize(
    ("judge", "bad"),
    [
        (statements_page.contradictions, CONTRADICTED),
        (statements_page.conditional, WHERE),
        (statements_page.complete, MISSING),
    ],
)
def test_each_verdict_counts_its_statements(judge, bad):
    assert judge(rows(HOLDS, UNTESTABLE, HOLDS)).outcome == PASS
    found = judge(rows(HOLDS, bad, HOLDS, UNTESTABLE))
    assert (found.outcome, found.measured, found.where) == (FINDING, Count(1, 4), "(1)")
    assert judge(rows(MISSING, UNTESTABLE)) is None


def test_statements_that_do_not_hold_come_first(tables):
    table = statements_page.exceptions(tables).frame
    verdicts = list(table["verdict"])
    assert len(verdicts) <= ROWS
    assert HOLDS not in verdicts
    assert verdicts == sorted(verdicts, key=[CONTRADICTED, MISSING, WHERE, UNTESTABLE].index)
    everything = statements_page.everything(tables)
    assert (everything["verdict"] != HOLDS).sum() == len(table)
    assert len(everything) == len(ALL)


# -- the checks --------------------------------------------------------------------------------------------------------

#: The checks that compile no kernel, and two that do.
QUICK = (*(c.id for c in checks.CHECKS if not c.methods), "form-third", "adjoint")


@pytest.fixture(scope="module")
def measured_rows():
    found = [row for id in QUICK for row in checks.measure_rows(id)[checks.TABLE]]
    return pd.DataFrame(found)


@pytest.mark.parametrize("id", QUICK)
def test_check_reproduces_its_committed_row(id, measured_rows, tables):
    now = measured_rows[measured_rows["check"] == id].iloc[0]
    then = tables(checks.TABLE)
    then = then[then["check"] == id].iloc[0]
    assert now["control"] == pytest.approx(then["control"], rel=1e-6, abs=1e-12)
    assert now["value"] == pytest.approx(then["value"], rel=1e-6, abs=1e-9)
    assert now["what"] == then["what"]
    assert now["against"] == then["against"]


def test_classical_generating_functions_are_0_half_1():
    assert sorted(checks_schemes.CLASSICAL) == [0, 0.5, 1]


def test_checks_are_cells():
    cells = checks.cells()
    assert [c.key["check"] for c in cells] == [c.id for c in checks.CHECKS]
    assert len({c.content for c in cells}) == len(cells)
    assert checks.cells(quick=True) == []
