"""List the distributions that an installation of phasebench needs, with licence and size.

All data come from the metadata of what is installed: the version, the licence (`License-Expression` of PEP 639, else
`License`, else the classifiers), the size of the files, and the distributions that require it.
"""

from __future__ import annotations

import re
from importlib import metadata

from packaging.requirements import Requirement

ROOT = "phasebench"
#: A `License` field longer than this is the licence's text, not its name.
NAME = 60
#: Classifier of a licence -> a short identifier.
SHORT = {
    "BSD License": "BSD",
    "MIT License": "MIT",
    "Python Software Foundation License": "PSF-2.0",
    "Apache Software License": "Apache-2.0",
    "GNU General Public License v3 (GPLv3)": "GPL-3.0-only",
    "GNU Lesser General Public License v3 or later (LGPLv3+)": "LGPL-3.0-or-later",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}


def key(name: str) -> str:
    """Normalize a distribution's name (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def requirement_names(requires: list[str] | None, extra: str = "") -> list[str]:
    """Return the normalized names of the requirements whose environment markers hold here.

    ``requires`` has requirements as in a package's metadata; those of the optional ``extra``, if given, are included.
    """
    found = [Requirement(text) for text in requires or ()]
    return [key(r.name) for r in found if r.marker is None or r.marker.evaluate({"extra": extra})]


def licence(about: metadata.PackageMetadata) -> str:
    """Return the licence that a distribution's metadata ``about`` name; "" if they name none."""
    for field in ("License-Expression", "License"):
        text = " ".join((about.get(field) or "").split())
        if text and len(text) <= NAME and text.upper() != "UNKNOWN":
            return SHORT.get(text, text)
    heads = [c.split(" :: ")[-1] for c in about.get_all("Classifier") or () if c.startswith("License :: ")]
    names = [SHORT.get(h, h) for h in heads if h != "OSI Approved"]
    return " or ".join(dict.fromkeys(names))


def frame() -> list[dict[str, object]]:
    """Make a row for each distribution that phasebench needs, directly required ones first, then the largest first."""
    by: dict[str, set[str]] = {}
    todo = [(name, ROOT) for name in requirement_names(metadata.requires(ROOT))]
    direct = {name for name, _ in todo}
    while todo:
        name, parent = todo.pop()
        known = name in by
        by.setdefault(name, set()).add(parent)
        if not known:
            todo += [(other, name) for other in requirement_names(metadata.distribution(name).requires)]
    rows = [_row(name, parents, name in direct) for name, parents in by.items()]
    return sorted(rows, key=lambda row: (not row["direct"], -row["MB"], row["package"]))


def _row(name: str, parents: set[str], direct: bool) -> dict[str, object]:
    found = metadata.distribution(name)
    files = [f.locate() for f in found.files or ()]
    size = sum(f.stat().st_size for f in files if f.suffix != ".pyc" and f.exists())
    return {
        "package": name,
        "version": found.version,
        "licence": licence(found.metadata),
        "direct": direct,
        "needed by": ", ".join(sorted(parents)),
        "MB": round(size / 1e6, 1),
    }
