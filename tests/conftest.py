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
    # The failure is kept as well: hundreds of tests would wait for it again.
    return json.loads(done.stdout.splitlines()[-1])["result"] if done.returncode == 0 else done.stderr


def _result(script: str, *arguments: str):
    result = _uncompiled(script, *arguments)
    assert not isinstance(result, str), f"{script} {' '.join(arguments)} failed:\n{result}"
    return result


@pytest.fixture(scope="session")
def uncompiled():
    """(script, arguments) -> the result that it prints, measured once a session with NUMBA_DISABLE_JIT=1."""
    return _result


@pytest.fixture(scope="session")
def measured():
    """Name -> the measurement of that name in multiprecision.py."""
    return functools.partial(_result, "multiprecision.py")
