"""All studies: their pages are those of the committed rows, and every claim can hold and can fail.

The committed report is what judges: a changed sentence, bound, column or figure shows in its difference, and
`phasebench report` writes it anew.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from itertools import chain, permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks import report
from phasebench.benchmarks.ladder.race import UNCOMPILED
from phasebench.benchmarks.page import drawn, markdown
from phasebench.benchmarks.page.origin import count_outdated, origin
from phasebench.benchmarks.page.page import NOTHING, conclusion
from phasebench.benchmarks.page.study import Claim, Runs, Study, rows_of
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MISSING, NONE, PASS, at_most
from phasebench.benchmarks.store.cells import text
from phasebench.benchmarks.studies import index
from support.pages import REPORTS

#: All studies; of the pages that are neither listed nor measure anything, which are of one form, only the first.
ALIKE = tuple(s.id for s in index.found().values() if not (s.listed or s.runs))
STUDIES = tuple(s for s in index.found().values() if s.id not in ALIKE[1:])
CLAIMS = [
    pytest.param(claim, id=f"{s.id}-{name}")
    for s in STUDIES
    for name, claim in [*s.claims.items(), *s.checks.items(), *s.numbers.items()]
    if isinstance(claim, Claim)
]
#: Ways to make texts, and numbers, wrong.
TEXTS = (None, f"{UNCOMPILED}wrong")
SPOIL = (lambda x: x * 1e9, lambda x: x * 1e-9, lambda x: x + 17.0, lambda x: -x, lambda x: x * 10, lambda x: x * x)


@pytest.fixture(scope="module")
def data():
    """The committed tables."""
    return report.Data(REPORTS)


def page_text(study: Study, data, folder: Path) -> str:
    """The page of a study, whose figures are drawn into a folder."""
    page = study.page
    verdicts = page.judge(data)
    outcome, answer = conclusion(page, data, verdicts)
    parts = verdicts, page.figures(data, folder) or [], page.table(data), origin(page, data), count_outdated(page, data)
    return markdown.document(page, outcome, answer, *parts)


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.id)
def test_the_page_is_that_of_the_committed_rows(study, data, tmp_path):
    assert page_text(study, data, tmp_path) == (REPORTS / f"{study.id}.md").read_text(encoding="utf-8")
    known = [about for runs in study.runs if (about := data.about(runs.table))]
    if any(f"matplotlib {version('matplotlib')}" not in about["versions"] for about in known):
        return  # another version of matplotlib may draw otherwise
    for picture in tmp_path.iterdir():
        assert picture.read_bytes() == (REPORTS / "figures" / picture.name).read_bytes(), picture.name


@pytest.mark.parametrize("study", [s for s in STUDIES if len(s.page.tables) > 1], ids=lambda s: s.id)
def test_a_page_is_written_of_one_of_its_tables(study, data):
    """As in the report of a user's rows."""
    page = study.page
    for one in page.tables:
        verdicts = page.judge(part := lambda name, one=one: data(name) if name == one else None)
        outcome, answer = conclusion(page, part, verdicts)
        page.table(part)
        assert answer if outcome != MISSING else answer == NOTHING


def spoiled(frame: pd.DataFrame, keys: set[str]) -> Iterator[pd.DataFrame]:
    """Copies of a table with a wrong column, save texts of keys: in all rows, every other one, those of a text.

    Then copies in which all numbers are wrong, a column has one number, or the values of another column, or other
    wrong texts; and copies without the rows of a text.
    """
    texts = frame.select_dtypes(exclude="number")
    same = [(texts[c] == x).to_numpy() for c in texts for x in texts[c].unique()[:40]]
    for part in (np.arange(len(frame)) >= 0, np.arange(len(frame)) % 2 == 0, *same):
        for column in frame.columns.difference(keys & {*texts}, sort=False):
            values = frame[column].to_numpy()
            if values.dtype == bool:
                wrong = [~values]
            else:
                wrong = ["wrong"] if column in texts else [spoil(values.astype(float)) for spoil in SPOIL]
            yield from (frame.assign(**{column: np.where(part, one, values)}) for one in wrong)
    numbers = frame.select_dtypes("number")
    yield from (frame.assign(**{c: spoil(numbers[c].astype(float)) for c in numbers}) for spoil in SPOIL)
    yield from (frame.assign(**{c: x}) for c in numbers for x in (numbers[c].iloc[0], numbers[c].median()))
    columns = texts.columns.difference(keys)
    pairs = [*permutations(numbers, 2), *permutations(columns, 2)]
    yield from (frame.assign(**{one: frame[other]}) for one, other in pairs)
    yield from (frame.assign(**{column: text}) for column in columns for text in TEXTS)
    yield from (frame[~part] for part in same)


#: The columns of the keys of each table.
KEYS = {table: {*runs.keys[0]} for s in STUDIES for runs in s.runs for table in (runs.table, *runs.more)}


@pytest.mark.parametrize("claim", CLAIMS)
def test_every_claim_can_hold_and_can_fail(claim, data):
    """With the committed numbers or with wrong ones in a part of a column; without its rows it says nothing."""
    frame = rows_of(data, claim.table)
    assert claim(lambda name: None) is None
    if frame is None:
        pytest.skip("its table has never been measured")
    assert replace(claim, table=lambda data: frame.head(0))(data) is None
    assert outcomes(claim, frame, data) >= {PASS, FAIL if claim.fault else FINDING}


def needed(judge, frame: pd.DataFrame, column: str) -> bool:
    """True if a claim cannot be judged without the column, or otherwise."""
    try:
        return judge(frame.drop(columns=column)) != judge(frame)
    except Exception:  # whatever a function of the study raises
        return True


def outcomes(claim: Claim, frame: pd.DataFrame, data=lambda name: None) -> set[str]:
    """Outcomes of a claim on a table and on its spoiled copies, until there are both."""

    def judge(one: pd.DataFrame):
        return replace(claim, table=lambda data: one)(data)

    found: set[str] = set()
    frame = frame[[c for c in frame if needed(judge, frame, c) or f"{{{c}" in str(claim.where)]]
    middle = np.mean([getattr(claim.expected, end, np.inf) for end in ("low", "high")])
    right = (frame.assign(**{c: middle}) for c in frame.select_dtypes("number") if np.isfinite(middle))
    for one in chain([frame], spoiled(frame, KEYS.get(claim.table, set())), right):
        verdict = judge(one)
        found |= {verdict.outcome} if verdict is not None else set()
        if PASS in found and found & {FAIL, FINDING}:
            break
    return found


def test_control_a_claim_that_cannot_fail_is_seen():
    frame = pd.DataFrame({"method": ["a", "b"], "error": [1e-9, 2e-9]})
    assert outcomes(Claim("errors are small", "t", "error", at_most(1e-3)), frame) == {PASS, FINDING}
    assert outcomes(Claim("errors are small", "t", "0 * error", at_most(1e-3)), frame) == {PASS}
    assert outcomes(Claim("errors are small", "t", "error ** 2", at_most(-1)), frame) == {FINDING}


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.id)
def test_keys_are_those_of_the_committed_tables(study):
    cells = study.cells()
    assert len({c.id for c in cells}) == len(cells)
    assert study.cells(quick=True) == [c for c in cells if c.quick]
    for runs in study.runs:
        path = REPORTS / "data" / f"{runs.table}.csv"
        if not path.exists():
            continue  # it has never been measured
        frame = pd.read_csv(path, dtype=str, keep_default_na=False)
        keys = {tuple(map(text, key.values())) for key in runs.keys}
        assert {*map(tuple, frame[list(runs.keys[0])].to_numpy())} == keys


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.id)
def test_a_study_is_found_by_its_id(study):
    (page,) = [p for p in report.PAGES if p.id == study.id]
    assert page.question == study.question
    assert drawn.module_of(page.figures).startswith("phasebench.benchmarks.studies.")


def test_the_key_of_a_cell_holds_what_its_method_and_problem_stand_for():
    study = Study("one", 0, "", "", (), (), {}, ())
    keys = [{"method": m, "problem": p} for m, p in (("rk4", "pendulum"), ("rk4", "kepler"), ("gauss-4", "pendulum"))]
    cells = Runs("t", at_most, keys).cells(study)
    assert [c.names for c in cells] == [{"rk4", "pendulum"}, {"rk4", "kepler"}, {"gauss-4", "pendulum"}]
    assert len({c.content for c in cells}) == 3
    assert cells[0].content != Runs("t", at_most, keys, needs=("more",)).cells(study)[0].content


def test_wrong_values_that_are_counted_are_named():
    frame = pd.DataFrame({"method": list("abcd"), "problem": "x", "good": [True, False, False, False]})
    assert [Claim("", "t", "good", names=n)({"t": frame}.get).where for n in (1, 2, 3)] == [
        "b on x", "b on x, c on x and 1 more", "b on x, c on x and d on x",
    ]  # fmt: skip
    assert Claim("", "t", "good", NONE, where="{method}", names=3)({"t": frame}.get).where == "a"


def test_the_text_of_a_claim_is_a_literal():
    """A computed one could contain a measured number."""
    folder = Path(index.__file__).parent
    calls = [n for p in folder.rglob("*.py") for n in ast.walk(ast.parse(p.read_text())) if isinstance(n, ast.Call)]
    texts = [call.args[0] for call in calls if getattr(call.func, "id", "") == "Claim"]
    assert len(texts) >= len(STUDIES)
    assert [ast.unparse(text) for text in texts if not isinstance(text, ast.Constant)] == []
