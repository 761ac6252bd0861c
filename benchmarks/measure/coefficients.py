r"""Turns coefficients from a JSON record into a step: a splitting or a Runge-Kutta method.

``{"a": [...], "b": [...], "first": "A"}`` is the splitting :math:`\dots e^{b_1 h B} e^{a_1 h A}`: drifts by ``a`` and
kicks by ``b`` alternate, beginning with the longer list or with ``first`` ("A" for drifts).  ``{"gamma": [...]}`` is
the composition of leapfrog steps over these fractions of h, which begin with a kick or with ``first``.  ``{"A":
[[...]], "b": [...]}`` is the Runge-Kutta method of that tableau, implicit if A is not strictly lower triangular.
Numbers are JSON numbers or texts such as "1/6"; they are read exactly and rounded to the precision of h.  The keys
``claims`` and ``requires`` are optional.

Printed decimals are rounded: `shift` changes their last digit, and what that changes in a residual, `DIGITS_EXPLAIN`
times over, is rounding.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure import own_step as own_steps
from phasebench.benchmarks.measure.own_step import OwnStep
from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from phasebench.benchmarks.certificate.stepping import Exact
    from phasebench.benchmarks.measure.own_step import System
    from phasebench.integrators.values.kinds import Number

KEYS = ("a", "b", "gamma", "A", "c", "first", "name", "claims", "requires")
#: Largest number of fixed-point iterations for the stages of an implicit tableau.
ITERATIONS = 200
FORM = (
    'write {"a": [...], "b": [...]} for a splitting, {"gamma": [...]} for a composition of leapfrog steps, or '
    '{"A": [[...]], "b": [...]} for a tableau'
)
#: A residual up to this many times what a change of the last digits makes is rounding.
DIGITS_EXPLAIN = 10
#: The change of the last digits: one unit, or this part of the number, which a double hardly resolves; signs by a seed.
LAST_DIGIT, SEED = Fraction(1, 10**15), 1
#: How numbers are changed: not at all, in the last printed digit, or in the last one that doubles resolve too.
EXACT, PRINTED, DOUBLES = range(3)
#: Decimals of fewer digits are choices, not rounded numbers.
CHOICE = 12


class _Decimal(Fraction):
    """The exact value of a decimal, with its ``text``."""

    def __new__(cls, *number: str | int) -> _Decimal:
        self = super().__new__(cls, *number)
        self.text = str(number[0])
        return self


def from_file(path: str) -> OwnStep:
    """Make the step of a JSON file of coefficients; raise InvalidInput if it cannot be read or does not hold them."""
    try:
        record = json.loads(Path(path).read_text(encoding="utf-8"), parse_float=_Decimal)
    except OSError as error:
        raise InvalidInput(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InvalidInput(f"{path} is no JSON: {error}") from None
    return replace(own_step(record, path), again=from_file)


def own_step(record: object, name: str) -> OwnStep:
    """Make the step of a splitting or Runge-Kutta method from its coefficients, ``record`` as in a JSON file.

    ``name`` becomes the step's id and is named in messages.  Raises InvalidInput for a malformed record.
    """
    if not isinstance(record, Mapping):
        raise InvalidInput(f"{name} is a {type(record).__name__}; {FORM}")
    strange = [str(key) for key in record if key not in KEYS]
    if strange or {"a", "b", "A", "gamma"} & {*record} not in ({"a", "b"}, {"A", "b"}, {"gamma"}):
        raise InvalidInput(f"{name}{f' has {strange[0]!r}' if strange else ''}: {FORM}")
    claims = own_steps.checked_claims(record.get("claims", {}), f"{name}: claims")
    make, default = (_tableau, ()) if "A" in record else (_splitting, ("separable",))
    requires = own_steps.checked_requires(record.get("requires", default), f"{name}: requires")
    step, changed = (make(record, name, change) for change in (EXACT, DOUBLES))
    return OwnStep(name, step, claims, requires, changed=changed, exchanged=_exchanged(record, name))


def is_rounded(number: str) -> bool:
    """True if a number as text was rounded: a decimal of many digits, or a long integer of a rational approximation."""
    return "." not in number or len(number.partition(".")[2]) >= CHOICE


def shift(number: str, change: int) -> Fraction:
    """Return what to add to a rounded number, as text, to change its last digit, with a sign by the text and `SEED`.

    A decimal is changed by a unit of the digit that ``change`` names, `PRINTED` or `DOUBLES`, an integer by
    `LAST_DIGIT`.
    """
    sign = 1 if zlib.crc32(f"{SEED} {number}".encode()) % 2 else -1
    relative = LAST_DIGIT * Fraction(number)
    if "." not in number:
        return sign * relative
    unit = Fraction(1, 10 ** len(number.partition(".")[2]))
    return sign * (unit if change == PRINTED else max(unit, relative))


def _number(x: object, name: str, change: int = EXACT) -> Fraction:
    try:
        if isinstance(x, bool) or not isinstance(x, (int, float, str, Fraction)):
            raise ValueError
        text, value = str(getattr(x, "text", x)).strip().lstrip("+-"), Fraction(x)
        rounded = change and text.replace(".", "", 1).isdigit() and "." in text and is_rounded(text)
        return value + (shift(text, change) if rounded else 0)
    except (ValueError, OverflowError, ZeroDivisionError):
        raise InvalidInput(f"{name}: {x!r} is no number; write 0.25, or the text '1/4'") from None


def _numbers(values: object, key: str, name: str, change: int = EXACT) -> list[Fraction]:
    if isinstance(values, str) or not isinstance(values, Sequence) or not len(values):
        raise InvalidInput(f"{name}: {key} is {values!r}; it must be a list of numbers")
    return [_number(x, name, change) for x in values]


def _in(coefficient: Fraction, h: Number) -> Number:
    """Return an exact coefficient times h, in the precision of h (a double or a multiprecision number)."""
    if isinstance(h, float):
        return float(coefficient) * h
    return h * coefficient.numerator / coefficient.denominator


def _exchanged(record: Mapping[str, Any], name: str) -> tuple[str, Callable] | None:
    """(the entry of ``first`` that begins a splitting of as many drifts as kicks with the other one, its step)."""
    if "a" not in record or len(record["a"]) != len(record["b"]):
        return None
    first = "A" if record.get("first") == "B" else "B"
    return f'"first": "{first}"', _splitting({**record, "first": first}, name)


def _splitting(
    record: Mapping[str, Any], name: str, change: int = EXACT
) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    if "gamma" in record:
        first, begin = record.get("first", "B"), _numbers(record["gamma"], "gamma", name, change)
        halves = [(x + y) / 2 for x, y in pairwise([Fraction(0), *begin, Fraction(0)])]
        a, b = (halves, begin) if first == "A" else (begin, halves)
    else:
        a, b = (_numbers(record[key], key, name, change) for key in "ab")
        first = record.get("first", "B" if len(b) > len(a) else "A")
    begin, other = (a, b) if first == "A" else (b, a)
    if first not in ("A", "B") or len(begin) - len(other) not in (0, 1):
        raise InvalidInput(f"{name}: {len(a)} drifts a and {len(b)} kicks b do not alternate from {first!r}")
    turns = [[(first, x), ("B" if first == "A" else "A", y)] for x, y in zip_longest(begin, other)]
    flows = [(letter, x) for turn in turns for letter, x in turn if x is not None]

    def step(system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number) -> tuple[np.ndarray, np.ndarray]:
        for letter, x in flows:
            if letter == "A":
                q = q + _in(x, h) * system.dH_dp(q, p)
            else:
                p = p - _in(x, h) * system.dH_dq(q, p)
        return q, p

    return step


def _tableau(record: Mapping[str, Any], name: str, change: int = EXACT) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    rows, b = record["A"], _numbers(record["b"], "b", name, change)
    if isinstance(rows, str) or not isinstance(rows, Sequence) or len(rows) != len(b):
        raise InvalidInput(f"{name}: A must have {len(b)} rows, one for each of b")
    A = [_numbers(row, "a row of A", name, change) for row in rows]
    if any(len(row) != len(b) for row in A):
        raise InvalidInput(f"{name}: a row of A must have {len(b)} numbers, one for each of b")
    explicit = all(x == 0 for i, row in enumerate(A) for x in row[i:])
    stages = _explicit if explicit else _implicit

    def step(system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number) -> tuple[np.ndarray, np.ndarray]:
        d = len(q)

        def slope(y: np.ndarray) -> np.ndarray:
            return np.concatenate([system.dH_dp(y[:d], y[d:]), -system.dH_dq(y[:d], y[d:])])

        y = np.concatenate([q, p])
        weights = [_in(x, h) for x in b]
        end = y + sum(w * k for w, k in zip(weights, stages(slope, y, A, h), strict=True))
        return end[:d], end[d:]

    return step


def _explicit(
    slope: Callable[[np.ndarray], np.ndarray], y: np.ndarray, A: Sequence[Sequence[Fraction]], h: Number
) -> list:
    slopes: list = []
    for row in A:
        slopes.append(slope(y + sum(_in(x, h) * k for x, k in zip(row, slopes, strict=False) if x)))
    return slopes


def _implicit(
    slope: Callable[[np.ndarray], np.ndarray], y: np.ndarray, A: Sequence[Sequence[Fraction]], h: Number
) -> list:
    """The stage derivatives by fixed-point iteration, until the change no longer falls."""
    rows = [[_in(x, h) for x in row] for row in A]
    slopes, last = [slope(y)] * len(A), None
    for _ in range(ITERATIONS):
        new = [slope(y + sum(w * k for w, k in zip(row, slopes, strict=True))) for row in rows]
        change = max(abs(x - z).max() for x, z in zip(new, slopes, strict=True))
        slopes = new
        if change == 0 or (last is not None and change >= last):
            return slopes
        last = change
    raise ArithmeticError(f"the stages do not converge in {ITERATIONS} iterations")
