"""The text of functions of symbolic expressions, for `codegen` to make ready.

Numbers: a rational is divided in the arithmetic at hand, a double stays exactly the double it is.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import lru_cache

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from .codegen import DOUBLE, MULTIPRECISION, kept_text

#: Numba's integers are below it.
LARGEST = 2**63


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
        return str(x.p) if abs(x.p) < LARGEST else self._print_Rational(x)

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
            return f"sqrt({self._argument(base)})"
        if n == -sp.Rational(1, 2):
            return f"(1/sqrt({self._argument(base)}))"
        return f"({self._print(base)})**({self._print(n)})"

    def _argument(self, x):
        """An argument of a function, which is what tells the function in which arithmetic to work."""
        return f"mpfr({x.p})" if self.multi and x.is_Integer else self._print(x)

    def _print_known(self, x):
        return f"{type(x).__name__.lower()}({', '.join(map(self._argument, x.args))})"

    _print_sin = _print_cos = _print_tan = _print_exp = _print_log = _print_known
    _print_sinh = _print_cosh = _print_tanh = _print_asin = _print_acos = _print_atan = _print_known

    def _print_Abs(self, x):
        return f"abs({self._print(x.args[0])})"


def _roots_shared(expressions: list[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Write powers of halves and quarters as integer powers of one root, powers of sums as of symbols."""
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


@lru_cache(maxsize=4096)
def vectorised(q: tuple[sp.Symbol, ...], p: tuple[sp.Symbol, ...], expression: sp.Expr) -> str:
    """The text of the expression for `codegen.on_columns`."""
    key = hashlib.sha256(" ".join(map(sp.srepr, (*q, *p, expression))).encode()).hexdigest()[:24]
    return kept_text(f"v-{key}.py", lambda: source("f", [("q", q), ("p", p)], [expression], DOUBLE))
