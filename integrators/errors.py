"""The one exception for input that cannot be used."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InvalidInput(ValueError):
    """Input that names nothing known or cannot be integrated; the message says what was wrong and what to do."""


def unknown(kind: str, name: str, known: Iterable[str]) -> InvalidInput:
    """The error for an unknown name, with the nearest known ones."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=8, cutoff=0.6)
    hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(known)}"
    return InvalidInput(f"there is no {kind} '{name}'; {hint}")
