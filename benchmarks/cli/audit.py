"""``audit``: what packages claim of their integrators beside what is measured."""

from __future__ import annotations

from typing import Annotated

import typer

from .shared import err, invalid_input, out, print_json


def audit(
    package: Annotated[list[str], typer.Option(help="A package, such as rebound.")] = [],  # noqa: B006
    peer: Annotated[list[str], typer.Option(help="A peer, such as rebound-leapfrog.")] = [],  # noqa: B006
    quick: Annotated[bool, typer.Option(help="Two measures on one problem.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure established integrators, all where none is named, and show which of their claims hold."""
    from phasebench.benchmarks.experiments.audit.audit import audit as measure
    from phasebench.benchmarks.experiments.audit.table import show

    with invalid_input(), err.status("audit") as status:
        measured = measure([*package, *peer] or None, quick=quick, progress=status.update)
    if as_json:
        print_json({"rows": measured.rows, "claims": measured.claims, "remarks": measured.remarks})
    else:
        show(measured, out)
