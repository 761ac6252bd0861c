"""From the text of functions to functions: compiled, on plain NumPy, or on numbers of many digits.

A generated function takes and returns the values of `vector`: tuples of doubles (compiled, small d), arrays of doubles
(compiled, large d; plain NumPy) or object arrays of MPFR's numbers (`precision`).  `printing` writes the text; it is
kept in `cache` under the hash of what it was generated from, so that SymPy works once, and so is its machine code
(`machine`).  A process keeps what it has made ready, whichever system object asks again.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import ModuleType

import gmpy2
import mpmath
import numba
import numpy as np
from numba import types

from phasebench.integrators.errors import InvalidInput

from . import cache, machine
from .vector import ARRAYS, TUPLES

#: Above this many degrees of freedom a state is an array, up to it a tuple (registers) unless a kernel that works in
#: place has it otherwise (`filling.twin`).
TUPLE_LIMIT = 20

DOUBLE, MULTIPRECISION = "double", "multiprecision"


def compiled() -> bool:
    """Whether functions are compiled; not so with NUMBA_DISABLE_JIT=1."""
    return not numba.config.DISABLE_JIT


def value_kind(d: int, arrays: bool = False) -> str:
    """What a compiled state of d components is, "tuple" or "array"; an array in any case where it is told so."""
    return "array" if arrays or d > TUPLE_LIMIT else "tuple"


def value_type(d: int, arrays: bool = False):
    """The Numba type of a compiled state of d components."""
    tuples = value_kind(d, arrays) == "tuple"
    return types.UniTuple(types.float64, d) if tuples else types.Array(types.float64, 1, "C")


def options(d: int) -> dict:
    """The compiler's options for states of d components."""
    return TUPLES if value_kind(d) == "tuple" else ARRAYS


def _kind_of(signature) -> str:
    """What the states are that a function of this signature takes."""
    return "array" if any(isinstance(t, types.Array) and t.ndim == 1 for t in signature.args) else "tuple"


def _finish(text: str, style: str) -> str:
    """Replace the marks ``value`` and ``number`` by what the style returns."""
    if style == "tuple":
        return text.replace("value((", "((").replace("number(", "float(")
    if style == "array":
        return text.replace("value((", "np.array((").replace("number(", "float(")
    if style == "mpfr":
        return text.replace("value((", "vector((").replace("number(", "mpfr(")
    return text.replace("value((", "np.array((").replace("number(", "(")


#: What this process has made ready, by the digest of what it was generated from.
_ready: dict = {}


def function(key: str, build, signature, arithmetic: str = DOUBLE):
    """The function whose text ``build(arithmetic)`` writes, ready for the kernels; the same object for the same key.

    ``key`` identifies the content (it is hashed for the cache); ``signature`` is its Numba signature.
    """
    if arithmetic == MULTIPRECISION:
        style, header = "mpfr", "import mpmath as mp\nfrom gmpy2 import *\n"
        header += f"from {__name__} import MULTIPRECISION, exactly, vector\n\n"
    else:
        style = _kind_of(signature) if compiled() else "numpy"
        header = "from math import *\nimport numpy as np\n\n"
    digest = hashlib.sha256(f"{style}|{key}".encode()).hexdigest()[:24]
    if digest not in _ready:
        text = kept_text(f"f-{digest}.py", lambda: header + _finish(build(arithmetic), style))
        _ready[digest] = _load(digest, text, style, signature)
    return _ready[digest]


def origin(made) -> tuple | None:
    """What `again` makes a compiled function of this module from; None of any other."""
    return getattr(made, "origin", None)


def again(digest: str, signature):
    """The compiled function of that origin; raises KeyError where its text is not in the cache."""
    if digest not in _ready:
        text = cache.read(f"f-{digest}.py")
        if text is None:
            raise KeyError(digest)
        _ready[digest] = _load(digest, text.decode(), _kind_of(signature), signature)
    return _ready[digest]


def kept_text(name: str, write) -> str:
    """The text under that name in the cache, or what ``write()`` returns."""
    kept = cache.read(name)
    if kept is not None:
        return kept.decode()
    text = write()
    cache.write(name, text.encode())
    return text


def _load(digest: str, text: str, style: str, signature):
    """The function that the text defines."""
    module = ModuleType(f"phasebench_generated_{digest}")
    sys.modules[module.__name__] = module  # Numba looks the module up when it loads the machine code
    exec(compile(text, f"<generated {digest}>", "exec"), module.__dict__)
    if style in ("mpfr", "numpy"):
        return module.f
    name = f"f|{digest}|{hashlib.sha256(text.encode()).hexdigest()}"
    made = machine.compiled(module.f, signature, TUPLES if style == "tuple" else ARRAYS, name)
    made.origin = digest, signature
    return made


@lru_cache(maxsize=4096)
def on_columns(text: str):
    """The function that the text defines, on columns of NumPy arrays: f(q, p) with q, p of shape (d, n)."""
    namespace = vars(np) | {"np": np, "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}
    exec(text.replace("value((", "np.array((").replace("number(", "("), namespace)
    return namespace["f"]


@contextmanager
def precision(digits: int) -> Iterator[None]:
    """Work with so many digits: mpmath, and the numbers of "multiprecision"."""
    with mpmath.workdps(digits), gmpy2.context(gmpy2.get_context(), precision=mpmath.mp.prec):
        yield


def epsilon(arithmetic: str):
    """The round-off of the arithmetic at hand."""
    return exactly(mpmath.mp.eps if arithmetic == MULTIPRECISION else np.finfo(float).eps, arithmetic)


def vector(numbers) -> np.ndarray:
    """An array of numbers of many digits, whatever kind of number each was.

    Raises InvalidInput where mpmath works with other digits than `precision` has set.
    """
    if gmpy2.get_context().precision != mpmath.mp.prec:
        raise InvalidInput("set the digits of multiprecision by codegen.precision(digits), not by mpmath alone")
    out = np.empty(len(numbers), dtype=object)
    out[:] = [exactly(x, MULTIPRECISION) for x in numbers]
    return out


def exactly(x, arithmetic: str):
    """x (int, float, Fraction, decimal string, number of mpmath or of MPFR) in the arithmetic at hand."""
    if arithmetic == DOUBLE:
        return float(mpmath.mpf(x)) if isinstance(x, str) else float(x)
    if isinstance(x, (int, float, str, gmpy2.mpfr)):
        return gmpy2.mpfr(x)
    ratio = mpmath.libmp.to_rational(x._mpf_) if hasattr(x, "_mpf_") else (x.numerator, x.denominator)
    return gmpy2.mpfr(gmpy2.mpq(*ratio))
