"""What commands share: where they print, how they read numbers, how they end on invalid input."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction

import typer
from rich.console import Console

from phasebench.integrators.errors import InvalidInput

out, err = Console(), Console(stderr=True)
#: Exit codes of a run that went wrong, and of input that cannot be used.
WRONG, INVALID = 1, 2


@contextmanager
def invalid_input(said: Callable[[str], None] | None = None) -> Iterator[None]:
    """End the command with code 2 where its input is invalid; ``said`` prints the message elsewhere than on stderr."""
    try:
        yield
    except InvalidInput as error:
        (said or complain)(str(error))
        raise typer.Exit(INVALID) from None


def complain(message: str) -> None:
    """Print what was wrong with the input; brackets in it are text."""
    from rich.markup import escape

    err.print(f"[bold red]invalid:[/] {escape(message)}", highlight=False, soft_wrap=True)


def show(title: str, heads: list[str], rows: list[list[str]]) -> None:
    """Print a table."""
    from rich.table import Table

    table = Table(title=title, header_style="bold", show_lines=False)
    for i, head in enumerate(heads):
        table.add_column(head, no_wrap=i == 0, overflow="fold")
    for row in rows:
        table.add_row(*row)
    (out if out.is_terminal else Console(width=280)).print(table)


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
    found: dict[str, str] = {}
    for item in items:
        key, mark, value = (x.strip() for x in item.partition("="))
        if not mark or not key or not value:
            raise InvalidInput(f"{option} {item}: write name=value, such as lam=1/3")
        if key in found:
            raise InvalidInput(f"{option} {key} is given twice")
        found[key] = value
    return found


def values(items: list[str], option: str) -> dict[str, float]:
    """name=value with one number each."""
    found = {}
    for key, text in pairs(items, f"--{option}").items():
        value = numbers(text, f"{option} {key}")
        if len(value) != 1:
            raise InvalidInput(f"--{option} {key} is '{text}'; it must be one number")
        found[key] = value[0]
    return found
