"""Generate functions from formulae whose variables are SIMD lanes, stored in the rows of a table.

Such a function f(B) reads its arguments, one row each, from the first rows of the table B, and writes its results to
the rows that follow.  Sums, products, quotients, integer and half-integer powers, sin, cos, exp, sinh, cosh and tanh
have a lane version; other functions do not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.compile.lazy import sympy as sp

from . import elementary, lanes

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem
    from phasebench.integrators.values.kinds import Function

#: SymPy's names of the operations that have a lane version.
SUPPORTED = ("Add", "Mul", "Pow", "sin", "cos", "exp", "sinh", "cosh", "tanh")


def supported(expressions: Iterable[sp.Expr]) -> bool:
    """True if every function in the expressions has a lane version."""
    kinds = tuple(getattr(sp, name) for name in SUPPORTED)
    parts = (part for e in expressions for part in sp.preorder_traversal(e) if part.args)
    return all(isinstance(e, kinds) and not _unsupported_power(e) for e in parts)


def _unsupported_power(e: sp.Expr) -> bool:
    """True if a power has no lane version: its exponent is not a multiple of 1/2, or too large to multiply out."""
    return isinstance(e, sp.Pow) and not (
        e.exp.is_Rational and e.exp.q <= 2 and abs(e.exp) * e.exp.q <= codegen.MAX_POWER
    )


def function(
    kind: str,
    arguments: Sequence[tuple[str, Sequence[sp.Symbol]]],
    results: Callable,
    n: int,
    system: PartitionedSystem,
    arithmetic: str,
) -> Function:
    """Return the compiled function f(B) that evaluates formulae in n lanes; rows of the table B are its variables.

    ``kind`` is a label that identifies the function in the cache, ``arguments`` are pairs (name, vector of symbols),
    whose values f reads from the first rows of B, one row for each symbol; f writes its results to the rows after them.
    ``results`` takes no arguments and returns a `Program` of vectors, whose components are the results in order; it is
    called only if the text is not in the cache.
    """
    rows = sum(len(symbols) for _, symbols in arguments)

    def text(arithmetic: str) -> str:
        from phasebench.integrators.compile import printing

        program = results()
        expressions = [e for vector in program.results for e in vector]
        formula = printing.source("g", arguments, program._replace(results=[expressions]), arithmetic)
        begins = [sum(len(symbols) for _, symbols in arguments[:i]) for i in range(len(arguments))]
        values = [
            f"({''.join(f'take(B, {first + k}, LIKE), ' for k in range(len(symbols)))})"
            for first, (_, symbols) in zip(begins, arguments, strict=True)
        ]
        unpacked = "".join(f"g_{k}, " for k in range(len(expressions)))
        return "\n".join(
            [
                "from phasebench.integrators.values.elementary import cos, cosh, exp, sin, sinh, sqrt, tanh",
                "from phasebench.integrators.values.lanes import put, take",
                "from phasebench.integrators.values.vector import inline",
                f"LIKE = {(0.0,) * n}",
                f"@inline\n{formula.replace('value((', '((')}",
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
    """Return a hash of the modules `lanes` and `elementary`, for cache keys: generated functions contain their code."""
    return hashlib.sha256(b"".join(Path(m.__file__).read_bytes() for m in (lanes, elementary))).hexdigest()
