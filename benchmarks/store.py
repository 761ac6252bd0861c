"""Rows on disk: one JSON object a line, written as soon as it is measured, so that a killed run loses nothing."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from integrators.errors import InvalidInput


def _is_row(line: str) -> bool:
    """Whether a line is a whole row."""
    try:
        return "key" in json.loads(line)
    except (ValueError, TypeError):
        return False


class Store:
    """Measured rows in a file, found again by their ``key``.

    A line that a killed run left unfinished is dropped; any other unreadable line is an error that names it.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._rows: dict[str, dict[str, Any]] = {}
        if self.path.exists():
            for row in self._read():
                self._rows[row["key"]] = row

    def _read(self) -> Iterator[dict[str, Any]]:
        text = self.path.read_text()
        if not text.endswith("\n"):  # the run was killed while it wrote its last line
            whole, last = text[: text.rfind("\n") + 1], text[text.rfind("\n") + 1 :]
            text = f"{text}\n" if _is_row(last) else whole
            self.path.write_text(text)
        for number, line in enumerate(text.split("\n"), 1):
            if not line:
                continue
            try:
                row = json.loads(line)
                row["key"]
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidInput(
                    f"{self.path}, line {number}, is no row ({error}); remove the line, or the file to measure anew"
                ) from None
            yield row

    def get(self, key: str) -> dict[str, Any] | None:
        """The row of that key, or None."""
        return self._rows.get(key)

    def put(self, key: str, row: dict[str, Any]) -> None:
        """Keep a row, on disk before this returns."""
        row = {"key": key, **row}
        self._rows[key] = row
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a") as stream:
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            os.fsync(stream.fileno())

    def rows(self) -> list[dict[str, Any]]:
        """Every row, the last of each key."""
        return list(self._rows.values())
