"""Turn the source text of generated functions into functions: compiled, in plain NumPy, or in multiprecision.

A generated function takes and returns vectors of d numbers: tuples of doubles (compiled, small d), arrays of doubles
(compiled, large d; or plain NumPy) or object arrays of MPFR numbers (`precision`).  `printing` writes the text.  The
text is stored in `cache` under the hash of what it was generated from, so that SymPy works once; its machine code is
stored too (`machine`).  Within a process the same key always gives the same function, whichever system asks for it.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numba import types

from phasebench.integrators.errors import InvalidInput

from . import cache, machine
from .digest import of_folder
from .lazy import gmpy2, mpmath
from .options import ARRAYS, TUPLES

if TYPE_CHECKING:
    from phasebench.integrators.values.kinds import Function, Number, Signature

#: Most degrees of freedom for which a state is a tuple, in registers; above, it is an array.  Kernels that work in
#: place may have their own, lower limit (`inplace.in_place_version`).
TUPLE_LIMIT = 20

DOUBLE, MULTIPRECISION = "double", "multiprecision"
#: Largest integer power that is written as products.
MAX_POWER = 48


def compiled() -> bool:
    """True if functions are compiled, that is unless NUMBA_DISABLE_JIT=1."""
    return not numba.config.DISABLE_JIT


def value_kind(d: int, arrays: bool = False) -> str:
    """The kind of a compiled state of d components, "tuple" or "array"; ``arrays`` forces arrays."""
    return "array" if arrays or d > TUPLE_LIMIT else "tuple"


def value_type(d: int, arrays: bool = False) -> types.Type:
    """The Numba type of a compiled state of d components; ``arrays`` forces arrays."""
    tuples = value_kind(d, arrays) == "tuple"
    return types.UniTuple(types.float64, d) if tuples else types.Array(types.float64, 1, "C")


def options(d: int) -> dict:
    """The options of `numba.njit` for functions of states of d components."""
    return TUPLES if value_kind(d) == "tuple" else ARRAYS


def _kind_of(signature: Signature) -> str:
    return "array" if any(isinstance(t, types.Array) and t.ndim == 1 for t in signature.args) else "tuple"


#: Style -> the constructors of a vector and of a number.
CONSTRUCTORS = {
    "tuple": ("", "float"),
    "array": ("np.array", "float"),
    "mpfr": ("vector", "mpfr"),
    "numpy": ("np.array", ""),
}


def _finish(text: str, style: str) -> str:
    """Replace ``value`` and ``number`` in a source text by the `CONSTRUCTORS` of a style."""
    value, number = CONSTRUCTORS[style]
    return re.sub(r"\bnumber\(", f"{number}(", text.replace("value((", f"{value}(("))


@lru_cache(maxsize=16)
def once(f: Callable, signature: Signature, arithmetic: str = DOUBLE) -> Callable:
    """Return f for all kernels, compiled when one first calls it; f itself if no compiled kernel calls it."""
    return machine.Function(f, signature, TUPLES, f.__name__, rare=True) if arithmetic == DOUBLE and compiled() else f


#: The generated functions of this process, by the digest of what each was generated from.
_ready: dict = {}


def function(key: str, build: Callable[[str], str], signature: Signature, arithmetic: str = DOUBLE) -> Function:
    """Return the function that the Python text ``build(arithmetic)`` defines, compiled or in multiprecision.

    Parameters
    ----------
    key : text that identifies what the function computes; the cache uses its hash, and the same key gives the same
        object
    build : a function that takes the arithmetic and returns the source text of a function ``f``
    signature : the Numba signature of ``f``
    arithmetic : `DOUBLE` or `MULTIPRECISION`
    """
    if arithmetic == MULTIPRECISION:
        style, header = "mpfr", "import mpmath as mp\nfrom gmpy2 import *\n"
        header += f"from {__name__} import MULTIPRECISION, to_number, vector\n\n"
    else:
        style = _kind_of(signature) if compiled() else "numpy"
        header = "from math import *\nimport numpy as np\n\n"
    derived = of_folder("integrators.systems")
    digest = hashlib.sha256(f"{style}|{key}|{derived}".encode()).hexdigest()[:24]
    if digest not in _ready:
        text = cached_text(f"f-{digest}.py", lambda: header + _finish(build(arithmetic), style))
        _ready[digest] = _load(digest, text, style, signature)
    return _ready[digest]


def origin(f: Function) -> tuple[str, Signature] | None:
    """Return the arguments (digest, signature) with which `rebuild` makes f again, or None if f was not generated."""
    return getattr(f, "origin", None)


def rebuild(digest: str, signature: Signature) -> Function:
    """Return the generated function with this digest and signature; raise KeyError if its text is not in the cache."""
    if digest not in _ready:
        text = cache.read(f"f-{digest}.py")
        if text is None:
            raise KeyError(digest)
        _ready[digest] = _load(digest, text.decode(), _kind_of(signature), signature)
    return _ready[digest]


def cached_text(name: str, write: Callable[[], str]) -> str:
    """Return the text stored in the cache under ``name``; if there is none, store and return ``write()``."""
    kept = cache.read(name)
    if kept is not None:
        return kept.decode()
    text = write()
    cache.write(name, text.encode())
    return text


def _load(digest: str, text: str, style: str, signature: Signature) -> Function:
    """Return the function ``f`` that a text defines, compiled unless the style is "mpfr" or "numpy"."""
    module = ModuleType(f"phasebench_generated_{digest}")
    sys.modules[module.__name__] = module  # Numba looks the module up when it loads the machine code
    exec(compile(text, f"<generated {digest}>", "exec"), module.__dict__)
    if style in ("mpfr", "numpy"):
        return module.f
    name = f"f|{digest}|{hashlib.sha256(text.encode()).hexdigest()}"
    f = machine.Function(module.f, signature, TUPLES if style == "tuple" else ARRAYS, name)
    f.origin = digest, signature
    return f


@lru_cache(maxsize=4096)
def load_columnwise(text: str) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the function ``f`` that the text defines, as f(q, p) of NumPy arrays q, p of shape (d, n)."""
    namespace = vars(np) | {"np": np, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}
    exec(_finish(text, "numpy"), namespace)
    return namespace["f"]


@contextmanager
def precision(digits: int) -> Iterator[None]:
    """Set the precision of mpmath and of `MULTIPRECISION` to ``digits`` decimal digits while the context is open."""
    with mpmath.workdps(digits), gmpy2.context(gmpy2.get_context(), precision=mpmath.mp.prec):
        yield


def epsilon(arithmetic: str) -> Number:
    """Return the machine epsilon of the arithmetic, a double or an MPFR number at the current precision."""
    return to_number(mpmath.mp.eps if arithmetic == MULTIPRECISION else np.finfo(float).eps, arithmetic)


def vector(numbers: Sequence[Any] | np.ndarray) -> np.ndarray:
    """Return an object array of the numbers as MPFR numbers, whatever kind of number each was.

    Raises InvalidInput if mpmath's precision is not the one that `precision` has set.
    """
    if gmpy2.get_context().precision != mpmath.mp.prec:
        raise InvalidInput("set the digits of multiprecision by codegen.precision(digits), not by mpmath alone")
    out = np.empty(len(numbers), dtype=object)
    out[:] = [to_number(x, MULTIPRECISION) for x in numbers]
    return out


def to_number(x: Any, arithmetic: str) -> Number:
    """Convert x (int, float, Fraction, decimal string, mpmath or MPFR number) to a number of the arithmetic."""
    if arithmetic == DOUBLE:
        return float(mpmath.mpf(x)) if isinstance(x, str) else float(x)
    if isinstance(x, (int, float, str, gmpy2.mpfr)):
        return gmpy2.mpfr(x)
    ratio = mpmath.libmp.to_rational(x._mpf_) if hasattr(x, "_mpf_") else (x.numerator, x.denominator)
    return gmpy2.mpfr(gmpy2.mpq(*ratio))
