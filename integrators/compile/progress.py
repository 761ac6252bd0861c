"""Announce compilations by the function ``announce``, which does nothing unless a caller has replaced it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

#: Maps a message to the context that is open while the work is done; the command line shows the message on a terminal.
announce: Callable[[str], AbstractContextManager] = nullcontext


def compiling(what: str, d: int) -> AbstractContextManager:
    """Return a context manager that announces the compilation of ``what`` for d degrees of freedom."""
    return announce(f"compiling {what} for d = {d} ...")
