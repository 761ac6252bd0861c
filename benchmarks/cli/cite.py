"""``cite``: the works behind methods and problems, as BibTeX."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import invalid_input


def cite(
    names: Annotated[
        list[str] | None, typer.Argument(help="Methods and problems; at first those that the report used.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="The report's folder.")] = Path("reports"),
) -> None:
    """Print BibTeX for the works behind methods and problems, or behind all that a report used."""
    from phasebench.benchmarks import bibliography

    with invalid_input():
        try:
            used = names or bibliography.used(folder)
        except FileNotFoundError:
            raise InvalidInput(
                f"there are no data in {folder}; name methods or problems, or run `pytest benchmarks` first"
            ) from None
        text = bibliography.cited(used)
    print(text)
