"""The measurements (`Cell`) that test the statements in packages' documentation, one for each script."""

from __future__ import annotations

from phasebench.benchmarks.store.cells import POOL, Cell, Package, Rows, content

from .said import BY_SCRIPT
from .statements import SCRIPTS, Statement, row, run


def measure_rows(script: str) -> Rows:
    """Run a script that tests statements of a package's documentation: a row for each statement, with its verdict.

    Returns the rows by table name.
    """
    found = run(SCRIPTS / f"{script}.py")
    return {"audit_statements": [row(s, *found) for s in BY_SCRIPT[script]]}


def cells() -> list[Cell]:
    """List the measurements to make (`Cell`), one for each script that tests statements."""
    return [_cell(script, members) for script, members in BY_SCRIPT.items()]


def _cell(script: str, members: list[Statement]) -> Cell:
    package = members[0].package
    texts = [(s.said, s.shows, s.severity, s.mend, s.link) for s in members]
    return Cell(
        "audit",
        ("audit_statements",),
        {"script": script},
        measure_rows,
        (script,),
        content(
            "audit_statements",
            members[0].path.read_text(encoding="utf-8"),
            *texts,
            Package(package),
            code=["phasebench.benchmarks.experiments.audit.said"],
        ),
        frozenset({package, *(peer for s in members for peer, _ in s.covers)}),
        POOL,
    )
