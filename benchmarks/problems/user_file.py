"""Load a user's Python file as a module; errors in the file are reported with their line."""

from __future__ import annotations

import contextlib
import hashlib
import sys
import traceback
import types
from collections.abc import Iterator
from pathlib import Path

from phasebench.integrators.errors import InvalidInput

#: How the names of files end, by which users name what is theirs.
SUFFIXES = (".py", ".csv", ".json")


def is_file(name: str) -> bool:
    """True if a user's name of a problem or method is a path (by a slash, its ending, mine.py:object), not an id."""
    return file_and_object(name)[0].lower().endswith(SUFFIXES) or "/" in name or "\\" in name


def file_and_object(name: str) -> tuple[str, str]:
    """Split ``./mine.py:object.attribute`` into path and object, "" if none; a drive's colon is part of the path."""
    head, _, tail = name.rpartition(":")
    return (head, tail) if head.lower().endswith(".py") else (name, "")


def load(path: str, what: str = "problem") -> types.ModuleType:
    """Load a user's Python file as a module, once in a process unless its text changes.

    ``what``, which the file defines ("problem" or "method"), is for messages.  Imports relative to the package of
    problems work in it.  Raises InvalidInput for a file that cannot be read or that raises, naming its line.
    """
    file = Path(path)
    if file.is_dir():
        raise InvalidInput(f"{path} is a directory; a {what} is a Python file in it")
    if not file.exists():
        raise InvalidInput(f"there is no file {path}; names of registered {what}s have neither a slash nor .py")
    if file.suffix.lower() != ".py":
        raise InvalidInput(f"{path} is no Python file: the name of a {what}'s file ends in .py")
    try:
        text = file.read_bytes()
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from None
    # Named by its text too: what an earlier load defined can be pickled after the file was loaded again.
    name = f"{__package__}.user_{hashlib.sha256(str(file.resolve()).encode() + text).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    module = types.ModuleType(name)
    module.__file__, module.__package__ = str(file.resolve()), __package__
    with users_code(path, "the file"):
        code = compile(text, path, "exec")
        sys.modules[name] = module  # dataclasses look up their module here
        try:
            exec(code, module.__dict__)
        except BaseException:
            del sys.modules[name]
            raise
    return module


@contextlib.contextmanager
def users_code(path: str, what: str) -> Iterator[None]:
    """Run code of a user's file ``path``: errors become InvalidInput with their line, and its prints go to stderr.

    ``what`` names the code if no line is known.
    """
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except (Exception, SystemExit) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == path]
        if isinstance(error, SyntaxError) and error.filename == path:
            lines.append(error.lineno)
        where = f"{path}, line {lines[-1]}" if lines and lines[-1] else f"{path}, {what}"
        said = error.msg if isinstance(error, SyntaxError) else error
        text = str(said) if isinstance(error, InvalidInput) else f"{type(error).__name__}: {said}"
        raise InvalidInput(f"{where}: {text}") from error
