"""Writes the report from the tables of a run: an entry page and a page for each question, in Markdown.

Nothing is integrated here: a page is a pure function of rows on disk, verdicts included.  A complete report is written
into a temporary folder and then replaces the old one file by file, the entry page last.  The same pages are written as
HTML on request.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page import html, markdown
from phasebench.benchmarks.page.drawn import Figures
from phasebench.benchmarks.page.origin import count_outdated, origin
from phasebench.benchmarks.page.page import Page, Picture, Table, conclusion
from phasebench.benchmarks.page.verdict import MEANING
from phasebench.benchmarks.studies import index
from phasebench.integrators.errors import InvalidInput

from .store import tables as results

#: All pages, in reading order.
PAGES: tuple[Page, ...] = tuple(study.page for study in index.found().values())
QUICK = "This is the quick tier: few steps, few rounds; it shows that the suite runs, and no more."


class Data:
    """The tables of a report folder, each read once: ``data("front")`` is the table ``front``, None if it is missing.

    With ``stale`` the tables include rows that an earlier version of the code measured.
    """

    def __init__(self, folder: Path, stale: bool = True) -> None:
        self.folder, self.stale = folder, stale
        self._known: dict = {}
        self._digests: dict[str, str] = {}

    def __call__(self, name: str) -> pd.DataFrame | None:
        """Return the table with this name as a DataFrame, or None if it was not measured."""
        return self._read(name)[0]

    def origins(self, name: str) -> list[tuple[str, str, str, int]]:
        """Return when, by which commit and where the rows of a table were measured: `tables.origins`."""
        return results.origins(self.folder, name)

    def about(self, name: str) -> dict | None:
        """Return the metadata of a table: machine, versions, number of stale rows; None if it was not measured."""
        return self._read(name)[1]

    def digest(self, name: str) -> str:
        """Return a hash, 16 hex digits, of a table's file and of whether its stale rows are used.

        Stale rows were measured by an earlier version of the code.
        """
        if name not in self._digests:
            path = self.folder / "data" / f"{name}.csv"
            content = path.read_bytes() if path.exists() else b""
            self._digests[name] = hashlib.sha256(content + bytes([self.stale])).hexdigest()[:16]
        return self._digests[name]

    def _read(self, name: str) -> tuple[pd.DataFrame, dict] | tuple[None, None]:
        if name not in self._known:
            self._known[name] = results.read(self.folder, name, self.stale)
        return self._known[name]


@dataclass(frozen=True)
class _Written:
    """A page of the report after it was written: what the entry page and the HTML version are made from.

    Attributes
    ----------
    page : the definition of the page
    outcome, answer : the verdict in a word, and a sentence that answers the page's question
    pictures, table : the figures of the page, and the table that it shows, or None
    all_rows : the complete table, of which the page may show a part, without the provenance columns; or None
    """

    page: Page
    outcome: str
    answer: str
    pictures: list[Picture]
    table: Table | None
    all_rows: pd.DataFrame | None


def build(
    folder: str | Path,
    quick: bool = False,
    progress: Callable[[int, int], None] = lambda done, of: None,
    html_folder: str | Path | None = None,
) -> Path:
    """Write every page into ``folder`` from its data, all or none; return the path of the entry page.

    ``quick`` puts a note on the entry page that few steps were run; ``progress`` is called with the numbers of pages
    done and in all.  With ``html_folder`` the pages are also written there as HTML, with the tables that they link to.
    Raises InvalidInput if the data cannot be read or the pages cannot be written.
    """
    folder = Path(folder)
    pages = None if html_folder is None else Path(html_folder)
    with _scratch(folder) as scratch, _scratch(pages) if pages else nullcontext() as html_scratch:
        try:
            target = Path(scratch)
            (target / "figures").mkdir()
            both, figures = (Data(folder), Data(folder, stale=False)), Figures(folder)
            written = []
            for page in PAGES:
                written.append(_page(page, both, figures, target))
                progress(len(written), len(PAGES))
            figures.write(target / "figures")
            _entry(written, target, quick)
            if pages:
                _write_html(written, target, folder, Path(html_scratch))
                _remove_pages(pages)
                _replace(Path(html_scratch), pages)
            _replace(target, folder)
        except OSError as error:
            raise InvalidInput(f"the report in {folder} cannot be written: {error.strerror}; it is as it was") from None
    return folder / "README.md"


def check(folder: str | Path) -> list[str]:
    """Build the report anew from the data in ``folder``; return the names of what is not as it stands there.

    Pages are compared to the byte; of figures, what they are drawn from.  Raises InvalidInput as `build` does.
    """
    folder = Path(folder).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        target = Path(scratch)
        (target / "data").symlink_to(folder / "data", target_is_directory=True)
        shutil.copytree(folder / "figures", target / "figures", dirs_exist_ok=True)
        build(target)
        pages = {p.name for place in (folder, target) for p in place.glob("*.md")}
        other = [name for name in pages if _bytes(folder / name) != _bytes(target / name)]
        drawn = [{id: of["tables"] for id, of in Figures(place).before.items()} for place in (folder, target)]
    return sorted(
        [*other, *(f"figures of {id}" for id in {*drawn[0], *drawn[1]} if drawn[0].get(id) != drawn[1].get(id))]
    )


def _bytes(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None


def _scratch(folder: Path) -> tempfile.TemporaryDirectory:
    """Make a temporary folder in ``folder``, itself made if missing; raises InvalidInput if it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(dir=folder, prefix=".report-")
    except OSError as error:
        raise InvalidInput(f"no report can be written to {folder}: {error.strerror}") from None


def _page(page: Page, both: tuple[Data, Data], figures: Figures, target: Path) -> _Written:
    """Write a page into ``target`` from all its rows or, if this fails, from the rows that are not stale.

    Stale rows were measured by an earlier version of the code, and may lack columns that the page needs.  ``both`` is
    (the data with stale rows, the data without them); ``figures`` draws the page's figures, or copies those that have
    not changed.
    """
    data, current = both
    old = count_outdated(page, data)
    try:
        return _write_page(page, data, figures, target, old)
    except Exception:  # stale rows of another form can raise anything
        if not old:
            raise
        return _write_page(page, current, figures, target, f"{old}, of another form and left out")


def _write_page(page: Page, data: Data, figures: Figures, target: Path, old: str) -> _Written:
    verdicts = page.judge(data)
    pictures, table = figures.of(page, data, target / "figures"), page.table(data)
    all_rows = page.whole(data)
    outcome, answer = conclusion(page, data, verdicts)
    text = markdown.document(page, outcome, answer, verdicts, pictures, table, origin(page, data), old)
    (target / f"{page.id}.md").write_text(text, encoding="utf-8")
    return _Written(page, outcome, f"{answer} ({old})" if old else answer, pictures, table, all_rows)


def _entry(written: list[_Written], target: Path, quick: bool) -> None:
    """Write the entry page: a line per page, and a table of the best integrator for each accuracy.

    ``written`` has the pages of the report; ``quick`` adds a note that few steps were run.
    """
    lines = pd.DataFrame(
        [
            {"question": f"[{w.page.question}]({w.page.id}.md)", "outcome": f"**{w.outcome}**", "answer": w.answer}
            for w in written
            if w.page.listed
        ]
    )
    parts = ["# phasebench: what was measured\n", *([f"{QUICK}\n"] if quick else []), markdown.table(lines)]
    parts.append(markdown.bullets([f"**{outcome}**: {meaning}." for outcome, meaning in MEANING.items()]))
    choice = next(w for w in written if w.page.id == "trade")
    if choice.table is not None:
        parts += ["## Which integrator for which accuracy\n", markdown.wrap(choice.table.caption) + "\n"]
        parts += [markdown.table(choice.table.frame, digits=choice.table.digits)]
    for picture in choice.pictures[:1]:
        parts += [f"![{picture.title}](figures/{picture.file})\n", markdown.wrap(picture.caption) + "\n"]
    (target / "README.md").write_text("\n".join(parts), encoding="utf-8")


def _write_html(written: list[_Written], source: Path, folder: Path, target: Path) -> None:
    """Write the Markdown pages of the folder ``source`` as HTML into the folder ``target``.

    The tables to which they link are copied from ``folder`` into ``target``.
    """
    for w in written:
        text = (source / f"{w.page.id}.md").read_text(encoding="utf-8")
        (target / f"{w.page.id}.html").write_text(html.document(text, source, w.all_rows), encoding="utf-8")
    entry = (source / "README.md").read_text(encoding="utf-8")
    (target / "index.html").write_text(html.document(entry, source, home=None, fold=False), encoding="utf-8")
    (target / "data").mkdir()
    for name in {f"{name}.csv" for w in written for name in w.page.tables}:
        if (folder / "data" / name).exists():
            shutil.copyfile(folder / "data" / name, target / "data" / name)


def _remove_pages(folder: Path) -> None:
    """Remove the HTML pages of an earlier report; other files stay."""
    for path in folder.glob("*.html"):
        if html.GENERATOR in path.read_text(encoding="utf-8", errors="replace"):
            path.unlink()


def _replace(target: Path, folder: Path) -> None:
    """Move every new file, written below ``target``, to the same relative path in ``folder``, the entry page last.

    So the links of the entry page never lead to a page that is not there yet.
    """
    entry = ("README.md", "index.html")
    files = sorted((p for p in target.rglob("*") if p.is_file()), key=lambda p: p.name in entry)
    for path in files:
        place = folder / path.relative_to(target)
        place.parent.mkdir(exist_ok=True)
        os.replace(path, place)
