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
    from phasebench.benchmarks.rows.store import Store
    from phasebench.benchmarks.rows.tables import Results

    with invalid_input():
        if rows is not None:
            if not rows.exists():
                raise InvalidInput(f"there is no file {rows}; `phasebench run --output {rows}` makes one")
            measured = [{k: v for k, v in r.items() if k != "key"} for r in Store(rows).rows()]
            if not measured:
                raise InvalidInput(f"{rows} has no rows; `phasebench run --output {rows}` measures some")
            found = Results(folder, quick=any(r.get("tier") == "quick" for r in measured))
            found.add("rows", measured)
            found.write()
        if not (folder / "data").is_dir():
            raise InvalidInput(f"there are no data in {folder}; `pytest benchmarks` or `phasebench run` measures them")
    entry = reports.build(folder, progress=lambda line: err.print(line, highlight=False))
    out.print(f"read {entry}")
