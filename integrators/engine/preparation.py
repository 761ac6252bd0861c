"""What families prepare, kept: the numbers of a method and the functions of a system that has a key.

A `kernel.Prepared` is pickled with the origins of its functions in the place of the functions (`codegen.origin`); it is
found by the method, by value, and by the system's key.  What holds anything else that is compiled is not kept.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from functools import lru_cache

from numba.core.dispatcher import Dispatcher
from numba.core.serialize import NumbaPickler

from . import cache, codegen

#: Whether anything is kept: not where what families prepare is changed, as tests do.
KEPT = True
#: Of how many methods what they are is remembered.
MOST = 512


class _Value(pickle.Pickler):
    """Writes a method as what its kernel is prepared from: how its parameters are read is none of that."""

    def reducer_override(self, obj):
        if hasattr(obj, "with_parameters"):
            return tuple, ([(k, v) for k, v in vars(obj).items() if k != "with_parameters"],)
        return NotImplemented


class _Pickler(NumbaPickler):
    """Writes functions by their origins."""

    def persistent_id(self, obj):
        if not isinstance(obj, Dispatcher):
            return None
        found = codegen.origin(obj)
        if found is None:
            raise pickle.PicklingError("a function that is compiled, and not generated")
        return found


class _Unpickler(pickle.Unpickler):
    def persistent_load(self, origin):
        return codegen.again(*origin)


def _written(kind: type[pickle.Pickler], thing) -> bytes | None:
    """The thing as bytes; None where it is of what cannot be written."""
    stream = io.BytesIO()
    try:
        kind(stream, protocol=5).dump(thing)
    except (pickle.PicklingError, TypeError, AttributeError):
        return None
    return stream.getvalue()


#: The bytes of methods that have been asked for, by their identity, and the methods, so that they keep it.
_bytes: dict = {}


def _bytes_of(method) -> bytes | None:
    known = _bytes.get(id(method))
    if known is None:
        if len(_bytes) >= MOST:
            _bytes.clear()
        known = _bytes[id(method)] = method, _written(_Value, method)
    return known[1]


def entry(method, system) -> str | None:
    """The name of the entry; None where there can be none."""
    key = getattr(system, "key", "") if KEPT and codegen.compiled() else ""
    value = _bytes_of(method) if key else None
    if value is None:
        return None
    about = f"{key}|{system.variant}|{codegen.value_kind(system.d)}|"
    return f"prepared-{hashlib.sha256(about.encode() + value).hexdigest()[:24]}.pickle"


@lru_cache(maxsize=512)
def _read(name: str, version: str):
    """What stands in an entry, once in a process."""
    content = cache.read(name)
    if content is None:
        raise LookupError(name)
    try:
        return _Unpickler(io.BytesIO(content)).load()
    except Exception as error:  # whatever it is, preparing anew is the cure
        cache.forget(name)
        raise LookupError(name) from error


def read(name: str | None):
    """What was written under the name, or None."""
    try:
        return None if name is None else _read(name, str(cache.folder()))
    except LookupError:
        return None


def write(name: str | None, prepared) -> None:
    """Keep what a family prepared, if that is possible."""
    content = None if name is None else _written(_Pickler, prepared)
    if content is not None:
        cache.write(name, content)
