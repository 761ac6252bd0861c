"""The floating-point environment of the process: detects and undoes a change that a package makes.

A library compiled for speed may switch the processor to flush numbers below 2^-1022 to zero and leave it so, which then
affects all later computations of the process.  REBOUND's WHFast512 does (5.2.2).
"""

from __future__ import annotations

import contextlib
import ctypes
import struct
from collections.abc import Iterator
from functools import cache

#: 2^-1074 from its bits, since a process that flushes cannot compute it; and a 0 that no compiler can fold.
(LEAST,) = struct.unpack("<d", (1).to_bytes(8, "little"))
ZERO = float("0")
#: Enough bytes for the environment of any C library (32 in GNU's on x86-64).
ROOM = 512


@cache
def _library() -> ctypes.CDLL | None:
    """The C library, if it has fegetenv and fesetenv; else None."""
    try:
        library = ctypes.CDLL(None)
        library.fegetenv, library.fesetenv  # noqa: B018
    except (OSError, TypeError, AttributeError):
        return None
    return library


def gradual() -> bool:
    """True if the smallest number, 2^-1074, survives an addition: underflow is gradual, as in IEEE 754."""
    return struct.pack("<d", LEAST + ZERO) == struct.pack("<d", LEAST) and LEAST != ZERO


@contextlib.contextmanager
def restore_environment() -> Iterator[None]:
    """A context, or decorator, that restores this thread's floating-point environment (modes, rounding, flags)."""
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
