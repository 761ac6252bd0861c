"""What all generators of pages use: the stored tables, Markdown, links, and the writing of files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.store import tables

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / "reports"
#: File below docs/ -> its text.
Files = dict[str, str]


@cache
def stored(name: str) -> pd.DataFrame:
    """A stored table of the last run of the benchmarks, such as "rows", as a data frame.

    Rows that earlier versions of the code measured are included.  Raises FileNotFoundError if there is no such table.
    """
    frame, _ = tables.read(REPORTS, name)
    if frame is None:
        raise FileNotFoundError(f"reports/data/{name}.csv is missing; `pytest benchmarks` measures it")
    return frame


def table(rows: Iterable[Mapping[str, object]]) -> str:
    """A Markdown table of ``rows``, dicts with the same keys, which are its heads; "" if there are none."""
    rows = list(rows)
    if not rows:
        return ""
    heads = list(rows[0])
    lines = [heads, ["---"] * len(heads), *([cell(row[head]) for head in heads] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def cell(value: object) -> str:
    """A value as the text of a table's cell."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = value if isinstance(value, str) else number(value)
    return re.sub(r"\s+", " ", text).replace("|", "\\|").strip() or " "


def plain(text: object) -> str:
    """Escape the text so that Markdown finds no markup in it; "" for a missing value."""
    return re.sub(r"([\\`*_\[\]<>$~#])", r"\\\1", "" if pd.isna(text) else str(text))


def code(text: str) -> str:
    """Text as Markdown code."""
    return f"`{text}`"


def fenced(text: str, language: str = "text") -> str:
    """Text as a block of code."""
    return f"```{language}\n{text.rstrip()}\n```\n"


def fold(title: str, content: str) -> str:
    """Markdown of a box that shows its title, and its content after a click."""
    return f"::::{{dropdown}} {title}\n{content.rstrip()}\n::::\n"


def facts(pairs: Mapping[str, str]) -> str:
    """Markdown of a table of two columns without heads: a name, and its value; empty values are left out."""
    lines = "".join(f"* - {name}\n  - {value}\n" for name, value in pairs.items() if value)
    return f":::{{list-table}}\n:class: facts\n:widths: 22 78\n\n{lines}:::\n"


def toctree(names: Sequence[str]) -> str:
    """Markdown of a hidden table of contents of the pages with these names, which Sphinx needs for navigation."""
    lines = "\n".join(names)
    return f"```{{toctree}}\n:hidden:\n\n{lines}\n```\n"


def rst(text: str) -> str:
    """Wrap the text of a docstring, which is reStructuredText, for a Markdown page, with bars as in |p| escaped."""
    return f"```{{eval-rst}}\n{chr(10).join(escape(text.strip().splitlines()))}\n```\n"


def escape(lines: Iterable[str]) -> list[str]:
    """Escape bars, as in |p|, in lines of reStructuredText, so that they stay bars; formulae and code are unchanged."""
    out, inside = [], -1
    for line in lines:
        depth = len(line) - len(line.lstrip())
        if line.strip() and depth <= inside:
            inside = -1
        if ".. math::" in line:
            inside = depth
        out.append(line if inside >= 0 else re.sub(r"(`[^`]*`)|\|", lambda m: m[1] or r"\|", line))
    return out


def paragraphs(docstring: str) -> list[str]:
    """Split a docstring at empty lines; an indented part, such as a formula, stays with the part above it."""
    parts: list[str] = []
    for part in re.split(r"\n\s*\n", docstring.strip()):
        if parts and part.startswith("    "):
            parts[-1] += "\n\n" + part
        else:
            parts.append(part)
    return parts


def bibtex(keys: Iterable[str]) -> str:
    """The BibTeX entries with these keys of the bibliography as a Markdown block of code; "" for none."""
    from phasebench.benchmarks.bibliography import entries

    found = [entries()[key] for key in sorted(set(keys))]
    return fenced("\n\n".join(found), "bibtex") if found else ""


def citations(keys: Iterable[str]) -> str:
    """Citations of the works with these keys of the bibliography, as Markdown with semicolons between; "" for none."""
    keys = list(dict.fromkeys(keys))
    return "; ".join(f"{{cite:t}}`{key}`" for key in keys)


def write(folder: Path, files: Files, owned: Iterable[str]) -> None:
    """Write files (name -> text) below a folder; files that already have their text are not touched.

    In the subfolders ``owned`` all other Markdown files are deleted.
    """
    for name, text in files.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    for name in owned:
        for path in (folder / name).rglob("*.md"):
            if path.relative_to(folder).as_posix() not in files:
                path.unlink()
