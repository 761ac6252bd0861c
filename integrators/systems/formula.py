"""Parse formulae that a user types, by a whitelist: Python's parser makes the syntax tree, nothing is evaluated.

A formula consists of decimal numbers, + - * / ** and parentheses, the functions of `FUNCTIONS`, the constants pi and e,
and the variables that the caller names.  An integer is exact, and a decimal is the double that Python reads; but in an
exponent a decimal is the fraction that it stands for: q**0.1 is q**(1/10).  Formulae that SymPy would not process in
any reasonable time (towers of powers, sums that expand to millions of terms) are refused by limits on their size.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from math import ceil, comb, isfinite, lcm

from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput

NAMES = ("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "asin", "acos", "atan")
#: Name in a formula -> SymPy's.
FUNCTIONS = {name: name for name in NAMES} | {"ln": "log", "abs": "Abs", "Abs": "Abs"}
CONSTANTS = {"pi": "pi", "e": "E"}
#: Limits of a text: the number of its characters, and the depth of its nested brackets.
LONGEST, DEEPEST = 10_000, 25
#: Limits of an exponent: its size and its denominator.
LARGEST_POWER, LARGEST_ROOT = 100, 1000
#: Digits of an integer as it is typed; bits of a numerator or denominator that numbers combine to:
#: generated code divides two doubles, and those end there.
DIGITS, BITS = 30, 1023
#: Limits of an expression: nodes of its tree, and terms after its products and powers are multiplied out.
NODES, TERMS = 20_000, 5_000
SHOWN = 60

_FOREIGN = re.compile(r"[^A-Za-z0-9_+\-*/().,^\s]|[^\x00-\x7f]")
_NUMBER = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


def parse(text: str, variables: Mapping[str, sp.Expr]) -> sp.Expr:
    """Parse a formula in ``variables``, numbers and the functions of `FUNCTIONS`; return it as a SymPy expression.

    Parameters
    ----------
    text : the formula
    variables : name -> symbol, or the number that a name stands for; they take precedence over the constants pi and e

    Raises
    ------
    InvalidInput
        For anything else in the text, which the message names; for a formula that is not real and finite, or larger
        than the limits of the module.
    """
    try:
        expression = _read(_tree(text), variables, 0)
        if expression.has(sp.zoo, sp.oo, -sp.oo, sp.nan):
            raise InvalidInput("it is not finite: it has a constant part such as 1/0 or log(0)")
        if expression.has(sp.I):
            raise InvalidInput("it is not real: it has a root or logarithm of a negative number")
        _check_expansion(expression)
    except InvalidInput as error:
        raise InvalidInput(f"the formula {_format(text)} cannot be used: {error}") from None
    except RecursionError:
        raise InvalidInput(f"the formula {_format(text)} is nested too deep") from None
    return expression


def parse_equation(text: str, variables: Mapping[str, sp.Expr]) -> sp.Expr:
    """Parse a formula, or an equation "left = right" as left - right; raises InvalidInput as `parse`."""
    if text.count("=") != 1:
        return parse(text, variables)
    left, right = (parse(side, variables) for side in text.split("="))
    return left - right


def names(text: str) -> list[str]:
    """The names in a formula that are not called as functions, sorted; raises InvalidInput as `parse`."""
    try:
        tree = _tree(text)
    except InvalidInput as error:
        raise InvalidInput(f"the formula {_format(text)} cannot be used: {error}") from None
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    return sorted({node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and id(node) not in called})


def _format(text: str) -> str:
    return repr(text) if len(text) <= SHOWN else f"{text[:SHOWN]!r}... of {len(text)} characters"


def _tree(text: str) -> ast.expr:
    """The syntax tree of a formula; raises InvalidInput for characters or syntax that are not allowed."""
    if len(text) > LONGEST:
        raise InvalidInput(f"it has {len(text)} characters; the most is {LONGEST}")
    if not text.strip():
        raise InvalidInput("it is empty")
    foreign = _FOREIGN.search(text)
    if foreign:
        raise InvalidInput(f"the character {foreign.group()!a} stands in no formula")
    for number in _NUMBER.finditer(text):
        after = re.match(r"\w+|\.", text[number.end() :])
        if after:
            raise InvalidInput(
                f"'{number.group()}{after.group()}' is no decimal number; a product is written with *, as in 2*q"
            )
    depth = 0
    for c in text:
        depth += (c == "(") - (c == ")")
        if depth > DEEPEST:
            raise InvalidInput(f"its brackets are nested more than {DEEPEST} deep")
    try:
        return ast.parse(" ".join(text.split()), mode="eval").body
    except (SyntaxError, ValueError) as error:
        raise InvalidInput(f"{getattr(error, 'msg', error)}") from None
    except (RecursionError, MemoryError):
        raise InvalidInput("it is nested too deep") from None


def _chain(node: ast.BinOp, kinds: tuple[type, ...]) -> list[tuple[type, ast.expr]]:
    """List the operands of a chain such as a - b + c, in order, as pairs (class of the operator before it, operand).

    ``kinds`` are the classes of the operators that form a chain; the first operand gets the first of them.  The loop
    replaces a recursion, so that a sum of a thousand terms does not count as deeply nested.
    """
    operands: list[tuple[type, ast.expr]] = []
    while isinstance(node, ast.BinOp) and isinstance(node.op, kinds):
        operands.append((type(node.op), node.right))
        node = node.left
    return [(kinds[0], node), *reversed(operands)]


def _read(node: ast.expr, variables: Mapping[str, sp.Expr], depth: int) -> sp.Expr:
    if depth > 2 * DEEPEST:
        raise InvalidInput(f"it is nested more than {2 * DEEPEST} deep")

    def read(x: ast.expr) -> sp.Expr:
        return _read(x, variables, depth + 1)

    match node:
        case ast.Constant(value=value) if type(value) in (int, float):
            return _number(value)
        case ast.Name(id=name):
            return _name(name, variables)
        case ast.UnaryOp(op=ast.USub(), operand=x):
            return -read(x)
        case ast.UnaryOp(op=ast.UAdd(), operand=x):
            return read(x)
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            terms = _chain(node, (ast.Add, ast.Sub))
            return _check_number(sp.Add(*(read(x) if op is ast.Add else -read(x) for op, x in terms)))
        case ast.BinOp(op=ast.Mult() | ast.Div()):
            product = sp.Integer(1)
            for op, x in _chain(node, (ast.Mult, ast.Div)):
                product = _product(product, read(x), op is ast.Div)
            return product
        case ast.BinOp(op=ast.Pow(), left=a, right=b):
            return _power(read(a), read(b))
        case ast.BinOp(op=ast.BitXor()):
            raise InvalidInput("'^' is no power; write **")
        case ast.Call(func=ast.Name(id=name), args=[x], keywords=[]) if name in FUNCTIONS and name not in variables:
            if not isinstance(x, ast.Starred):
                return _apply(getattr(sp, FUNCTIONS[name]), read(x))
        case ast.Call(func=ast.Name(id=name)):
            known = ", ".join(FUNCTIONS)
            raise InvalidInput(f"'{name}' is no function of one argument among {known}; a product is written with *")
        case ast.Call():
            raise InvalidInput("brackets follow what is no function; a product is written with *")
    raise InvalidInput(f"{ast.unparse(node)!r} ({type(node).__name__}) stands in no formula")


def _number(value: int | float) -> sp.Rational:
    if isinstance(value, int) and value >= 10**DIGITS:
        raise InvalidInput(f"a number has more than {DIGITS} digits; write it as a decimal")
    if not isfinite(value):
        raise InvalidInput("a number is too large for a double")
    return _check_number(sp.Rational(value))


def _name(name: str, variables: Mapping[str, sp.Expr]) -> sp.Expr:
    if name in variables:
        return variables[name]
    if name in CONSTANTS:
        return getattr(sp, CONSTANTS[name])
    if name in FUNCTIONS:
        raise InvalidInput(f"'{name}' is a function: write {name}(...)")
    if name == "t":
        raise InvalidInput(time_hint(len(variables) // 2 + 1))
    raise InvalidInput(f"'{name}' is none of the variables {', '.join(variables)}")


def _check_number(e: sp.Expr) -> sp.Expr:
    """Return ``e``, or raise InvalidInput if it has a long number, or is a constant whose value is not real and finite.

    This guarantees that SymPy never gets a number that it would take long to evaluate.
    """
    coefficient = e.as_coeff_Mul()[0]
    if coefficient.is_Rational and _bits(coefficient) > BITS and sp.Rational(float(coefficient)) != coefficient:
        raise InvalidInput(_LONG)
    if not e.is_Rational and not e.free_symbols:
        value = complex(e.evalf()) if not e.has(sp.zoo, sp.nan, sp.oo, -sp.oo) else complex("nan")
        if not isfinite(value.real) or not isfinite(value.imag):
            raise InvalidInput(f"its constant part {_format(str(e))} is not finite, or too large for a double")
        if abs(value.imag) > 1e-12 * abs(value):
            raise InvalidInput(f"its constant part {_format(str(e))} is not real")
    return e


def _bits(x: sp.Rational) -> int:
    return max(int(x.p).bit_length(), int(x.q).bit_length())


_LONG = (
    f"a number in it takes more than {BITS} bits as a fraction; write its value as a decimal, in units in which it is "
    "between 1e-290 and 1e300"
)


def _exponents(e: sp.Expr) -> Iterable[tuple[sp.Expr, sp.Expr]]:
    """Pairs (base, exponent) of those factors of ``e`` that are powers."""
    return [f.as_base_exp() for f in sp.Mul.make_args(e) if f.is_Pow]


def _product(a: sp.Expr, b: sp.Expr, divide: bool) -> sp.Expr:
    if divide and b == 0:
        raise InvalidInput("it divides by zero")
    # SymPy gathers roots of numbers over their common denominator and raises the numbers to it.
    if lcm(1, *(n.q for e in (a, b) for _, n in _exponents(e) if n.is_Rational)) > LARGEST_ROOT:
        raise InvalidInput(f"the denominators of its exponents have a common one above {LARGEST_ROOT}")
    return _small_powers(_check_number(a / b if divide else a * b))


def _small_powers(e: sp.Expr) -> sp.Expr:
    for _, n in _exponents(e):
        if n.is_Rational and (abs(n) > LARGEST_POWER or n.q > LARGEST_ROOT):
            raise InvalidInput(f"its factors combine to a power {n}; the largest is {LARGEST_POWER}")
    return e


def _power(base: sp.Expr, n: sp.Expr) -> sp.Expr:
    """base**n; raises InvalidInput where its numbers or powers would become large."""
    if base == sp.E:
        return _apply(sp.exp, n)
    if not n.is_Rational:
        raise InvalidInput(f"the power {_format(str(n))} is no rational number; write exp(y*log(x)) for x**y")
    if abs(n) > LARGEST_POWER:
        raise InvalidInput(f"a power is of size {float(n):.3g}; the largest is {LARGEST_POWER}")
    near = Fraction(int(n.p), int(n.q)).limit_denominator(LARGEST_ROOT)
    if float(near) != float(n):
        raise InvalidInput(f"the power {float(n)!r} is no fraction of a denominator up to {LARGEST_ROOT}")
    n = sp.Rational(near.numerator, near.denominator)
    if base == 0 and n < 0:
        raise InvalidInput("it divides by zero")
    coefficient = base.as_coeff_Mul()[0]
    if coefficient.is_Rational and abs(coefficient) != 1 and _bits(coefficient) * abs(n) > BITS:
        raise InvalidInput(_LONG)
    for _, m in _exponents(base):
        if m.is_Rational and (abs(m * n) > LARGEST_POWER or m.q * n.q > LARGEST_ROOT):
            raise InvalidInput(f"a power {m} is raised to {n}; the largest in all is {LARGEST_POWER}")
    return _small_powers(_check_number(base**n))


def _apply(function: Callable[[sp.Expr], sp.Expr], x: sp.Expr) -> sp.Expr:
    """Return function(x) for a function of SymPy, which simplifies it; raises InvalidInput if it becomes too large."""
    if function is sp.sqrt:
        return _power(x, sp.Rational(1, 2))
    if function is sp.exp:
        for term in sp.Add.make_args(x):  # SymPy writes exp(c log y) as y**c
            c, rest = term.as_coeff_Mul()
            if isinstance(rest, sp.log) and c != 1:
                return _product(_power(rest.args[0], c), _apply(sp.exp, x - term), False)
    value = _check_number(function(x))
    if not (isinstance(value, sp.Function) and value.args == (x,)):
        _small_powers(value)
        _count(value)  # tan(asin(x)) holds x twice: such a chain doubles at every link
    return value


def _count(e: sp.Expr) -> None:
    stack, seen = [e], 0
    while stack:
        seen += 1
        if seen > NODES:
            raise InvalidInput(f"it simplifies to more than {NODES} terms and factors")
        stack += stack.pop().args


def _check_expansion(e: sp.Expr) -> None:
    """Raise InvalidInput if ``e`` grows too large when products and powers are multiplied out, as derivatives do."""
    _count(e)
    inner = [0]

    def terms(x: sp.Expr) -> int:
        if x.is_Add:
            return _check_count(sum(map(terms, x.args)))
        if x.is_Mul:
            count = 1
            for f in x.args:
                count = _check_count(count * terms(f))
            return count
        if x.is_Pow and x.exp.is_Rational:
            m, n = terms(x.base), ceil(abs(x.exp))
            return _check_count(comb(m + n - 1, n))
        for a in x.args:
            inner[0] = _check_count(inner[0] + terms(a))
        return 1

    _check_count(terms(e) + inner[0])


def _check_count(n: int) -> int:
    if n > TERMS:
        raise InvalidInput(f"multiplied out it has more than {TERMS} terms; the most is {TERMS}")
    return n


def time_hint(n: int) -> str:
    """Return the hint, for error messages, on how to enter an H that depends on t: time becomes coordinate number n."""
    return (
        f"H depends on the time t: make time a coordinate, write q{n} for t and add p{n} to H, as in "
        f"p1**2/2 - q1*cos(q{n}) + p{n}; it starts from q{n} = 0 and any p{n}, such as 0"
    )
