"""What a run measured: tables by name, kept as CSV beside the reports that are written from them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from . import provenance as machine


class Results:
    """Tables by name.  A run of some of the benchmarks replaces their tables and leaves the others as they were."""

    def __init__(self, folder: Path, quick: bool = False):
        self.folder = folder
        self.quick = quick
        self.measured: dict[str, list[dict[str, Any]]] = {}
        self.notes: list[str] = []

    @property
    def data(self) -> Path:
        """The folder of the CSV files."""
        return self.folder / "data"

    def add(self, name: str, rows: Iterable[dict[str, Any]]) -> None:
        """Append rows to the table ``name`` of this run."""
        self.measured.setdefault(name, []).extend(rows)

    def write(self) -> None:
        """Write this run's tables, each with the machine it was measured on."""
        import pandas as pd

        self.data.mkdir(parents=True, exist_ok=True)
        for name, rows in self.measured.items():
            pd.DataFrame(rows).to_csv(self.data / f"{name}.csv", index=False, lineterminator="\n")
            (self.data / f"{name}.json").write_text(
                json.dumps(machine.summary() | {"quick": self.quick}, indent=1) + "\n"
            )


def read(folder: Path, name: str):
    """The table ``name`` as a DataFrame and the machine it was measured on; (None, None) where it was not measured."""
    import pandas as pd

    path = folder / "data" / f"{name}.csv"
    if not path.exists():
        return None, None
    about = json.loads((folder / "data" / f"{name}.json").read_text())
    return pd.read_csv(path, keep_default_na=True), about
