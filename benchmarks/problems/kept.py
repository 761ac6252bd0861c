"""A cache of problems on disk; a cached problem imports SymPy only when its formulae are used (`systems.deferred`)."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from phasebench.integrators.compile import cache as store
from phasebench.integrators.compile import digest
from phasebench.integrators.systems import deferred

from .base import Problem

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: The digest of the code of all problems, a part of every key of the cache.
PROBLEMS = digest.of_folder("benchmarks.problems")


def load_or_make(id: str, parameters: Mapping[str, float], make: Callable[[], Problem]) -> Problem:
    """Return the registered problem ``id`` from the cache on disk, or else from ``make``, and cache it.

    ``make`` takes no arguments and can be pickled.
    """
    return of_key(deferred.key_of(PROBLEMS, id, sorted(parameters.items())), make, make)


def of_content(content: tuple, recipe: Callable[[], Problem], make: Callable[[], Problem]) -> Problem:
    """Return the problem determined by ``content`` (such as a table of bodies), from the cache on disk or ``make``.

    ``recipe`` is a function that makes the same problem as ``make`` and can be pickled: it is stored with the problem,
    and called when a problem from the cache needs its formulae.
    """
    return of_key(deferred.key_of(PROBLEMS, content), recipe, make)


def of_key(key: str, recipe: Callable[[], Problem], make: Callable[[], Problem]) -> Problem:
    """Return the problem stored in the cache on disk under a key; if it is not there, call ``make`` and store it.

    A problem whose system runs on hand-written loops is not stored.

    ``recipe`` is a function that makes the same problem as ``make`` and can be pickled: it is stored with the problem,
    and called when a problem from the cache needs its formulae.
    """
    entry = f"p-{key}.pickle"
    found = deferred.load(entry)
    if found is not None:
        return found
    made = make()
    if not made.system.loops:
        shell = deferred.shell(made.system, key, partial(_system, recipe))
        invariants = deferred.Named(made.invariants, partial(_invariants, recipe))
        store.write(entry, pickle.dumps(replace(made, system=shell, invariants=invariants)))
    return made


def _system(recipe: Callable[[], Problem]) -> PartitionedSystem:
    return recipe().system


def _invariants(recipe: Callable[[], Problem]) -> Mapping:
    return recipe().invariants
