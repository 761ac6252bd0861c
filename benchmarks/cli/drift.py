"""``drift``: the drift of a stored time series, such as an energy along a run, told apart from its oscillation."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from phasebench.integrators.errors import InvalidInput, unknown_name

from . import options
from .shared import WRONG, invalid_input, out, print_json

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.series import Drift

#: Names of a column of times, if none is given.
TIMES = ("t", "time", "times")


def drift(
    series: Annotated[
        Path,
        typer.Argument(
            metavar="SERIES", help="A table, ./series.csv, with names in its first line; lines with # are left out."
        ),
    ],
    time: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN", help="The column of times. Default: t or time.")
    ] = None,
    column: Annotated[
        str, typer.Option("--column", metavar="COLUMN", help="The column of the series that may drift.")
    ] = "energy",
    as_json: options.Json = False,
) -> None:
    """Print the drift of a stored series with its interval; exit code 0 only if the interval holds 0."""
    with invalid_input():
        columns = read(series)
        names = (time, column) if time is not None else (_time_column(series, columns), column)
        t, values = (_column(series, columns, name) for name in names)
        from phasebench.benchmarks.measure.series import drift as measured

        found = measured(t, values)
    if as_json:
        print_json(found.as_dict())
    else:
        _print(found, series, column)
    raise typer.Exit(0 if found.holds_zero else WRONG)


def read(path: Path) -> dict[str, list[str]]:
    """The columns of a CSV file as text, by name; raises InvalidInput if it cannot be read."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(line for line in file if line.strip() and not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInput(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not rows:
        raise InvalidInput(f"{path} is empty: its first line must name the columns")
    heads = [head.strip() for head in rows[0]]
    short = next((i for i, row in enumerate(rows[1:], 1) if len(row) != len(heads)), None)
    if short is not None:
        raise InvalidInput(f"{path}: row {short} has {len(rows[short])} entries for {len(heads)} columns")
    return {head: [row[k] for row in rows[1:]] for k, head in enumerate(heads)}


def _time_column(path: Path, columns: dict[str, list[str]]) -> str:
    found = next((name for name in columns if name.lower() in TIMES), None)
    if found is None:
        raise InvalidInput(f"{path} has no column t or time; say --time with one of {', '.join(columns)}")
    return found


def _column(path: Path, columns: dict[str, list[str]], name: str) -> list[float]:
    """The numbers of a column; raises InvalidInput for an unknown one, and for text that is no number."""
    if name not in columns:
        raise InvalidInput(f"{path}: {unknown_name('column', name, columns)}")
    numbers = []
    for row, text in enumerate(columns[name], 1):
        try:
            numbers.append(float(text))
        except ValueError:
            raise InvalidInput(f"{path}: '{text}' in row {row} of column '{name}' is no number") from None
    return numbers


def _print(found: Drift, series: Path, column: str) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None)
    table.add_row("series", Text(f"{column} of {series}"))
    verdict = ("green", "none is seen") if found.holds_zero else ("bold red", "it drifts")
    table.add_row("drift", Text(verdict[1], verdict[0]))
    table.add_row("slope", f"{found.slope:+.3e} in a unit of time")
    low, high = found.interval
    table.add_row("interval", f"{low:+.3e} to {high:+.3e}, which {'holds' if found.holds_zero else 'excludes'} 0")
    table.add_row("oscillation", f"{found.oscillation:.3e}, half the range without the drift")
    table.add_row("method", Text(found.method))
    out.print(table, highlight=False)
