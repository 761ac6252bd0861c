"""``stability``: the stable steps of a method on the harmonic oscillator."""

from __future__ import annotations

from typing import Annotated

from . import options
from .shared import compilation_shown, invalid_input, out, pairs, print_json


def stability(
    method: Annotated[str, options.method_argument("A method, a peer with a step, or ./mine.py.")],
    param: options.Parameters = [],  # noqa: B006
    as_json: options.Json = False,
) -> None:
    """Print the intervals of h omega in which a method is stable on the harmonic oscillator."""
    with invalid_input():
        parameters = pairs(param, "--param")
        with compilation_shown(not as_json):
            from phasebench.benchmarks.measure import oscillator

            found = oscillator.stability(method, parameters=parameters).row()
    if as_json:
        print_json(found)
    else:
        _print(found)


def _print(found: dict) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    names = ", ".join(f"{k}={v}" for k, v in found["params"].items())
    limit = found["limit"]
    table.add_row("method", Text(f"{found['method']}{f'({names})' if names else ''}"))
    table.add_row("limit of h omega", f"none up to {found['scanned']:g}" if limit is None else f"{limit:.10g}")
    ends = [f"{a:.10g} to {'beyond' if b is None else f'{b:.10g}'}" for a, b in found["intervals"]]
    table.add_row("stable for", ", ".join(ends) or "no step")
    if found["touches"]:
        table.add_row("trace touches 2 at", ", ".join(f"{z:.6g}" for z in found["touches"]))
    table.add_row("from", found["how"])
    if found["reason"]:
        table.add_row("reason", Text(found["reason"]))
    out.print(table, highlight=False)
