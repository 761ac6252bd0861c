"""Translate SymPy expressions to heyoka's: numbers are exact in the integrator's precision, and the form runs fast.

heyoka's own ``from_sympy`` rejects rationals whose denominator is not a power of two and truncates long decimals to
double, and its powers with exponents of 3 or more are NaN at base zero.  Here rationals are divided in the working
precision, decimals keep all their bits, and positive integer and half-integer powers are products and square roots.

heyoka differentiates equal subexpressions only once; which ones a system shares, `systems.shared` says.  A negative
power is one power (``r2**-1.5``, ``r2**-7``), and factors that depend on the state come before constants, which differ
between bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    import heyoka as hy
    import sympy as sp

FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sinh", "cosh", "tanh", "asin", "acos", "atan")


def number(e: sp.Expr, fp: Callable[[Any], Any]) -> Any:
    """The number ``e`` (without variables) in the type ``fp``, accurate to one unit in the last place."""
    import sympy as sp

    if isinstance(e, (sp.Float, sp.Rational)):
        r = sp.Rational(e)  # a Float is the binary number that it stores
        p, q = int(r.p), int(r.q)
        return p / q if fp is float else fp(p) / fp(q)
    return fp(str(sp.N(e, getattr(fp, "digits", 50))))


def translate(e: sp.Expr, variables: dict, fp: Callable[[Any], Any]) -> hy.expression:
    """The expression ``e`` in heyoka's ``variables`` (SymPy symbol -> heyoka variable), with numbers of type ``fp``.

    Raises
    ------
    InvalidInput
        For a function or symbol without translation; the message names it.
    """
    import heyoka as hy
    import sympy as sp

    def constant(x: sp.Expr) -> hy.expression:
        return hy.expression(number(x, fp))

    two = constant(sp.Integer(2))

    def product(base: hy.expression, n: int) -> hy.expression:
        """base**n, n >= 1, by repeated squaring; heyoka's squares take half the time of products, in sums less."""
        result = None
        while n:
            if n & 1:
                result = base if result is None else result * base
            base, n = base**two if n > 1 else base, n >> 1
        return result

    def power(base: sp.Expr, exponent: sp.Expr) -> hy.expression:
        b = walk(base)
        if not exponent.is_Rational or exponent.q > 2:
            return b ** walk(exponent)
        if exponent < 0:
            return constant(sp.Integer(1)) / b if exponent == -1 else b ** constant(exponent)
        whole, half = divmod(int(exponent.p), exponent.q)
        parts = ([product(b, whole)] if whole else []) + ([hy.sqrt(b)] if half else [])
        return parts[0] if len(parts) == 1 else parts[0] * parts[1]

    def multiple(x: sp.Mul) -> hy.expression:
        """Translate a product: a product of the factors with variables, negative powers last, times the number."""
        constants = [a for a in x.args if not a.free_symbols]
        factors = [a for a in x.args if a.free_symbols]
        ordered = sorted(factors, key=lambda a: (bool(a.as_base_exp()[1].is_negative), sp.default_sort_key(a)))
        result = walk(ordered[0])
        for a in ordered[1:]:
            result = result * walk(a)
        scale = sp.Mul(*constants)
        return result if scale == 1 else constant(scale) * result

    known: dict = {}

    def walk(x: sp.Expr) -> hy.expression:
        if x not in known:
            known[x] = _walk(x)
        return known[x]

    def _walk(x: sp.Expr) -> hy.expression:
        if x in variables:
            return variables[x]
        if not x.free_symbols:
            return constant(x)
        if isinstance(x, sp.Add):
            return hy.sum([walk(a) for a in x.args])
        if isinstance(x, sp.Mul):
            return multiple(x)
        if isinstance(x, sp.Pow):
            return power(*x.args)
        name = type(x).__name__
        if name in FUNCTIONS and len(x.args) == 1:
            return getattr(hy, name)(walk(x.args[0]))
        raise InvalidInput(f"heyoka cannot be given '{x}': there is no translation of {name}")

    return walk(sp.sympify(e))
