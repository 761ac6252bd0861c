"""Rows on disk: one JSON object a line, written as soon as it is measured, so that a killed run loses nothing."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from phasebench.integrators.errors import InvalidInput

#: How every line begins: the key is written first.
BEGINS = '{"key": '


class Store:
    """Measured rows in a file, found again by their ``key``.

    A line that a killed run left unfinished is dropped; any other unreadable line is an error that names it, and
    leaves the file as it is.  Raises InvalidInput as well for a file that cannot be read or written.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._rows: dict[str, dict[str, Any]] = {}
        if self.path.exists():
            for row in self._read():
                self._rows[row["key"]] = row

    def _read(self) -> Iterator[dict[str, Any]]:
        try:
            text = self.path.read_text()
        except OSError as error:
            raise InvalidInput(f"{self.path} cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise InvalidInput(f"{self.path} is no file of rows: it is no text") from None
        lines = text.split("\n")
        last = lines.pop()  # empty, but where the run was killed while it wrote
        for number, line in enumerate(lines, 1):
            if line:
                yield self._row(line, number)
        if not last:
            return
        try:
            row = self._row(last, len(lines) + 1)
        except InvalidInput:
            if not last.startswith(BEGINS[: len(last)]):
                raise
            self.path.write_text("".join(f"{line}\n" for line in lines))
        else:
            self.path.write_text(f"{text}\n")
            yield row

    def _row(self, line: str, number: int) -> dict[str, Any]:
        try:
            row = json.loads(line)
            row["key"]
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidInput(
                f"{self.path}, line {number}, is no row ({error}); remove the line, or the file to measure anew"
            ) from None
        return row

    def get(self, key: str) -> dict[str, Any] | None:
        """The row of that key, or None."""
        return self._rows.get(key)

    def put(self, key: str, row: dict[str, Any]) -> None:
        """Keep a row, on disk before this returns."""
        row = {"key": key, **row}
        self._rows[key] = row
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise InvalidInput(f"{self.path} cannot be written: {error.strerror}") from None

    def rows(self) -> list[dict[str, Any]]:
        """Every row, the last of each key."""
        return list(self._rows.values())
