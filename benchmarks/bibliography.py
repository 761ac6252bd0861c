"""BibTeX entries of the works that methods and problems cite, from the two files ``bibliography.bib``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from phasebench import integrators
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.names import unknown_method
from phasebench.integrators.registry import BY_ID

from . import problems

FILES = (
    Path(integrators.__file__).with_name("bibliography.bib"),
    Path(problems.__file__).with_name("bibliography.bib"),
)


@cache
def entries() -> dict[str, str]:
    """Return all entries of the two bibliography files as a dict: BibTeX key -> text of the entry."""
    text = "\n".join(path.read_text() for path in FILES)
    by_key = {m[1]: m[0].strip() for m in re.finditer(r"^@\w+\{([^,\s]+),.*?^\}$", text, re.MULTILINE | re.DOTALL)}
    assert len(by_key) == len(re.findall(r"^@", text, re.MULTILINE)), "an entry does not end with a brace of its own"
    return by_key


def bibtex(names: Iterable[str]) -> str:
    """Return the BibTeX entries that the named methods and problems cite, each once, sorted by key, as one text.

    ``names`` are ids of methods, and names of problems with or without an orbit (``henon-heiles:box``).  Raises
    InvalidInput, which suggests the nearest known name, for any other name.
    """
    keys: set[str] = set()
    for name in names:
        if name in BY_ID:
            keys |= set(BY_ID[name].cite)
        elif name.partition(":")[0] in problems.PROBLEMS:
            keys |= set(problems.problem(name).cite)
        else:
            raise unknown_method(name, [*BY_ID, *problems.PROBLEMS], "method or problem")
    return "\n\n".join(entries()[key] for key in sorted(keys))


def ids_in_report(folder: Path) -> list[str]:
    """Return the ids of the methods and problems in the tables of a report folder.

    Raises FileNotFoundError if the folder has no tables.
    """
    import pandas as pd

    tables = sorted((folder / "data").glob("*.csv"))
    if not tables:
        raise FileNotFoundError(folder / "data")
    names = set()
    for path in tables:
        try:
            frame = pd.read_csv(path, comment="#")
        except (OSError, ValueError) as error:
            raise InvalidInput(f"{path} cannot be read: {error}") from None
        for column in {"id", "method", "problem"} & set(frame.columns):
            names |= {str(x).partition("(")[0].partition(":")[0] for x in frame[column].unique()}
    return sorted(names & {*BY_ID, *problems.PROBLEMS})
