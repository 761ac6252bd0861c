"""``run``: methods over scenes into rows on disk."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import END_TIME, end_time, err, invalid_input, out, warn


def run(
    problem: Annotated[
        str | None,
        typer.Argument(metavar="[PROBLEM]", help="Instead of scenes a problem, or your own, ./my_problem.py."),
    ] = None,
    t_end: Annotated[str | None, typer.Option(help=f"Of PROBLEM. {END_TIME}")] = None,
    quantity: Annotated[str, typer.Option(help="Of PROBLEM: whose error is measured.")] = "end-state",
    scene: Annotated[list[str], typer.Option(help="A scene; all where none is named.")] = [],  # noqa: B006
    method: Annotated[list[str], typer.Option(help="A method or a peer; all where none is named.")] = [],  # noqa: B006
    quick: Annotated[bool, typer.Option(help="Fewer steps.")] = False,
    jobs: Annotated[int, typer.Option(help="Measure scenes in so many processes beside each other.", min=0)] = 0,
    scheduler: Annotated[
        str | None, typer.Option(help="Measure scenes on a Dask cluster: its address, tcp://10.0.0.1:8786.")
    ] = None,
    output: Annotated[
        Path, typer.Option(help="Rows, one JSON object a line; those that are there and have not changed stay.")
    ] = Path("rows.jsonl"),
) -> None:
    """Sweep methods over scenes, or over one problem's steps, into tidy rows on disk."""
    if problem is not None:
        with invalid_input():
            if jobs or scheduler:
                raise InvalidInput("--jobs and --scheduler are for scenes: the steps of one problem are timed, alone")
        _one(problem, t_end, quantity, method, scene, output)
        return
    from phasebench.benchmarks.experiments.trade import peer_rows, sweep
    from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
    from phasebench.benchmarks.rows import lines, screen
    from phasebench.benchmarks.rows.cluster import Cluster
    from phasebench.integrators.errors import unknown
    from phasebench.integrators.registry import METHODS

    methods = [m.id for m in (*METHODS, *peer_rows.swept())]
    with invalid_input():
        for name, known, kind in [(s, BY_ID, "scene") for s in scene] + [(m, methods, "method") for m in method]:
            if name not in known:
                raise unknown(kind, name, known)
        only = (lambda m: m.id in method) if method else None
        cells = sweep.cells(quick, [s for s in SCENES if not scene or s.id in scene], only)
        if jobs and scheduler:
            raise InvalidInput("both --jobs and --scheduler are given; leave out one of them")
        cluster = Cluster(scheduler) if scheduler else None
        with closing(cluster) if cluster else nullcontext(), screen.progress(sys.stderr) as progress:
            entries, failed, there = lines.measure(output, cells, progress, jobs, cluster)
    for line in failed:
        err.print(line)
    rows = [row for e in entries.values() for row in e.rows["rows"]]
    if there:
        err.print(f"{there} of {len(cells)} cells are in {output} already, of this version of the code")
    ends = Counter(r["status"] for r in rows)
    out.print(f"{len(rows)} rows in {output}: " + ", ".join(f"{n} {s}" for s, n in ends.items()))
    if failed:
        raise typer.Exit(1)


def _one(problem: str, t_end: str | None, quantity: str, methods: list[str], scenes: list[str], output: Path) -> None:
    """Error and time of methods on one problem, from where each breaks to round-off, one JSON object a line."""
    import json

    from phasebench.benchmarks.measure.compilation import row_failures
    from phasebench.reference.tables import write_file

    from .integrate import made
    from .workprecision import measured

    with invalid_input():
        if scenes:
            raise InvalidInput("both a problem and a scene are given; leave out one of them")
        if not output.parent.is_dir():
            raise InvalidInput(f"--output is {output}, and there is no folder {output.parent}")
        chosen = made(problem, None, {}, None, None)
        rows = measured(chosen, end_time(t_end, chosen), quantity, ",".join(methods))
        write_file(output, "".join(json.dumps(row) + "\n" for row in rows))
    warn(row_failures(rows)[1])
    ends = Counter(r["status"] for r in rows)
    out.print(f"{len(rows)} rows in {output}: " + ", ".join(f"{n} {s}" for s, n in ends.items()))
