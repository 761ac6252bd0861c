"""``certify``: the certified references computed anew, or one state of one's own."""

from __future__ import annotations

from typing import Annotated

import typer

from .shared import err, invalid_input, out


def certify(
    problem: Annotated[list[str] | None, typer.Argument(help="Problems, or problem:orbit; all at first.")] = None,
    update: Annotated[bool, typer.Option(help="Store what was computed.")] = False,
    t_end: Annotated[
        float | None, typer.Option(help="Certify this one time of one problem, and store nothing.")
    ] = None,
) -> None:
    """Compute stored reference states anew and show that nothing moved; exit code 1 where something did."""
    from phasebench.benchmarks.experiments.references import certify as references

    with invalid_input():
        code = references.certify(problem or (), update=update, t_end=t_end, console=out, progress=err)
    raise typer.Exit(code)
