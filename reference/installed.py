"""Versions of installed packages, and how the others are installed."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from .native import LIBRARIES, library_version


@cache
def version_of(package: str) -> str | None:
    """The installed version of a package, or of a library of headers; None if it is not installed."""
    if package in LIBRARIES:
        return library_version(package)
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def is_installed(package: str) -> bool:
    """Whether a package can be imported, or a library of headers and a compiler for it are there."""
    if package in LIBRARIES:
        return library_version(package) is not None
    try:
        return find_spec(package) is not None
    except ValueError:  # the package was removed from the imported modules
        return False


def how_to_install(package: str) -> str:
    """The command that installs a package."""
    return LIBRARIES[package].install if package in LIBRARIES else f"pip install {package}"
