"""From symbolic expressions to functions: compiled, on plain NumPy, or on numbers of many digits.

A generated function takes and returns the values of `vector`: tuples of doubles (compiled, small d), arrays of doubles
(compiled, large d; plain NumPy) or object arrays of MPFR's numbers (`precision`).  The source is kept on disk under
the hash of what it was generated from, so that SymPy works once; Numba keeps the machine code beside it.  A process
keeps what it has made ready, whichever system object asks again.

Numbers: a rational is divided in the arithmetic at hand, a double stays exactly the double it is.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import gmpy2
import mpmath
import numba
import numpy as np
import sympy as sp
from numba import types
from sympy.printing.pycode import PythonCodePrinter

from phasebench.integrators.errors import InvalidInput

from .vector import ARRAYS, TUPLES

#: Above this many degrees of freedom a state is an array, up to it a tuple (registers).
TUPLE_LIMIT = 20
#: Raise it when the generated text changes for the same expressions.
VERSION = 7

DOUBLE, MULTIPRECISION = "double", "multiprecision"


def compiled() -> bool:
    """Whether functions are compiled; not so with NUMBA_DISABLE_JIT=1."""
    return not numba.config.DISABLE_JIT


def cache_directory() -> Path:
    """Where generated sources are kept: $PHASEBENCH_CACHE, else ~/.cache/phasebench, else a temporary folder."""
    for place in (os.environ.get("PHASEBENCH_CACHE"), Path.home() / ".cache" / "phasebench"):
        if place:
            path = Path(place) / "generated"
            try:
                path.mkdir(parents=True, exist_ok=True)
                if os.access(path, os.W_OK):
                    return path
            except OSError:
                continue
    path = Path(tempfile.gettempdir()) / f"phasebench-{os.getuid() if hasattr(os, 'getuid') else 'user'}" / "generated"
    path.mkdir(parents=True, exist_ok=True)
    return path


class _Printer(PythonCodePrinter):
    """Python source in which powers are products and rationals exact in the arithmetic at hand."""

    def __init__(self, arithmetic: str):
        super().__init__({"fully_qualified_modules": False, "precision": 17})
        self.multi = arithmetic == MULTIPRECISION

    def _print_Rational(self, x):
        if float(x) == x:  # a double, such as a parameter of the problem
            return f"mpfr({float(x)!r})" if self.multi else repr(float(x))
        return f"(mpfr({x.p})/{x.q})" if self.multi else repr(x.p / x.q)  # rounded once, whatever the size of p and q

    _print_Half = _print_Rational

    def _print_Integer(self, x):
        return str(x.p)

    def _print_Float(self, x):
        return f"mpfr({float(x)!r})" if self.multi else repr(float(x))

    def _print_NumberSymbol(self, x):
        return f"exactly(mp.{str(x).lower()}, MULTIPRECISION)" if self.multi else repr(float(x))

    _print_Pi = _print_Exp1 = _print_NumberSymbol

    def _print_Pow(self, x, rational=False):
        base, n = x.args
        if n.is_Integer and 1 < abs(n) <= 12 and base.is_Symbol:
            product = "*".join([self._print(base)] * abs(int(n)))
            return f"({product})" if n > 0 else f"(1/({product}))"
        if n == -1:
            return f"(1/{self.parenthesize(base, 1000)})"
        if n == sp.Rational(1, 2):
            return f"sqrt({self._print(base)})"
        if n == -sp.Rational(1, 2):
            return f"(1/sqrt({self._print(base)}))"
        return f"({self._print(base)})**({self._print(n)})"

    def _print_known(self, x):
        return f"{type(x).__name__.lower()}({', '.join(self._print(a) for a in x.args)})"

    _print_sin = _print_cos = _print_tan = _print_exp = _print_log = _print_known
    _print_sinh = _print_cosh = _print_tanh = _print_asin = _print_acos = _print_atan = _print_known

    def _print_Abs(self, x):
        return f"abs({self._print(x.args[0])})"


def _roots_shared(expressions: list[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Write every half-integer power of a base as an integer power of one square root, powers of sums as of symbols."""
    defined: list[tuple[sp.Symbol, sp.Expr]] = []
    names: dict[sp.Expr, sp.Symbol] = {}

    def name(value: sp.Expr, letter: str) -> sp.Symbol:
        if value not in names:
            names[value] = sp.Symbol(f"{letter}{len(names)}_")
            defined.append((names[value], value))
        return names[value]

    def rewrite(e: sp.Expr) -> sp.Expr:
        if not e.args:
            return e
        args = [rewrite(a) for a in e.args]
        if isinstance(e, sp.Pow):
            base, n = args
            if n.is_Rational and n.q == 2:
                return name(sp.sqrt(base), "s") ** n.p
            if n.is_Integer and abs(n) > 1 and not base.is_Symbol:
                return name(base, "t") ** n
        return e.func(*args)

    return defined, [rewrite(e) for e in expressions]


def source(
    name: str, arguments: Sequence[tuple[str, Sequence[sp.Symbol] | sp.Symbol]], results, arithmetic: str
) -> str:
    """The text of a function of ``arguments`` (vectors of symbols, or single symbols).

    ``results`` is a list of vectors (lists of expressions) or of single expressions; the function returns them as a
    tuple, vectors as ``value(...)``.
    """
    renamed: dict[sp.Symbol, sp.Symbol] = {}
    lines = [f"def {name}({', '.join(n for n, _ in arguments)}):"]
    for n, symbols in arguments:
        if isinstance(symbols, sp.Symbol):
            renamed[symbols] = sp.Symbol(n)
            continue
        for i, s in enumerate(symbols):
            renamed[s] = sp.Symbol(f"{n}_{i}")
            lines.append(f"    {n}_{i} = {n}[{i}]")
    flat = [e for r in results for e in (r if isinstance(r, (list, tuple)) else [r])]
    flat = [sp.sympify(e).xreplace(renamed) for e in flat]
    unknown = set().union(*(e.free_symbols for e in flat)) - set(renamed.values()) if flat else set()
    if unknown:
        raise ValueError(
            f"the formula has symbols that are neither coordinates nor momenta: {sorted(map(str, unknown))}"
        )
    defined, flat = _roots_shared(flat)
    shared, flat = sp.cse([*(e for _, e in defined), *flat], symbols=(sp.Symbol(f"c{i}_") for i in range(10**9)))
    roots = dict(zip((s for s, _ in defined), flat[: len(defined)], strict=True))
    flat = flat[len(defined) :]
    printer = _Printer(arithmetic)
    pending = [*shared, *roots.items()]
    known = set(renamed.values())
    while pending:
        ready = [(s, e) for s, e in pending if e.free_symbols <= known]
        for s, e in ready:
            lines.append(f"    {s} = {printer.doprint(e)}")
            known.add(s)
        pending = [(s, e) for s, e in pending if s not in known]
    texts = iter([printer.doprint(e) for e in flat])
    parts = []
    for r in results:
        if isinstance(r, (list, tuple)):
            parts.append(f"value(({', '.join(next(texts) for _ in r)},))")
        else:
            parts.append(f"number({next(texts)})")
    lines.append(f"    return {', '.join(parts)}")
    return "\n".join(lines) + "\n"


def value_kind(d: int) -> str:
    """What a compiled state of d components is: "tuple" or "array"."""
    return "tuple" if d <= TUPLE_LIMIT else "array"


def value_type(d: int):
    """The Numba type of a compiled state of d components."""
    return types.UniTuple(types.float64, d) if value_kind(d) == "tuple" else types.Array(types.float64, 1, "C")


def options(d: int) -> dict:
    """The compiler's options for states of d components."""
    return TUPLES if value_kind(d) == "tuple" else ARRAYS


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


def function(key: str, build, d: int, signature, arithmetic: str = DOUBLE):
    """The function whose text ``build(arithmetic)`` writes, ready for the kernels; the same object for the same key.

    ``key`` identifies the content (it is hashed for the cache on disk); ``signature`` is its Numba signature.
    """
    if arithmetic == MULTIPRECISION:
        style, header = "mpfr", "import mpmath as mp\nfrom gmpy2 import *\n"
        header += f"from {__name__} import MULTIPRECISION, exactly, vector\n\n"
    elif compiled():
        style = value_kind(d)
        header = "from math import *\nimport numpy as np\n\n"
    else:
        style, header = "numpy", "from math import *\nimport numpy as np\n\n"
    digest = hashlib.sha256(f"{VERSION}|{style}|{key}".encode()).hexdigest()[:24]
    if digest not in _ready:
        _ready[digest] = _load(digest, header, style, lambda: build(arithmetic), d, signature)
    return _ready[digest]


def _load(digest: str, header: str, style: str, text, d: int, signature):
    """The generated function, from the disk where it is there."""
    path = cache_directory() / f"f_{digest}.py"
    if not path.exists():
        _write(path, header + _finish(text(), style))
    spec = importlib.util.spec_from_file_location(f"phasebench_generated_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # Numba looks the module up when it loads the machine code
    spec.loader.exec_module(module)
    if style in ("mpfr", "numpy"):
        return module.f
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
        return numba.njit(signature, cache=True, **options(d))(module.f)


@lru_cache(maxsize=4096)
def vectorised(q: tuple[sp.Symbol, ...], p: tuple[sp.Symbol, ...], expression: sp.Expr):
    """The expression on columns of NumPy arrays: f(q, p) with q, p of shape (d, n)."""
    namespace = {"np": np}
    exec("from numpy import *\nfrom numpy import arcsin as asin, arccos as acos, arctan as atan\n", namespace)
    text = source("f", [("q", q), ("p", p)], [expression], DOUBLE)
    exec(text.replace("value((", "np.array((").replace("number(", "("), namespace)
    return namespace["f"]


def _write(path: Path, text: str) -> None:
    """Write whole or not at all: several processes may generate the same file."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w") as stream:
        stream.write(text)
    os.replace(temporary, path)


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
