"""What every generator uses: the stored tables, Markdown tables, links, and files written only where they differ."""

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
    """A table of the last run, with the rows of earlier versions of the code."""
    frame, _ = tables.read(REPORTS, name)
    if frame is None:
        raise FileNotFoundError(f"reports/data/{name}.csv is missing; `pytest benchmarks` measures it")
    return frame


def table(rows: Iterable[Mapping[str, object]]) -> str:
    """A Markdown table of rows with the same keys; "" if there are none."""
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
    """Text in which Markdown finds no markup."""
    return re.sub(r"([\\`*_\[\]<>$~#])", r"\\\1", "" if pd.isna(text) else str(text))


def code(text: str) -> str:
    """Text as Markdown code."""
    return f"`{text}`"


def fenced(text: str, language: str = "text") -> str:
    """Text as a block of code."""
    return f"```{language}\n{text.rstrip()}\n```\n"


def fold(title: str, content: str) -> str:
    """Content that opens by a click."""
    return f"::::{{dropdown}} {title}\n{content.rstrip()}\n::::\n"


def facts(pairs: Mapping[str, str]) -> str:
    """A table of two columns without a head: what, and its value."""
    lines = "".join(f"* - {name}\n  - {value}\n" for name, value in pairs.items() if value)
    return f":::{{list-table}}\n:class: facts\n:widths: 22 78\n\n{lines}:::\n"


def toctree(names: Sequence[str]) -> str:
    """A hidden table of contents."""
    lines = "\n".join(names)
    return f"```{{toctree}}\n:hidden:\n\n{lines}\n```\n"


def rst(text: str) -> str:
    """Text of a docstring, which is reStructuredText."""
    return f"```{{eval-rst}}\n{chr(10).join(escape(text.strip().splitlines()))}\n```\n"


def escape(lines: Iterable[str]) -> list[str]:
    """Lines of reStructuredText in which a bar, as in |p|, is a bar, but for formulae and code."""
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
    """The parts of a docstring that empty lines separate, an indented part joined to the one above it."""
    parts: list[str] = []
    for part in re.split(r"\n\s*\n", docstring.strip()):
        if parts and part.startswith("    "):
            parts[-1] += "\n\n" + part
        else:
            parts.append(part)
    return parts


def bibtex(keys: Iterable[str]) -> str:
    """The BibTeX entries of works, a block of code; "" for none."""
    from phasebench.benchmarks.bibliography import entries

    found = [entries()[key] for key in sorted(set(keys))]
    return fenced("\n\n".join(found), "bibtex") if found else ""


def citations(keys: Iterable[str]) -> str:
    """The works as a sentence with references to the bibliography; "" for none."""
    keys = list(dict.fromkeys(keys))
    return "; ".join(f"{{cite:t}}`{key}`" for key in keys)


def write(folder: Path, files: Files, owned: Iterable[str]) -> None:
    """Write files below a folder, leave equal ones alone, and delete what else stands in the ``owned`` folders."""
    for name, text in files.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    for name in owned:
        for path in (folder / name).rglob("*.md"):
            if path.relative_to(folder).as_posix() not in files:
                path.unlink()
