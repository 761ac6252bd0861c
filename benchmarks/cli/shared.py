"""Helpers of all commands: output, tables, progress, reading of options, exit codes for invalid input."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.console import Console

from phasebench.benchmarks.store.json_text import json_text
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

out, err = Console(), Console(stderr=True)
#: Exit codes of a run that went wrong, and of input that cannot be used.
WRONG, INVALID = 1, 2
#: Spaces between the columns of a table; the least width to which a column is cut.
GAP, LEAST = 2, 24
#: Seconds between two lines of progress if stderr is no terminal: at first, and at most.
PAUSE, LONGEST_PAUSE = 2.0, 60.0


@contextmanager
def invalid_input(report: Callable[[str], None] | None = None) -> Iterator[None]:
    """End the command with exit code 2 if an InvalidInput is raised inside; ``report`` prints its message."""
    try:
        yield
    except InvalidInput as error:
        (report or complain)(str(error))
        raise typer.Exit(INVALID) from None


def say(text: str, console: Console = out) -> None:
    """Print text as it is: not folded, no word of it in colour, brackets no markup."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def complain(message: str) -> None:
    """Print on stderr what is wrong with the input; brackets in it are no markup."""
    from rich.markup import escape

    err.print(f"[bold red]invalid:[/] {escape(message)}", highlight=False, soft_wrap=True)


def warn(message: str | None) -> None:
    """Print a warning, such as which methods do not compile; nothing if the message is empty."""
    from rich.markup import escape

    if message:
        out.print(f"[bold red]warning:[/] {escape(message)}", highlight=False, soft_wrap=True)


@contextmanager
def compilation_shown(wanted: bool) -> Iterator[None]:
    """Context manager: inside it a terminal's status line shows what is being compiled, if ``wanted``."""
    from phasebench.integrators.compile import progress

    shown: list[str] = []
    before = progress.announce

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
        progress.announce = before


@contextmanager
def telling(what: str) -> Iterator[Callable[[str], None]]:
    """Give a function to show a line of progress, in a terminal's status line titled ``what``.

    Without a terminal the lines are printed on stderr, more and more rarely.
    """
    if err.is_terminal:
        from phasebench.integrators.compile import progress

        announce, progress.announce = progress.announce, nullcontext  # a terminal has one status line
        try:
            with err.status(what) as status:
                yield status.update
        finally:
            progress.announce = announce
        return
    last, pause = time.monotonic(), PAUSE

    def tell(line: str) -> None:
        nonlocal last, pause
        if time.monotonic() - last > pause:
            last, pause = time.monotonic(), min(2 * pause, LONGEST_PAUSE)
            say(f"  {line}", err)

    yield tell


def print_json(value: object) -> None:
    """Print a value as one line of JSON: numbers in full precision, null for NaN and infinities."""
    print(json_text(value))


def width() -> int | None:
    """Width of the output in characters, from COLUMNS or the terminal; None for a pipe or a file."""
    stated = os.environ.get("COLUMNS", "")
    if stated.isdigit():
        return int(stated)
    return out.width if out.is_terminal else None


def show(title: str, rows: list[dict[str, str]]) -> None:
    """Print a table with as many columns as fit the width of the output, in their order; cut the last if need be."""
    from rich.cells import cell_len, set_cell_size

    room = width()
    heads = list(rows[0]) if rows else []
    widths: dict[str, int] = {}
    for head in heads:
        wide = max(map(cell_len, (head, *(row[head] for row in rows))))
        left = wide if room is None else room - sum(widths.values()) - GAP * len(widths)
        if left < min(wide, LEAST):
            break
        widths[head] = min(wide, left)

    def cut(text: str, wide: int) -> str:
        return set_cell_size(text if cell_len(text) <= wide else set_cell_size(text, wide - 1) + "…", wide)

    def line(cells: dict[str, str]) -> str:
        return (" " * GAP).join(cut(cells[head], wide) for head, wide in widths.items()).rstrip()

    style = {"markup": False, "highlight": False, "soft_wrap": True}
    out.print(title, style="italic", **style)
    out.print(line({head: head for head in heads}), style="bold", **style)
    for row in rows:
        print(line(row))
    hidden = heads[len(widths) :]
    if hidden:
        out.print(f"in a wider terminal also: {', '.join(hidden)}; everything with --json", highlight=False, width=room)


def check_file(path: Path, endings: tuple[str, ...]) -> None:
    """Raise InvalidInput unless a file can be written to ``path`` and its name has one of the ``endings``."""
    if path.suffix.lower() not in endings:
        *others, last = endings
        kinds = f"{', '.join(others)} or {last}" if others else last
        raise InvalidInput(f"--output is {path}; the ending of its name says its kind: {kinds}")
    if not path.parent.is_dir():
        raise InvalidInput(f"--output is {path}, and there is no folder {path.parent}")
    if path.is_dir() or not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InvalidInput(f"--output {path} cannot be written")


def time_of(text: str | None, problem: Problem, option: str = "--t-end") -> float | None:
    """The value of an option that is a time, in the problem's unit of time; None if it is not given."""
    from phasebench.benchmarks.problems.units import span

    return None if text is None else span(text, problem.time_unit, option)


def numbers(text: str | None, name: str) -> list[float] | None:
    """Read comma-separated numbers or fractions such as 1/3 as floats; None for None.

    Raises InvalidInput, naming the option (``name``, without its dashes), for other text.
    """
    if text is None:
        return None
    try:
        return [float(Fraction(x.strip())) if "/" in x else float(x) for x in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InvalidInput(f"--{name} is '{text}'; it must be numbers with commas between, such as 0,0.82") from None


def pairs(items: list[str], option: str) -> dict[str, str]:
    """Read the values ``items`` of a repeated option, each name=value, as a dict from names to texts.

    Raises InvalidInput, naming the ``option``, for other text and for a name that is given twice.
    """
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
    """Read the values ``items`` of a repeated option, each name=number, as a dict from names to floats.

    Raises InvalidInput, naming the ``option`` (without its dashes), for anything else.
    """
    numbers_by_name = {}
    for key, text in pairs(items, f"--{option}").items():
        value = numbers(text, f"{option} {key}")
        if len(value) != 1:
            raise InvalidInput(f"--{option} {key} is '{text}'; it must be one number")
        numbers_by_name[key] = value[0]
    return numbers_by_name
