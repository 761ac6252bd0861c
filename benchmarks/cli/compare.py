"""``compare``: two stored runs beside each other."""

from __future__ import annotations

from typing import Annotated

import typer

from .shared import WRONG, invalid_input, out, print_json, show


def compare(
    before: Annotated[str, typer.Argument(help="A folder of reports, a CSV file of one, or a commit.")],
    after: Annotated[str, typer.Argument(help="Another.")] = "reports",
    rows: Annotated[int, typer.Option(help="Lines that are printed of each kind.")] = 10,
    json: Annotated[bool, typer.Option("--json", help="Print all of it as JSON.")] = False,
) -> None:
    """Say what of two stored runs differs: statuses, errors, and times beyond the noise.

    The exit code is 1 where something has changed its status, is less accurate, slower, or no longer there.
    """
    from phasebench.benchmarks import history

    with invalid_input():
        old, new = history.stored(before), history.stored(after)
    found = history.changes(old, new)
    bad = any(c.kind in history.BAD for c in found)
    if json:
        lines = [c._asdict() | {"ratio": c.ratio._asdict() if c.ratio else None} for c in found]
        print_json({"before": before, "after": after, "worse": bad, "changes": lines})
    else:
        for kind in history.KINDS:
            members = [c for c in found if c.kind == kind]
            if members:
                show(f"{kind}: {len(members)}", [_line(c) for c in members[:rows]])
                if len(members) > rows:
                    out.print(f"and {len(members) - rows} more; all of them with --json", highlight=False)
        both = [t for t in old if t in new]
        speed = history.usual(old, new)
        said = f"{len(found)} changes in {len(both)} tables that both have"
        out.print(said + (f"; all times together {speed.value:.2f} times those before." if speed.value > 0 else "."))
    if bad:
        raise typer.Exit(WRONG)


def _line(change) -> dict[str, str]:
    ratio = ""
    if change.ratio:
        low, high = f"{change.ratio.low:.3g}", f"{change.ratio.high:.3g}"
        ratio = f"{change.ratio.value:.3g}" + (f" [{low}, {high}]" if low != high else "")
    values = {"before": change.before, "after": change.after, "ratio": ratio}
    return {"table": change.table, "row": change.row, "column": change.column} | values
