"""The recorded error tables in `reference/tables`, with which measurements are compared.

A table is a CSV file; a JSON file beside it holds its provenance and the checksum of the CSV file, which is verified at
every reading.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
import re
from collections.abc import Mapping
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from phasebench import reference
from phasebench.benchmarks.problems.base import Problem
from phasebench.reference.files import write_file
from phasebench.reference.installed import version_of

from . import schema
from .tables import as_csv

if TYPE_CHECKING:
    import pandas as pd

DIRECTORY = Path(reference.__file__).with_name("tables")
REMEDY = "to record it anew: python -m pytest benchmarks --update-tables"
CHECKSUM = "sha256"
PACKAGES = ("numpy", "numba", "heyoka", "rebound", "sympy")


class CorruptTable(RuntimeError):
    """Raised for a damaged table; the message names the file, the fault and the remedy."""

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(f"{path}: {what}; {REMEDY}")


def provenance(problem: Problem, **more: object) -> dict:
    """The provenance of a table: digests of the problem's formulae and initial data, package versions, and ``more``."""
    import sympy as sp

    system = problem.system
    formulae = "|".join(sp.srepr(e) for e in (sp.sympify(system.H), *system.sides, *(e for _, e in system.definitions)))
    data = repr((tuple(map(float, problem.q0)), tuple(map(float, problem.p0))))
    return {
        "problem": problem.label,
        "formulae": _digest(formulae),
        "initial data": _digest(data),
        "python": platform.python_version(),
        **{name: version_of(name) for name in PACKAGES},
        **more,
    }


def save(name: str, frame: pd.DataFrame, provenance: Mapping[str, object], directory: Path = DIRECTORY) -> Path:
    """Store a table under a name, and return its path; ValueError for an unusable name, columns or provenance."""
    if not provenance or CHECKSUM in provenance:
        raise ValueError(f"a table needs its provenance, which has no key {CHECKSUM!r}")
    if not frame.columns.is_unique or not all(isinstance(c, str) for c in frame.columns):
        raise ValueError("the columns' names must be unique text")
    path = _path(name, directory)
    path.parent.mkdir(parents=True, exist_ok=True)
    body = as_csv(frame.to_dict("records"), list(frame))
    write_file(path, body)
    write_file(
        path.with_suffix(".json"),
        json.dumps({**provenance, schema.FIELD: schema.VERSION, CHECKSUM: _digest(body)}, indent=1) + "\n",
    )
    return path


def load(name: str, directory: Path = DIRECTORY) -> tuple[pd.DataFrame, dict]:
    """Read a stored table: (the table, with numbers as doubles; its provenance).

    Raises FileNotFoundError, or CorruptTable if it is not text or does not match its provenance.
    """
    import pandas as pd

    path = _path(name, directory)
    try:
        body = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CorruptTable(path, f"it is no text ({error})") from None
    try:
        about = dict(json.loads(path.with_suffix(".json").read_text(encoding="utf-8")))
        checksum = about.pop(CHECKSUM)
    except (OSError, ValueError, TypeError, KeyError):
        raise CorruptTable(path, "its provenance beside it cannot be read") from None
    schema.check(about, path)
    about.pop(schema.FIELD, None)
    if _digest(body) != checksum:
        raise CorruptTable(path, "its rows do not match their checksum")
    return pd.read_csv(io.StringIO(body), dtype=str, keep_default_na=False).apply(_as_numbers), about


def _as_numbers(column: pd.Series) -> list:
    try:
        return [float(x) if x else nan for x in column]
    except ValueError:
        return list(column)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _path(name: str, directory: Path) -> Path:
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*", name):
        raise ValueError(f"{name!r} is no plain name of a table")
    return directory / f"{name}.csv"
