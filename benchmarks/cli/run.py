"""``run``: methods over scenes into rows on disk."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from .shared import err, invalid_input, out


def run(
    scene: Annotated[list[str], typer.Option(help="A scene; all where none is named.")] = [],  # noqa: B006
    method: Annotated[list[str], typer.Option(help="A method or a peer; all where none is named.")] = [],  # noqa: B006
    quick: Annotated[bool, typer.Option(help="Fewer steps.")] = False,
    output: Annotated[
        Path, typer.Option(help="Rows, one JSON object a line; a run that was killed goes on there.")
    ] = Path("rows.jsonl"),
) -> None:
    """Sweep methods over scenes into tidy rows, kept on disk as they are measured."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from phasebench.benchmarks.experiments.trade import peer_rows, sweep
    from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
    from phasebench.benchmarks.rows.store import Store
    from phasebench.integrators.errors import unknown
    from phasebench.integrators.registry import METHODS

    methods = [m.id for m in (*METHODS, *peer_rows.swept())]
    with invalid_input():
        for name, known, kind in [(s, BY_ID, "scene") for s in scene] + [(m, methods, "method") for m in method]:
            if name not in known:
                raise unknown(kind, name, known)
        store = Store(output)
        only = (lambda m: m.id in method) if method else None
        todo = sweep.tasks([s for s in SCENES if not scene or s.id in scene], quick, only)
        done = sum(store.get(t.key) is not None for t in todo)
        if done:
            err.print(f"{done} of {len(todo)} rows are in {output} already")
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=err) as progress:
            bar = progress.add_task("sweep", total=len(todo), completed=done)

            def told(task, row):
                progress.update(bar, advance=1, description=f"{task.scene}, {row['method']}")

            rows = sweep.run(todo, store, told)
    ends = Counter(r["status"] for r in rows)
    out.print(f"{len(rows)} rows in {output}: " + ", ".join(f"{n} {s}" for s, n in ends.items()))
