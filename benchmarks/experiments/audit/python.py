"""Detect packages that the running Python is too old for, so that their rows, stored with a newer Python, are kept."""

from __future__ import annotations

from phasebench.benchmarks.store.cells import Unavailable
from phasebench.reference.peers import PEERS
from phasebench.reference.peers.record import older_python


def require(package: str) -> None:
    """Raise Unavailable if a package cannot be installed for this Python; do nothing if it is merely not installed."""
    why = older_python(next((p.python for p in PEERS if p.package == package), None))
    if why is not None:
        raise Unavailable(f"{package}: {why}")
