"""``report``: write the pages of a report from tables of measurements."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import WRONG, invalid_input, say


def report(
    reports: options.Reports = Path("reports"),
    rows: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Rows that `run` wrote, .jsonl, to take into the data first.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write the same pages as HTML, which need no other file, too.")
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit code 1 if the pages are not those of the tables.")
    ] = False,
) -> None:
    """Write the pages of a folder of reports from the tables in its subfolder data; with --html as HTML, too."""
    from phasebench.benchmarks import report as pages
    from phasebench.benchmarks.problems.scenes import BY_ID as SCENES
    from phasebench.benchmarks.store import lines, tables

    with invalid_input():
        if rows is not None:
            if not rows.exists():
                raise InvalidInput(f"there is no file {rows}; `phasebench run --quick --output {rows}` makes one")
            entries = lines.read(rows, "rows")
            if not entries:
                measure = f"`phasebench run --quick --output {rows}` measures some"
                raise InvalidInput(f"{rows} has no rows of scenes; {measure}")
            held = {id: e for id, e in entries.items() if e.rows["rows"][0].get("scene") in SCENES}
            if not held:
                raise InvalidInput(f"{rows} has rows of scenes of the trade alone, which have no page of one's own")
            with _written(reports):
                tables.take(reports / "data", "rows", held)
        if not (reports / "data").is_dir():
            measure = "`pytest benchmarks` measures them, or `phasebench run` and then `report --rows`"
            raise InvalidInput(f"there are no data in {reports}; {measure}")
        if check:
            other = pages.check(reports)
            for name in other:
                say(f"{name}: not what the tables give")
            raise typer.Exit(WRONG if other else 0)
        with _written(reports):
            entry = pages.build(reports, html_folder=html)
    read = f"read {html / 'index.html' if html else entry}"
    say(read)


@contextmanager
def _written(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        where = error.filename or folder
        raise InvalidInput(f"--reports {folder} cannot be written: {where}: {error.strerror or error}") from None
