"""``report``: the pages from measured tables."""

from __future__ import annotations

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
    from phasebench.benchmarks.rows import lines, tables

    with invalid_input():
        if rows is not None:
            if not rows.exists():
                raise InvalidInput(f"there is no file {rows}; `phasebench run --output {rows}` makes one")
            entries = lines.read(rows, "rows")
            if not entries:
                raise InvalidInput(f"{rows} has no rows; `phasebench run --output {rows}` measures some")
            tables.take(folder / "data", "rows", entries)
        if not (folder / "data").is_dir():
            raise InvalidInput(f"there are no data in {folder}; `pytest benchmarks` or `phasebench run` measures them")
    entry = reports.build(folder, progress=lambda line: err.print(line, highlight=False))
    out.print(f"read {entry}")
