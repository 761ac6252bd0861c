"""The reports, written from the tables that a run left: an entry page, and for each question a page in two formats.

Nothing is integrated here: a page is a function of rows on disk.  Every sentence of verdict is computed from them.  A
report is made whole beside the old one and then takes its place, file by file, the entry last.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.experiments.advice.page import PAGE as ADVICE
from phasebench.benchmarks.experiments.audit.page import PAGE as AUDIT
from phasebench.benchmarks.experiments.catalogue.page import PAGES as CATALOGUE
from phasebench.benchmarks.experiments.drift.page import PAGE as DRIFT
from phasebench.benchmarks.experiments.energy_preservation.page import PAGE as ENERGY_PRESERVATION
from phasebench.benchmarks.experiments.ensembles.page import PAGE as ENSEMBLES
from phasebench.benchmarks.experiments.extremes.encounters_page import PAGE as EXTREMES_ENCOUNTERS
from phasebench.benchmarks.experiments.extremes.limits_page import PAGE as EXTREMES_LIMITS
from phasebench.benchmarks.experiments.extremes.page import PAGE as EXTREMES
from phasebench.benchmarks.experiments.extremes.round_off_page import PAGE as EXTREMES_ROUND_OFF
from phasebench.benchmarks.experiments.extremes.springs_page import PAGE as EXTREMES_SPRINGS
from phasebench.benchmarks.experiments.invariants.page import PAGE as INVARIANTS
from phasebench.benchmarks.experiments.kepler.page import PAGE as KEPLER
from phasebench.benchmarks.experiments.knobs.page import PAGE as KNOBS
from phasebench.benchmarks.experiments.large.page import PAGE as LARGE
from phasebench.benchmarks.experiments.large.solvers_page import PAGE as LARGE_SOLVERS
from phasebench.benchmarks.experiments.matrix.page import PAGE as MATRIX
from phasebench.benchmarks.experiments.models.page import PAGE as MODELS
from phasebench.benchmarks.experiments.orders.page import PAGE as ORDERS
from phasebench.benchmarks.experiments.oscillatory.page import PAGE as OSCILLATORY
from phasebench.benchmarks.experiments.printed.page import PAGE as PRINTED
from phasebench.benchmarks.experiments.references.page import PAGE as REFERENCES
from phasebench.benchmarks.experiments.speed.page import PAGE as SPEED
from phasebench.benchmarks.experiments.start.page import PAGE as START
from phasebench.benchmarks.experiments.structure.page import PAGE as STRUCTURE
from phasebench.benchmarks.experiments.talks.page import PAGES as FIGURES
from phasebench.benchmarks.experiments.talks.statements_page import PAGES as TALKS
from phasebench.benchmarks.experiments.trade.page import PAGE as TRADE
from phasebench.benchmarks.experiments.trade.ratios_page import PAGE as TRADE_RATIOS
from phasebench.benchmarks.experiments.trade.scene_page import PAGES as TRADE_SCENES
from phasebench.benchmarks.experiments.waves.page import PAGE as WAVES
from phasebench.benchmarks.experiments.waves.spacetime_page import PAGE as MULTISYMPLECTIC
from phasebench.benchmarks.experiments.wisdom_holman.page import PAGE as WISDOM_HOLMAN
from phasebench.benchmarks.page import html, markdown
from phasebench.benchmarks.page.drawn import Figures
from phasebench.benchmarks.page.origin import origin, outdated
from phasebench.benchmarks.page.page import Page, Picture, Table, outcome
from phasebench.integrators.errors import InvalidInput

from .rows import tables as results

#: In the order in which a reader wants them.
PAGES: tuple[Page, ...] = (
    TRADE,
    TRADE_RATIOS,
    ADVICE,
    MODELS,
    KNOBS,
    PRINTED,
    ORDERS,
    STRUCTURE,
    MATRIX,
    INVARIANTS,
    DRIFT,
    ENERGY_PRESERVATION,
    EXTREMES,
    EXTREMES_LIMITS,
    EXTREMES_ROUND_OFF,
    EXTREMES_ENCOUNTERS,
    EXTREMES_SPRINGS,
    KEPLER,
    WISDOM_HOLMAN,
    OSCILLATORY,
    WAVES,
    MULTISYMPLECTIC,
    AUDIT,
    REFERENCES,
    SPEED,
    START,
    LARGE,
    LARGE_SOLVERS,
    ENSEMBLES,
    *CATALOGUE,
    *TALKS,
    *FIGURES,
    *TRADE_SCENES,
)
QUICK = "This is the quick tier: few steps, few rounds; it shows that the suite runs, and no more."


#: Columns that say where a row is from: in the tables on disk, not on a page.
SAME = "The same pages [in HTML](index.html), in which tables sort and filter."


class Data:
    """The tables of a folder, read once; with ``stale`` also the rows that an earlier version of the code measured."""

    def __init__(self, folder: Path, stale: bool = True):
        self.folder, self.stale = folder, stale
        self._known: dict = {}
        self._digests: dict[str, str] = {}

    def __call__(self, name: str) -> pd.DataFrame | None:
        """The table as a DataFrame, or None where it was not measured."""
        return self._read(name)[0]

    def provenance(self, name: str) -> pd.DataFrame:
        """When and on what machine each row of a table on disk was measured, where that was recorded."""
        path = self.folder / "data" / f"{name}.csv"
        return pd.read_csv(path, usecols=lambda column: column in results.PROVENANCE, low_memory=False)

    def about(self, name: str) -> dict | None:
        """On what it was measured."""
        return self._read(name)[1]

    def digest(self, name: str) -> str:
        """Of the rows that are read of a table."""
        if name not in self._digests:
            path = self.folder / "data" / f"{name}.csv"
            content = path.read_bytes() if path.exists() else b""
            self._digests[name] = hashlib.sha256(content + bytes([self.stale])).hexdigest()[:16]
        return self._digests[name]

    def _read(self, name: str):
        if name not in self._known:
            self._known[name] = results.read(self.folder, name, self.stale)
        return self._known[name]


@dataclass(frozen=True)
class _Written:
    """What the entry says of a page that was written."""

    page: Page
    outcome: str
    short: str
    pictures: list[Picture]
    table: Table | None


def build(folder: str | Path, quick: bool = False, progress: Callable[[str], None] = print) -> Path:
    """Write every page into ``folder`` from its data, whole or not at all; returns the entry page.

    Raises InvalidInput where the data cannot be read, or the pages not written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".report-") as scratch:
            target = Path(scratch)
            (target / "figures").mkdir()
            both, figures = (Data(folder), Data(folder, stale=False)), Figures(folder)
            written = [_page(page, both, figures, target) for page in PAGES]
            figures.write(target / "figures")
            _entry(written, target, quick)
            _replace(target, folder)
    except OSError as error:
        raise InvalidInput(f"the report in {folder} cannot be written: {error.strerror}; it is as it was") from None
    progress(f"wrote {len(written)} pages")
    return folder / "README.md"


def _page(page: Page, both: tuple[Data, Data], figures: Figures, target: Path) -> _Written:
    """Write a page into ``target`` from all rows; from the present version's alone where the others' form is another.

    ``both`` has all rows, and those of the present version.
    """
    data, current = both
    old = outdated(page, data)
    try:
        return _written(page, data, figures, target, old)
    except Exception:  # whatever rows of another form lead to
        if not old:
            raise
        return _written(page, current, figures, target, f"{old}, of another form and left out")


def _written(page: Page, data: Data, figures: Figures, target: Path, old: str) -> _Written:
    verdicts = page.judged(data)
    pictures, table = figures.of(page, data, target / "figures"), page.table(data)
    whole = page.whole(data)
    if whole is not None:
        whole = whole.drop(columns=list(results.PROVENANCE), errors="ignore")
    _put(target, page.id, markdown.document(page, verdicts, pictures, table, origin(page, data), old), whole)
    verdict, short = outcome(verdicts)
    return _Written(page, verdict, f"{short} ({old})" if old else short, pictures, table)


def _put(target: Path, name: str, text: str, whole: pd.DataFrame | None) -> None:
    """Write a page in both formats."""
    (target / f"{name}.md").write_text(text, encoding="utf-8")
    (target / f"{name}.html").write_text(html.document(text, target, whole), encoding="utf-8")


def _entry(written: list[_Written], target: Path, quick: bool) -> None:
    """The entry: a line a page, and which integrator for which accuracy."""
    lines = pd.DataFrame(
        [
            {"question": f"[{w.page.question}]({w.page.id}.md)", "outcome": f"**{w.outcome}**", "in short": w.short}
            for w in written
            if w.page.listed
        ]
    )
    parts = ["# phasebench: what was measured\n", *([f"{QUICK}\n"] if quick else []), markdown.table(lines)]
    choice = next(w for w in written if w.page is TRADE)
    if choice.table is not None:
        parts += ["## Which integrator for which accuracy\n", markdown.wrapped(choice.table.caption) + "\n"]
        parts += [markdown.table(choice.table.frame, digits=choice.table.digits)]
    for picture in choice.pictures[:1]:
        parts += [f"![{picture.title}](figures/{picture.file})\n", markdown.wrapped(picture.caption) + "\n"]
    text = "\n".join(parts)
    (target / "README.md").write_text(f"{text}\n{SAME}\n", encoding="utf-8")
    (target / "index.html").write_text(html.document(text, target, home=None, fold=False), encoding="utf-8")


def _replace(target: Path, folder: Path) -> None:
    """Move every file of ``target`` to its place in ``folder``; the entry comes last, when all it links to is there."""
    (folder / "figures").mkdir(exist_ok=True)
    entry = ("README.md", "index.html")
    files = sorted((p for p in target.rglob("*") if p.is_file()), key=lambda p: p.name in entry)
    for path in files:
        os.replace(path, folder / path.relative_to(target))
