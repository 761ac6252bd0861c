"""Whether other processes still run, as /proc tells."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

#: Marks tests that ask whether another process runs.
needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to look into")


def runs(pid: int) -> bool:
    """True if a process with this id runs; False for a zombie."""
    state = Path(f"/proc/{pid}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z"


def ends(pid: int, seconds: float = 5.0) -> bool:
    """Wait until the process with this id ends, for at most so many seconds; True if it has ended."""
    last = time.monotonic() + seconds
    while runs(pid) and time.monotonic() < last:
        time.sleep(0.05)
    return not runs(pid)
