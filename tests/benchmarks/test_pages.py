"""The pages: short, complete, self-contained; every verdict follows its rows."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pytest
from markdown_it import MarkdownIt

from phasebench.benchmarks import report, style
from phasebench.benchmarks.page import drawn, html, markdown
from phasebench.benchmarks.page.drawn import Figures
from phasebench.benchmarks.page.origin import commits
from phasebench.benchmarks.page.page import ANSWER, CLAIM, ROWS, SETTING, VERDICTS, Table, conclusion
from phasebench.benchmarks.page.verdict import (
    EVERY,
    FAIL,
    FINDING,
    LIST,
    MEANING,
    MISSING,
    PASS,
    Count,
    Verdict,
    at_most,
    overall,
)
from phasebench.benchmarks.report import PAGES
from phasebench.benchmarks.store import tables
from phasebench.integrators import driver
from phasebench.integrators.errors import InvalidInput
from support.pages import REPORTS

DATA = REPORTS / "data"
#: Largest size of a page in bytes, of a line in characters, and of an HTML page with its figures in bytes.
PAGE, LINE, HTML = 40_000, 400, 800_000
#: Largest number of words of a paragraph.
WORDS = 60
IDS = [p.id for p in PAGES]
EXPERIMENTS = DATA.parents[1] / "benchmarks" / "experiments"


class Said(NamedTuple):
    """What a page shows for the committed tables: the data that it reads, its verdicts and its table."""

    data: report.Data
    verdicts: list[Verdict]
    table: Table | None


@pytest.fixture(scope="module")
def built_report(tmp_path_factory):
    """(folder of the report on the committed tables, {page id: what it shows}); an integration raises.

    A figure is composed and not rasterized, which takes most of the time: the committed file stands for it.
    """
    folder, said = tmp_path_factory.mktemp("report"), {}
    shutil.copytree(DATA, folder / "data")
    shutil.copytree(DATA.parent / "figures", folder / "figures")
    written, judged, write = report._write_page, report.Page.judge, style.write

    def integrated(*given, **named):
        raise AssertionError("a page integrates")

    def judging(page, data):
        said[page.id] = judged(page, data)
        return said[page.id]

    def writing(page, data, *rest):
        entry = written(page, data, *rest)
        said[page.id] = Said(data, said[page.id], entry.table)
        return entry

    def composed(figure, path):
        known = DATA.parent / "figures" / path.name
        shutil.copy(known, path) if known.exists() else write(figure, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "Solution", integrated)
        patch.setattr(style, "write", composed)
        patch.setattr(report.Page, "judge", judging)
        patch.setattr(report, "_write_page", writing)
        report.build(folder, html_folder=folder / "html")
    return folder, said


@pytest.fixture(scope="module")
def folder(built_report):
    """The folder of the report on the committed tables."""
    return built_report[0]


@pytest.fixture(scope="module")
def page_texts(built_report):
    """{page id: what it shows for the committed tables}."""
    return built_report[1]


@pytest.fixture(scope="module")
def conclusions(page_texts):
    """{page id: (outcome, answer)}, what each page concludes from the committed tables."""
    return {page.id: conclusion(page, page_texts[page.id].data) for page in PAGES}


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    """The folder of a report without tables."""
    folder = tmp_path_factory.mktemp("empty")
    report.build(folder)
    return folder


# -- the form of a page ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", [*IDS, "README"])
def test_form_of_a_page(folder, id):
    """Short, links lead somewhere, tables are aligned; only outcomes are bold and nothing is italic."""
    text = (folder / f"{id}.md").read_text()
    assert len(text.encode()) <= PAGE
    assert max(map(len, text.splitlines())) <= LINE
    assert (folder / "html" / f"{'index' if id == 'README' else id}.html").stat().st_size <= HTML
    assert not re.search(r"\bnan\b", text)
    parts = re.split(r"\n\n|\n- ", text)
    assert [p for p in parts if not p.lstrip().startswith("|") and len(p.split()) > WORDS] == []
    links = re.findall(r"\]\(([^)#\s]+)", text)
    assert [x for x in links if "://" not in x and not (folder / x).exists()] == []
    for block in re.findall(r"(?:^\|.*\n)+", text, re.M):
        assert len({len(line) for line in block.splitlines()}) == 1
    shown = MarkdownIt("commonmark").enable("table").render(text)
    bold = {text.partition(" in ")[0] for text in re.findall(r"<strong>(.*?)</strong>", shown, re.S)}
    assert bold <= {*MEANING, "Not measured", "In part not by this version"}
    assert "<em>" not in shown


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_page_has_its_parts(folder, page_texts, conclusions, page):
    data, verdicts, table = page_texts[page.id]
    assert page.question.endswith("?")
    assert 1 <= len(page.setting) <= SETTING
    text = (folder / f"{page.id}.md").read_text()
    outcome, answer = conclusions[page.id]
    begins = f"# {page.question} **{outcome}** {answer}"
    assert " ".join(text.split()).startswith(" ".join(begins.split()))
    assert page.command in text
    if outcome == MISSING:  # not every scene of the trade-off page needs to be measured
        assert not page.listed
        return
    assert len(answer.split()) <= ANSWER
    assert answer.endswith(".")
    assert len(verdicts) <= VERDICTS
    assert bool(page.verdicts) == (outcome != LIST)
    for found in verdicts:
        assert len(found.claim.split()) <= CLAIM
        assert found.outcome in MEANING
        assert all(isinstance(cell, str) for cell in found.row().values())
    assert table is None or 1 <= len(table.frame) <= ROWS
    assert all(f"(data/{name}.csv)" in text for name in page.tables if data(name) is not None)
    assert not page.tables or "easured on" in text


def claims(tree):
    """The first argument, or ``claim=``, of each call of Verdict in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Verdict":
            named = [k.value for k in node.keywords if k.arg == "claim"]
            yield (node.args or named)[0]


def test_claim_of_a_verdict_is_a_literal():
    """A computed claim could contain a measured number."""
    found = [(path.name, c) for path in EXPERIMENTS.rglob("*.py") for c in claims(ast.parse(path.read_text()))]
    assert [(name, ast.unparse(c)) for name, c in found if not isinstance(c, ast.Constant)] == []
    control = ast.parse('Verdict(f"{n} hold", 1), Verdict(measured=2, claim=text), Verdict("all hold", 3)')
    assert [type(c) for c in claims(control)] == [ast.JoinedStr, ast.Name, ast.Constant]


def test_no_committed_figure_or_page_is_stale(folder):
    """Every committed file is shown by a present page."""
    committed = DATA.parent
    shown = json.loads((folder / "figures" / drawn.KEPT).read_text()).values()
    names = {name for page in shown for name in page["files"]}
    assert {p.name for p in (committed / "figures").iterdir()} - names == {drawn.KEPT}
    assert {p.stem for p in committed.glob("*.md")} <= {*IDS, "README"}


def test_index_names_every_page_with_its_outcome(folder, conclusions):
    text = (folder / "README.md").read_text()
    for page in PAGES:
        if not page.listed:
            assert any(f"]({page.id}.md)" in (folder / f"{p.id}.md").read_text() for p in PAGES if p.listed)
            continue
        found, short = conclusions[page.id]
        (line,) = [x for x in text.splitlines() if f"]({page.id}.md)" in x]
        assert f"**{found}**" in line
        assert short.replace("|", "\\|") in line
    assert "## Which integrator for which accuracy" in text


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_page_without_its_tables_says_so(empty, page):
    text = (empty / f"{page.id}.md").read_text()
    assert (f"**{MISSING}**" in text) == bool(page.tables)
    assert all(name in text for name in page.tables)
    lines = [x for x in (empty / "README.md").read_text().splitlines() if f"]({page.id}.md)" in x]
    assert len(lines) == page.listed
    assert all((f"**{MISSING}**" in line) == bool(page.tables) for line in lines)


@pytest.fixture(scope="module")
def committed_tables():
    """Path -> the committed table."""
    return {path: pd.read_csv(path, low_memory=False) for path in DATA.glob("*.csv")}


def draw(figure, path):
    """Draw every artist of a figure at low resolution without layout, and leave an empty file in place of the image."""
    figure.set_layout_engine("none")
    figure.set_dpi(20)
    with style.settings():
        figure.canvas.draw()
    path.touch()


@pytest.mark.parametrize("part", ["last", "failed", "none"])
def test_report_of_a_few_rows_is_written(tmp_path, monkeypatch, committed_tables, part):
    monkeypatch.setattr(style, "write", draw)
    (tmp_path / "data").mkdir()
    for path, table in committed_tables.items():
        if part == "failed" and "status" in table:
            few = table[table["status"] != "ok"].head(40)
        else:
            few = {"last": table.tail(7), "none": table.head(0), "failed": table.head(2)}[part]
        few.to_csv(tmp_path / "data" / path.name, index=False)
        shutil.copy(path.with_suffix(".json"), tmp_path / "data")
    assert report.build(tmp_path, quick=True).exists()
    assert "quick tier" in (tmp_path / "README.md").read_text()


@pytest.fixture
def two_pages(monkeypatch):
    """Reduce the report to two pages: trade, which the index shows, and speed."""
    monkeypatch.setattr(report, "PAGES", tuple(p for p in PAGES if p.id in ("trade", "speed")))


@pytest.mark.usefixtures("two_pages")
def test_failed_report_changes_no_file(tmp_path, monkeypatch):
    pages = tmp_path / "html"
    report.build(tmp_path, html_folder=pages)
    (tmp_path / "README.md").write_text("as it was")
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    written = html.document

    def broken(text, *rest, **named):
        if "phasebench: what was measured" in text:
            raise OSError(28, "no space is left")
        return written(text, *rest, **named).replace("</body>", "<p>new</p></body>")

    monkeypatch.setattr(html, "document", broken)
    with pytest.raises(InvalidInput, match="cannot be written: no space is left; it is as it was"):
        report.build(tmp_path, html_folder=pages)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


@pytest.mark.usefixtures("two_pages")
def test_html_is_written_to_the_requested_folder(tmp_path):
    report.build(tmp_path / "report")
    assert not list(tmp_path.rglob("*.html"))
    report.build(tmp_path / "report", html_folder=tmp_path / "site")
    assert {p.name for p in tmp_path.rglob("*.html")} == {"index.html", "trade.html", "speed.html"}
    assert not list((tmp_path / "report").glob("*.html"))


@pytest.mark.usefixtures("two_pages")
def test_html_of_removed_pages_is_deleted(tmp_path):
    site = tmp_path / "site"
    report.build(tmp_path / "report", html_folder=site)
    (site / "speed.html").rename(site / "velocity.html")
    (site / "mine.html").write_text("<!doctype html><title>mine</title>")
    report.build(tmp_path / "report", html_folder=site)
    assert {p.name for p in site.iterdir()} == {"index.html", "mine.html", "speed.html", "trade.html"}


@pytest.mark.usefixtures("two_pages")
@pytest.mark.parametrize("place", ["file", "file/site", "/proc/site"])
def test_html_in_an_invalid_folder_is_refused(tmp_path, place):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InvalidInput, match=f"no report can be written to .*{place}: "):
        report.build(tmp_path / "report", html_folder=tmp_path / place)
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == ["file"]
    assert (tmp_path / "file").read_text() == "mine"


def test_a_page_says_of_which_commits_its_rows_are():
    measured = [("2026-11-20", "aaaa", "m", 1), ("2026-11-21", "bbbb", "m", 5), ("2026-11-22", "bbbb", "n", 2)]
    assert commits(measured) == ("Rows: 7 of commit bbbb (2026-11-21 to 2026-11-22) and 1 of commit aaaa (2026-11-20).")
    assert "2 of no known commit" in commits([("2026-11-20", tables.UNKNOWN, "m", 2)])


def with_states(tmp_path, states: list[str], **columns):
    """(index entry, text) of the speed page if the rows of its table are current or outdated (``states``)."""
    shutil.copytree(DATA, tmp_path / "data")
    table = tables.Table(tmp_path / "data", "ratios")
    keys = dict(list(table.keys.items())[: len(states)])
    rows = [{columns.get(k, k): v for k, v in row.items()} for key in keys for row in table.rows_of(key)]
    for line, state in zip(keys.values(), states, strict=True):
        line["state"] = state
    table.replace(rows, keys, table.about)
    (tmp_path / "figures").mkdir()
    both = report.Data(tmp_path), report.Data(tmp_path, stale=False)
    written = report._page(next(p for p in PAGES if p.id == "speed"), both, Figures(tmp_path), tmp_path)
    return written, " ".join((tmp_path / "speed.md").read_text().split())


#: The other tables of the page.
OTHERS = ("speed", "speed_calls")
OTHER_ROWS = sum(len(pd.read_csv(DATA / f"{name}.csv")) for name in OTHERS)
OLD = f"2 of {3 + OTHER_ROWS} rows by an earlier version of the code"


@pytest.mark.parametrize(("states", "said"), [(["stale", "", "stale"], True), ([""] * 3, False)])
def test_page_with_outdated_rows_says_so(tmp_path, states, said):
    written, text = with_states(tmp_path, states)
    assert "data/ratios.csv): 3 rows" in text
    assert (f"**In part not by this version**: {OLD};" in text) == said
    assert (f"({OLD})" in written.answer) == said


def test_outdated_rows_of_another_format_are_left_out(tmp_path):
    _, text = with_states(tmp_path, ["stale", "stale"], median="name")
    assert "of another form and left out" in text
    assert "data/ratios.csv" not in text.partition("## Make it again")[2].partition("Not measured")[0]


def test_current_rows_of_another_format_are_an_error(tmp_path):
    with pytest.raises((KeyError, NameError)):
        with_states(tmp_path, ["", ""], median="name")


@pytest.fixture
def speed(two_pages, tmp_path, monkeypatch):
    """(folder of a drawn report on speed, list that collects the names of figures drawn from now on)."""
    (tmp_path / "data").mkdir()
    for name in ("ratios", "speed"):
        for end in ("csv", "json"):
            shutil.copy(DATA / f"{name}.{end}", tmp_path / "data")
    report.build(tmp_path)
    names, write = [], style.write
    monkeypatch.setattr(style, "write", lambda figure, path: names.append(path.name) or write(figure, path))
    return tmp_path, names


def test_unchanged_figures_are_not_redrawn(speed):
    folder, names = speed
    before = {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    report.build(folder)
    assert names == []
    assert {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before


def cut_a_row(folder):
    table = folder / "data" / "ratios.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))


def touch_a_figure(folder):
    with (folder / "figures" / "speed.png").open("ab") as stream:
        stream.write(b"more")


CHANGES = [
    cut_a_row,
    touch_a_figure,
    lambda folder: (folder / "figures" / "speed.png").unlink(),
    lambda folder: (folder / "figures" / drawn.KEPT).write_text("{"),
]


@pytest.mark.parametrize("change", CHANGES, ids=["a row", "a figure", "no figure", "no list"])
def test_figures_are_redrawn_after_a_change(speed, change):
    folder, names = speed
    change(folder)
    report.build(folder)
    assert names == ["speed.png"]


def test_figures_are_redrawn_if_their_code_changes(speed, monkeypatch):
    folder, names = speed
    monkeypatch.setattr(drawn, "_source", lambda module: "other")
    report.build(folder)
    assert names == ["speed.png"]


@pytest.mark.parametrize(
    ("id", "module"),
    [("options", "options"), ("trade-duffing", "trade")],
)
def test_figure_depends_on_the_module_of_its_study(id, module):
    """Not on that of the layer, or of the decorator around its function."""
    (page,) = [p for p in PAGES if p.id == id]
    assert drawn.module_of(page.figures) == f"phasebench.benchmarks.studies.{module}"


def test_outcome_of_a_page_is_its_worst_verdict():
    good, bad = (Verdict("all are well", Count(n, 2), EVERY) for n in (2, 1))
    wrong, missing = Verdict("errors are small", 2.0, at_most(1.0), otherwise=FAIL), Verdict("none", None, EVERY)
    assert [v.outcome for v in (good, bad, wrong, missing)] == [PASS, FINDING, FAIL, MISSING]
    assert overall([missing, good]) == PASS
    assert overall([good, bad]) == FINDING
    assert overall([bad, wrong]) == FAIL
    assert overall([missing]) == MISSING
    assert overall([]) == LIST


@pytest.mark.lowest
def test_vertical_bar_in_a_cell_is_escaped():
    text = markdown.table(pd.DataFrame({"what": ["|H - H0|"]}))
    assert r"\|H - H0\|" in text


# -- HTML --------------------------------------------------------------------------------------------------------------


def test_index_is_open_and_long_tables_are_folded(folder, tmp_path):
    """The tables of the index are visible at once; equally long tables of other pages are folded."""
    index = (folder / "html" / "index.html").read_text()
    assert index.count("<tr>") > html.LONG + 2
    assert "<details>" not in index
    text = (folder / "README.md").read_text().replace("(figures/", f"({folder}/figures/")
    assert "<details>" in html.document(text, tmp_path)
    assert "<details>" not in html.document(text, tmp_path, fold=False)


@pytest.mark.parametrize("text", ["p1**2 + p2**2/2", "RadauIIA3.__order__", "q1*q2*q3", "a_b_c"])
def test_escaped_text_is_shown_verbatim(text):
    render = MarkdownIt("commonmark").render
    assert render(markdown.plain(text)) == f"<p>{text}</p>\n"
    assert render(markdown.code(text)) == f"<p><code>{text}</code></p>\n"


@pytest.mark.parametrize("id", [*IDS, "index"])
def test_html_page_is_self_contained(folder, id):
    text = (folder / "html" / f"{id}.html").read_text()
    assert not re.search(r"""src=["'](?:https?:)?//|<link|@import|url\(""", text)
    assert set(re.findall(r'src="([^"]{10})', text)) <= {"data:image"}
    links = [x for x in re.findall(r'href="([^"]+)"', text) if not x.startswith("https://")]
    assert [link for link in links if not (folder / "html" / link).exists()] == []
    if id == "index":
        assert {f"{p.id}.html" for p in PAGES if p.listed} <= set(links)


CHROMIUM = next((p for p in ("chromium", "chromium-browser", "google-chrome") if shutil.which(p)), None)
browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the HTML pages with")
#: A script run in a page; it leaves its answer as the text of the body.
SORT_AND_FILTER = """
const field = document.querySelector("input.filter"), table = field.nextElementSibling.querySelector("table");
const rows = () => [...table.tBodies[0].rows].filter((r) => !r.hidden);
const column = (k) => rows().map((r) => r.cells[k].textContent);
const before = column(COLUMN);
table.tHead.rows[0].cells[COLUMN].click();
const rising = column(COLUMN);
table.tHead.rows[0].cells[COLUMN].click();
const falling = column(COLUMN);
field.value = "WORD";
field.dispatchEvent(new Event("input"));
document.body.textContent = "ANSWER" + JSON.stringify([before, rising, falling, column(0)]) + "END";
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
def test_table_sorts_and_filters(folder, tmp_path):
    text = (folder / "html" / "structure.html").read_text()
    script = SORT_AND_FILTER.replace("COLUMN", "3").replace("WORD", "dop853")
    page = tmp_path / "page.html"
    page.write_text(text.replace("</body>", f"<script>{{{script}}}</script></body>"))
    before, rising, falling, left = json.loads(answer(page, tmp_path))
    numbers = sorted(map(float, before))
    assert list(map(float, rising)) == numbers
    assert list(map(float, falling)) == numbers[::-1]
    assert list(map(float, before)) != numbers
    assert 0 < len(left) < len(before)


@browser
def test_pages_fit_the_width_of_a_phone(folder, tmp_path):
    pages = [(folder / "html" / f"{id}.html").as_uri() for id in [*IDS, "index"]]
    frames = "".join(f'<iframe width="400" height="900" src="{page}"></iframe>' for page in pages)
    script = (
        "addEventListener('load', () => { const wide = [...document.querySelectorAll('iframe')].map((f) => "
        "[f.src.split('/').pop(), f.contentDocument.documentElement.scrollWidth]);"
        "document.body.textContent = 'ANSWER' + JSON.stringify(wide) + 'END'; });"
    )
    page = tmp_path / "all.html"
    page.write_text(f"<!doctype html><body>{frames}<script>{script}</script></body>")
    widths = json.loads(answer(page, tmp_path, "--allow-file-access-from-files"))
    assert len(widths) == len(IDS) + 1
    assert [(name, width) for name, width in widths if not 300 < width <= 400] == []


@pytest.mark.usefixtures("two_pages")
def test_a_report_that_is_not_that_of_its_tables_is_found(tmp_path):
    shutil.copytree(DATA, tmp_path / "data")
    report.build(tmp_path)
    assert report.check(tmp_path) == []
    page, table = tmp_path / "speed.md", tmp_path / "data" / "ratios.csv"
    page.write_text(page.read_text().replace("0", "1", 1))
    assert report.check(tmp_path) == ["speed.md"]
    report.build(tmp_path)
    table.write_text(table.read_text().replace(".", ".9", 5))
    assert {"speed.md", "figures of speed"} <= {*report.check(tmp_path)}
