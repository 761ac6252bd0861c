"""Where a compilation announces itself: nowhere, unless somebody who watches sets `announce`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

#: What is being done -> what is entered while it is done.  The command line shows it on a terminal.
announce: Callable[[str], AbstractContextManager] = nullcontext


def compiling(what: str, d: int) -> AbstractContextManager:
    """The context in which ``what`` is compiled for d degrees of freedom."""
    return announce(f"compiling {what} for d = {d} ...")
