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


def load_or_make(content: tuple, recipe: Callable[[], Problem]) -> Problem:
    """Return the problem that ``content`` determines from the cache on disk; if it is not there, make and store it.

    ``recipe`` makes it and can be pickled: it is stored with the problem, and called when one from the cache needs its
    formulae.  A problem whose system runs on hand-written loops is not stored.
    """
    key = deferred.key_of(PROBLEMS, *content)
    entry = f"p-{key}.pickle"
    found = deferred.load(entry)
    if found is not None:
        return found
    made = recipe()
    if not made.system.loops:
        shell = deferred.shell(made.system, key, partial(_system, recipe))
        invariants = deferred.Named(made.invariants, partial(_invariants, recipe))
        store.write(entry, pickle.dumps(replace(made, system=shell, invariants=invariants)))
    return made


def _system(recipe: Callable[[], Problem]) -> PartitionedSystem:
    return recipe().system


def _invariants(recipe: Callable[[], Problem]) -> Mapping:
    return recipe().invariants
