"""The generated reports as pages of the site: text, figures and tables are copied, the entry page becomes the index."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from pages import REPORTS, Files, toctree

#: Tables of more bytes than this are not copied: they stand in the source.
LARGEST = 400_000


def files() -> Files:
    """The pages of the reports."""
    found = {f"reports/{path.name}": _links(path.read_text(encoding="utf-8")) for path in sorted(REPORTS.glob("*.md"))}
    entry = found.pop("reports/README.md")
    names = [name.removeprefix("reports/").removesuffix(".md") for name in found]
    found["reports/index.md"] = f"{entry}\n{toctree(names)}"
    return found


def _links(text: str) -> str:
    """The text with the entry page and tables that are not copied linked as they are found here."""
    text = text.replace("](README.md)", "](index.md)")
    return re.sub(r"\[([^\]]*)\]\((data/[\w-]+\.csv)\)", _table, text)


def _table(match: re.Match) -> str:
    small = (REPORTS / match[2]).stat().st_size <= LARGEST
    return match[0] if small else f"`reports/{match[2]}`"


def copy(folder: Path) -> None:
    """Copy figures and small tables below a folder where they differ."""
    for path in [*REPORTS.glob("figures/*.png"), *REPORTS.glob("data/*.csv")]:
        target = folder / "reports" / path.relative_to(REPORTS)
        if path.stat().st_size > LARGEST or (target.exists() and target.read_bytes() == path.read_bytes()):
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
