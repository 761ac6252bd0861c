"""`kinds`: of each family one method for each pattern of its data; methods of a kind differ in their numbers alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from phasebench.benchmarks.measure.battery import by_label, variants
from phasebench.integrators.record import Method
from phasebench.integrators.registry import METHODS

#: Family -> its first method.
FIRST = {m.family: m for m in reversed(METHODS)}


def pattern(data: Any) -> Any:
    """What decides which code runs on the data of a record: its texts, parities, and which numbers vanish."""
    if isinstance(data, (str, bool)):
        return data
    if isinstance(data, (tuple, list)):
        parts = [pattern(x) for x in data]
        size = len(parts) if len(parts) < 2 else 2 + len(parts) % 2
        if parts and set(parts) <= {"zero", "one", "number"}:
            return size, parts[0] == "zero", parts[-1] == "zero", "zero" in parts
        return size, frozenset(parts)
    if callable(data):
        return "function"
    return "zero" if data == 0 else "one" if isinstance(data, int) and data == 1 else "number"


def kind(m: Method) -> tuple:
    """The kind of a method: its family, what it requires and declares, and the pattern of its data."""
    declared = m.symmetric, m.symplectic, m.energy, m.quadratic, m.one_step
    return m.family, frozenset(m.requires), declared, pattern(m.data)


def kinds(methods: Iterable[Method] | None = None) -> dict[str, Method]:
    """Label -> method: the first of each kind among the methods, by default all with their usual parameters."""
    first: dict[tuple, Method] = {}
    for m in variants() if methods is None else methods:
        first.setdefault(kind(m), m)
    return by_label(first.values())
