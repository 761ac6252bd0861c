"""On what it was measured: processor, system and versions."""

from __future__ import annotations

import os
import platform
from functools import cache
from pathlib import Path

from phasebench.reference.tables import version_of

PACKAGES = ("numpy", "scipy", "numba", "sympy", "mpmath", "heyoka", "rebound", "pandas", "matplotlib")


@cache
def versions() -> dict[str, str]:
    """Versions of this project, Python and the packages that a number may depend on."""
    packages = ("phasebench", *PACKAGES)
    return {"python": platform.python_version()} | {name: version_of(name) or "absent" for name in packages}


@cache
def processor() -> str:
    """The processor's name as the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def summary() -> dict[str, str]:
    """What a report says of the machine."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.machine()}",
        "versions": ", ".join(f"{k} {v}" for k, v in versions().items()),
    }
