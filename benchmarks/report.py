"""The reports, written from the tables that a run left: `reports/README.md` and a page for each question.

Every sentence of verdict is computed from the rows.  A page whose table was not measured says so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from phasebench.benchmarks.experiments.audit.page import PAGE as AUDIT
from phasebench.benchmarks.experiments.catalogue.coefficients import PAGE as COEFFICIENTS
from phasebench.benchmarks.experiments.catalogue.methods import PAGE as METHODS
from phasebench.benchmarks.experiments.energy_preservation.page import PAGE as EQUIP
from phasebench.benchmarks.experiments.invariants.page import PAGE as INVARIANTS
from phasebench.benchmarks.experiments.kepler.page import PAGE as KEPLER
from phasebench.benchmarks.experiments.matrix.page import PAGE as MATRIX
from phasebench.benchmarks.experiments.orders.page import PAGE as ORDERS
from phasebench.benchmarks.experiments.oscillatory.page import PAGE as OSCILLATORY
from phasebench.benchmarks.experiments.printed.page import PAGE as PRINTED
from phasebench.benchmarks.experiments.references.page import PAGE as REFERENCES
from phasebench.benchmarks.experiments.speed.page import PAGE as SPEED
from phasebench.benchmarks.experiments.structure.page import PAGE as STRUCTURE
from phasebench.benchmarks.experiments.waves.page import PAGE as PDE
from phasebench.benchmarks.experiments.wisdom_holman.page import PAGE as WISDOM_HOLMAN
from phasebench.benchmarks.page.markdown import measured_on
from phasebench.benchmarks.page.page import Page

from .rows import tables as results

#: In the order in which a reader wants them.
PAGES: tuple[Page, ...] = (
    PRINTED,
    MATRIX,
    ORDERS,
    COEFFICIENTS,
    STRUCTURE,
    INVARIANTS,
    EQUIP,
    OSCILLATORY,
    PDE,
    KEPLER,
    WISDOM_HOLMAN,
    AUDIT,
    REFERENCES,
    SPEED,
    METHODS,
)


class Data:
    """The tables of a folder, read once."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._known: dict = {}

    def __call__(self, name: str):
        """The table as a DataFrame, or None where it was not measured."""
        return self._read(name)[0]

    def about(self, name: str):
        """On what it was measured."""
        return self._read(name)[1]

    def _read(self, name: str):
        if name not in self._known:
            self._known[name] = results.read(self.folder, name)
        return self._known[name]


def build(
    folder: str | Path, quick: bool = False, progress: Callable[[str], None] = print, figures: bool = False
) -> Path:
    """Write every page into ``folder`` from its data; returns the entry page.

    ``figures``: draw the talks' figures, which integrate what they show; else those that stand in the folder are kept.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    data = Data(folder)
    from .experiments.talks import gallery as seeds

    if figures:
        progress("drawing the figures")
        drawn = seeds.save(folder / "figures", quick=quick)
    else:
        drawn = seeds.standing(folder / "figures")
    verdicts: list[str] = []
    contents: list[str] = []
    for page in PAGES:
        found = page.write(data, folder / "figures")
        missing = [t for t in page.tables if data(t) is None]
        text = [f"# {page.title}\n"]
        if missing:
            text.append(f"Not measured in this folder: {', '.join(missing)}. Run `pytest benchmarks`.\n")
        if found is not None:
            verdict, body = found
            verdicts += [f"- **[{page.title}]({page.id}.md)**", *(f"  - {v}" for v in verdict)]
            text += [*(f"- {v}" for v in verdict), "", body]
        text += [measured_on(data.about(t)) for t in page.tables[:1]]
        (folder / f"{page.id}.md").write_text("\n".join(text).rstrip() + "\n")
        contents.append(f"- [{page.title}]({page.id}.md): {page.question}")
        progress(f"wrote {page.id}.md")
    if drawn:
        contents += _gallery(folder, drawn)
    entry = folder / "README.md"
    about = next((data.about(t) for p in PAGES for t in p.tables if data.about(t)), None)
    heading = "# phasebench: what was measured\n"
    tier = "" if not quick else "This is the quick tier: few steps, few rounds; it shows that the suite runs.\n"
    entry.write_text(
        "\n".join(
            [heading, tier, "## Verdict\n", *verdicts, "\n## Pages\n", *contents, "", measured_on(about)]
        ).rstrip()
        + "\n"
    )
    return entry


def _gallery(folder: Path, drawn) -> list[str]:
    """A page of figures for each section; returns their lines for the entry."""
    sections: dict[str, list] = {}
    for record, filename, caption in drawn:
        sections.setdefault(record.section, []).append((record, filename, caption))
    lines = []
    for section, members in sections.items():
        name = "figures-" + "".join(c if c.isalnum() else "-" for c in section.lower())
        text = [f"# Figures: {section}\n"]
        for record, filename, caption in members:
            text += [f"## {record.title}\n", f"![{record.title}](figures/{Path(filename).name})\n", f"{caption}\n"]
        (folder / f"{name}.md").write_text("\n".join(text).rstrip() + "\n")
        lines.append(f"- [Figures: {section}]({name}.md): {'; '.join(r.title for r, _, _ in members)}")
    return lines
