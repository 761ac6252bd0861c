"""On what it was measured: processor, system and versions."""

from __future__ import annotations

import hashlib
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


@cache
def machine() -> str:
    """A short name of the hardware, and after a slash of the versions that it was measured with."""
    hardware = f"{processor()}|{os.cpu_count()}|{platform.system()}|{platform.machine()}"
    return "/".join(hashlib.sha256(x.encode()).hexdigest()[:6] for x in (hardware, repr(sorted(versions().items()))))


def same_hardware(a: str, b: str) -> bool:
    """Whether two of `machine` have the same hardware."""
    return a.partition("/")[0] == b.partition("/")[0]


def summary() -> dict[str, str]:
    """What a report says of the machine."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.machine()}",
        "versions": ", ".join(f"{k} {v}" for k, v in versions().items()),
    }
