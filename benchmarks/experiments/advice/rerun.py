"""Run advised commands again, in a fresh process that shares nothing with the search for the advice."""

from __future__ import annotations

import json
import subprocess
import sys

#: Source of that process: it passes the arguments of each command line to the command-line application.
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
    """Run command lines in one fresh process and return the JSON objects that they print; RuntimeError if it fails."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], input=json.dumps(lines), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"the rerun failed:\n{done.stderr}")
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def error_of(printed: dict) -> float | None:
    """Return the error in the JSON object ``printed`` by the command ``integrate``.

    It is the error of the requested quantity if one was requested, else that of the end state; None without either.
    """
    found = printed.get("quantity_error")
    return found["error"] if found else printed.get("global_error")
