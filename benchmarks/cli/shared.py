"""What commands share: where they print, how they read numbers, how they end on invalid input."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from fractions import Fraction
from math import isfinite

import typer
from rich.console import Console

from phasebench.integrators.errors import InvalidInput

out, err = Console(), Console(stderr=True)
#: Exit codes of a run that went wrong, and of input that cannot be used.
WRONG, INVALID = 1, 2
#: Between two columns of a table; and the least that is shown of one, or all of it where it is narrower.
GAP, LEAST = 2, 24
#: What --t-end is.
END_TIME = 'End time; with a unit where the problem has one: "1e4 yr".'
#: Seconds between two lines of progress where no terminal shows it: at first, and at most.
PAUSE, LONGEST_PAUSE = 2.0, 60.0


@contextmanager
def invalid_input(report: Callable[[str], None] | None = None) -> Iterator[None]:
    """End the command with code 2 where its input is invalid; ``said`` prints the message elsewhere than on stderr."""
    try:
        yield
    except InvalidInput as error:
        (report or complain)(str(error))
        raise typer.Exit(INVALID) from None


def complain(message: str) -> None:
    """Print what was wrong with the input; brackets in it are text."""
    from rich.markup import escape

    err.print(f"[bold red]invalid:[/] {escape(message)}", highlight=False, soft_wrap=True)


def warn(message: str | None) -> None:
    """Print what has to be known first, such as methods that do not compile; nothing where there is nothing."""
    from rich.markup import escape

    if message:
        out.print(f"[bold red]warning:[/] {escape(message)}", highlight=False, soft_wrap=True)


@contextmanager
def compilation_shown(wanted: bool) -> Iterator[None]:
    """While something is compiled, say so on a terminal."""
    from phasebench.integrators.engine import progress

    shown: list[str] = []

    @contextmanager
    def outermost(what: str) -> Iterator[None]:
        with nullcontext() if shown else err.status(what):  # a terminal has one status line
            shown.append(what)
            yield
            shown.pop()

    if wanted and err.is_terminal:
        progress.announce = outermost
    try:
        yield
    finally:
        progress.announce = nullcontext


@contextmanager
def telling(what: str) -> Iterator[Callable[[str], None]]:
    """Show how far a command is: on a terminal's status line, elsewhere by a line now and then, ever more rarely."""
    if err.is_terminal:
        with err.status(what) as status:
            yield status.update
        return
    last, pause = time.monotonic(), PAUSE

    def say(line: str) -> None:
        nonlocal last, pause
        if time.monotonic() - last > pause:
            last, pause = time.monotonic(), min(2 * pause, LONGEST_PAUSE)
            err.print(f"  {line}", highlight=False, markup=False, soft_wrap=True)

    yield say


def print_json(value: object) -> None:
    """Print a value as one line of JSON: numbers in full precision, null where there is none."""
    print(json.dumps(_finite(value), allow_nan=False))


def _finite(value: object) -> object:
    """The value with None in place of what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _finite(x) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(x) for x in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def width() -> int | None:
    """How many columns there are to print in; None where nothing says so (a pipe, a file)."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isdigit():
        return int(stated)
    return out.width if out.is_terminal else None


def show(title: str, rows: list[dict[str, str]]) -> None:
    """Print a table: of its columns, in their order, as many as fit, the last of them cut where it has to be."""
    from rich.table import Table
    from rich.text import Text

    room = width()
    heads = list(rows[0]) if rows else []
    widths: dict[str, int] = {}
    for head in heads:
        wide = max(len(head), *(len(row[head]) for row in rows))
        left = wide if room is None else room - sum(widths.values()) - GAP * len(widths)
        if left < min(wide, LEAST):
            break
        widths[head] = min(wide, left)
    table = Table(
        title=title, title_justify="left", header_style="bold", box=None, pad_edge=False, padding=(0, GAP, 0, 0)
    )
    for head, wide in widths.items():
        table.add_column(head, no_wrap=True, overflow="ellipsis", width=wide)
    for row in rows:
        table.add_row(*(Text(row[head]) for head in widths))
    whole = sum(widths.values()) + GAP * len(widths)
    console = Console(width=room or max(whole, len(title)))
    console.print(table)
    hidden = heads[len(widths) :]
    if hidden:
        console.print(f"in a wider terminal also: {', '.join(hidden)}; everything with --json", highlight=False)


def end_time(text: str | None, problem) -> float | None:
    """The end time that --t-end is, in the problem's unit of time."""
    from phasebench.benchmarks.problems.units import span

    return None if text is None else span(text, problem.time_unit, "--t-end")


def numbers(text: str | None, name: str) -> list[float] | None:
    """Comma-separated numbers; fractions such as 1/3 are read as well."""
    if text is None:
        return None
    try:
        return [float(Fraction(x.strip())) if "/" in x else float(x) for x in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InvalidInput(f"--{name} is '{text}'; it must be numbers with commas between, such as 0,0.82") from None


def pairs(items: list[str], option: str) -> dict[str, str]:
    """name=value, each name once."""
    items_by_name: dict[str, str] = {}
    for item in items:
        key, mark, value = (x.strip() for x in item.partition("="))
        if not mark or not key or not value:
            raise InvalidInput(f"{option} {item}: write name=value, such as lam=1/3")
        if key in items_by_name:
            raise InvalidInput(f"{option} {key} is given twice")
        items_by_name[key] = value
    return items_by_name


def values(items: list[str], option: str) -> dict[str, float]:
    """name=value with one number each."""
    numbers_by_name = {}
    for key, text in pairs(items, f"--{option}").items():
        value = numbers(text, f"{option} {key}")
        if len(value) != 1:
            raise InvalidInput(f"--{option} {key} is '{text}'; it must be one number")
        numbers_by_name[key] = value[0]
    return numbers_by_name
