"""A process that runs tests on a copy of the project; what the project itself imports from others is there already."""

from __future__ import annotations

import os
import sys
from pathlib import Path

PRELOADED = (
    "pytest",
    "numpy",
    "scipy.stats",
    "scipy.integrate",
    "sympy",
    "numba",
    "pandas",
    "matplotlib.pyplot",
    "mpmath",
)
#: What makes Python import the project from a copy of it, which the editable install does not know.
REDIRECT = """import sys
for name, module in list(sys.modules.items()):
    if name.startswith("__editable___phasebench"):
        module.MAPPING.update({k: v.replace(ROOT, COPY) for k, v in module.MAPPING.items()})
"""


def redirect(root: Path, copy: Path) -> None:
    """Write what redirects processes that tests start."""
    site = copy / ".mutation" / "sitecustomize.py"
    site.parent.mkdir(exist_ok=True)
    site.write_text(REDIRECT.replace("ROOT", repr(str(root))).replace("COPY", repr(str(copy))))


def run(root: str, copy: str, tests: list[str]) -> None:
    """Run tests until one fails; the exit code is pytest's."""
    import pytest

    os.setsid()
    os.chdir(copy)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    os.environ |= {"PYTHONPATH": f"{copy}/.mutation"}
    exec(REDIRECT, {"ROOT": root, "COPY": copy})
    sys.exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))
