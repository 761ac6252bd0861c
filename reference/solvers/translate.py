"""SymPy expressions as heyoka's, with every number exact in the precision of the integrator.

heyoka's own ``from_sympy`` refuses rationals whose denominator is no power of two and cuts long decimals to double;
its power with an exponent of 3 or more is NaN at base zero.  Here rationals are divided in the precision at hand,
decimals keep all their bits, and integer and half-integer powers are products and square roots.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    import sympy as sp

FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sinh", "cosh", "tanh", "asin", "acos", "atan")


def number(e: sp.Expr, fp):
    """The number ``e`` (without variables) in the type ``fp``, right up to one unit in the last place."""
    import sympy as sp

    if isinstance(e, (sp.Float, sp.Rational)):
        r = sp.Rational(e)  # a Float is the binary number that it stores
        p, q = int(r.p), int(r.q)
        return p / q if fp is float else fp(p) / fp(q)
    return fp(str(sp.N(e, getattr(fp, "digits", 50))))


def translate(e: sp.Expr, variables: dict, fp):
    """The expression ``e`` in heyoka's ``variables`` (SymPy symbol -> heyoka variable), with numbers of type ``fp``.

    Raises
    ------
    InvalidInput
        For a function or symbol that has no translation, naming it.
    """
    import heyoka as hy
    import sympy as sp

    def constant(x):
        return hy.expression(number(x, fp))

    def product(base, n):
        """base**n, n >= 1, by squaring."""
        result = None
        while n:
            if n & 1:
                result = base if result is None else result * base
            base, n = base * base if n > 1 else base, n >> 1
        return result

    def power(base, exponent):
        b = walk(base)
        if exponent.is_Rational and exponent.q in (1, 2):
            whole, half = divmod(abs(int(exponent.p)), 2) if exponent.q == 2 else (abs(int(exponent.p)), 0)
            parts = ([product(b, whole)] if whole else []) + ([hy.sqrt(b)] if half else [])
            value = parts[0] if len(parts) == 1 else parts[0] * parts[1]
            return constant(sp.Integer(1)) / value if exponent.p < 0 else value
        return b ** walk(exponent)

    def walk(x):
        if x in variables:
            return variables[x]
        if not x.free_symbols:
            return constant(x)
        if isinstance(x, sp.Add):
            return sum((walk(a) for a in x.args[1:]), walk(x.args[0]))
        if isinstance(x, sp.Mul):
            result = walk(x.args[0])
            for a in x.args[1:]:
                result = result * walk(a)
            return result
        if isinstance(x, sp.Pow):
            return power(*x.args)
        name = type(x).__name__
        if name in FUNCTIONS and len(x.args) == 1:
            return getattr(hy, name)(walk(x.args[0]))
        raise InvalidInput(f"heyoka cannot be given '{x}': there is no translation of {name}")

    return walk(sp.sympify(e))
