"""The floating-point environment of the process: what a package changes in it, and taking that back.

A library compiled for speed may switch the processor to flushing numbers below 2^-1022 to zero, and leave it so: all
that the process computes afterwards is in that mode, whoever computes it.  REBOUND's WHFast512 does (5.2.2).
"""

from __future__ import annotations

import contextlib
import ctypes
import struct
from collections.abc import Callable, Iterator
from functools import cache, wraps

#: 2^-1074 by its bits, since a process that flushes cannot compute it; and a 0 that no compiler sees.
(LEAST,) = struct.unpack("<d", (1).to_bytes(8, "little"))
ZERO = float("0")
#: Bytes that hold the environment of any C library (32 of the GNU one on x86-64).
ROOM = 512


@cache
def _library():
    """The C library with fegetenv and fesetenv; None where there is none with both."""
    try:
        library = ctypes.CDLL(None)
        library.fegetenv, library.fesetenv  # noqa: B018
    except (OSError, TypeError, AttributeError):
        return None
    return library


def gradual() -> bool:
    """Whether the least number, 2^-1074, survives an addition: underflow is gradual, as IEEE 754 has it."""
    return struct.pack("<d", LEAST + ZERO) == struct.pack("<d", LEAST) and LEAST != ZERO


@contextlib.contextmanager
def kept() -> Iterator[None]:
    """Leave the environment (modes, rounding, flags) of this thread as it was before, whatever that was."""
    library = _library()
    if library is None:
        yield
        return
    before = ctypes.create_string_buffer(ROOM)
    library.fegetenv(before)
    try:
        yield
    finally:
        library.fesetenv(before)


def keeping(call: Callable) -> Callable:
    """The call, which leaves the environment of its thread as it was before."""

    @wraps(call)
    def kept_call(*arguments):
        with kept():
            return call(*arguments)

    return kept_call
