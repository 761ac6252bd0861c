"""Announce compilations by the function ``announce``: by default on stderr, if it is a terminal's or a notebook's."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from threading import Timer

#: Seconds after which a compilation is announced; what is in the cache loads sooner.
PATIENCE = 0.5
#: Set in the environment, it stops announcements; the command line, which has its own, and the documentation do.
QUIET = "PHASEBENCH_QUIET"

_open: list[str] = []


@contextmanager
def on_stderr(what: str) -> Iterator[None]:
    """Write a message while the work takes long; a terminal's line is erased at its end, a notebook keeps it."""
    terminal, notebook = sys.stderr.isatty(), type(sys.stderr).__module__ == "ipykernel.iostream"
    if _open or QUIET in os.environ or not (terminal or notebook):
        yield
        return

    def show() -> None:
        _open.append(what)
        print(what, end="" if terminal else "\n", file=sys.stderr, flush=True)

    timer = Timer(PATIENCE, show)
    timer.daemon = True
    timer.start()
    _open.append(what)
    try:
        yield
    finally:
        timer.cancel()
        if len(_open) > 1 and terminal:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
        _open.clear()


#: Maps a message to the context that is open while the work is done.
announce: Callable[[str], AbstractContextManager] = on_stderr


def compiling(what: str, d: int) -> AbstractContextManager:
    """Return a context manager that announces the compilation of ``what`` for d degrees of freedom."""
    return announce(f"compiling {what} for d = {d} ...")
