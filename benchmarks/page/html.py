"""Writes a page as one self-contained HTML file: figures, style and script are embedded; it needs no network.

The HTML is rendered from the page's Markdown, so that both say the same.  The script sorts a table by a click on a
column's head and filters its rows by text; without it the page is complete but static.
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import pandas as pd

from .markdown import number
from .verdict import MEANING

#: Marks every page of a report, so that the pages of an earlier report are recognized.
GENERATOR = '<meta name="generator" content="phasebench report">'
#: Tables with more rows are folded.
LONG = 25


def _style(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _inline_images(folder: Path) -> Callable[[re.Match], str]:
    """A function for `re.sub` that replaces an image's file name, in ``folder``, by its bytes as a data URL."""

    def replace(match: re.Match) -> str:
        image = base64.b64encode((folder / html.unescape(match[1])).read_bytes()).decode()
        return f'<img loading="lazy" src="data:image/png;base64,{image}"'

    return replace


def _box(match: re.Match) -> str:
    """Put a matched HTML table into a box that scrolls on its own."""
    return f'<div class="table">{match[0]}</div>'


def _fold(match: re.Match) -> str:
    """Put a matched HTML table into a box that scrolls on its own, folded if it is long."""
    rows = match[0].count("<tr>") - 1
    return f"<details><summary>{rows} rows</summary>{_box(match)}</details>" if rows > LONG else _box(match)


def _outcome(match: re.Match) -> str:
    """Mark up a matched outcome, such as PASS or FAIL, as HTML with a class that gives its colour."""
    return f'<strong class="{match[1].lower()}">{match[1]}</strong>'


def _cells(values: Iterable, tag: str) -> str:
    return "".join(f"<{tag}>{html.escape(number(x))}</{tag}>" for x in values)


def _full_table(frame: pd.DataFrame) -> str:
    """A folded HTML table with every row of a frame."""
    body = "".join(f"<tr>{_cells(row, 'td')}</tr>" for row in frame.itertuples(index=False))
    table = f"<table><thead><tr>{_cells(frame.columns, 'th')}</tr></thead><tbody>{body}</tbody></table>"
    return f'<details><summary>All {len(frame)} rows</summary><div class="table">{table}</div></details>'


def document(
    text: str, folder: Path, whole: pd.DataFrame | None = None, home: str | None = "index.html", fold: bool = True
) -> str:
    """Return a page's Markdown as a complete HTML document.

    Parameters
    ----------
    text : the Markdown, with links to figures and other pages relative to ``folder``
    folder : the folder of the figures
    whole : a table shown folded at the end
    home : the page linked at the top, None on the entry page itself
    fold : True to fold tables of more than `LONG` rows
    """
    from markdown_it import MarkdownIt

    body = MarkdownIt("commonmark").enable("table").render(text)
    body = re.sub(r"<table>.*?</table>", _fold if fold else _box, body, flags=re.S)
    body = re.sub(r'<img src="([^":]+)"', _inline_images(folder), body)
    body = re.sub(r'href="([\w-]+)\.md"', lambda m: f'href="{"index" if m[1] == "README" else m[1]}.html"', body)
    body = re.sub(rf"<strong>({'|'.join(MEANING)})</strong>", _outcome, body, flags=re.I)
    if whole is not None and len(whole):
        body += _full_table(whole)
    title = html.escape(text.splitlines()[0].lstrip("# "))
    above = f'<nav><a href="{home}">All pages</a></nav>' if home else ""
    origin = f"{GENERATOR}\n" if home else ""
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n{origin}<title>{title}</title>\n'
        f"<style>\n{_style('page.css')}</style>\n</head>\n<body>\n<main>\n{above}\n{body}</main>\n"
        f"<script>\n{_style('page.js')}</script>\n</body>\n</html>\n"
    )
