"""The part of a page that states its origin: the command, the machine, the date, and rows from earlier runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import pandas as pd

from .markdown import join_list, wrap
from .page import Page

if TYPE_CHECKING:
    from phasebench.benchmarks.report import Data


def earlier(rows: pd.DataFrame, machines: Mapping) -> str:
    """Return a phrase that says when a table's rows were measured, and how many come from earlier runs or old code.

    ``rows`` may have the columns date, machine and state ("stale" if the code has changed since); ``machines`` maps a
    machine's name to a dict that describes it.
    """
    if "date" not in rows or rows["date"].isna().all():
        return "the date was not recorded"
    days = rows["date"].dropna().astype(str).str[:10]
    old = days[days < days.max()]
    text = f"measured on {days.max()}"
    if len(old):
        span = old.min() if old.min() == old.max() else f"{old.min()} to {old.max()}"
        names = rows.loc[old.index, "machine"].dropna().unique() if "machine" in rows else ()
        where = (
            join_list(list(dict.fromkeys(machines.get(n, {}).get("processor", n) for n in names)), 2)
            if len(names)
            else ""
        )
        text = (
            f"{len(days) - len(old)} {text}, {len(old)} not by that run but on {span}{f' ({where})' if where else ''}"
        )
    unknown = len(rows) - len(days)
    text += f", {unknown} at a date that was not recorded" if unknown else ""
    stale = int((rows["state"] == "stale").sum()) if "state" in rows else 0
    return text + (f"; {stale} of them by an earlier version of the code" if stale else "")


def count_outdated(page: Page, data: Data) -> str:
    """A phrase that counts the rows of a page measured by an earlier version of the code; "" if there are none."""
    stale, whole = (
        sum(count(name) for name in page.tables if data(name) is not None)
        for count in (lambda name: (data.about(name) or {}).get("stale", 0), lambda name: len(data(name)))
    )
    return f"{stale} of {whole} rows by an earlier version of the code" if stale else ""


def _table(name: str, data: Data) -> str:
    rows = data.provenance(name)
    said = earlier(rows, (data.about(name) or {}).get("machines", {}))
    return f"[data/{name}.csv](data/{name}.csv): {len(data(name))} rows, {said}."


def machine(about: Mapping | None) -> str:
    """Return a sentence on the machine, package versions and kind of run (quick or full) of a table's metadata."""
    if not about:
        return ""
    tier = "quick tier" if about.get("quick") else "full run"
    return f"Measured on {about['processor']}; {about['system']}; {about['versions']}; {tier}."


def origin(page: Page, data: Data) -> str:
    """Return the end of a page, a Markdown list: the command that measures its tables, the tables, and the machines.

    ``data`` is a `report.Data`, which reads the tables.
    """
    measured = [name for name in page.tables if data(name) is not None]
    missing = [name for name in page.tables if data(name) is None]
    lines = [f"- `{page.command}`"] if page.command else []
    if missing:
        lines.append(wrap(f"**Not measured** in this folder: {', '.join(missing)}.", "- ", "  "))
    lines += [wrap(_table(name, data), "- ", "  ") for name in measured]
    said = dict.fromkeys(machine(data.about(name)) for name in measured)
    lines += [wrap(text, "- ", "  ") for text in said if text]
    return "\n".join(lines or ["Computed from the records of the methods and problems."]) + "\n"
