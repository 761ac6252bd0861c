"""Measurements without round-off in this process, where it compiles nothing: each cell when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from phasebench.benchmarks.measure import multiprecision
from phasebench.integrators.engine.codegen import precision

from .exact import ALL, chosen, measurements


class Lazily(Mapping):
    """A mapping of known keys, each value of which is made when it is first asked for."""

    def __init__(self, keys: Iterable[str], make: Callable[[str], object]):
        self._keys, self._make, self._made = tuple(keys), make, {}

    def __getitem__(self, key: str):
        if key not in self._keys:
            raise KeyError(key)
        if key not in self._made:
            self._made[key] = self._make(key)
        return self._made[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


def measured(what: str) -> Mapping:
    """What `exact.measurements` would return."""
    if what not in multiprecision.CELLS:
        with precision(multiprecision.DIGITS):
            return measurements(what)

    def of(label: str) -> Lazily:
        return Lazily(chosen(what, label), lambda name: multiprecision.measure(what, label, name))

    return Lazily(ALL, of)
