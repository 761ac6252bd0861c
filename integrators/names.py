"""A tuple of objects that can also be indexed by their ids (`Records`), and usual names of methods with their ids."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, SupportsIndex, TypeVar, overload

from .errors import InvalidInput, unknown_name

T = TypeVar("T")


@cache
def aliases() -> dict[str, list[str]]:
    """A name of the field, in small letters and digits alone -> ids of the methods that it may mean."""
    return tomllib.loads(Path(__file__).with_name("aliases.toml").read_text(encoding="utf-8"))


def normalize(name: str) -> str:
    """The name in lower case without accents, letters and digits only, for comparison."""
    import unicodedata

    letters = unicodedata.normalize("NFKD", name).casefold()
    return "".join(c for c in letters if c.isascii() and c.isalnum())


def unknown_method(name: str, known: Iterable[str], kind: str = "method") -> InvalidInput:
    """Make the error for an unknown method; its message lists the ids that the name may stand for, or the nearest ids.

    ``known`` are the known ids; usual names, such as "leapfrog", are looked up in `aliases`.
    """
    known = list(known)
    wanted = normalize(name)
    meant = [id for id in known if normalize(id) == wanted]
    meant += [id for id in aliases().get(wanted, ()) if id in known and id not in meant]
    if not meant:
        return unknown_name(kind, name, known)
    return InvalidInput(f"there is no {kind} '{name}'; did you mean {' or '.join(meant)}?")


class Records(tuple[T, ...]):
    """A tuple of records (objects with an ``id``, such as methods): ``records["rk4"]`` is the record with that id.

    ``"rk4" in records`` tells whether there is one.
    """

    _find: Callable[[Any], T]

    @classmethod
    def of(cls, records: Iterable[T], find: Callable[[Any], T]) -> Records[T]:
        """Make the tuple of ``records``; ``find(id)`` returns a record, or raises InvalidInput for an unknown id."""
        made = cls(records)
        made._find = find
        return made

    @overload  # type: ignore[override]
    def __getitem__(self, key: SupportsIndex | str) -> T: ...
    @overload
    def __getitem__(self, key: slice) -> tuple[T, ...]: ...
    def __getitem__(self, key: SupportsIndex | slice | str) -> T | tuple[T, ...]:
        """The record at a position or with an id; for a slice, a part of the tuple."""
        return self._find(key) if isinstance(key, str) else super().__getitem__(key)

    def __contains__(self, key: object) -> bool:
        """True if ``key``, a record or the id of a record, is in the tuple."""
        return any(getattr(r, "id", None) == key for r in self) if isinstance(key, str) else super().__contains__(key)
