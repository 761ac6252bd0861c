"""The works that methods cite: BibTeX from ``integrators/bibliography.bib``, the one place where they stand."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import integrators
from integrators.registry import BY_ID

FILE = Path(integrators.__file__).with_name("bibliography.bib")


@cache
def entries() -> dict[str, str]:
    """Key -> the text of its entry."""
    text = FILE.read_text()
    found = {m[1]: m[0].strip() for m in re.finditer(r"^@\w+\{([^,\s]+),.*?^\}$", text, re.MULTILINE | re.DOTALL)}
    assert len(found) == len(re.findall(r"^@", text, re.MULTILINE)), "an entry does not end with a brace of its own"
    return found


def cited(ids: Iterable[str]) -> str:
    """BibTeX of the works that these methods cite, each once, in the order of their keys."""
    keys = {key for id in ids for key in BY_ID[id].cite}
    return "\n\n".join(entries()[key] for key in sorted(keys))


def used(folder: Path) -> list[str]:
    """The ids of the methods in a report's tables; raises FileNotFoundError where there are none."""
    import pandas as pd

    tables = sorted((folder / "data").glob("*.csv"))
    if not tables:
        raise FileNotFoundError(folder / "data")
    found = set()
    for path in tables:
        frame = pd.read_csv(path, comment="#")
        for column in {"id", "method"} & set(frame.columns):
            found |= {str(x).partition("(")[0] for x in frame[column].unique()}
    return sorted(found & set(BY_ID))
