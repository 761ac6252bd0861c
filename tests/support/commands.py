"""Run commands of ``phasebench`` in the process of a test."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from typer.testing import CliRunner

from phasebench.benchmarks.cli import app


class Done(NamedTuple):
    """How a command ended: its exit code, its standard output and its standard error."""

    exit_code: int
    stdout: str
    stderr: str

    @property
    def output(self) -> str:
        """All that the command printed: its standard output, then its standard error."""
        return self.stdout + self.stderr

    @property
    def said(self) -> str:
        """Its standard error without line breaks."""
        return " ".join(self.stderr.split())


def call(*words: object, **environment: str) -> Done:
    """Run a command, given by its words, with these environment variables; an unexpected exception is raised."""
    done = CliRunner().invoke(app, [str(word) for word in words], env=environment)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return Done(done.exit_code, done.stdout, done.stderr)


def strict(text: str) -> Any:
    """Parse standard JSON, in which NaN and Infinity are errors."""

    def refuse(token: str):
        raise ValueError(f"{token} is not JSON")

    return json.loads(text, parse_constant=refuse)


def run_json(*words: object) -> tuple[int, Any]:
    """(exit code, JSON object) of ``integrate --json``, which must print exactly one line."""
    done = call("integrate", *words, "--json")
    assert done.stdout.count("\n") == 1
    return done.exit_code, strict(done.stdout)


def integrate_json(*words: object) -> Any:
    """The JSON object of ``integrate --json``, which must exit with 0."""
    code, found = run_json(*words)
    assert code == 0, found
    return found
