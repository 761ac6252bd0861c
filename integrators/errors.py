"""`InvalidInput`, the exception for input that cannot be used, and its message for unknown names."""

from __future__ import annotations

from collections.abc import Iterable


class InvalidInput(ValueError):
    """Raised for unknown names and unusable input; the message says what was wrong and what to do."""


#: So many known names are told where none is near.
MANY = 20


def unknown_name(kind: str, name: str, known: Iterable[str]) -> InvalidInput:
    """Make the error for an unknown name of a ``kind`` of things, such as "method".

    Its message lists the nearest known names.
    """
    import difflib

    known = sorted(set(known))
    near = difflib.get_close_matches(name, known, n=8, cutoff=0.6)
    more = f" and {len(known) - MANY} more (`phasebench list`)" if len(known) > MANY else ""
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known[:MANY])}{more}"
    return InvalidInput(f"there is no {kind} '{name}'; {hint}")
