"""What is imported when it is first asked for: SymPy (what is in the cache needs none of it), and public names."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType


class Lazily(ModuleType):
    """A package's stand-in, which imports it at the first attribute."""

    def __getattr__(self, name: str):
        value = getattr(importlib.import_module(self.__name__), name)
        setattr(self, name, value)
        return value


sympy = Lazily("sympy")


def attributes(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """The ``__getattr__`` of a package whose public names come from modules in it, ``homes``, each loaded for them."""

    def attribute(name: str):
        if name not in homes:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        value = getattr(importlib.import_module(f".{homes[name]}", package), name)
        setattr(sys.modules[package], name, value)
        return value

    return attribute
