"""The reports, written from the tables that a run left: `reports/README.md` and a page for each question.

Every sentence of verdict is computed from the rows.  A page whose table was not measured says so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from . import pages, results
from .markdown import measured_on


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
    folder: str | Path, quick: bool = False, progress: Callable[[str], None] = print, figures: bool = True
) -> Path:
    """Write every page into ``folder`` from its data; returns the entry page.

    ``figures``: draw the talks' figures, which integrate what they show; else those that stand in the folder are kept.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    data = Data(folder)
    from . import figures as seeds

    if figures:
        progress("drawing the figures")
        drawn = seeds.save(folder / "figures", quick=quick)
    else:
        drawn = seeds.standing(folder / "figures")
    verdicts: list[str] = []
    contents: list[str] = []
    for page in pages.PAGES:
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
    about = next((data.about(t) for p in pages.PAGES for t in p.tables if data.about(t)), None)
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
