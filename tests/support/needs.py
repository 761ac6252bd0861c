"""Tests of packages that may be missing."""

from __future__ import annotations

import pytest

from phasebench.reference.installed import how_to_install, is_installed


def need(package: str) -> None:
    """Skip the test, with the command that installs the package, where it or its headers are missing."""
    if not is_installed(package):
        pytest.skip(f"not here: {how_to_install(package)}")
