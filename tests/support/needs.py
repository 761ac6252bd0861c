"""Skip tests that need a package that is not installed."""

from __future__ import annotations

import pytest

from phasebench.reference.installed import how_to_install, is_installed


def need(package: str) -> None:
    """Skip the running test if the package or its headers are missing; the message says how to install it."""
    if not is_installed(package):
        pytest.skip(f"not here: {how_to_install(package)}")
