"""Ctrl-C stays with Python: some packages' C code takes the process's handler of it, and keeps it.

REBOUND's `integrate` (5.2.2) and galpy's C code do.  A later Ctrl-C would then reach no Python code of the process.
"""

from __future__ import annotations

import ctypes
import signal

#: A plain number: making one of an enumeration at each call would cost a microsecond.
_SIGINT = int(signal.SIGINT)
_get, _put = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig
_get.restype = _put.restype = ctypes.c_void_p
_get.argtypes, _put.argtypes = (ctypes.c_int,), (ctypes.c_int, ctypes.c_void_p)


def handler() -> int | None:
    """The address of the function that an interrupt calls."""
    return _get(_SIGINT)


def put_back(before: int | None) -> None:
    """Let interrupts call the function again that they called ``before``."""
    _put(_SIGINT, before)
