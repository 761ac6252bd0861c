"""Switch the processor to flush denormal numbers to zero, as libraries compiled for speed may do."""

from __future__ import annotations

import ctypes
import platform
import sys

import pytest

from phasebench.reference.peers import floating

#: Offset of the MXCSR register in fenv_t of the GNU C library on x86-64, and its bits DAZ and FTZ.
OFFSET, BITS = 28, 0x8040

only_there = pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="where the mode stands is known of x86-64 alone"
)


def flush(on: bool = True) -> None:
    """Switch on or off that the processor flushes denormal numbers to zero."""
    library = ctypes.CDLL(None)
    environment = ctypes.create_string_buffer(floating.ROOM)
    library.fegetenv(environment)
    mode = ctypes.c_uint32.from_buffer(environment, OFFSET)
    mode.value = mode.value | BITS if on else mode.value & ~BITS
    library.fesetenv(environment)
