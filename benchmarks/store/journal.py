"""The journal of a run: each finished cell is written to disk at once, one JSON object a line, and survives a kill.

A line that cannot be read (the run was killed while writing, the disk failed) counts as not measured.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phasebench.integrators.errors import InvalidInput
from phasebench.reference.files import write_file

from .cells import Rows


@dataclass(frozen=True)
class Entry:
    """A finished cell: its id, content hash, date, machine, seconds spent, rows, and commit."""

    cell: str
    content: str
    date: str
    machine: str
    spent: float
    rows: Rows
    commit: str = ""


class Journal:
    """A file of finished cells, to which a run appends each as soon as it is measured; raises InvalidInput."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.unreadable = 0
        self.entries: dict[str, Entry] = {}
        for entry in self._read():
            self.entries[entry.cell] = entry

    def _read(self) -> Iterator[Entry]:
        try:
            lines = self.path.read_bytes().split(b"\n")
        except FileNotFoundError:
            return
        except OSError as error:
            raise InvalidInput(f"{self.path} cannot be read: {error.strerror}") from None
        for line in filter(None, lines):
            try:
                entry = Entry(**json.loads(line))
                if not all(isinstance(rows, list) for rows in entry.rows.values()):
                    raise ValueError
            except (ValueError, TypeError, AttributeError):
                self.unreadable += 1
            else:
                yield entry

    def put(self, entry: Entry) -> None:
        """Store a finished cell; it is on disk when this returns."""
        self.entries[entry.cell] = entry
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as stream:
                # If a killed run left an unfinished line, start a new one.
                begin = b"\n" if stream.tell() and not _ends(self.path) else b""
                stream.write(begin + _line(entry).encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise InvalidInput(f"{self.path} cannot be written: {error.strerror}") from None

    def drop(self, cells: Iterable[str]) -> None:
        """Remove the entries of ``cells`` (ids of measurements), which the tables contain by now; others stay."""
        for cell in cells:
            self.entries.pop(cell, None)
        if not self.entries:
            self.path.unlink(missing_ok=True)
            return
        try:
            write_file(self.path, "".join(map(_line, self.entries.values())))
        except OSError as error:
            raise InvalidInput(f"{self.path} cannot be written: {error.strerror}") from None


def _line(entry: Entry) -> str:
    return json.dumps(asdict(entry), default=_plain) + "\n"


def _ends(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) == b"\n"


def _plain(value: np.generic) -> Any:
    return value.item()


@contextlib.contextmanager
def lock(folder: Path, name: str = ".lock") -> Iterator[None]:
    """Context manager: hold an exclusive lock, the file ``name`` in a folder; raise InvalidInput if it is taken."""
    try:
        import fcntl
    except ImportError:  # no file locks on this system
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / name).open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidInput(f"another run writes to {folder}; wait for it, or write elsewhere") from None
        yield
