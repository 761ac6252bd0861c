"""``elsewhere``: compare results of integrators in other languages, run elsewhere, with this suite's methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options
from .shared import invalid_input, print_json, show, telling, warn


def elsewhere(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Rows measured elsewhere, ./rows.csv, with their header.")
    ],
    method: options.Methods = [],  # noqa: B006
    as_json: options.Json = False,
) -> None:
    """Check a file of results from elsewhere, and set them beside this suite's methods at as many evaluations."""
    from phasebench.benchmarks.store.elsewhere import FORMAT, VERSION, read
    from phasebench.benchmarks.studies.elsewhere import compare

    with invalid_input(), telling("elsewhere"):
        found = read(file)
        theirs, ours = compare(found, method or None)
    if as_json:
        print_json({FORMAT: VERSION, "header": found.header, "rows": theirs, "own": ours})
        return
    show(f"measured elsewhere by {found.by}, on {found.header['machine']}", [_line(r) for r in theirs])
    show(f"this suite's methods on {found.problem.label}, t = 0 to {found.t_end:g}", [_line(r) for r in ours])
    warn("; ".join(dict.fromkeys(r["reason"] for r in (*theirs, *ours) if r["reason"])))


def _line(row: dict) -> dict[str, str]:
    step = f"h = {row['h']:.6g}" if row.get("h") is not None else f"tol = {row['tol']:.3g}"
    numbers = {name: row[name] for name in ("error", "uncertainty", "energy_error")}
    told = {name.replace("_", " "): "-" if x is None else f"{x:.3g}" for name, x in numbers.items()}
    return {"method": row["method"], "step": step, "evaluations": str(row["evaluations"])} | told
