"""Compilations are announced where somebody looks, once, and only if they take long."""

from __future__ import annotations

import io
import time

import pytest

from phasebench.integrators.compile import progress


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self):
        return True


#: What a notebook puts in the place of stderr.
Notebook = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})


def written(stream, monkeypatch, seconds=0.1, quiet=False):
    """What is written to ``stream`` as stderr by a compilation within a compilation of so many seconds."""
    monkeypatch.setattr(progress, "PATIENCE", 0.02)
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.delenv(progress.QUIET, raising=False)
    if quiet:
        monkeypatch.setenv(progress.QUIET, "1")
    with progress.on_stderr("compiling one ..."), progress.on_stderr("compiling another ..."):
        time.sleep(seconds)
    return stream.getvalue()


def test_a_terminal_shows_the_outer_compilation_and_erases_it(monkeypatch):
    assert written(Terminal(), monkeypatch) == "compiling one ...\r\033[K"


def test_a_notebook_keeps_it(monkeypatch):
    assert written(Notebook(), monkeypatch) == "compiling one ...\n"


@pytest.mark.parametrize(
    ("stream", "options"), [(io.StringIO, {}), (Terminal, {"seconds": 0.0}), (Terminal, {"quiet": True})]
)
def test_nothing_is_written_to_files_for_short_work_or_on_request(stream, options, monkeypatch):
    assert written(stream(), monkeypatch, **options) == ""
