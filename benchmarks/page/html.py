"""A page as one self-contained HTML file: figures, style and script stand in it; it needs no network.

The HTML is made of the page's Markdown, so that both say the same.  The script sorts a table by the column whose head
is clicked and filters its rows by text; without it the page is whole, but still.
"""

from __future__ import annotations

import base64
import html
import re
from pathlib import Path

import pandas as pd

from .markdown import number

#: Tables of more rows are folded.
LONG = 25


def _style(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _inlined(folder: Path):
    """A replacement of an image's file name by its bytes."""

    def replace(match: re.Match) -> str:
        image = base64.b64encode((folder / html.unescape(match[1])).read_bytes()).decode()
        return f'<img loading="lazy" src="data:image/png;base64,{image}"'

    return replace


def _box(match: re.Match) -> str:
    """A table in a box that scrolls by itself."""
    return f'<div class="table">{match[0]}</div>'


def _folded(match: re.Match) -> str:
    """A table in a box that scrolls by itself, folded where it is long."""
    rows = match[0].count("<tr>") - 1
    return f"<details><summary>{rows} rows</summary>{_box(match)}</details>" if rows > LONG else _box(match)


def _cells(values, tag: str) -> str:
    return "".join(f"<{tag}>{html.escape(number(x))}</{tag}>" for x in values)


def _whole(frame: pd.DataFrame) -> str:
    """Every row of a frame, folded."""
    body = "".join(f"<tr>{_cells(row, 'td')}</tr>" for row in frame.itertuples(index=False))
    table = f"<table><thead><tr>{_cells(frame.columns, 'th')}</tr></thead><tbody>{body}</tbody></table>"
    return f'<details><summary>All {len(frame)} rows</summary><div class="table">{table}</div></details>'


def document(
    text: str, folder: Path, whole: pd.DataFrame | None = None, home: str | None = "index.html", fold: bool = True
) -> str:
    """The HTML of a page's Markdown.

    Parameters
    ----------
    text : the Markdown, which links to its figures and to other pages relative to ``folder``
    folder : where the figures lie
    whole : a table shown folded at the end
    home : the page that is linked above, None on the entry itself
    fold : whether tables of more than `LONG` rows are folded
    """
    from markdown_it import MarkdownIt

    body = MarkdownIt("commonmark").enable("table").render(text)
    body = re.sub(r"<table>.*?</table>", _folded if fold else _box, body, flags=re.S)
    body = re.sub(r'<img src="([^":]+)"', _inlined(folder), body)
    body = re.sub(r'href="([\w-]+)\.md"', lambda m: f'href="{"index" if m[1] == "README" else m[1]}.html"', body)
    body = re.sub(r"<strong>(PASS|FINDING|not measured)</strong>", r'<strong class="\1">\1</strong>', body)
    if whole is not None and len(whole):
        body += _whole(whole)
    title = html.escape(text.splitlines()[0].lstrip("# "))
    above = f'<nav><a href="{home}">All pages</a></nav>' if home else ""
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{title}</title>\n'
        f"<style>\n{_style('page.css')}</style>\n</head>\n<body>\n<main>\n{above}\n{body}</main>\n"
        f"<script>\n{_style('page.js')}</script>\n</body>\n</html>\n"
    )
