"""Reports of other rows: of few or none, outdated ones, into other folders; which figures are drawn again; style."""

from __future__ import annotations

import shutil
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from markdown_it import MarkdownIt
from PIL import Image

from phasebench.benchmarks import report, style
from phasebench.benchmarks.page import drawn, html, markdown
from phasebench.benchmarks.page.drawn import Figures
from phasebench.benchmarks.page.origin import commits
from phasebench.benchmarks.page.verdict import (
    EVERY,
    FAIL,
    FINDING,
    LIST,
    MISSING,
    PASS,
    Count,
    Verdict,
    at_most,
    overall,
)
from phasebench.benchmarks.report import PAGES
from phasebench.benchmarks.store import tables
from phasebench.integrators.errors import InvalidInput
from support.pages import REPORTS

DATA = REPORTS / "data"


def content(folder):
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_report_without_tables_says_so(tmp_path):
    report.build(tmp_path)
    entry = (tmp_path / "README.md").read_text().splitlines()
    for page in PAGES:
        text = (tmp_path / f"{page.id}.md").read_text()
        assert (f"**{MISSING}**" in text) == bool(page.tables)
        assert all(name in text for name in page.tables)
        lines = [x for x in entry if f"]({page.id}.md)" in x]
        assert len(lines) == page.listed
        assert all((f"**{MISSING}**" in line) == bool(page.tables) for line in lines)


def draw(figure, path):
    """Draw every artist of a figure at low resolution without layout, and leave an empty file in place of the image."""
    figure.set_layout_engine("none")
    figure.set_dpi(20)
    with style.settings():
        figure.canvas.draw()
    path.touch()


@pytest.mark.parametrize("part", ["last", "failed"])
def test_report_of_a_few_rows_is_written(tmp_path, monkeypatch, part):
    monkeypatch.setattr(style, "write", draw)
    (tmp_path / "data").mkdir()
    for path in DATA.glob("*.csv"):
        table = pd.read_csv(path, low_memory=False)
        failed = table[table["status"] != "ok"].head(40) if "status" in table else table.head(0)
        {"last": table.tail(7), "failed": failed}[part].to_csv(tmp_path / "data" / path.name, index=False)
        shutil.copy(path.with_suffix(".json"), tmp_path / "data")
    assert report.build(tmp_path, quick=True).exists()
    assert "quick tier" in (tmp_path / "README.md").read_text()


# -- files -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def speed(tmp_path, monkeypatch):
    """(folder of a drawn report on speed, list that collects the names of figures drawn from now on).

    It has two pages: trade, which the index shows, and speed.
    """
    monkeypatch.setattr(report, "PAGES", tuple(p for p in PAGES if p.id in ("trade", "speed")))
    folder, names, write = tmp_path / "report", [], style.write
    (folder / "data").mkdir(parents=True)
    for name in ("ratios", "speed"):
        for end in ("csv", "json"):
            shutil.copy(DATA / f"{name}.{end}", folder / "data")
    report.build(folder)
    monkeypatch.setattr(style, "write", lambda figure, path: names.append(path.name) or write(figure, path))
    return folder, names


def test_failed_report_changes_no_file(speed, tmp_path, monkeypatch):
    folder, _ = speed
    report.build(folder, html_folder=tmp_path / "html")
    (folder / "README.md").write_text("as it was")
    before, written = content(tmp_path), html.document

    def broken(text, *rest, **named):
        if "phasebench: what was measured" in text:
            raise OSError(28, "no space is left")
        return written(text, *rest, **named).replace("</body>", "<p>new</p></body>")

    monkeypatch.setattr(html, "document", broken)
    with pytest.raises(InvalidInput, match="cannot be written: no space is left; it is as it was"):
        report.build(folder, html_folder=tmp_path / "html")
    assert content(tmp_path) == before


def test_html_is_written_to_the_requested_folder_and_what_was_removed_is_deleted(speed, tmp_path):
    folder, _ = speed
    site = tmp_path / "site"
    assert not list(tmp_path.rglob("*.html"))
    report.build(folder, html_folder=site)
    assert {p.name for p in tmp_path.rglob("*.html")} == {"index.html", "trade.html", "speed.html"}
    assert {p.name for p in (site / "data").iterdir()} == {"ratios.csv", "speed.csv"}
    (site / "speed.html").rename(site / "velocity.html")
    (site / "mine.html").write_text("<!doctype html><title>mine</title>")
    report.build(folder, html_folder=site)
    assert {p.name for p in site.glob("*.html")} == {"index.html", "mine.html", "speed.html", "trade.html"}
    (tmp_path / "file").write_text("mine")
    for place in ("file", "file/site"):
        with pytest.raises(InvalidInput, match=f"no report can be written to .*{place}: "):
            report.build(folder, html_folder=tmp_path / place)
    assert (tmp_path / "file").read_text() == "mine"


def cut_a_row(folder):
    table = folder / "data" / "ratios.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))


def touch_a_figure(folder):
    with (folder / "figures" / "speed.png").open("ab") as stream:
        stream.write(b"more")


@pytest.mark.parametrize(
    ("change", "again"),
    [
        (lambda folder: None, False),
        (cut_a_row, True),
        (touch_a_figure, True),
        (lambda folder: (folder / "figures" / "speed.png").unlink(), True),
        (lambda folder: (folder / "figures" / drawn.KEPT).write_text("{"), True),
    ],
    ids=["nothing", "a row", "a figure", "no figure", "no list"],
)
def test_figures_are_drawn_again_after_a_change(speed, change, again):
    folder, names = speed
    change(folder)
    before = content(folder)
    report.build(folder)
    assert names == ["speed.png"] * again
    assert again or content(folder) == before


def test_a_report_that_is_not_that_of_its_tables_is_found(speed):
    folder, _ = speed
    assert report.check(folder) == []
    page, table = folder / "speed.md", folder / "data" / "ratios.csv"
    page.write_text(page.read_text().replace("0", "1", 1))
    assert report.check(folder) == ["speed.md"]
    report.build(folder)
    table.write_text(table.read_text().replace(".", ".9", 5))
    assert {"speed.md", "figures of speed"} <= {*report.check(folder)}


# -- outdated rows -----------------------------------------------------------------------------------------------------


def with_states(tmp_path, states: list[str], **columns):
    """(index entry, text) of the speed page if the rows of its table are current or outdated (``states``)."""
    (tmp_path / "data").mkdir()
    for name in ("ratios", *OTHERS):
        for end in ("csv", "json", "keys"):
            shutil.copy(DATA / f"{name}.{end}", tmp_path / "data")
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
OLD = f"2 of {3 + sum(len(pd.read_csv(DATA / f'{x}.csv')) for x in OTHERS)} rows by an earlier version of the code"


@pytest.mark.parametrize(("states", "said"), [(["stale", "", "stale"], True), ([""] * 3, False)])
def test_page_with_outdated_rows_says_so(tmp_path, states, said):
    written, text = with_states(tmp_path, states)
    assert "data/ratios.csv): 3 rows" in text
    assert (f"**In part not by this version**: {OLD};" in text) == said
    assert (f"({OLD})" in written.answer) == said


def test_rows_of_another_form_are_left_out_if_they_are_outdated(tmp_path):
    _, text = with_states(tmp_path, ["stale", "stale"], median="name")
    assert "of another form and left out" in text
    assert "data/ratios.csv" not in text.partition("## Make it again")[2].partition("Not measured")[0]
    (tmp_path / "current").mkdir()
    with pytest.raises((KeyError, NameError)):
        with_states(tmp_path / "current", ["", ""], median="name")


def test_a_page_says_of_which_commits_its_rows_are():
    measured = [("2026-11-20", "aaaa", "m", 1), ("2026-11-21", "bbbb", "m", 5), ("2026-11-22", "bbbb", "n", 2)]
    assert commits(measured) == ("Rows: 7 of commit bbbb (2026-11-21 to 2026-11-22) and 1 of commit aaaa (2026-11-20).")
    assert "2 of no known commit" in commits([("2026-11-20", tables.UNKNOWN, "m", 2)])


# -- Markdown and HTML -------------------------------------------------------------------------------------------------


def test_outcome_of_a_page_is_its_worst_verdict():
    good, bad = (Verdict("all are well", Count(n, 2), EVERY) for n in (2, 1))
    wrong, missing = Verdict("errors are small", 2.0, at_most(1.0), otherwise=FAIL), Verdict("none", None, EVERY)
    assert [v.outcome for v in (good, bad, wrong, missing)] == [PASS, FINDING, FAIL, MISSING]
    of = [missing, good], [good, bad], [bad, wrong], [missing], []
    assert [overall(verdicts) for verdicts in of] == [PASS, FINDING, FAIL, MISSING, LIST]


@pytest.mark.lowest
@pytest.mark.parametrize("text", ["p1**2 + p2**2/2", "RadauIIA3.__order__", "a_b_c"])
def test_text_is_escaped(text):
    render = MarkdownIt("commonmark").render
    assert render(markdown.plain(text)) == f"<p>{text}</p>\n"
    assert render(markdown.code(text)) == f"<p><code>{text}</code></p>\n"
    assert r"\|H - H0\|" in markdown.table(pd.DataFrame({"what": ["|H - H0|"]}))


# -- the style of figures ----------------------------------------------------------------------------------------------


def test_a_few_pixels_of_a_colour_keep_it(tmp_path):
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.0)
        x = np.linspace(0, 60, 5000)
        for k, colour in enumerate((style.BLUE, style.VERMILION, style.PURPLE, style.ORANGE)):
            axes.plot(x, np.sin(x + k), color=colour)
        axes.plot([30], [1.2], "s", color=style.GREEN, markersize=4)
        style.write(figure, tmp_path / "x.png")
    with Image.open(tmp_path / "x.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    green = [int(style.GREEN[i : i + 2], 16) for i in (1, 3, 5)]
    assert np.abs(pixels - green).max(axis=1).min() <= 4


def boxes(figure, axis):
    """The boxes of an axis's visible tick labels, in pixels, from the left to the right."""
    low, high = sorted(axis.get_view_interval())
    ticks = [t for t in (*axis.get_major_ticks(), *axis.get_minor_ticks()) if low <= t.get_loc() <= high]
    labels = [t.label1 for t in ticks if t.label1.get_text()]
    return sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)


@pytest.mark.parametrize(
    ("columns", "span", "inverted"),
    [(1, (2e-5, 1.1e-4), False), (4, (1.7e-6, 5.5e-5), True), (3, (130, 4800), False), (4, (60, 200), False)],
)
def test_labels_of_a_logarithmic_axis_do_not_overlap(columns, span, inverted, tmp_path):
    with style.settings():
        figure, ((axes, *_),) = style.panels(1, columns, 3.0)
        axes.loglog(span, (1e-9, 1.0))
        if inverted:
            axes.invert_xaxis()
            figure.draw_without_rendering()
            assert any(a.x1 >= b.x0 for a, b in pairwise(boxes(figure, axes.xaxis))), "the control: matplotlib's own"
        style.write(figure, tmp_path / "x.png")
        found = boxes(figure, axes.xaxis)
        assert len(found) >= 2
        assert all(a.x1 < b.x0 for a, b in pairwise(found))
