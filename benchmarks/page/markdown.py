"""Writes a page as Markdown: aligned tables and wrapped sentences."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from .page import Page, Picture, Table
from .verdict import MEANING, PASS, Verdict

#: Line width of the text, in characters.
WIDTH = 110


def number(x: Any, digits: int = 3) -> str:
    """A number with ``digits`` significant digits (0.0123, 1.23e-05); "" if it is None or NaN."""
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
    """True if a column holds numbers, or texts that are all numbers."""
    if pd.api.types.is_numeric_dtype(column):
        return True
    return pd.to_numeric(column[column.astype(str) != ""], errors="coerce").notna().all()


def table(frame: pd.DataFrame, columns: Mapping[str, str] | Sequence[str] | None = None, digits: int = 3) -> str:
    """An aligned Markdown table of a frame's columns (name -> heading; by default all)."""
    if columns is not None:
        names = list(columns)
        frame = frame.reindex(columns=names)
        if isinstance(columns, Mapping):
            frame = frame.rename(columns=columns)
    right = [_numeric(frame[c]) for c in frame]
    cells = [[number(x, digits).replace("|", "\\|") for x in row] for row in frame.itertuples(index=False)]
    heads = [str(c) for c in frame.columns]
    widths = [max(len(h), *(len(r[i]) for r in cells), 3) if cells else max(len(h), 3) for i, h in enumerate(heads)]

    def line(parts: Iterable[str]) -> str:
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


def join_list(items: Sequence[str], limit: int = 8) -> str:
    """The items as "a, b and c"; of more than ``limit`` the first ones and how many more there are."""
    items = list(items)
    if not items:
        return "none"
    if len(items) > limit:
        return ", ".join(items[:limit]) + f" and {len(items) - limit} more"
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def code(text: str) -> str:
    """The text as Markdown code, in which * and _ need no escape."""
    return f"`{text}`"


def plain(text: str) -> str:
    """The text with * and _ escaped for Markdown."""
    return text.replace("*", "\\*").replace("_", "\\_")


def wrap(text: str, first: str = "", then: str = "") -> str:
    """Return the text in lines of at most `WIDTH` characters; no word is broken.

    The first line begins with ``first``, every other line with ``then``.
    """
    return textwrap.fill(text, WIDTH, initial_indent=first, subsequent_indent=then, break_long_words=False,
                         break_on_hyphens=False)  # fmt: skip


def bullets(sentences: Sequence[str]) -> str:
    """The sentences as a Markdown list."""
    return "\n".join(wrap(sentence, "- ", "  ") for sentence in sentences) + "\n"


def verdicts_table(found: Sequence[Verdict]) -> str:
    """The Markdown table of a page's verdicts, one row each."""
    rows = pd.DataFrame([v.row() for v in found]).map(plain)
    return table(rows if rows["where it is worst"].any() else rows.drop(columns="where it is worst"))


def _meaning(verdicts: Sequence[Verdict]) -> str:
    """What the outcomes in a table of verdicts mean."""
    there = [name for name in MEANING if name == PASS or any(v.outcome == name for v in verdicts)]
    return "; ".join(f"{name}: {MEANING[name]}" for name in there) + "."


def document(
    page: Page,
    outcome: str,
    answer: str,
    verdicts: Sequence[Verdict],
    pictures: Sequence[Picture],
    shown: Table | None,
    origin: str,
    outdated: str = "",
) -> str:
    """The Markdown of a page; the outcome and the answer come first.

    ``outcome`` and ``answer`` are its verdict in a word and in a sentence, ``shown`` is its table.  ``origin`` says
    where and when its tables were measured; ``outdated`` says how many rows were measured by an earlier version of the
    code ("" if none).
    """
    parts = [f"# {page.question}\n", wrap(f"**{outcome}** {answer}") + "\n"]
    if verdicts:
        parts += [wrap(_meaning(verdicts)) + "\n"] if any(v.outcome != PASS for v in verdicts) else []
        parts.append(verdicts_table(verdicts))
    if outdated:
        remedy = "`pytest benchmarks --dear` measures them."
        parts += [wrap(f"**In part not by this version**: {outdated}; {remedy}") + "\n"]
    parts += ["## What is measured\n", bullets(page.setting)]
    for picture in pictures:
        parts += [f"![{picture.title}](figures/{picture.file})\n", wrap(picture.caption) + "\n"]
    if shown is not None:
        parts += ["## Table\n", wrap(shown.caption) + "\n", table(shown.frame, digits=shown.digits)]
    if page.limits:
        parts += ["## What could be wrong\n", bullets(page.limits)]
    parts += ["## Make it again\n", origin]
    return "\n".join(parts).rstrip() + "\n"
