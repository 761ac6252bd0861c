"""Problems from the cache: with shells for their systems (`integrators.systems.deferred`), SymPy is not needed."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from phasebench.integrators.engine import cache as store
from phasebench.integrators.systems import deferred

from .base import Problem


@cache
def _sources() -> str:
    """The hash of all modules of problems."""
    folder = Path(__file__).parent
    return deferred.key_of(*(path.read_bytes() for path in sorted(folder.glob("**/*.py"))))


def whole(id: str, parameters: Mapping[str, float], make: Callable[[], Problem]) -> Problem:
    """The registered problem ``id`` with values for its parameters, which ``make`` would make."""
    return of_key(deferred.key_of(_sources(), id, sorted(parameters.items())), partial(_again, id, parameters), make)


def of_content(content: tuple, recipe: Callable[[], Problem], make: Callable[[], Problem]) -> Problem:
    """The problem that a module here makes of some content; as `of_key`."""
    return of_key(deferred.key_of(_sources(), content), recipe, make)


def of_key(key: str, recipe: Callable[[], Problem], make: Callable[[], Problem]) -> Problem:
    """The problem of that key, from the cache; or as ``make`` makes it, and kept.

    ``recipe`` makes it again in any process.
    """
    entry = f"p-{key}.pickle"
    found = deferred.kept(entry)
    if found is not None:
        return found
    made = make()
    if not made.system.loops:
        shell = deferred.shell(made.system, key, partial(_system, recipe))
        invariants = deferred.Named(made.invariants, partial(_invariants, recipe))
        store.write(entry, pickle.dumps(replace(made, system=shell, invariants=invariants)))
    return made


def _again(id: str, parameters: Mapping[str, float]) -> Problem:
    from . import _derived

    return _derived(id, **parameters)


def _system(recipe: Callable[[], Problem]):
    return recipe().system


def _invariants(recipe: Callable[[], Problem]) -> Mapping:
    return recipe().invariants
