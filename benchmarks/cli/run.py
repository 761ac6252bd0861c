"""``run``: measure methods on scenes (problems with a time span and steps), and write the rows to a file."""

from __future__ import annotations

import sys
from collections import Counter
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import check_file, err, invalid_input, out, say, telling, time_of, warn


def run(
    problem: Annotated[
        str | None, options.problem_argument("PROBLEM", "Instead of scenes, a problem, or your own, ./my_problem.py.")
    ] = None,
    t_end: options.EndTime = None,
    quantity: Annotated[str, options.quantity("Of PROBLEM; a scene has its own.")] = "end-state",
    scene: Annotated[
        list[str],
        typer.Option(metavar="NAME", help="A scene of `list scenes`; repeat it."),
    ] = [],  # noqa: B006
    method: options.Methods = [],  # noqa: B006
    everything: Annotated[bool, options.everything("All scenes and methods are measured, if none is named.")] = False,
    quick: Annotated[bool, options.quick("Fewer steps.")] = False,
    jobs: Annotated[int, options.jobs("Each measures a scene; 0: all are measured in this one.")] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Measure scenes on a Dask cluster: its address, tcp://10.0.0.1:8786."),
    ] = None,
    output: Annotated[
        Path,
        options.output("FILE", "Rows: .jsonl, one JSON object a line; those of scenes that have not changed stay."),
    ] = Path("rows.jsonl"),
) -> None:
    """Measure methods on scenes, or on one problem over many steps, and write tidy rows to a file.

    Without a scene or a method, say what --all would measure and how long that takes.
    """
    with invalid_input():
        check_file(output, (".jsonl",))
    if problem is not None:
        with invalid_input():
            if jobs or scheduler:
                raise InvalidInput("--jobs and --scheduler are for scenes: the steps of one problem are timed, alone")
            if quick or everything:
                raise InvalidInput("--quick and --all are for scenes: of one problem all steps are measured")
            _refuse_other_rows(output, of_scenes=False)
        _one(problem, t_end, quantity, method, scene, output)
        return
    from phasebench.benchmarks.store import lines, screen
    from phasebench.benchmarks.store.cluster import Cluster

    with invalid_input():
        if t_end is not None:
            raise InvalidInput("--t-end is for a problem: a scene has its own time span")
        if everything and (scene or method):
            raise InvalidInput("--all measures all scenes and methods: leave it out, or --scene and --method")
        _refuse_other_rows(output, of_scenes=True)
        cells = _cells(scene, method, quick)
        if jobs and scheduler:
            raise InvalidInput("both --jobs and --scheduler are given; leave out one of them")
        if not (scene or method or quick or everything):
            _announce(cells)
            return
        cluster = Cluster(scheduler) if scheduler else None
        with closing(cluster) if cluster else nullcontext(), screen.progress(sys.stderr) as progress:
            entries, failed, there = lines.measure(output, cells, progress, jobs, cluster)
    for line in failed:
        say(line, err)
    rows = [row for e in entries.values() for row in e.rows["rows"]]
    if there:
        there_ = f"{there} of {len(cells)} cells are in {output} already, of this version of the code"
        say(there_, err)
    _tell_rows(rows, output)
    if failed:
        raise typer.Exit(1)


def _cells(scenes: list[str], methods: list[str], quick: bool) -> list:
    """The cells of the scenes and methods that are named, or of all; scenes of the trade not with ``quick``."""
    from phasebench.benchmarks.ladder import sweep
    from phasebench.benchmarks.problems.questions import BY_ID as ASKED
    from phasebench.benchmarks.problems.questions import QUESTIONS
    from phasebench.benchmarks.problems.scenes import BY_ID, SCENES
    from phasebench.benchmarks.problems.user_file import is_file
    from phasebench.integrators.errors import unknown_name
    from phasebench.integrators.names import unknown_method

    known = [m.id for m in sweep.swept()]
    for name in scenes:
        if name not in BY_ID and name not in ASKED:
            raise unknown_name("scene", name, [*BY_ID, *ASKED])
    for name in methods:
        if is_file(name):
            at = (BY_ID | ASKED).get(next(iter(scenes), ""), SCENES[0])
            raise InvalidInput(
                f"{name} is a step of your own: rows of scenes stay as long as the code that they depend on, of which "
                f"your file is no part; measure it by: run {at.problem} --t-end {at.t_end:g} --method {name}"
            )
        if name not in known:
            raise unknown_method(name, known)
    only = (lambda m: m.id in methods) if methods else None
    whole = not (scenes or methods or quick)
    held = sweep.cells(quick, [s for s in SCENES if not scenes or s.id in scenes], only)
    return held + sweep.question_cells([q for q in QUESTIONS if whole or q.id in scenes], only)


def _refuse_other_rows(output: Path, of_scenes: bool) -> None:
    """Raise InvalidInput if the file has rows of the other kind, which would be lost."""
    from phasebench.benchmarks.store import lines

    if lines.of_scenes(output) is (not of_scenes):
        whose = "one problem" if of_scenes else "scenes"
        raise InvalidInput(f"{output} has rows of {whose}, which would be lost: name another file with --output")


def _tell_rows(rows: list[dict], output: Path) -> None:
    ends = Counter(r["status"] for r in rows)
    told = f"{len(rows)} rows in {output}: " + ", ".join(f"{n} {s}" for s, n in ends.items())
    say(told)


def _announce(cells: list) -> None:
    """Print what a run of all ``cells`` (single measurements) would measure, and how long that takes."""
    from phasebench.benchmarks.store.run import standing
    from phasebench.benchmarks.store.tables import Table

    stored = {"rows": Table(Path("reports") / "data", "rows")}
    hours = sum(standing(cell, stored).spent for cell in cells) / 3600
    scenes, methods = ({cell.key[k] for cell in cells} for k in ("scene", "method"))
    out.print(
        f"{len(methods)} methods and peers on {len(scenes)} scenes are {len(cells)} cells, about {hours:.2g} hours "
        "(a cell without a stored time counts as 5 s): `run --all` measures them; "
        "`run --scene pendulum-t2 --method pefrl` only those, `run --quick` a few steps of each method",
        highlight=False,
        soft_wrap=True,
    )


def _one(problem: str, t_end: str | None, quantity: str, methods: list[str], scenes: list[str], output: Path) -> None:
    """Measure error and time of methods on one problem, from the widest step to round-off; write them as JSON lines."""
    from phasebench.benchmarks.measure.compilation import row_failures
    from phasebench.benchmarks.store import schema
    from phasebench.benchmarks.store.json_text import json_text
    from phasebench.benchmarks.workprecision import workprecision
    from phasebench.reference.files import write_file

    from .integrate import made

    with invalid_input():
        if scenes:
            raise InvalidInput("both a problem and a scene are given; leave out one of them")
        with telling("run") as tell:
            chosen = made(problem, None, {}, None, None)
            rows = workprecision(chosen, methods, t_end=time_of(t_end, chosen), quantity=quantity, progress=tell).rows
        try:
            write_file(output, "".join(json_text({schema.FIELD: schema.VERSION} | row) + "\n" for row in rows))
        except OSError as error:
            raise InvalidInput(f"--output {output} cannot be written: {error.strerror or error}") from None
    warn(row_failures(rows)[1])
    _tell_rows(rows, output)
