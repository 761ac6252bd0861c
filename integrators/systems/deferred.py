"""Stand-ins for systems, so that SymPy is not loaded if all that a run needs of a system is in the cache.

A system that is made from text, or by code whose hash is known, has a *key*, the hash of that text or code.  Under the
key the cache stores the system's traits, the source text of its functions, and a stand-in, called its *shell*: an
object of the system's class that holds a few facts (`FACTS`, such as the number of degrees of freedom), the key, and
the *recipe*, a function that builds the system.  When another attribute of the shell is read, such as H, the recipe
builds the system, and the shell takes over all of its attributes (`complete`).
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from phasebench.integrators.compile import cache, digest

if TYPE_CHECKING:
    from .hamiltonian import PartitionedSystem

#: The attributes of its system that a shell holds.
FACTS = ("d", "content", "driven", "has_energy", "parameters", "singularities")


def key_of(*parts: object) -> str:
    """Return a hash, 24 hexadecimal digits, of the ``repr`` of the parts and of the code of systems.

    It identifies what that code makes from the parts.
    """
    return hashlib.sha256(repr((*parts, digest.of_folder("integrators.systems"))).encode()).hexdigest()[:24]


def shell(system: PartitionedSystem, key: str, recipe: Callable[[], Any]) -> PartitionedSystem:
    """Make the stand-in of a system: an object that holds its `FACTS` and calls ``recipe()`` when more is needed.

    Sets ``system.key`` to the key, too.  ``recipe`` builds the system; it must be picklable.
    """
    system.key = key
    out = type(system).__new__(type(system))
    vars(out).update({name: getattr(system, name) for name in FACTS}, key=key, _functions={}, _recipe=recipe)
    out._waiting = frozenset(vars(system)) - {*vars(out)}
    return out


def complete(system: PartitionedSystem, name: str) -> bool:
    """Build the system behind a stand-in when its attribute ``name`` is read, and copy its attributes to the stand-in.

    Returns True if the attribute is there now, False if the system has none of that name.
    """
    own = vars(system)
    recipe = own.get("_recipe")
    if recipe is None or name not in own.get("_waiting", ()):
        return name in own  # where another thread was faster
    own.update({known: value for known, value in vars(recipe()).items() if known not in ("key", "_functions")})
    own.pop("_recipe", None)
    return True


def load(name: str) -> Any:
    """Return the object that is pickled under a name in the cache, or None if there is none that can be read."""
    content = cache.read(name)
    try:
        return None if content is None else pickle.loads(content)
    except Exception:  # whatever it is, making it anew is the cure
        cache.forget(name)
        return None


def system(key: str, recipe: partial) -> PartitionedSystem:
    """Return the system that the key identifies: its stand-in from the cache if there is one, else ``recipe()``.

    In the second case the cache gets a stand-in of the system, for the next time.  ``recipe`` is a `functools.partial`.
    """
    key = key_of(key, digest.digest([recipe.func.__module__]))
    entry = f"s-{key}.pickle"
    found = load(entry)
    if found is None:
        found = recipe()
        cache.write(entry, pickle.dumps(shell(found, key, recipe)))
    return found


class Named(Mapping):
    """A read-only mapping whose names are known, while its values are made only when one is looked up.

    ``names`` are the names; ``recipe()``, which each look-up calls, returns a mapping from them to the values.
    """

    def __init__(self, names: Iterable[str], recipe: Callable[[], Mapping]) -> None:
        self._names, self._recipe = tuple(names), recipe

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise KeyError(name)
        return self._recipe()[name]

    def __iter__(self) -> Iterator:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
