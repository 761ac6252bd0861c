"""Cache on disk what is prepared to run a method on a system: the method's coefficients, and the system's functions.

Both together are a `kernel.Prepared`.  It is pickled with the origins of its functions (`codegen.origin`) in place of
the functions, under a name that is a hash of the pickled method and of the system's key (`systems.deferred`), which
identifies the system.  It is not stored if the system has no key, or if it holds compiled functions that were not
generated from formulae.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from numba.extending import is_jitted

from . import cache, codegen, digest, machine

if TYPE_CHECKING:
    from phasebench.integrators.record import Method
    from phasebench.integrators.stepping.kernel import Prepared
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem
    from phasebench.integrators.values.kinds import Function

#: Whether anything is stored; tests that change what families prepare set it to False.
ENABLED = True
#: Most methods whose pickled bytes are kept in memory.
MAX_METHODS = 512


class _MethodPickler(pickle.Pickler):
    """Leaves out the function that computes fields from a method's parameters, which no kernel depends on."""

    def reducer_override(self, obj: Any) -> Any:
        if hasattr(obj, "with_parameters"):
            return tuple, ([(k, v) for k, v in obj.__getstate__().items() if k != "with_parameters"],)
        return NotImplemented


class _FunctionPickler(pickle.Pickler):
    """Pickles generated functions by their origins, from which `codegen.rebuild` makes them again."""

    def persistent_id(self, obj: Any) -> tuple | None:
        if not (isinstance(obj, machine.Function) or is_jitted(obj)):
            return None
        origin = codegen.origin(obj)
        if origin is None:
            raise pickle.PicklingError("a function that is compiled, and not generated")
        return origin


class _FunctionUnpickler(pickle.Unpickler):
    def persistent_load(self, origin: tuple) -> Function:
        return codegen.rebuild(*origin)


def _pickle(kind: type[pickle.Pickler], thing: object) -> bytes | None:
    stream = io.BytesIO()
    try:
        kind(stream, protocol=5).dump(thing)
    except (pickle.PicklingError, TypeError, AttributeError):
        return None
    return stream.getvalue()


#: id of a method -> (the method, its pickled bytes, or None).  Holding the method keeps its id from being used again.
_bytes: dict = {}


def _bytes_of(method: Method) -> bytes | None:
    if id(method) not in _bytes:
        if len(_bytes) >= MAX_METHODS:
            _bytes.clear()
        _bytes[id(method)] = method, _pickle(_MethodPickler, method)
    return _bytes[id(method)][1]


def entry(method: Method, system: PartitionedSystem) -> str | None:
    """Return the name of the cache entry for a method prepared for a system, or None if it cannot be stored."""
    key = getattr(system, "key", "") if ENABLED and codegen.compiled() else ""
    value = _bytes_of(method) if key else None
    if value is None:
        return None
    code = digest.digest([*digest.families(method), type(system).__module__])
    about = f"{key}|{system.variant}|{codegen.value_kind(system.d)}|{code}|"
    return f"prepared-{hashlib.sha256(about.encode() + value).hexdigest()[:24]}.pickle"


@lru_cache(maxsize=512)
def _read(name: str, version: str) -> Prepared:
    """What was pickled in the entry ``name`` of the cache folder ``version``; raises LookupError if there is none."""
    content = cache.read(name)
    if content is None:
        raise LookupError(name)
    try:
        return _FunctionUnpickler(io.BytesIO(content)).load()
    except Exception as error:  # whatever the damage, it is prepared again
        cache.forget(name)
        raise LookupError(name) from error


def read(name: str | None) -> Prepared | None:
    """Return the `kernel.Prepared` that was stored under the name, or None if there is none or ``name`` is None."""
    try:
        return None if name is None else _read(name, str(cache.folder()))
    except LookupError:
        return None


def write(name: str | None, prepared: Prepared) -> None:
    """Store a `kernel.Prepared` under the name; do nothing if ``name`` is None or ``prepared`` cannot be pickled."""
    content = None if name is None else _pickle(_FunctionPickler, prepared)
    if content is not None:
        cache.write(name, content)
