"""All studies, found by their files: `STUDY` of a module or a package, or `STUDIES` where one has several pages."""

from __future__ import annotations

import functools
import pkgutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from phasebench.benchmarks.page.study import Study


@functools.cache
def found() -> dict[str, Study]:
    """Id -> study, in the order of the report."""
    names = [m.name for m in pkgutil.iter_modules([str(Path(__file__).parent)]) if not m.name.startswith("bench_")]
    modules = [import_module(f"{__package__}.{name}") for name in names]
    of = [(m, s) for m in modules for s in getattr(m, "STUDIES", [m.STUDY] if hasattr(m, "STUDY") else [])]
    studies = [replace(s, module=m.__name__) for m, s in of]
    return {s.id: s for s in sorted(studies, key=lambda s: (s.place, s.id))}
