"""``report``: the pages from measured tables."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import err, invalid_input, out


def report(
    folder: Annotated[Path, typer.Option(help="The folder whose data the report is written from.")] = Path("reports"),
    rows: Annotated[Path | None, typer.Option(help="Rows of `run` to take in first.")] = None,
) -> None:
    """Write the report of a folder from the tables in its ``data``."""
    from phasebench.benchmarks import report as reports
    from phasebench.benchmarks.problems.scenes import BY_ID as SCENES
    from phasebench.benchmarks.rows import lines, tables

    with invalid_input():
        if rows is not None:
            if not rows.exists():
                raise InvalidInput(f"there is no file {rows}; `phasebench run --output {rows}` makes one")
            entries = lines.read(rows, "rows")
            if not entries:
                raise InvalidInput(f"{rows} has no rows; `phasebench run --output {rows}` measures some")
            held = {id: e for id, e in entries.items() if e.rows["rows"][0].get("scene") in SCENES}
            if not held:
                raise InvalidInput(f"{rows} has rows of scenes of the trade alone, which have no page of one's own")
            with _written(folder):
                tables.take(folder / "data", "rows", held)
        if not (folder / "data").is_dir():
            raise InvalidInput(f"there are no data in {folder}; `pytest benchmarks` or `phasebench run` measures them")
        with _written(folder):
            entry = reports.build(folder, progress=lambda line: err.print(line, highlight=False))
    out.print(f"read {entry}")


@contextmanager
def _written(folder: Path) -> Iterator[None]:
    """Raise InvalidInput where the folder cannot be written to."""
    try:
        yield
    except OSError as error:
        where = error.filename or folder
        raise InvalidInput(f"--folder {folder} cannot be written: {where}: {error.strerror or error}") from None
