"""Formulae that a user types, read by a whitelist: Python's syntax tree is walked, nothing is evaluated."""

from __future__ import annotations

import ast
from collections.abc import Mapping

import sympy as sp

from .errors import InvalidInput

NAMES = ("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "asin", "acos", "atan")
FUNCTIONS = {name: getattr(sp, name) for name in NAMES} | {"ln": sp.log, "abs": sp.Abs}
CONSTANTS = {"pi": sp.pi, "e": sp.E}
OPERATORS = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
LONGEST, LARGEST_POWER = 10_000, 100


def parse(text: str, variables: Mapping[str, sp.Symbol]) -> sp.Expr:
    """The expression that ``text`` writes in ``variables``, numbers, + - * / ** and the functions of `FUNCTIONS`.

    An integer is exact, a decimal the double that Python reads; ``^`` is no power.

    Raises
    ------
    InvalidInput
        For anything else, naming it.
    """
    if len(text) > LONGEST:
        raise InvalidInput(f"the formula has {len(text)} characters; the most is {LONGEST}")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        found = _read(tree.body, variables)
    except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"the formula {text!r} cannot be read: {error}") from None
    if found.has(sp.zoo, sp.oo, -sp.oo, sp.nan):
        raise InvalidInput(f"the formula {text!r} is not finite: it has a constant part such as 1/0 or log(0)")
    return found


def _read(node: ast.AST, variables: Mapping[str, sp.Symbol]) -> sp.Expr:
    match node:
        case ast.Constant(value=value) if type(value) is int:
            if abs(value) > 10**30:
                raise InvalidInput("a number in the formula has more than 30 digits; write it as a decimal")
            return sp.Integer(value)
        case ast.Constant(value=value) if type(value) is float:
            if value != value or abs(value) == float("inf"):
                raise InvalidInput("a number in the formula is too large for a double")
            return sp.Rational(value)
        case ast.Name(id=name):
            if name in variables:
                return variables[name]
            if name in CONSTANTS:
                return CONSTANTS[name]
            raise InvalidInput(f"'{name}' in the formula is none of the variables {', '.join(variables)}")
        case ast.UnaryOp(op=ast.USub(), operand=x):
            return -_read(x, variables)
        case ast.UnaryOp(op=ast.UAdd(), operand=x):
            return _read(x, variables)
        case ast.BinOp(op=op, left=a, right=b) if type(op) in OPERATORS:
            left, right = _read(a, variables), _read(b, variables)
            if isinstance(op, ast.Pow) and not (right.is_Number and abs(right) <= LARGEST_POWER):
                raise InvalidInput(f"a power in the formula is no number of size at most {LARGEST_POWER}")
            if isinstance(op, ast.Pow) and left.is_Number and left.is_Integer and abs(left) > 1000:
                raise InvalidInput("a power of a large number in the formula; write its value")
            if isinstance(op, ast.Div) and right == 0:
                raise InvalidInput("the formula divides by zero")
            return OPERATORS[type(op)](left, right)
        case ast.Call(func=ast.Name(id=name), args=[x], keywords=[]) if name in FUNCTIONS:
            return FUNCTIONS[name](_read(x, variables))
        case ast.Call(func=ast.Name(id=name)):
            raise InvalidInput(f"'{name}' in the formula is no function of one argument among {', '.join(FUNCTIONS)}")
        case ast.BinOp(op=ast.BitXor()):
            raise InvalidInput("'^' in the formula: write a power as **")
    raise InvalidInput(f"the formula has a {type(node).__name__}, which no formula needs")
