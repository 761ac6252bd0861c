"""Lazy imports: SymPy, mpmath and gmpy2, which not every process needs, and packages' public names."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType


class LazyModule(ModuleType):
    """A stand-in for a package that imports it when an attribute is first read."""

    def __getattr__(self, name: str) -> object:
        value = getattr(importlib.import_module(self.__name__), name)
        setattr(self, name, value)
        return value


#: True for a type checker; here by hand because the module typing takes long to import.
TYPE_CHECKING = False

if TYPE_CHECKING:
    import gmpy2 as gmpy2
    import mpmath as mpmath
    import sympy as sympy
else:
    gmpy2, mpmath, sympy = map(LazyModule, ("gmpy2", "mpmath", "sympy"))


def attributes(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """Return a package's ``__getattr__`` that imports each public name when it is first read.

    ``homes`` maps each name to the module of the package that defines it.
    """

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = getattr(importlib.import_module(f".{homes[name]}", package), name)
        setattr(sys.modules[package], name, value)
        return value

    return attribute
