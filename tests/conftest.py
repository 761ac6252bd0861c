"""Fixtures of the suite: measurements of a process in which nothing is compiled."""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


@functools.cache
def _uncompiled(script: str, *arguments: str):
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, str(HERE / script), *arguments]
    done = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{script} {' '.join(arguments)} failed:\n{done.stderr}"
    return json.loads(done.stdout.splitlines()[-1])["result"]


@pytest.fixture(scope="session")
def uncompiled():
    """(script, arguments) -> the result that it prints, measured once a session with NUMBA_DISABLE_JIT=1."""
    return _uncompiled


@pytest.fixture(scope="session")
def measured():
    """Name -> the measurement of that name in multiprecision.py."""
    return functools.partial(_uncompiled, "multiprecision.py")
