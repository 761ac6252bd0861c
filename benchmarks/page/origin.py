"""The part of a page that states its origin: the command, the tables, the commits and the machines of their rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from phasebench.benchmarks.store.tables import UNKNOWN

from .markdown import join_list, wrap
from .page import Page

if TYPE_CHECKING:
    from phasebench.benchmarks.report import Data

#: The most commits of rows that are named.
MOST = 4


def count_outdated(page: Page, data: Data) -> str:
    """A phrase that counts the rows of a page measured by an earlier version of the code; "" if there are none."""
    measured = [name for name in page.tables if data(name) is not None]
    stale = sum((data.about(name) or {}).get("stale", 0) for name in measured)
    whole = sum(len(data(name)) for name in measured)
    return f"{stale} of {whole} rows by an earlier version of the code" if stale else ""


def commits(measured: Sequence[tuple[str, str, str, int]]) -> str:
    """Say of which commits the rows of tables are; ``measured`` is what `tables.origins` says of them."""
    count: Counter = Counter()
    days: dict[str, set[str]] = {}
    for date, commit, _, rows in measured:
        count[commit] += rows
        days.setdefault(commit, set()).add(date)

    def told(commit: str, rows: int) -> str:
        first, last = min(days[commit]), max(days[commit])
        when = first if first == last else f"{first} to {last}"
        return f"{rows} of {'no known commit' if commit == UNKNOWN else f'commit {commit}'} ({when})"

    return f"Rows: {join_list([told(*entry) for entry in count.most_common()], MOST)}."


def machine(about: Mapping, rows: int | None, quick: bool) -> str:
    """Return a sentence on the machine, the package versions and the kind of run (quick or full) of rows.

    ``about`` describes the machine; ``rows`` is their number, None for all.
    """
    tier = "quick tier" if quick else "full run"
    many = "Measured" if rows is None else f"{rows} rows measured"
    return f"{many} on {about['processor']}; {about['system']}; {about['versions']}; {tier}."


def _machines(names: Sequence[str], data: Data) -> list[str]:
    count: Counter = Counter()
    known: dict[str, Mapping] = {}
    for name in names:
        about = data.about(name) or {}
        known |= about.get("machines", {})
        for _, _, machine_id, rows in data.origins(name):
            count[machine_id, bool(about.get("quick"))] += rows
    found = [(known[id], rows, quick) for (id, quick), rows in count.most_common() if id in known]
    return [machine(about, rows if len(found) > 1 else None, quick) for about, rows, quick in found]


def origin(page: Page, data: Data) -> str:
    """Return the end of a page, a Markdown list: the command that measures its tables, the tables, and the machines.

    ``data`` is a `report.Data`, which reads the tables.
    """
    measured = [name for name in page.tables if data(name) is not None]
    missing = [name for name in page.tables if data(name) is None]
    lines = [f"- `{page.command}`"] if page.command else []
    if missing:
        lines.append(wrap(f"**Not measured** in this folder: {', '.join(missing)}.", "- ", "  "))
    lines += [wrap(f"[data/{name}.csv](data/{name}.csv): {len(data(name))} rows.", "- ", "  ") for name in measured]
    known = [entry for name in measured for entry in data.origins(name)]
    if known:
        old = count_outdated(page, data)
        lines.append(wrap(commits(known) + (f" {old}." if old else ""), "- ", "  "))
    lines += [wrap(text, "- ", "  ") for text in _machines(measured, data)]
    return "\n".join(lines or ["Computed from the records of the methods and problems."]) + "\n"
