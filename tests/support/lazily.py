"""Multiprecision measurements in this process, which compiles nothing; each number is measured on first access."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from phasebench.benchmarks.measure import multiprecision
from phasebench.integrators.compile.codegen import precision

from .exact import ALL, measurements, systems_for


class Lazily(Mapping):
    """A mapping with fixed keys that computes each value on first access."""

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


def lazy_measurements(what: str) -> Mapping:
    """Return the results of the multiprecision measurement ``what``, {method's label: {system: value}}.

    Each value is computed on first access, if the measurement is made system by system.
    """
    if what not in multiprecision.CELLS:
        with precision(multiprecision.DIGITS):
            return measurements(what)

    def of(label: str) -> Lazily:
        return Lazily(systems_for(what, label), lambda name: multiprecision.measure(what, label, name))

    return Lazily(ALL, of)
