"""Look up versions of installed packages, and the commands that install missing ones."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from .native import LIBRARIES, library_version


@cache
def version_of(package: str) -> str | None:
    """The installed version of a Python package, or of a C or C++ library; None if it is not installed."""
    if package in LIBRARIES:
        return library_version(package)
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def is_installed(package: str) -> bool:
    """True if a Python package can be imported, or a C or C++ library has its headers and a compiler here."""
    if package in LIBRARIES:
        return library_version(package) is not None
    try:
        return find_spec(package) is not None
    except ValueError:  # the package was removed from the imported modules
        return False


def how_to_install(package: str) -> str:
    """The shell command, as text, that installs a Python package or a C or C++ library."""
    return LIBRARIES[package].install if package in LIBRARIES else f"pip install {package}"
