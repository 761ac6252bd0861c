"""The terminal output of a run: a progress bar, and a table at the end."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from typing import TextIO

from .run import Outcome

HEADINGS = ("experiment", "measured now", "sampled", "unchanged")
HEADINGS += ("not by this version", "not here", "failed", "seconds")


@contextlib.contextmanager
def progress(stream: TextIO) -> Iterator[Callable[[str, int, int, float], None]]:
    """A function (experiment, done, total, seconds left) that shows the progress of a run, if this is a terminal."""
    if not stream.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (
        TextColumn("{task.description:>20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=Console(file=stream)) as bar:
        task = bar.add_task("", total=None, left="")

        def show(experiment: str, done: int, total: int, left: float) -> None:
            minutes, seconds = divmod(round(left), 60)
            told = f"about {minutes}:{seconds:02} left" if left else ""
            bar.update(task, description=experiment, completed=done, total=total, left=told)

        yield show


def counts(outcome: Outcome) -> list[dict[str, object]]:
    """Count a run's cells by experiment: a row for each, for the table that ends a run."""
    left = {c.id for c in outcome.left}
    absent = {c.id for c in outcome.plan.absent} | outcome.unavailable
    rows: dict[str, dict[str, object]] = {}
    for cell in outcome.cells:
        row = rows.setdefault(cell.experiment, dict.fromkeys(HEADINGS, 0) | {"experiment": cell.experiment})
        kind = (
            "failed"
            if cell.id in outcome.failed
            else "measured now"
            if cell.id in outcome.entries
            else "sampled"
            if cell.id in outcome.sampled
            else "not here"
            if cell.id in absent
            else "not by this version"
            if cell.id in left or not outcome.fresh(cell)
            else "unchanged"
        )
        row[kind] += 1
        row["seconds"] = round(outcome.seconds.get(cell.experiment, 0.0))
    return list(rows.values())


def summary(outcome: Outcome, width: int = 100) -> str:
    """The table printed at the end of a run, as text: a line for each experiment with the numbers of `counts`."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for k, heading in enumerate(HEADINGS):
        table.add_column(heading, justify="right" if k else "left")
    rows = counts(outcome)
    for row in rows:
        table.add_row(*(str(row[h] or "") for h in HEADINGS))
    table.add_row("all", *(str(sum(r[h] for r in rows) or "") for h in HEADINGS[1:]))
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue().rstrip()
