"""Distinguishes compilation errors from all others, so that a method that does not compile is reported by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from .integrator import OURS

#: Packages that compile; an error raised in or below one of them is a compilation error.
COMPILERS = (
    *("numba", "llvmlite", "phasebench.integrators.compile", "phasebench.integrators.values"),
    *(f"phasebench.integrators.stepping.{module}" for module in ("kernel", "packed_call", "orbit_lanes")),
)
#: Largest number of characters of a reason.
LONGEST = 200
#: Status of the row of an integrator that does not compile.
FAILED = "failed"


class Failed(NamedTuple):
    """An integrator (its name) that does not compile, and why: type and first line of the error."""

    integrator: str
    why: str


def compilation_error(error: BaseException) -> str | None:
    """Return type and first line of an error that was raised while compiling; None for any other error."""
    if not any(_compiles(name) for name in _modules(error)):
        return None
    first = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
    return f"{type(error).__name__}: {first}"[:LONGEST].rstrip(": ")


class NotCompiled(Exception):
    """The error of an integrator whose kernel Numba does not compile; names it and the compiler's reason."""

    def __init__(self, failed: Failed) -> None:
        super().__init__(f"{failed.integrator} does not compile: {failed.why}")
        self.failed = failed


@contextmanager
def naming(integrator: str) -> Iterator[None]:
    """A context manager: a compilation error inside becomes a `NotCompiled` that names the integrator."""
    try:
        yield
    except Exception as error:
        why = compilation_error(error)
        if why is None:
            raise
        raise NotCompiled(Failed(integrator, why)) from error


def _modules(error: BaseException) -> Iterator[str]:
    """Yield the names of the modules in an error's traceback."""
    frame = error.__traceback__
    while frame is not None:
        yield frame.tb_frame.f_globals.get("__name__", "")
        frame = frame.tb_next


def _compiles(name: str) -> bool:
    return any(name == compiler or name.startswith(f"{compiler}.") for compiler in COMPILERS)


def row_failures(rows: Sequence[Mapping[str, Any]]) -> tuple[list[dict[str, str]], str]:
    """Return (a dict of ``integrator`` and ``why`` for each that does not compile, a sentence) from rows of results."""
    failed = [Failed(r["id"], r["reason"]) for r in rows if r["status"] == FAILED]
    own = [r["status"] for r in rows if r["kind"] == OURS]
    return [f._asdict() for f in failed], failure_summary(failed, bool(own) and set(own) == {FAILED})


def failure_summary(failed: Sequence[Failed], all_own: bool) -> str:
    """Return a sentence on what does not compile, with the first reason, or ""; ``all_own``: no own method does."""
    if not failed:
        return ""
    names = list(dict.fromkeys(f.integrator for f in failed))
    text = f"{', '.join(names)} failed to compile"
    if all_own:
        text = f"None of this project's methods that were tried compiles ({', '.join(names)})"
    return f"{text}: {failed[0].why}"


__all__ = ["FAILED", "Failed", "NotCompiled", "compilation_error", "failure_summary", "naming", "row_failures"]
