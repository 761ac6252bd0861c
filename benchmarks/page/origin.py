"""Where the rows of a page are from: the command, the machine, the date, and what an earlier run measured."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from .markdown import listed, wrapped
from .page import Page


def earlier(frame: pd.DataFrame) -> str:
    """What is said of rows that the latest run did not measure; empty where there are none, or no dates."""
    if "date" not in frame or frame["date"].isna().all():
        return ""
    days = frame["date"].dropna().astype(str).str[:10]
    old = days[days < days.max()]
    if old.empty:
        return f"measured on {days.max()}"
    machines = frame.loc[old.index, "machine"].dropna().unique() if "machine" in frame else []
    where = f", on {listed(list(machines), 2)}" if len(machines) else ""
    span = old.min() if old.min() == old.max() else f"{old.min()} to {old.max()}"
    return f"{len(days) - len(old)} measured on {days.max()}, {len(old)} not in that run but on {span}{where}"


def _table(name: str, frame: pd.DataFrame) -> str:
    date = earlier(frame) or "the date was not recorded"
    return f"[data/{name}.csv](data/{name}.csv): {len(frame)} rows, {date}."


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
    lines += [wrapped(_table(name, data(name)), "- ", "  ") for name in measured]
    said = dict.fromkeys(machine(data.about(name)) for name in measured)
    lines += [wrapped(text, "- ", "  ") for text in said if text]
    return "\n".join(lines or ["Computed from the records of the methods and problems."]) + "\n"
