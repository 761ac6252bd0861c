"""Replace the code of functions in place, so that every module that has imported them runs the changed code."""

from __future__ import annotations

import gc
import inspect
from types import CodeType, FunctionType

Place = tuple[str, int]


def swaps(old: CodeType, new: CodeType) -> list[tuple[Place, CodeType]] | None:
    """[(place, new code)] of the changed functions of a module; None if code that runs at import has changed too."""
    before, after = _inner(old), _inner(new)
    if _itself(old) != _itself(new) or len(before) != len(after):
        return None
    found: list[tuple[Place, CodeType]] = []
    for a, b in zip(before, after, strict=True):
        if a == b:
            continue
        if a.co_flags & inspect.CO_NEWLOCALS:
            if a.co_freevars != b.co_freevars:
                return None
            found.append((place(a), b))
        else:
            body = swaps(a, b)
            if body is None:
                return None
            found += body
    return found


def place(code: CodeType) -> Place:
    """(qualified name, first line): identifies a function within its file."""
    return code.co_qualname, code.co_firstlineno


def _inner(code: CodeType) -> list[CodeType]:
    return [constant for constant in code.co_consts if isinstance(constant, CodeType)]


def _itself(code: CodeType) -> tuple:
    """The code of a module or class itself, without that of its functions."""
    return code.co_code, code.co_names, [repr(c) for c in code.co_consts if not isinstance(c, CodeType)]


def functions(file: str) -> dict[Place, list[FunctionType]]:
    """Place -> the function objects in this process that come from a file."""
    found: dict[Place, list[FunctionType]] = {}
    for thing in gc.get_objects():
        if type(thing) is FunctionType and thing.__code__.co_filename == file:
            found.setdefault(place(thing.__code__), []).append(thing)
    return found
