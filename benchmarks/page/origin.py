"""Where the rows of a page are from: the command, the machine, the date, and what an earlier run measured."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from .markdown import listed, wrapped
from .page import Page


def earlier(rows: pd.DataFrame, machines: Mapping) -> str:
    """What is said of when the rows were measured, and of those that the latest run did not measure.

    ``rows`` has the columns date, machine and state, or lacks them; ``machines`` describes the machines by name.
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
            listed(list(dict.fromkeys(machines.get(n, {}).get("processor", n) for n in names)), 2) if len(names) else ""
        )
        text = (
            f"{len(days) - len(old)} {text}, {len(old)} not by that run but on {span}{f' ({where})' if where else ''}"
        )
    unknown = len(rows) - len(days)
    text += f", {unknown} at a date that was not recorded" if unknown else ""
    stale = int((rows["state"] == "stale").sum()) if "state" in rows else 0
    return text + (f"; {stale} of them by an earlier version of the code" if stale else "")


def outdated(page: Page, data) -> str:
    """What is said of the rows of a page that an earlier version of the code measured; nothing where there is none."""
    stale, whole = (
        sum(count(name) for name in page.tables if data(name) is not None)
        for count in (lambda name: (data.about(name) or {}).get("stale", 0), lambda name: len(data(name)))
    )
    return f"{stale} of {whole} rows measured by an earlier version of the code" if stale else ""


def _table(name: str, data) -> str:
    rows = data.provenance(name)
    said = earlier(rows, (data.about(name) or {}).get("machines", {}))
    return f"[data/{name}.csv](data/{name}.csv): {len(data(name))} rows, {said}."


def machine(about: Mapping | None) -> str:
    """On what a table was measured."""
    if not about:
        return ""
    tier = "quick tier" if about.get("quick") else "full run"
    return f"Measured on {about['processor']}; {about['system']}; {about['versions']}; {tier}."


def origin(page: Page, data) -> str:
    """The Markdown that says where a page is from; ``data`` is a `report.Data`."""
    measured = [name for name in page.tables if data(name) is not None]
    missing = [name for name in page.tables if data(name) is None]
    lines = [f"- `{page.command}`"] if page.command else []
    if missing:
        lines.append(wrapped(f"**Not measured** in this folder: {', '.join(missing)}.", "- ", "  "))
    lines += [wrapped(_table(name, data), "- ", "  ") for name in measured]
    said = dict.fromkeys(machine(data.about(name)) for name in measured)
    lines += [wrapped(text, "- ", "  ") for text in said if text]
    return "\n".join(lines or ["Computed from the records of the methods and problems."]) + "\n"
