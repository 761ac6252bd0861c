"""Runs commands that were advised, in a process that has seen nothing of the advice."""

from __future__ import annotations

import json
import subprocess
import sys

#: The process: the words after the program's name, line for line, go to the installed command.
SCRIPT = """
import json, shlex, sys
from contextlib import suppress
from phasebench.benchmarks.cli import app

for line in json.loads(sys.stdin.read()):
    program, *arguments = shlex.split(line)
    assert program == "phasebench", line
    with suppress(SystemExit):
        app([*arguments, "--json"], standalone_mode=False)
    sys.stdout.flush()
"""


def rerun(lines: list[str]) -> list[dict]:
    """The JSON objects that the commands print, run in one fresh process."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=json.dumps(lines), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"the rerun failed:\n{done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def error_of(printed: dict) -> float | None:
    """The error that ``integrate`` printed: of the quantity that was asked for, or of the end."""
    found = printed.get("quantity_error")
    return found["error"] if found else printed.get("global_error")
