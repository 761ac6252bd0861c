r"""Symmetric linear multistep methods for x'' = f(x): coefficients, exact order conditions, stability.

.. math::
    \sum_{j=0}^k \alpha_j\,x_{n+j} = h^2\sum_{j=0}^k \beta_j\,f_{n+j},\qquad
    \rho(z) = \sum_j \alpha_j z^j,\quad \sigma(z) = \sum_j \beta_j z^j,

with :math:`\alpha_j = \alpha_{k-j}, \beta_j = \beta_{k-j}, \beta_0 = 0`.  The order is p where
:math:`\sum_j\alpha_j j^r = r(r-1)\sum_j\beta_j j^{r-2}` for :math:`r = 0, \dots, p + 1`.  Everything here is in exact
fractions, but for the roots of polynomials.

On the oscillator :math:`x'' = -\omega^2 x` a step is stable where all roots of :math:`\rho + H^2\sigma`,
:math:`H = h\omega`, are simple and of modulus 1.  Divided by :math:`z^{k/2}` both polynomials are polynomials A, B of
degree k / 2 in :math:`c = (z + 1/z)/2`, and the condition is that A + H^2 B has k / 2 different roots in (-1, 1).
It changes only where two of them meet, :math:`A'B = AB', H^2 = -A/B`, or where one is at 1 or -1.

Sources: G. D. Quinlan, S. Tremaine, Astron. J. 100 (1990) 1694-1700; the numbers as the program Principia has them
(`integrators/methods.hpp`); J. D. Lambert, I. A. Watson, J. Inst. Math. Appl. 18 (1976) 189-202 (intervals of
periodicity); P. Console, E. Hairer, BIT 54 (2014) (rho with (z - 1)^2 divided out).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import lcm
from typing import NamedTuple

from phasebench.integrators.compile.lazy import mpmath

from .fractions import mirror

Polynomial = tuple[Fraction, ...]
#: Digits of the ends of stable intervals.
DIGITS = 60


class Multistep(NamedTuple):
    """The coefficients alpha_0, ..., alpha_k of a multistep method, and numerators and denominator of the beta_j."""

    alpha: tuple[int, ...]
    numerators: tuple[int, ...]
    denominator: int

    @property
    def rho(self) -> Polynomial:
        """The coefficients of the polynomial rho(z), lowest power first."""
        return tuple(map(Fraction, self.alpha))

    @property
    def sigma(self) -> Polynomial:
        """The coefficients of the polynomial sigma(z), lowest power first."""
        return tuple(Fraction(x, self.denominator) for x in self.numerators)


def symmetric(alpha: Sequence[int], numerators: Sequence[int], denominator: int) -> Multistep:
    """Make a symmetric multistep method; alpha and beta are given by their first halves with the middle."""
    return Multistep(mirror(alpha), mirror(numerators), denominator)


#: The methods of Quinlan and Tremaine by their order, which is the number k of their steps.
QUINLAN_TREMAINE = {
    8: symmetric((1, -2, 2, -1, 0), (0, 17671, -23622, 61449, -50516), 12096),
    10: symmetric((1, -1, 1, -1, 1, -2), (0, 399187, -485156, 2391436, -2816732, 4651330), 241920),
    12: symmetric(
        (1, -2, 2, -1, 0, 0, 0),
        (0, 90987349, -229596838, 812627169, -1628539944, 2714971338, -3041896548),
        53222400,
    ),
    14: symmetric(
        (1, -2, 2, -1, 0, 0, 0, 0),
        (
            0,
            433489274083,
            -1364031998256,
            5583113380398,
            -14154444148720,
            28630585332045,
            -42056933842656,
            48471792742212,
        ),
        237758976000,
    ),
}


def order(rho: Polynomial, sigma: Polynomial) -> int:
    """The largest p for which the order conditions hold; -2 if none does.  Coefficients stand lowest power first."""
    r = 0
    while _condition(rho, sigma, r) == 0:
        r += 1
    return r - 2


def _condition(rho: Sequence, sigma: Sequence, r: int) -> Fraction:
    left = sum(a * Fraction(j) ** r for j, a in enumerate(rho))
    return left - (r * (r - 1) * sum(b * Fraction(j) ** (r - 2) for j, b in enumerate(sigma)) if r > 1 else 0)


def stormer(order: int, k: int = 0) -> Multistep:
    """Make Stormer's explicit method, x_n+1 - 2 x_n + x_n-1 = h^2 sum_j beta_j f_j, with ``order`` earlier values f_j.

    It is written as a method of k steps; by default k is the order, the smallest possible number, and for a larger k
    the coefficients of the oldest values are 0.  Only the method of order 2 is symmetric.
    """
    alpha = (*(0,) * (order - 2), 1, -2, 1)
    right = [_condition(alpha, (), r + 2) / ((r + 1) * (r + 2)) for r in range(order)]
    beta = (*moments(range(order), right), Fraction(0))
    denominator = lcm(*(x.denominator for x in beta))
    missing = (0,) * max(k - order, 0)
    return Multistep((*missing, *alpha), (*missing, *(int(x * denominator) for x in beta)), denominator)


def divide_by_root_one(polynomial: Sequence) -> tuple:
    """The coefficients of polynomial / (z - 1), lowest power first as in ``polynomial``; ValueError if 1 is no root."""
    out, rest = [], 0
    for a in reversed(polynomial):
        rest = rest + a
        out.append(rest)
    if out.pop() != 0:
        raise ValueError("1 is no root of the polynomial")
    return tuple(reversed(out))


def reduced(rho: Sequence) -> tuple:
    """The coefficients of rho / (z - 1)^2, lowest power first."""
    return divide_by_root_one(divide_by_root_one(rho))


def moments(nodes: Sequence[int], right: Sequence[Fraction]) -> tuple[Fraction, ...]:
    """Solve sum_j w_j nodes_j^r = right_r, r = 0, ..., n - 1, for the weights w at n nodes, in exact fractions."""
    n = len(nodes)
    rows = [[Fraction(x) ** r for x in nodes] + [Fraction(right[r])] for r in range(n)]
    for i in range(n):
        pivot = next(r for r in range(i, n) if rows[r][i] != 0)
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for r in range(n):
            if r != i:
                rows[r] = [x - rows[r][i] * y for x, y in zip(rows[r], rows[i], strict=True)]
    return tuple(row[-1] for row in rows)


def velocity_weights(k: int) -> tuple[Fraction, ...]:
    """The weights d_j of a formula for the velocity at the newest of k equidistant times, where x'' = f.

    v_n = (x_n - x_n-1) / h + h sum_j d_j f_n-j, j = 0, ..., k - 1: exact for x a polynomial of degree k + 1.
    """
    return moments(range(k), [Fraction(1, (r + 1) * (r + 2)) for r in range(k)])


def parasitic_roots(rho: Sequence) -> list:
    """The parasitic roots: all roots of rho except the double one at 1 and those at 0, as mpmath numbers."""
    rest = list(reduced(rho))
    while rest[0] == 0:
        rest.pop(0)
    return _roots(rest)


def _roots(polynomial: Sequence) -> list:
    """All roots of a polynomial with rational coefficients, lowest power first, to `DIGITS` digits."""
    with mpmath.workdps(DIGITS):
        leading = [mpmath.mpf(Fraction(x).numerator) / Fraction(x).denominator for x in reversed(_trim(polynomial))]
        return mpmath.polyroots(leading, maxsteps=1000, extraprec=8 * DIGITS) if len(leading) > 1 else []


def _trim(polynomial: Sequence) -> list:
    out = list(polynomial)
    while len(out) > 1 and out[-1] == 0:
        out.pop()
    return out


# -- stability on the oscillator --------------------------------------------------------------------------------------


def in_cosine(palindrome: Sequence) -> Polynomial:
    """A palindrome of degree k in z, divided by z^(k/2), as a polynomial in c = (z + 1/z) / 2, lowest power first."""
    half = (len(palindrome) - 1) // 2
    total = [Fraction(0)] * (half + 1)
    for m in range(half + 1):
        weight = Fraction(palindrome[half + m]) * (2 if m else 1)
        for i, t in enumerate(_chebyshev(m)):
            total[i] += weight * t
    return tuple(total)


def _chebyshev(m: int) -> list[int]:
    a, b = [1], [0, 1]
    for _ in range(m):
        a, b = b, [2 * x - y for x, y in zip([0, *b], [*a, 0, 0], strict=False)]
    return a


def _derivative(p: Sequence) -> list:
    return [i * x for i, x in enumerate(p)][1:]


def _product(p: Sequence, q: Sequence) -> list:
    out = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            out[i + j] += x * y
    return out


def _value(p: Sequence, x: mpmath.mpf) -> mpmath.mpf:
    total = 0 * x
    for a in reversed(p):
        total = total * x + (mpmath.mpf(a.numerator) / a.denominator if isinstance(a, Fraction) else a)
    return total


def stable_intervals(table: Multistep) -> list[tuple[float, float]]:
    """All intervals (begin, end) of H = h omega in which the method ``table`` is stable on an oscillator, in order."""
    A, B = in_cosine(table.rho), in_cosine(table.sigma)
    meeting = [x - y for x, y in zip(_product(_derivative(A), [*B, 0]), _product([*A, 0], _derivative(B)), strict=True)]
    with mpmath.workdps(DIGITS):
        tiny = mpmath.mpf(10) ** (-DIGITS // 3)
        places = [mpmath.mpf(1), mpmath.mpf(-1), *(c.real for c in _roots(meeting) if abs(c.imag) < tiny)]
        squares = {_ratio(A, B, c) for c in places if abs(_value(B, c)) > tiny}
        ends = [mpmath.mpf(0), *(mpmath.sqrt(x) for x in sorted(squares) if x > tiny)]
        pieces: list[list] = []
        for a, b in pairwise([*ends, ends[-1] + 1]):
            if not _stable(A, B, ((a + b) / 2) ** 2):
                continue
            if pieces and pieces[-1][1] == a and _stable(A, B, a**2):
                pieces[-1][1] = b
            else:
                pieces.append([a, b])
    return [(float(a), float(b)) for a, b in pieces]


def _ratio(A: Sequence, B: Sequence, c: mpmath.mpf) -> mpmath.mpf:
    return -_value(A, c) / _value(B, c)


def _stable(A: Polynomial, B: Polynomial, square: mpmath.mpf) -> bool:
    """True if the polynomial A + H^2 B, of A and B from `in_cosine`, has as many roots in (-1, 1) as its degree."""
    numbers = [
        mpmath.mpf(a.numerator) / a.denominator + square * mpmath.mpf(b.numerator) / b.denominator
        for a, b in zip(A, B, strict=True)
    ]
    roots = mpmath.polyroots(numbers[::-1], maxsteps=1000, extraprec=8 * DIGITS)
    tiny = mpmath.mpf(10) ** (-DIGITS // 4)
    real = sorted(c.real for c in roots if abs(c.imag) < tiny and abs(c.real) < 1)
    return len(real) == len(roots) and all(b - a > tiny for a, b in pairwise(real))
