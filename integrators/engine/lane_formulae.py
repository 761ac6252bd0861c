"""Functions of formulae whose variables are lanes, which stand in the rows of a memory.

A function reads its arguments, a row each, from the first rows of the memory and writes its results to the rows that
follow.  Formulae of sums, products, quotients, integer and half-integer powers, sin, cos and exp can be had; any other
function has no form in lanes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

from numba import types

from . import codegen, elementary, lanes
from .lazy import sympy as sp

#: SymPy's names of what lanes have.
KNOWN = ("Add", "Mul", "Pow", "sin", "cos", "exp")


def known(expressions: Iterable[sp.Expr]) -> bool:
    """Whether lanes have all that the expressions are made of."""
    kinds = tuple(getattr(sp, name) for name in KNOWN)
    parts = (part for e in expressions for part in sp.preorder_traversal(e) if part.args)
    return all(isinstance(e, kinds) and not _root(e) for e in parts)


def _root(e: sp.Expr) -> bool:
    """Whether a power is none that products and square roots make."""
    return isinstance(e, sp.Pow) and not (e.exp.is_Rational and e.exp.q <= 2 and abs(e.exp) <= 12)


def function(
    kind: str, arguments: Sequence[tuple[str, Sequence[sp.Symbol]]], results: Callable, n: int, system, arithmetic: str
):
    """The function of ``arguments``, named vectors of symbols of a system, in n lanes.

    ``results`` is a function without arguments that returns a list of expressions, called only if the text is not kept.
    """
    rows = sum(len(symbols) for _, symbols in arguments)

    def text(arithmetic):
        from . import printing

        expressions = results()
        formula = printing.source("g", arguments, [expressions], arithmetic)
        begins = [sum(len(symbols) for _, symbols in arguments[:i]) for i in range(len(arguments))]
        values = [
            f"({''.join(f'take(B, {first + k}, LIKE), ' for k in range(len(symbols)))})"
            for first, (_, symbols) in zip(begins, arguments, strict=True)
        ]
        unpacked = "".join(f"g_{k}, " for k in range(len(expressions)))
        return "\n".join(
            [
                "from phasebench.integrators.engine.elementary import cos, exp, sin, sqrt",
                "from phasebench.integrators.engine.lanes import put, take",
                "from phasebench.integrators.engine.vector import inlined",
                f"LIKE = {(0.0,) * n}",
                f"@inlined\n{formula.replace('value((', '((')}",
                f"def f(B):\n    {unpacked}= g({', '.join(values)})",
                *(f"    put(B, {rows + k}, g_{k}, LIKE)" for k in range(len(expressions))),
                "",
            ]
        )

    signature = types.void(types.Array(types.float64, 2, "C"))
    key = f"{kind} in {n} lanes|{_operations()}|{system.content}"
    return codegen.function(key, text, signature, arithmetic)


@cache
def _operations() -> str:
    """The hash of the modules whose operations become a part of a generated function."""
    return hashlib.sha256(b"".join(Path(m.__file__).read_bytes() for m in (lanes, elementary))).hexdigest()
