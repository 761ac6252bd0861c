"""``cite``: the works behind methods and problems, as BibTeX."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import invalid_input


def cite(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Methods and problems. Default: those that the reports used.",
            autocompletion=options.completion("methods", "problems"),
        ),
    ] = None,
    reports: options.Reports = Path("reports"),
) -> None:
    """Print BibTeX for the works behind methods and problems, or behind all that a report used."""
    from phasebench.benchmarks import bibliography

    with invalid_input():
        try:
            used = names or bibliography.ids_in_report(reports)
        except FileNotFoundError:
            raise InvalidInput(
                f"there are no data in {reports}; name methods or problems, or run `pytest benchmarks` first"
            ) from None
        text = bibliography.bibtex(used)
    print(text)
