"""Tables computed from measured rows and shipped with the package, so that users need not measure."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from phasebench.reference.files import write_file

from .tables import as_csv

Known = TypeVar("Known")


class ShippedTable(Generic[Known]):
    """A CSV file that is computed from measured rows and shipped with the package, and its parsed content.

    ``build`` gives the lines of the file from measured rows, ``parse`` the object that the program uses from the lines,
    cells as text; it is called with [] if there is no file.
    """

    def __init__(
        self,
        path: Path,
        build: Callable[..., Iterable[Mapping[str, object]]],
        parse: Callable[[list[dict[str, str]]], Known],
    ) -> None:
        self.path, self.build, self.parse = path, build, parse
        self._known: dict[Path, Known] = {}

    def load(self) -> Known:
        """The parsed content of the file, which is read once."""
        if self.path not in self._known:
            lines: list[dict[str, str]] = []
            if self.path.exists():
                with self.path.open(newline="", encoding="utf-8") as stream:
                    lines = list(csv.DictReader(stream))
            self._known[self.path] = self.parse(lines)
        return self._known[self.path]

    def text(self, *rows: Any) -> str:
        """The text of the CSV file, built from measured rows, the arguments of ``build``."""
        lines = list(self.build(*rows))
        return as_csv(lines, list(lines[0]))

    def save(self, *rows: Any) -> None:
        """Write the CSV file anew, at once, from measured rows, the arguments of ``build``."""
        write_file(self.path, self.text(*rows))
        self._known.clear()
