"""``audit``: what packages claim of their integrators beside what is measured."""

from __future__ import annotations

from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from .shared import invalid_input, out, print_json, telling


def audit(
    package: Annotated[list[str], typer.Option(help="A package, such as rebound.")] = [],  # noqa: B006
    peer: Annotated[list[str], typer.Option(help="A peer, such as rebound-leapfrog.")] = [],  # noqa: B006
    quick: Annotated[bool, typer.Option(help="Two measures on one problem.")] = False,
    scripts: Annotated[bool, typer.Option(help="Run the scripts that test what documentation says, too.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Measure established integrators, all where none is named, and show which of their claims hold."""
    from phasebench.benchmarks.experiments.audit.audit import audit as measure
    from phasebench.benchmarks.experiments.audit.table import show

    with invalid_input(), telling("audit") as tell:
        _own_steps_are_validated(peer)
        measured = measure([*package, *peer] or None, quick=quick, progress=tell)
        stated = _stated({r["package"] for r in measured.rows}, tell) if scripts else []
    if as_json:
        whole = {"rows": measured.rows, "claims": measured.claims, "remarks": measured.remarks}
        print_json(whole | ({"statements": stated} if scripts else {}))
        return
    show(measured, out)
    for row in stated:
        out.print(f"{row['package']}, {row['verdict']}: '{row['said']}'", markup=False, highlight=False)
        out.print(f"  {row['script']}: {row['shows'] or row['reason']}", markup=False, highlight=False)


def _own_steps_are_validated(names: list[str]) -> None:
    from phasebench.benchmarks.problems.user_file import is_file

    own = next((name for name in names if is_file(name)), None)
    if own is not None:
        raise InvalidInput(f"the audit is of packages; `phasebench validate {own}` judges a step of your own")


def _stated(packages: set[str], progress) -> list[dict]:
    """The statements of the packages' documentation, judged by their scripts."""
    from phasebench.benchmarks.experiments.audit import statements
    from phasebench.benchmarks.experiments.audit.said import BY_SCRIPT

    rows = []
    for script, members in BY_SCRIPT.items():
        if members[0].package in packages:
            progress(script)
            rows += statements.measured(script)["audit_statements"]
    return rows
