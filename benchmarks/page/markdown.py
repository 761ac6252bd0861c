"""The Markdown of a page: aligned tables, wrapped sentences."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

import pandas as pd

from .page import Page, Picture, Table, Verdict, outcome

#: Characters of a line of text.
WIDTH = 110


def number(x, digits: int = 3) -> str:
    """A number with so many significant digits: 0.0123, 1.23e-05; nothing for a missing one."""
    if x is None or (isinstance(x, float) and math.isnan(x)):
        return ""
    if isinstance(x, (bool, str)):
        return str(x)
    if isinstance(x, int) or (float(x).is_integer() and abs(x) < 1e6 and "e" not in repr(x)):
        return str(int(x))
    if x != 0 and not 1e-3 <= abs(x) < 1e5:
        return f"{x:.{digits - 1}e}"
    return f"{x:.{digits}g}"


def _numeric(column: pd.Series) -> bool:
    """Whether a column holds numbers, be they written out already."""
    if pd.api.types.is_numeric_dtype(column):
        return True
    return pd.to_numeric(column[column.astype(str) != ""], errors="coerce").notna().all()


def table(frame: pd.DataFrame, columns: Mapping[str, str] | Sequence[str] | None = None, digits: int = 3) -> str:
    """An aligned table of the columns (name -> heading) of a frame."""
    if columns is not None:
        names = list(columns)
        frame = frame.reindex(columns=names)
        if isinstance(columns, Mapping):
            frame = frame.rename(columns=columns)
    right = [_numeric(frame[c]) for c in frame]
    cells = [[number(x, digits).replace("|", "\\|") for x in row] for row in frame.itertuples(index=False)]
    heads = [str(c) for c in frame.columns]
    widths = [max(len(h), *(len(r[i]) for r in cells), 3) if cells else max(len(h), 3) for i, h in enumerate(heads)]

    def line(parts):
        padded = (p.rjust(w) if r else p.ljust(w) for p, w, r in zip(parts, widths, right, strict=True))
        return "| " + " | ".join(padded) + " |"

    rule = (
        "|"
        + "|".join(
            " " + "-" * (w - 1) + ":" + " " if r else " " + "-" * w + " " for w, r in zip(widths, right, strict=True)
        )
        + "|"
    )
    return "\n".join([line(heads), rule, *(line(c) for c in cells)]) + "\n"


def listed(items: Sequence[str], limit: int = 8) -> str:
    """a, b and c; the first of many."""
    items = list(items)
    if not items:
        return "none"
    if len(items) > limit:
        return ", ".join(items[:limit]) + f" and {len(items) - limit} more"
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def code(text: str) -> str:
    """The text as code, in which * and _ stand for themselves."""
    return f"`{text}`"


def plain(text: str) -> str:
    """The text with * and _ escaped, so that they stand for themselves."""
    return text.replace("*", "\\*").replace("_", "\\_")


def wrapped(text: str, first: str = "", then: str = "") -> str:
    """The text in lines of at most `WIDTH` characters; no word is broken."""
    return textwrap.fill(text, WIDTH, initial_indent=first, subsequent_indent=then, break_long_words=False,
                         break_on_hyphens=False)  # fmt: skip


def bullets(sentences: Sequence[str]) -> str:
    """A list of sentences."""
    return "\n".join(wrapped(sentence, "- ", "  ") for sentence in sentences) + "\n"


def document(
    page: Page,
    verdicts: Sequence[Verdict],
    pictures: Sequence[Picture],
    shown: Table | None,
    origin: str,
    outdated: str = "",
) -> str:
    """The Markdown of a page.

    ``origin`` says where and when its tables were measured, or that they were not; ``outdated`` how much of them an
    earlier version of the code has measured.
    """
    parts = [f"# {page.question}\n"]
    if verdicts:
        parts += [f"**{outcome(verdicts)[0]}**\n", bullets([v.text for v in verdicts])]
    else:
        parts += ["**Not measured** in this folder.\n"]
    if outdated:
        parts += [
            wrapped(f"**In part not by this version**: {outdated}; `pytest benchmarks` measures them again.") + "\n"
        ]
    parts += ["## What is measured\n", bullets(page.setting)]
    for picture in pictures:
        parts += [f"![{picture.title}](figures/{picture.file})\n", wrapped(picture.caption) + "\n"]
    if shown is not None:
        parts += ["## Table\n", wrapped(shown.caption) + "\n", table(shown.frame, digits=shown.digits)]
    if page.limits:
        parts += ["## What could invalidate this\n", bullets(page.limits)]
    parts += ["## Where it is from\n", origin]
    return "\n".join(parts).rstrip() + "\n"
