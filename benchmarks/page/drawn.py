"""Caches the figures of a report: one is drawn again only if its rows or the code that draws it changed.

The file `KEPT` beside the figures stores for each page the digests of the tables and the code that its figures were
drawn from, and of the figure files: a file changed since then is drawn again.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from phasebench.integrators.compile import digest

from .page import Page, Picture

if TYPE_CHECKING:
    import pandas as pd

    from phasebench.benchmarks.report import Data

KEPT = "drawn.json"
#: Packages of this project from which drawings take what they show besides rows: names, colours.
SHOWN = ("integrators.records", "reference.peers", "benchmarks.problems")


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def module_of(draw: Callable) -> str:
    """The name of the module that defines a drawing function; of a study's figure, that of the study."""
    while isinstance(draw, functools.partial):
        draw = draw.func
    study = getattr(getattr(draw, "__self__", None), "module", None)
    return study or inspect.unwrap(draw).__module__


@functools.cache
def _source(module: str) -> str:
    """Return a hash of the code that a drawing depends on: its module with imports, the style, and `SHOWN`."""
    style = digest.digest(["phasebench.benchmarks.style"])
    return _hash(" ".join([digest.digest([module]), style, *map(digest.of_folder, SHOWN)]).encode())


class _Reading:
    """A wrapper of a page's data (name -> table) that records in ``names`` which tables were read."""

    def __init__(self, data: Data) -> None:
        self._data, self.names = data, set()

    def __call__(self, name: str) -> pd.DataFrame | None:
        self.names.add(name)
        return self._data(name)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._data, name)


class Figures:
    """Draws the figures of a report's pages, or copies those of the previous report in ``folder`` that are still valid.

    ``before`` has the digests that the previous report stored, and ``now`` those of the new figures, page by page.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "figures"
        self.now: dict[str, dict] = {}
        try:
            self.before = json.loads((self.folder / KEPT).read_text(encoding="utf-8"))
        except (OSError, ValueError):  # missing or truncated: draw everything
            self.before = {}

    def of(self, page: Page, data: Data, target: Path) -> list[Picture]:
        """Draw a page's figures into ``target``, or copy those of the report before if they are still valid.

        ``data`` is a `report.Data`, which reads the tables.  Returns the figures with their titles and captions.
        """
        entry = self.before.get(page.id)
        if entry is None or not self._same(entry, page, data):
            read = _Reading(data)
            pictures = list(page.figures(read, target) or ())
            entry = {
                "source": _source(module_of(page.figures)),
                "tables": {name: data.digest(name) for name in sorted(read.names)},
                "pictures": [[p.file, p.title, p.caption] for p in pictures],
                "files": {p.file: _hash((target / p.file).read_bytes()) for p in pictures},
            }
        else:
            for name in entry["files"]:
                shutil.copyfile(self.folder / name, target / name)
        self.now[page.id] = entry
        return [Picture(*picture) for picture in entry["pictures"]]

    def _same(self, entry: dict, page: Page, data: Data) -> bool:
        return (
            entry["source"] == _source(module_of(page.figures))
            and all(data.digest(name) == known for name, known in entry["tables"].items())
            and all(self._holds(name, known) for name, known in entry["files"].items())
        )

    def _holds(self, name: str, known: str) -> bool:
        path = self.folder / name
        return path.is_file() and _hash(path.read_bytes()) == known

    def write(self, target: Path) -> None:
        """Write the digests of the figures to the file `KEPT` in ``target``."""
        (target / KEPT).write_text(json.dumps(self.now, indent=1, sort_keys=True) + "\n", encoding="utf-8")
