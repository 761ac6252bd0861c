"""Write the source text of functions from SymPy expressions; `codegen` turns it into functions.

A rational number is divided in the arithmetic of the function; a double stays exactly the double that it is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from . import digest
from .codegen import DOUBLE, MAX_POWER, MULTIPRECISION, cached_text

#: Integers of this size or more do not fit Numba's 64-bit integers, and are written as floats.
INTEGER_LIMIT = 2**63
#: Longest product of equal factors that is written out; longer ones are built from halves.
MAX_FACTORS = 12


class Program(NamedTuple):
    """Expressions to be computed by a generated function, with intermediate results that they refer to.

    Attributes
    ----------
    definitions : intermediate results, pairs (symbol, expression), each after those that it refers to
    results : the results, vectors (lists of expressions) and single expressions, as `source` takes them
    """

    definitions: Sequence[tuple[Any, Any]]
    results: Sequence[Any]


class _Printer(PythonCodePrinter):
    """Prints expressions as Python, with integer powers as products and rationals exact in the given arithmetic."""

    def __init__(self, arithmetic: str) -> None:
        super().__init__({"fully_qualified_modules": False, "precision": 17})
        self.multi = arithmetic == MULTIPRECISION

    def _print_Rational(self, x: sp.Rational) -> str:
        if float(x) == x:  # a double, such as a parameter of the problem
            return f"mpfr({float(x)!r})" if self.multi else repr(float(x))
        return f"(mpfr({x.p})/{x.q})" if self.multi else repr(x.p / x.q)  # rounded once, whatever the size of p and q

    _print_Half = _print_Rational

    def _print_Integer(self, x: sp.Integer) -> str:
        return str(x.p) if abs(x.p) < INTEGER_LIMIT else self._print_Rational(x)

    def _print_Float(self, x: sp.Float) -> str:
        return f"mpfr({float(x)!r})" if self.multi else repr(float(x))

    def _print_NumberSymbol(self, x: sp.Expr) -> str:
        return f"to_number(mp.{str(x).lower()}, MULTIPRECISION)" if self.multi else repr(float(x))

    _print_Pi = _print_Exp1 = _print_NumberSymbol

    def _print_Pow(self, x: sp.Pow, rational: bool = False) -> str:
        base, n = x.args
        if n.is_Integer and 1 < abs(n) <= MAX_POWER and base.is_Symbol:
            product = _product(self._print(base), abs(int(n)))
            return f"({product})" if n > 0 else f"(1/({product}))"
        if n == -1:
            return f"(1/{self.parenthesize(base, 1000)})"
        if n == sp.Rational(1, 2):
            return f"sqrt({self._argument(base)})"
        if n == -sp.Rational(1, 2):
            return f"(1/sqrt({self._argument(base)}))"
        return f"({self._print(base)})**({self._print(n)})"

    def _argument(self, x: sp.Expr) -> str:
        """Print the argument of a function; an integer becomes an MPFR number, which selects the arithmetic."""
        return f"mpfr({x.p})" if self.multi and x.is_Integer else self._print(x)

    def _print_known(self, x: sp.Function) -> str:
        return f"{type(x).__name__.lower()}({', '.join(map(self._argument, x.args))})"

    _print_sin = _print_cos = _print_tan = _print_exp = _print_log = _print_known
    _print_sinh = _print_cosh = _print_tanh = _print_asin = _print_acos = _print_atan = _print_known

    def _print_Abs(self, x: sp.Abs) -> str:
        return f"abs({self._print(x.args[0])})"


def _product(base: str, n: int) -> str:
    """The n-th power of ``base`` as products; of equal halves if n is large, to multiply less."""
    if n <= MAX_FACTORS:
        return "*".join([base] * n)
    half = f"({_product(base, n // 2)})"
    return "*".join([half, half, *[base] * (n % 2)])


def _share_roots(expressions: list[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Rewrite powers with exponents n/2 and n/4 as integer powers of one root of the base, so that it is taken once.

    Integer powers of sums become powers of a symbol.  Returns the definitions (symbol, expression) of roots and sums,
    and the rewritten expressions.
    """
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
            if n.is_Rational and n.q in (2, 4):
                root = name(sp.sqrt(base), "s")
                return (root if n.q == 2 else name(sp.sqrt(root), "s")) ** n.p
            if n.is_Integer and abs(n) > 1 and not base.is_Symbol:
                return name(base, "t") ** n
        return e.func(*args)

    return defined, [rewrite(e) for e in expressions]


def in_order_of_evaluation(definitions: Iterable[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Sort definitions (symbol, expression) such that each comes after those whose symbols its expression contains."""
    pending, order = dict(definitions), []
    while pending:
        ready = [s for s, e in pending.items() if not e.free_symbols & pending.keys()]
        order += [(s, pending.pop(s)) for s in ready]
    return order


def share(definitions: Sequence[tuple[Any, Any]], expressions: Sequence[Any]) -> tuple[list[tuple[Any, Any]], list]:
    """Define common subexpressions: returns (definitions in order of evaluation, the expressions in terms of them).

    The ``definitions`` given, pairs (symbol, expression), are among those returned; ``expressions`` may refer to them.
    """
    symbols = (sp.Symbol(f"c{i}_") for i in range(10**9))
    shared, flat = sp.cse([*(e for _, e in definitions), *expressions], symbols=symbols)
    named = zip((s for s, _ in definitions), flat, strict=False)
    return in_order_of_evaluation([*shared, *named]), flat[len(definitions) :]


def source(
    name: str,
    arguments: Sequence[tuple[str, Sequence[sp.Symbol] | sp.Symbol]],
    results: Program | Sequence[Any],
    arithmetic: str,
) -> str:
    """Return the text of a function of ``arguments`` (each a name and a vector of symbols, or a single symbol).

    ``name`` is the function's name.  ``results`` lists vectors (lists of expressions) and single expressions, or is a
    `Program`; the function returns the results as a tuple, each vector as ``value(...)``.  Raises ValueError if an
    expression has a symbol that is not an argument, or if two arguments have the same one.
    """
    definitions, results = results if isinstance(results, Program) else ((), results)
    renamed: dict[sp.Symbol, sp.Symbol] = {}
    symbols_of = [[s] if isinstance(s, sp.Symbol) else [*s] for _, s in arguments]
    if len(set().union(*symbols_of)) < sum(map(len, symbols_of)):
        raise ValueError(f"two arguments of the function '{name}' have the same symbol")
    lines = [f"def {name}({', '.join(n for n, _ in arguments)}):"]
    for n, symbols in arguments:
        if isinstance(symbols, sp.Symbol):
            renamed[symbols] = sp.Symbol(n)
            continue
        for i, s in enumerate(symbols):
            renamed[s] = sp.Symbol(f"{n}_{i}")
            lines.append(f"    {n}_{i} = {n}[{i}]")
    flat = [e for r in results for e in (r if isinstance(r, (list, tuple)) else [r])]
    flat = [sp.sympify(e).xreplace(renamed) for e in (*(e for _, e in definitions), *flat)]
    names = {*renamed.values(), *(s for s, _ in definitions)}
    unknown = set().union(*(e.free_symbols for e in flat)) - names if flat else set()
    if unknown:
        raise ValueError(
            f"the formula has symbols that are neither coordinates nor momenta: {sorted(map(str, unknown))}"
        )
    defined, flat = _share_roots(flat)
    named = zip((s for s, _ in definitions), flat, strict=False)
    ordered, flat = share([*defined, *named], flat[len(definitions) :])
    printer = _Printer(arithmetic)
    lines += [f"    {s} = {printer.doprint(e)}" for s, e in ordered]
    texts = iter([printer.doprint(e) for e in flat])
    parts = []
    for r in results:
        if isinstance(r, (list, tuple)):
            items = [next(texts) for _ in r]
            if all(text.lstrip("-").isdigit() for text in items):  # an array of integers would be one of int64
                items = [f"{text}.0" for text in items]
            parts.append(f"value(({', '.join(items)},))")
        else:
            parts.append(f"number({next(texts)})")
    lines.append(f"    return {', '.join(parts)}")
    return "\n".join(lines) + "\n"


@lru_cache(maxsize=4096)
def columnwise_text(q: tuple[sp.Symbol, ...], p: tuple[sp.Symbol, ...], expression: sp.Expr) -> str:
    """Return the source text of a function f(q, p) that evaluates an expression, for `codegen.load_columnwise`."""
    parts = [*map(sp.srepr, (*q, *p, expression)), digest.digest([__name__])]
    key = hashlib.sha256(" ".join(parts).encode()).hexdigest()[:24]
    return cached_text(f"v-{key}.py", lambda: source("f", [("q", q), ("p", p)], [expression], DOUBLE))
