"""Generate the site's pages of the reports: texts, figures and small tables are copied from the folder of reports.

README.md of that folder becomes the index.  In menus the page A-B stands beneath the page A: talks-maps beneath talks.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from pages import REPORTS, Files, toctree

#: Tables of more bytes than this are not copied: they stand in the source.
LARGEST = 400_000


def files() -> Files:
    """The pages of the reports: file name -> Markdown."""
    found = {f"reports/{path.name}": _links(path.read_text(encoding="utf-8")) for path in sorted(REPORTS.glob("*.md"))}
    entry = found.pop("reports/README.md")
    names = [name.removeprefix("reports/").removesuffix(".md") for name in found]
    beneath: dict[str, list[str]] = {"": []}
    for name in names:
        head = name.partition("-")[0]
        beneath.setdefault(head if head in names and head != name else "", []).append(name)
    for head, members in beneath.items():
        if head:
            found[f"reports/{head}.md"] += f"\n{toctree(members)}"
    listed = [f"{name.replace('-', ' ').replace('_', ' ').capitalize()} <{name}>" for name in beneath[""]]
    found["reports/index.md"] = f"{entry}\n{toctree([*listed, 'Questions </faq>'])}"
    return found


def _links(text: str) -> str:
    """The text of a report with its links adapted to the site.

    README.md becomes index.md; a table too large to be copied is named in place of a link.
    """
    text = text.replace("](README.md)", "](index.md)")
    return re.sub(r"\[([^\]]*)\]\((data/[\w-]+\.csv)\)", _table, text)


def _table(match: re.Match) -> str:
    small = (REPORTS / match[2]).stat().st_size <= LARGEST
    return match[0] if small else f"`reports/{match[2]}`"


def copy(folder: Path) -> None:
    """Copy the figures and small tables of the reports to ``folder``/reports, unless they are there unchanged."""
    for path in [*REPORTS.glob("figures/*.png"), *REPORTS.glob("data/*.csv")]:
        target = folder / "reports" / path.relative_to(REPORTS)
        if path.stat().st_size > LARGEST or (target.exists() and target.read_bytes() == path.read_bytes()):
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
