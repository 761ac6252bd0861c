"""The machine of a measurement: processor, operating system and package versions."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from functools import cache
from pathlib import Path

from phasebench.reference.installed import version_of

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "sympy", "mpmath", "heyoka", "rebound", "pandas", "matplotlib")


@cache
def versions() -> dict[str, str]:
    """Versions of this project, Python and the packages that results may depend on; "absent" if not installed."""
    packages = ("phasebench", *PACKAGES)
    return {"python": platform.python_version()} | {name: version_of(name) or "absent" for name in packages}


@cache
def processor() -> str:
    """The processor's name, as the operating system reports it."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


@cache
def machine() -> str:
    """The name of this machine, "a/b": a is a short hash of the hardware, b one of the package versions."""
    hardware = f"{processor()}|{os.cpu_count()}|{platform.system()}|{platform.machine()}"
    return "/".join(hashlib.sha256(x.encode()).hexdigest()[:6] for x in (hardware, repr(sorted(versions().items()))))


@cache
def commit() -> str:
    """The commit of this project's sources, short, with "+" if they differ from it; "" outside of its repository."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")) != ROOT:
            return ""
        edited = git("status", "--porcelain", "--untracked-files=no", "--", "*.py")
        return git("rev-parse", "--short=8", "HEAD") + ("+" if edited else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def same_hardware(a: str, b: str) -> bool:
    """True if two names from `machine` have the same hardware."""
    return a.partition("/")[0] == b.partition("/")[0]


def summary() -> dict[str, str]:
    """Texts for reports: the processor with its cores (``processor``), the ``system``, and package ``versions``."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.machine()}",
        "versions": ", ".join(f"{k} {v}" for k, v in versions().items()),
    }
