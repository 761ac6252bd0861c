"""``audit``: compare what packages claim of their integrators with measurements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from phasebench.integrators.errors import InvalidInput

from . import options
from .shared import invalid_input, out, print_json, telling
from .shared import show as print_table


def audit(
    package: Annotated[list[str], options.package("Its integrators are measured; repeat it. Default: all.")] = [],  # noqa: B006
    peer: Annotated[
        list[str],
        typer.Option(
            metavar="NAME",
            help="A peer, such as rebound-leapfrog; repeat it. Default: all.",
            autocompletion=options.completion("peers"),
        ),
    ] = [],  # noqa: B006
    quick: Annotated[bool, options.quick("Two measures on one problem.")] = False,
    scripts: Annotated[
        bool, typer.Option("--scripts", help="Run the scripts that test what documentation says, too.")
    ] = False,
    tables: Annotated[
        bool,
        typer.Option("--tables", help="Check coefficient tables in packages' sources instead."),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Measure the integrators of established packages, by default all, and show which of their claims hold."""
    if tables:
        with invalid_input(), telling("audit") as tell:
            if peer or quick or scripts:
                raise InvalidInput("--tables checks tables of coefficients: leave out --peer, --quick and --scripts")
            checked = _check_tables(package, tell)
        if as_json:
            print_json(checked)
        else:
            _show_tables(checked)
        return
    from phasebench.benchmarks.audit.audit import audit as measure
    from phasebench.benchmarks.audit.table import show

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


def _stated(packages: set[str], progress: Callable[[str], None]) -> list[dict]:
    """Run the scripts that test statements in these packages' documentation; return a row per statement."""
    from phasebench.benchmarks.studies.audit import statements

    rows = []
    for script, members in statements.BY_SCRIPT.items():
        if members[0].package in packages:
            progress(script)
            rows += statements.measure(script)
    return rows


def _check_tables(packages: list[str], tell: Callable[[str], None]) -> list[dict]:
    """Check the coefficient tables transcribed from the sources of these packages, or of all if none is named."""
    from phasebench.benchmarks.studies.catalogue.tables import check, read

    known = {package.casefold(): package for package, _ in read()}
    unknown = next((p for p in packages if p.casefold() not in known), None)
    if unknown is not None:
        raise InvalidInput(f"no table of '{unknown}' is transcribed, only of {', '.join(sorted(known.values()))}")
    chosen = {p.casefold() for p in packages} or known
    rows = []
    for table in read().values():
        if table.package.casefold() in chosen:
            tell(f"{table.package}, {table.name}")
            rows.append(check(table))
    return rows


def _show_tables(rows: list[dict]) -> None:
    columns = ["package", "name", "stated order", "named order", "order", "digits printed", "digits that hold", "kind"]
    texts = [{c: "" if r[c] is None else str(r[c]) for c in columns} for r in rows]
    print_table(f"{len(rows)} tables; the order is by the order conditions", texts)
