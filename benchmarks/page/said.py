"""What others say, as data: statements of a TOML file, each with what judges it, and the table of their verdicts.

A file has a table for each source, with its statements: ``[brouwer]``, ``[brouwer.said.heyoka]``.  A statement has the
entries of its source, unless it has its own.  Entries that judge it are those of `Claim`: ``claim`` (its text),
``table``, ``rows``, ``value``, ``expected``, ``unit``, ``where``, ``beside``, ``span``.  A text is an expression of
columns, or a format of the worst row; ``{function = "name", ...}`` is a function of the study with these arguments.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from .page import Data, Table
from .study import Claim
from .verdict import EVERY, FINDING, MISSING, NONE, PASS, Between, Condition, at_least, at_most

#: A number printed with "about" is met within this factor.
ABOUT = 2.0
#: Name of an expected value in a file -> condition.
EXPECTED: Mapping[str, Callable[..., Condition]] = {
    "at_least": at_least,
    "at_most": at_most,
    "between": lambda ends: Between(*ends),
    "about": lambda value: Between(value / ABOUT, value * ABOUT),
    "all": lambda whether: EVERY if whether else NONE,
}
Functions = Mapping[str, Callable[..., Any]]


def entries(path: Path) -> dict[str, dict[str, Any]]:
    """Name -> statement of a file, in its order, with what its source says."""
    sources = tomllib.loads(path.read_text(encoding="utf-8")).values()
    return {name: {**source, **one} for source in sources for name, one in source.pop("said").items()}


def named(value: Any, functions: Functions) -> Any:
    """The function that a mapping of a file names, with its arguments; any other value as it is."""
    if not isinstance(value, dict) or "function" not in value:
        return value
    arguments = {name: x for name, x in value.items() if name != "function"}
    return partial(functions[value["function"]], **arguments)


def claim(entry: Mapping[str, Any], functions: Functions) -> Claim:
    """The claim of a statement, whose named functions are among ``functions``."""
    expected = named(entry["expected"], functions)
    if isinstance(expected, dict):
        ((name, bound),) = expected.items()
        expected = EXPECTED[name](bound)
    names = ("rows", "unit", "where", "beside", "span")
    more = {name: named(entry[name], functions) for name in names if name in entry}
    return Claim(entry["claim"], entry["table"], named(entry["value"], functions), expected, **more)


@dataclass(frozen=True)
class Statement:
    """A printed number or statement: its claim, and the other entries of the file."""

    claim: Claim
    entry: Mapping[str, Any]

    def row(self, data: Data) -> dict[str, str]:
        """The line of the table: the claim beside what is printed and measured, and the outcome."""
        found = self.claim(data)
        told = found.row() if found else {"measured": "", "outcome": MISSING}
        return {
            "claim": self.entry["claim"],
            "printed": self.entry["printed"],
            "measured": told["measured"],
            "outcome": told["outcome"],
            "why they differ": self.entry.get("why", ""),
            "where": told.get("where it is worst", ""),
            "source": self.entry["source"],
        }


def statements(path: Path, functions: Functions) -> dict[str, Statement]:
    """Name -> statement of a file."""
    return {name: Statement(claim(e, functions), e) for name, e in entries(path).items()}


def claims(said: Mapping[str, Statement], shown: bool) -> dict[str, Claim]:
    """The claims of the statements that a page shows above its table; if not ``shown``, the other ones."""
    return {name: s.claim for name, s in said.items() if s.entry.get("shown", False) == shown}


def table(said: Mapping[str, Statement], caption: str) -> Callable[[Data], Table | None]:
    """The table of all statements, None if none was measured."""

    def of(data: Data) -> Table | None:
        judged = any(s.claim(data) for s in said.values())
        return Table(pd.DataFrame([s.row(data) for s in said.values()]), caption) if judged else None

    return of


def answer(said: Iterable[Statement], text: str) -> Callable[[Data], str | None]:
    """A sentence with {n}, the number of judged statements, of which {hold} and {fail}; None if none is judged."""

    def of(data: Data) -> str | None:
        found = [v.outcome for s in said if (v := s.claim(data)) and v.outcome != MISSING]
        numbers = {"n": len(found), "hold": found.count(PASS), "fail": found.count(FINDING)}
        return text.format(**numbers) if found else None

    return of
