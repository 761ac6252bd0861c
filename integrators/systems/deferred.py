"""Stand-ins for systems, so that SymPy is not loaded where all that a run needs of a system is in the cache.

A system that is made from text, or by code whose hash is known, has a *key*, the hash of that text or code.  The cache
keeps, under the key, what the system is asked for (its traits, the text of its functions), and a *shell* of it: an
object of its class that knows the number of degrees of freedom, its key and its recipe.  Whatever else is asked of a
shell, such as H itself, has the recipe make the system, of which the shell then takes everything.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from phasebench.integrators.compile import cache

#: What a shell knows of its system.
FACTS = ("d", "content", "has_energy", "singularities")


def key_of(*parts: object) -> str:
    """A hash that identifies what is made from these parts, by their text."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


def shell(system, key: str, recipe: Callable[[], Any]):
    """Make the stand-in of a system: it holds a few facts, and makes the system by ``recipe`` when more is needed.

    The system gets the key, too; ``recipe`` can be pickled.
    """
    system.key = key
    out = type(system).__new__(type(system))
    vars(out).update({name: getattr(system, name) for name in FACTS}, key=key, _functions={}, _recipe=recipe)
    out._waiting = frozenset(vars(system)) - {*vars(out)}
    return out


def complete(system, name: str) -> bool:
    """Turn a stand-in into the whole system if that has an attribute ``name``; True if the attribute is there now."""
    own = vars(system)
    recipe = own.get("_recipe")
    if recipe is None or name not in own.get("_waiting", ()):
        return name in own  # where another thread was faster
    own.update({known: value for known, value in vars(recipe()).items() if known not in ("key", "_functions")})
    own.pop("_recipe", None)
    return True


def load(name: str):
    """The object pickled under a name in the cache, or None if there is none that can be read."""
    content = cache.read(name)
    try:
        return None if content is None else pickle.loads(content)
    except Exception:  # whatever it is, making it anew is the cure
        cache.forget(name)
        return None


def system(key: str, recipe: Callable[[], Any]):
    """The system with the key: a stand-in from the cache, or made by ``recipe``, in which case a stand-in is cached."""
    entry = f"s-{key}.pickle"
    found = load(entry)
    if found is None:
        found = recipe()
        cache.write(entry, pickle.dumps(shell(found, key, recipe)))
    return found


class Named(Mapping):
    """A mapping whose names are known, and whose values ``recipe()`` makes when one is read."""

    def __init__(self, names, recipe: Callable[[], Mapping]):
        self._names, self._recipe = tuple(names), recipe

    def __getitem__(self, name):
        if name not in self._names:
            raise KeyError(name)
        return self._recipe()[name]

    def __iter__(self) -> Iterator:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
