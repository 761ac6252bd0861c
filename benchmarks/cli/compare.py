"""``compare``: the differences between two stored runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from . import options
from .shared import WRONG, invalid_input, out, print_json, show

if TYPE_CHECKING:
    from phasebench.benchmarks.store.history import Change


def compare(
    before: Annotated[
        str,
        typer.Argument(
            metavar="BEFORE", help="A folder of reports, a CSV file of one, rows of `run` (.jsonl), or a commit."
        ),
    ],
    after: Annotated[str, typer.Argument(metavar="AFTER", help="Another.")] = "reports",
    lines: Annotated[
        int, typer.Option(metavar="NUMBER", min=0, help="Number of lines printed of each kind of change.")
    ] = 10,
    as_json: options.Json = False,
) -> None:
    """Show the differences between two stored runs: statuses, errors, and times beyond the noise.

    The exit code is 1 if a row has another status, is less accurate, is slower, or is no longer there.
    """
    from phasebench.benchmarks.store import history

    with invalid_input():
        old, new = history.load_pair(before, after)
    found = history.changes(old, new)
    bad = any(c.kind in history.BAD for c in found)
    if as_json:
        changes = [c._asdict() | {"ratio": c.ratio._asdict() if c.ratio else None} for c in found]
        print_json({"before": before, "after": after, "worse": bad, "changes": changes})
    else:
        for kind in history.KINDS:
            members = [c for c in found if c.kind == kind]
            if members:
                show(f"{kind}: {len(members)}", [_line(c) for c in members[:lines]])
                if len(members) > lines:
                    out.print(f"and {len(members) - lines} more; all of them with --json", highlight=False)
        both = [t for t in old if t in new]
        speed = history.overall(old, new)
        said = f"{len(found)} changes in {len(both)} tables that both have"
        out.print(said + (f"; all times together {speed.value:.2f} times those before." if speed.value > 0 else "."))
    if bad:
        raise typer.Exit(WRONG)


def _line(change: Change) -> dict[str, str]:
    ratio = ""
    if change.ratio:
        low, high = f"{change.ratio.low:.3g}", f"{change.ratio.high:.3g}"
        ratio = f"{change.ratio.value:.3g}" + (f" [{low}, {high}]" if low != high else "")
    values = {"before": change.before, "after": change.after, "ratio": ratio}
    return {"table": change.table, "row": change.row, "column": change.column} | values
