"""All studies and pages: the committed report is that of the committed rows, every claim can hold and can fail.

The committed report is what judges: a changed sentence, bound, column or figure shows in its difference, and
`phasebench report` writes it anew.
"""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from importlib.metadata import version
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from markdown_it import MarkdownIt

from phasebench.benchmarks import report, style
from phasebench.benchmarks.ladder.race import UNCOMPILED
from phasebench.benchmarks.page import drawn
from phasebench.benchmarks.page.page import ANSWER, CLAIM, NOTHING, ROWS, SETTING, VERDICTS, conclusion
from phasebench.benchmarks.page.study import Claim, Runs, Study, measured, rows_of
from phasebench.benchmarks.page.verdict import FAIL, FINDING, MEANING, MISSING, NONE, PASS, at_most
from phasebench.benchmarks.report import PAGES
from phasebench.benchmarks.store import compare, run, workers
from phasebench.benchmarks.store.cells import ALONE, text
from phasebench.benchmarks.store.cells import UNCOMPILED as APART
from phasebench.benchmarks.store.digits import TIMES
from phasebench.benchmarks.store.tables import STALE, Table, fresh_rows
from phasebench.benchmarks.studies import index
from phasebench.integrators import driver
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
IDS = [*(p.id for p in PAGES), "README"]
#: Largest size of a page in bytes, of a line in characters, of a paragraph in words, and of an HTML page in bytes.
PAGE, LINE, WORDS, HTML = 40_000, 400, 60, 800_000


@pytest.fixture(scope="module")
def data():
    """The committed tables."""
    return report.Data(REPORTS)


# -- the report --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder of the report on the committed tables; an integration raises.

    Figures are drawn where their rows or the code that draws them have changed, but of pages that are alike one alone.
    """
    folder = tmp_path_factory.mktemp("report")
    (folder / "data").symlink_to(REPORTS / "data", target_is_directory=True)
    shutil.copytree(REPORTS / "figures", folder / "figures")
    kept, write = drawn.Figures(REPORTS).before, style.write
    alike = {name for id in ALIKE[1:] for name in kept[id]["files"]}

    def integrated(*given, **named):
        raise AssertionError("a page integrates")

    def composed(figure, path):
        shutil.copy(REPORTS / "figures" / path.name, path) if path.name in alike else write(figure, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "Solution", integrated)
        patch.setattr(style, "write", composed)
        report.build(folder, html_folder=folder / "html")
    return folder


@pytest.mark.parametrize("id", IDS)
def test_the_page_is_that_of_the_committed_rows(built, id):
    assert (built / f"{id}.md").read_text() == (REPORTS / f"{id}.md").read_text()


def test_figures_are_those_of_the_committed_rows(built, data):
    names = {place: {p.name for p in (place / "figures").iterdir()} for place in (built, REPORTS)}
    shown = {name for of in drawn.Figures(built).before.values() for name in of["files"]} | {drawn.KEPT}
    assert names[built] >= names[REPORTS] == shown
    assert {p.stem for p in REPORTS.glob("*.md")} <= {*IDS}
    known = [about for s in STUDIES for runs in s.runs if (about := data.about(runs.table))]
    if any(f"matplotlib {version('matplotlib')}" not in about["versions"] for about in known):
        return  # another version of matplotlib may draw otherwise
    for name in names[REPORTS] - {drawn.KEPT}:
        assert (built / "figures" / name).read_bytes() == (REPORTS / "figures" / name).read_bytes(), name


@pytest.mark.parametrize("id", IDS)
def test_form_of_a_page(built, id):
    """Short, links lead somewhere, tables are aligned; only outcomes are bold and nothing is italic."""
    text = (REPORTS / f"{id}.md").read_text()
    assert len(text.encode()) <= PAGE
    assert max(map(len, text.splitlines())) <= LINE
    assert not re.search(r"\bnan\b", text)
    parts = re.split(r"\n\n|\n- ", text)
    assert [p for p in parts if not p.lstrip().startswith("|") and len(p.split()) > WORDS] == []
    links = re.findall(r"\]\(([^)#\s]+)", text)
    assert [x for x in links if "://" not in x and not (REPORTS / x).exists()] == []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        assert len({len(line) for line in block.splitlines()}) == 1
    shown = MarkdownIt("commonmark").enable("table").render(text)
    bold = {text.partition(" in ")[0] for text in re.findall(r"<strong>(.*?)</strong>", shown, re.S)}
    assert bold <= {*MEANING, "Not measured", "In part not by this version"}
    assert "<em>" not in shown


@pytest.mark.parametrize("id", IDS)
def test_html_page_is_self_contained(built, id):
    page = built / "html" / f"{'index' if id == 'README' else id}.html"
    text = page.read_text()
    assert page.stat().st_size <= HTML
    assert not re.search(r"""src=["'](?:https?:)?//|<link|@import|url\(""", text)
    assert set(re.findall(r'src="([^"]{10})', text)) <= {"data:image"}
    links = [x for x in re.findall(r'href="([^"]+)"', text) if not x.startswith("https://")]
    assert [link for link in links if not (page.parent / link).exists()] == []
    assert id != "README" or {f"{p.id}.html" for p in PAGES if p.listed} <= {*links}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.id)
def test_parts_of_a_page(data, page):
    assert page.question.endswith("?")
    assert 1 <= len(page.setting) <= SETTING
    assert len(page.verdicts) <= VERDICTS
    assert all(len(claim.text.split()) <= CLAIM for claim in page.verdicts if isinstance(claim, Claim))
    text = " ".join((REPORTS / f"{page.id}.md").read_text().split())
    assert text.startswith(" ".join(f"# {page.question} **".split()))
    assert page.command in text
    if f"**{MISSING}**" in text.partition("?")[2][:20]:  # not every scene of the trade-off page needs to be measured
        assert not page.listed
        return
    assert all(f"(data/{name}.csv)" in text for name in page.tables if data(name) is not None)
    if page.listed:
        (line,) = [x for x in (REPORTS / "README.md").read_text().splitlines() if f"]({page.id}.md)" in x]
        cells = [x.strip() for x in re.split(r"(?<!\\)\|", line)]
        assert cells[2].strip("*") in MEANING
        assert 0 < len(re.sub(r" \([^()]*version[^()]*\)$", "", cells[3]).split()) <= ANSWER
        assert " ".join(cells[3].replace("\\|", "|").partition(" (")[0].split())[:60] in text


@pytest.mark.parametrize("study", [s for s in STUDIES if len(s.page.tables) > 1], ids=lambda s: s.id)
def test_a_page_is_written_of_one_of_its_tables(study, data):
    """As in the report of a user's rows."""
    page = study.page
    for one in page.tables:
        verdicts = page.judge(part := lambda name, one=one: data(name) if name == one else None)
        outcome, answer = conclusion(page, part, verdicts)
        shown = page.table(part)
        assert shown is None or len(shown.frame) <= ROWS
        assert answer if outcome != MISSING else answer == NOTHING


# -- in a browser -----------------------------------------------------------------------------------------------------

CHROMIUM = next((p for p in ("chromium", "chromium-browser", "google-chrome") if shutil.which(p)), None)
browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the HTML pages with")
#: A script run in a page; it leaves its answer as the text of the body.
SORT_AND_FILTER = """
const field = document.querySelector("input.filter"), table = field.nextElementSibling.querySelector("table");
const rows = () => [...table.tBodies[0].rows].filter((r) => !r.hidden);
const column = (k) => rows().map((r) => r.cells[k].textContent);
const before = column(COLUMN), names = column(0);
table.tHead.rows[0].cells[COLUMN].click();
const rising = column(COLUMN);
table.tHead.rows[0].cells[COLUMN].click();
const falling = column(COLUMN);
field.value = names[0];
field.dispatchEvent(new Event("input"));
document.body.textContent = "ANSWER" + JSON.stringify([before, rising, falling, names, column(0)]) + "END";
"""


def answer(page: Path, tmp_path: Path, *options: str) -> str:
    """The answer that the page's script leaves, in a headless Chromium."""
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
    command += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=5000", *options]
    done = subprocess.run(
        [*command, "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    return re.search(r"ANSWER(.*)END", done.stdout, re.S)[1]


@browser
def test_table_sorts_and_filters(built, tmp_path):
    text = (built / "html" / "structure.html").read_text()
    script = SORT_AND_FILTER.replace("COLUMN", "3")
    page = tmp_path / "page.html"
    page.write_text(text.replace("</body>", f"<script>{{{script}}}</script></body>"))
    before, rising, falling, names, left = json.loads(answer(page, tmp_path))
    numbers = sorted(map(float, before))
    assert list(map(float, rising)) == numbers
    assert list(map(float, falling)) == numbers[::-1]
    assert list(map(float, before)) != numbers
    assert sorted(left) == sorted(name for name in names if names[0] in name)
    assert 0 < len(left) < len(names)


@browser
def test_pages_fit_the_width_of_a_phone(built, tmp_path):
    pages = [(built / "html" / f"{id}.html").as_uri() for id in ["index", *IDS[:-1]]]
    frames = "".join(f'<iframe width="400" height="900" src="{page}"></iframe>' for page in pages)
    script = (
        "addEventListener('load', () => { const wide = [...document.querySelectorAll('iframe')].map((f) => "
        "[f.src.split('/').pop(), f.contentDocument.documentElement.scrollWidth]);"
        "document.body.textContent = 'ANSWER' + JSON.stringify(wide) + 'END'; });"
    )
    page = tmp_path / "all.html"
    page.write_text(f"<!doctype html><body>{frames}<script>{script}</script></body>")
    widths = json.loads(answer(page, tmp_path, "--allow-file-access-from-files"))
    assert len(widths) == len(pages)
    assert [(name, width) for name, width in widths if not 300 < width <= 400] == []


# -- claims ------------------------------------------------------------------------------------------------------------

#: Ways to make texts, and numbers, wrong.
TEXTS = (None, f"{UNCOMPILED}wrong")
SPOIL = (lambda x: x * 1e9, lambda x: x * 1e-9, lambda x: x + 17.0, lambda x: -x, lambda x: x * 10, lambda x: x * x)
#: Rows of a long table that are spoiled first, one by one column.
FEW = 200
#: The columns of the keys of each table.
KEYS = {table: {*runs.keys[0]} for s in STUDIES for runs in s.runs for table in (runs.table, *runs.more)}


def coarsely(frame: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Copies of a table in which all numbers, or all that is true or false, are wrong; the rows of a text alone.

    Numbers keep their sign: a function need not take a time that is negative.
    """
    numbers, logical = frame.select_dtypes("number"), frame.select_dtypes(bool)
    texts = frame.select_dtypes(exclude=["number", bool])
    larger = [spoil for spoil in SPOIL if spoil(1.0) > 0]
    yield from (frame.assign(**{c: spoil(numbers[c].astype(float)) for c in numbers}) for spoil in larger)
    yield from (frame.assign(**dict.fromkeys(logical, value)) for value in (False, True) if len(logical.columns))
    yield from (frame[texts[c] == x] for c in texts for x in texts[c].unique()[:20])


def spoiled(frame: pd.DataFrame, keys: set[str]) -> Iterator[pd.DataFrame]:
    """Copies of a table with a wrong column, save texts of keys: in all rows, every other one, those of a text.

    Then copies in which a column has one number, or the values of another column, or other wrong texts; and copies
    without the rows of a text.
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
    yield from (frame.assign(**{c: x}) for c in numbers for x in (numbers[c].iloc[0], numbers[c].median()))
    columns = texts.columns.difference(keys)
    pairs = [*permutations(numbers, 2), *permutations(columns, 2)]
    yield from (frame.assign(**{one: frame[other]}) for one, other in pairs)
    yield from (frame.assign(**{column: text}) for column in columns for text in TEXTS)
    yield from (frame[~part] for part in same)


@pytest.mark.parametrize("claim", CLAIMS)
def test_every_claim_can_hold_and_can_fail(claim, data):
    """With the committed numbers or with wrong ones in a part of a column; without its rows it says nothing."""
    frame = rows_of(data, claim.table)
    assert claim(lambda name: None) is None
    if frame is None:
        pytest.skip("its table has never been measured")
    assert replace(claim, table=lambda data: frame.head(0))(data) is None
    assert outcomes(claim, frame, data) >= {PASS, FAIL if claim.fault else FINDING}


def needed(judge, frame: pd.DataFrame) -> pd.DataFrame:
    """The columns of a table without which a claim cannot be judged, or otherwise."""
    known = judge(frame)

    def lacks(column: str) -> bool:
        try:
            return judge(frame.drop(columns=column)) != known
        except Exception:  # whatever a function of the study raises
            return True

    return frame[[c for c in frame if lacks(c)]]


def outcomes(claim: Claim, frame: pd.DataFrame, data=lambda name: None) -> set[str]:
    """Outcomes of a claim on a table and on its spoiled copies, until there are both."""
    known = {name: rows_of(data, name) for name in claim.beside}  # dear tables are made once

    def judge(one: pd.DataFrame):
        beside = [lambda data, name=name: known[name] for name in known]
        return replace(claim, table=lambda data: one, beside=beside)(data)

    def copies() -> Iterator[pd.DataFrame]:
        yield frame
        yield from coarsely(frame)
        columns = needed(judge, frame)
        columns = frame[[c for c in frame if c in columns or f"{{{c}" in str(claim.where)]]
        middle = np.mean([getattr(claim.expected, end, np.inf) for end in ("low", "high")])
        if np.isfinite(middle):
            yield from (columns.assign(**{c: middle}) for c in columns.select_dtypes("number"))
        keys = KEYS.get(claim.table, set())
        if len(frame) > FEW:
            yield from spoiled(columns.iloc[:: len(frame) // FEW], keys)
        yield from spoiled(columns, keys)

    found: set[str] = set()
    for one in copies():
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


def test_wrong_values_that_are_counted_are_named():
    frame = pd.DataFrame({"method": list("abcd"), "problem": "x", "good": [True, False, False, False]})
    assert [Claim("", "t", "good", names=n)({"t": frame}.get).where for n in (1, 2, 3)] == [
        "b on x", "b on x, c on x and 1 more", "b on x, c on x and d on x",
    ]  # fmt: skip
    assert Claim("", "t", "good", NONE, where="{method}", names=3)({"t": frame}.get).where == "a"


def literals(tree: ast.AST) -> Iterable[ast.expr]:
    """The first argument, or ``claim=``, of each call of Claim or Verdict."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("Claim", "Verdict"):
            yield (node.args or [k.value for k in node.keywords if k.arg == "claim"])[0]


def test_the_text_of_a_claim_is_a_literal():
    """A computed one could contain a measured number."""
    folder = Path(index.__file__).parent
    texts = [text for p in folder.rglob("*.py") for text in literals(ast.parse(p.read_text()))]
    assert len(texts) >= len(STUDIES)
    assert [ast.unparse(text) for text in texts if not isinstance(text, ast.Constant)] == []


# -- cells -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.id)
def test_keys_are_those_of_the_committed_tables(study):
    cells = study.cells()
    assert len({c.id for c in cells}) == len(cells)
    assert study.cells(quick=True) == [c for c in cells if c.quick]
    for runs in study.runs:
        path = REPORTS / "data" / f"{runs.table}.csv"
        if not path.exists():
            continue  # it has never been measured
        keys = {tuple(map(text, key.values())): runs.dear(**key) for key in runs.keys}
        frame = pd.read_csv(path, dtype=str, keep_default_na=False, usecols=[*runs.keys[0]] or None)
        there = {*map(tuple, frame[list(runs.keys[0])].to_numpy())}
        known = [{*column} for column in zip(*there, strict=True)]
        lost = [k for k in {*keys} - there if not keys[k] or all(x in of for x, of in zip(k, known, strict=True))]
        assert there <= {*keys}
        assert not lost, "only what is dear, and of a method or problem that is new, may wait"


#: Seconds: of the stored measurements that took no longer, the longest of each table is made again, or the quickest.
LONG, LONGEST = 0.5, 2.5
#: So many measurements are made again of a table for which nothing is compiled.
MANY = 20
#: Tables of fine grids, which magnify round-off: `test_multisymplectic` has the laws of box schemes.
MAGNIFIED = ("multisymplectic",)
#: First digits are the same; what is smaller is round-off.
SAME = compare.Again(units=(0.0, 1e-12))


def quick_cells(runs, cells, stored) -> list:
    """The cells of a table that are measured again; none if all take too long, or their rows are outdated."""
    known = [(about, cell) for cell in cells if cell.available and (about := stored.intact(cell))]
    spent = {cell.id: float(about["spent"]) for about, cell in known if about["state"] != STALE}
    found = sorted((c for c in cells if spent.get(c.id, np.inf) <= LONGEST), key=lambda c: spent[c.id])
    short = [c for c in found if spent[c.id] <= LONG]
    return short[:: max(1, len(short) // MANY)] if runs.where == APART else short[-1:] or found[:1]


def differences(table, new, old) -> list:
    """The numbers of two tables that differ, without times and words."""
    columns = {c for row in (*new, *old) for c in row if not TIMES.fullmatch(c)} - {*compare.WORDS}
    limits = dict.fromkeys(columns, SAME) | compare.BANDS.get(table, {})
    return compare.differences(compare.match(new, old, []), limits)


@pytest.mark.parametrize(
    ("study", "runs"),
    [
        pytest.param(s, runs, id=runs.table)
        for s in STUDIES
        for runs in s.runs
        if runs.where != ALONE and runs.table not in MAGNIFIED
    ],
)
def test_a_quick_measurement_comes_out_as_it_is_stored(study, runs):
    """A wrong sign in a measure shows here; a right change shows, too, until its rows are measured."""
    stored = Table(REPORTS / "data", runs.table)
    with workers.Worker(APART) if runs.where == APART else nullcontext() as apart:
        for cell in quick_cells(runs, runs.cells(study), stored):
            work = cell.measure, cell.arguments
            found = workers.answer(*work) if apart is None else apart.call(workers.answer, *work).value
            assert found.error is None, found.error
            new = fresh_rows(run.entry(cell, found), runs.table, cell)
            assert differences(runs.table, new, stored.of(cell)) == [], cell.label


def test_control_a_changed_number_is_seen():
    old = [{"method": "rk4", "error": "0.5", "seconds": "1"}]
    assert [d.column for d in differences("t", [old[0] | {"error": "0.501", "seconds": "2"}], old)] == ["error"]


def test_the_key_of_a_cell_holds_what_its_method_and_problem_stand_for():
    study = Study("one", 0, "", "", (), (), {}, ())
    keys = [{"method": m, "problem": p} for m, p in (("rk4", "pendulum"), ("rk4", "kepler"), ("gauss-4", "pendulum"))]
    cells = Runs("t", at_most, keys).cells(study)
    assert [c.names for c in cells] == [{"rk4", "pendulum"}, {"rk4", "kepler"}, {"gauss-4", "pendulum"}]
    assert len({c.content for c in cells}) == 3
    assert cells[0].content != Runs("t", at_most, keys, needs=("more",)).cells(study)[0].content


def test_rows_of_a_cell_begin_with_its_key():
    key = (("method", "rk4"), ("h", 0.1))
    assert measured(("t",), lambda method, h: {"x": h}, key) == {"t": [{"method": "rk4", "h": 0.1, "x": 0.1}]}
    both = measured(("t", "u"), lambda method, h: {"t": [{"h": 2}], "u": []}, key)
    assert both == {"t": [{"method": "rk4", "h": 2}], "u": []}


@pytest.mark.parametrize("id", ["options", "trade-duffing"])
def test_a_study_is_found_by_its_id_and_its_figure_depends_on_its_module(id):
    (page,) = [p for p in PAGES if p.id == id]
    assert page.question == index.found()[id].question
    assert drawn.module_of(page.figures) == f"phasebench.benchmarks.studies.{id.partition('-')[0]}"
