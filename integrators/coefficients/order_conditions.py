r"""Orders of splittings and compositions from their coefficients alone, without integrating anything.

A step is a product of exponentials of non-commuting letters, a series over words (the free associative algebra).
It has order p if its coefficients of all words of degree up to p equal those of the exact flow.

- ``splitting``: :math:`\prod_k e^{b_k B} e^{a_k A}` against :math:`e^{A + B}`, A the drift and B the kick.
- ``nystrom``: the same where T is quadratic.  Then :math:`[B, [B, [B, A]]] = 0`, and words are equal modulo the ideal
  of this relation.  Its leading word BBBA does not overlap itself, so that :math:`BBBA \to 3BBAB - 3BABB + ABBB`
  reduces every word to one normal form (G. M. Bergman, Adv. Math. 29 (1978) 178-218).
- ``near-integrable``: for H = A + eps B; the order is (p_1, p_2, ...), where the error of the terms with eps^k is
  O(eps^k h^(p_k + 1)).
- ``composition``: of a symmetric base of order 2, :math:`e^{Y_1 + Y_3 + Y_5 + \dots}` with :math:`Y_n` of degree n,
  over the fractions: :math:`\prod_k e^{g_k Y_1 + g_k^3 Y_3 + \dots}` against :math:`e^{Y_1}`.

Sources: Hairer, Lubich, Wanner (2006), III.4-5; S. Blanes, F. Casas, A Concise Introduction to Geometric Numerical
Integration (2016), chapter 3; McLachlan, SIAM J. Sci. Comput. 16 (1995) 151-168; Blanes et al., Appl. Numer. Math. 68
(2013) 58-72 (generalised order).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from math import comb
from typing import TYPE_CHECKING

import mpmath
import numpy as np

from .fractions import DIGITS

if TYPE_CHECKING:
    from .force_gradient import Substep

#: A residual below this is zero; that of the next degree has to exceed `VISIBLE`.
TOLERANCE, VISIBLE = mpmath.mpf("1e-38"), mpmath.mpf("1e-12")
KINDS = ("splitting", "nystrom", "near-integrable", "composition")

Key = tuple[int, int]
Residuals = dict[Key, np.ndarray]


# -- two letters: words of n letters are the numbers 0 ... 2^n - 1, a digit 1 for each B -----------------------------


@cache
def _numbers(n: int, k: int) -> np.ndarray:
    """The words of n letters A, B, k of them B, as increasing integers: a binary digit 0 for each A, 1 for each B."""
    return np.array([w for w in range(2**n) if w.bit_count() == k])


def _times_exponential(letter: str, a: mpmath.mpf, series: Residuals) -> Residuals:
    """The series from the left times exp(a letter): (n, k) -> coefficients of the words in the order of `_numbers`."""
    out = {key: x.copy() for key, x in series.items()}
    for n, k in out:
        factor = mpmath.mpf(1)
        for j in range(1, (k if letter == "B" else n - k) + 1):
            factor = factor * a / j
            # Words that begin with j letters A are the first of their length, those with j letters B the last.
            rest = series[n - j, k - j if letter == "B" else k]
            part = slice(-len(rest), None) if letter == "B" else slice(len(rest))
            # The array first: mpmath tries to convert it, and to print it in its refusal, before NumPy multiplies.
            out[n, k][part] = out[n, k][part] + rest * factor
    return out


def _blocks(steps: Iterable[tuple[str, mpmath.mpf]], degrees: Sequence[int]) -> Residuals:
    """Coefficients of a step minus the exact flow's, by (n, k): words of n letters, k of them B, n <= `_limit`."""
    keys = [(n, k) for n in range(max(degrees) + 1) for k in range(n + 1) if n <= _limit(degrees, k)]
    series = {(n, k): np.full(comb(n, k), mpmath.mpf(n == 0), dtype=object) for n, k in keys}
    for letter, a in reversed(list(steps)):
        series = _times_exponential(letter, a, series)
    return {(n, k): x - 1 / mpmath.factorial(n) for (n, k), x in series.items()}


def words(steps: Iterable[tuple[str, mpmath.mpf]], degree: int) -> list[np.ndarray]:
    """Coefficients of a splitting's step minus those of exp(A + B): for each degree n an array (2^n,) over words."""
    every = [np.empty(2**n, dtype=object) for n in range(degree + 1)]
    for (n, k), x in _blocks(steps, (degree,)).items():
        every[n][_numbers(n, k)] = x
    return every


@cache
def _reductions(n: int) -> tuple[tuple[int, int, int, int], ...]:
    """The reductions of words of n letters that contain BBBA, from the largest word to the smallest.

    Each is (word with BBBA, those with BBAB, BABB, ABBB in its place), words as integers of n bits.
    """
    out = []
    for word in range(2**n - 1, -1, -1):
        for shift in range(n - 3):
            if (word >> shift) & 15 == 0b1110:
                out.append((word, *(word ^ ((0b1110 ^ other) << shift) for other in (0b1101, 0b1011, 0b0111))))
                break
    return tuple(out)


def normal_form(residual: np.ndarray) -> np.ndarray:
    """The coefficients of the words without BBBA, by which [B, [B, [B, A]]] = 0 expresses all, from those of all."""
    out = residual.copy()
    reductions = _reductions(len(out).bit_length() - 1)
    for word, bbab, babb, abbb in reductions:
        c = out[word]
        out[bbab] += 3 * c
        out[babb] -= 3 * c
        out[abbb] += c
    return np.delete(out, [r[0] for r in reductions])


# -- modified kicks exp(b B + c C), C = [B, [A, B]] (`force_gradient`) ----------------------------------------------


def _times_kick(b: mpmath.mpf, c: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    out, term = [x.copy() for x in series], series
    for k in range(1, len(series)):
        term = _times_generator(b / k, c / k, term)
        out = [x + y for x, y in zip(out, term, strict=True)]
    return out


def _times_generator(b: mpmath.mpf, c: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    """The series, as in `words`, from the left times b B + c C, with C = 2 BAB - BBA - ABB."""
    out = [x * 0 for x in series]
    for n in range(1, len(series)):
        out[n][2 ** (n - 1) :] = series[n - 1] * b
        if n >= 3 and c != 0:
            for prefix, factor in ((0b101, 2), (0b110, -1), (0b011, -1)):
                part = slice(prefix * 2 ** (n - 3), (prefix + 1) * 2 ** (n - 3))
                out[n][part] = out[n][part] + series[n - 3] * (factor * c)
    return out


def _times_drift(a: mpmath.mpf, series: list[np.ndarray]) -> list[np.ndarray]:
    out = [x.copy() for x in series]
    for n in range(1, len(series)):
        factor = mpmath.mpf(1)
        for k in range(1, n + 1):
            factor = factor * a / k
            out[n][: 2 ** (n - k)] = out[n][: 2 ** (n - k)] + series[n - k] * factor
    return out


def modified_residuals(steps: Sequence[Substep], degree: int) -> list[np.ndarray]:
    """Coefficients of a step minus exp(A + B), the exact flow: for each degree 0, ..., ``degree`` an array over words.

    ``steps`` are the step's substeps.  A word is a product of letters A and B, as many as its degree; words are reduced
    to normal form by [B, [B, [B, A]]] = 0.
    """
    with mpmath.workdps(max(DIGITS, mpmath.mp.dps)):
        series = [np.full(2**n, mpmath.mpf(n == 0), dtype=object) for n in range(degree + 1)]
        for letter, weight, c in reversed(list(steps)):
            series = _times_drift(weight, series) if letter == "A" else _times_kick(weight, c, series)
        return [normal_form(x - 1 / mpmath.factorial(n)) for n, x in enumerate(series)]


# -- the letters Y_1, Y_3, Y_5, ... of a symmetric base --------------------------------------------------------------


@cache
def odd_words(weight: int) -> tuple[tuple[int, ...], ...]:
    """The sequences of odd numbers with the sum ``weight``: (1, 1, 1), (3,) for 3."""
    if weight == 0:
        return ((),)
    return tuple((first, *rest) for first in range(1, weight + 1, 2) for rest in odd_words(weight - first))


def odd_residuals(fractions: Sequence[mpmath.mpf], weight: int) -> list[np.ndarray]:
    """A composition's coefficients minus the exact flow's: for n = 0, ..., ``weight`` an array over `odd_words(n)`."""
    every = [w for n in range(weight + 1) for w in odd_words(n)]
    inverse = [1 / mpmath.factorial(k) for k in range(weight + 1)]
    series = {w: mpmath.mpf(not w) for w in every}
    for g in fractions:
        powers = [g**n for n in range(weight + 1)]
        step = {w: powers[sum(w)] * inverse[len(w)] for w in every}
        series = {w: sum(step[w[:i]] * series[w[i:]] for i in range(len(w) + 1)) for w in every}
    exact = {w: inverse[len(w)] if set(w) <= {1} else 0 for w in every}
    return [np.array([series[w] - exact[w] for w in odd_words(n)], dtype=object) for n in range(weight + 1)]


# -- orders ----------------------------------------------------------------------------------------------------------


def _limit(degrees: Sequence[int], k: int) -> int:
    """The largest degree at the power k of eps: the last entry holds for higher powers, the first for 0, too."""
    return degrees[min(max(k, 1), len(degrees)) - 1]


def residuals(kind: str, steps: Sequence, degrees: int | Sequence[int]) -> Residuals:
    """The differences of a method's coefficients from the exact flow's: {(degree, power of eps): array over words}.

    The power of eps is 0 unless the kind is "near-integrable".

    Parameters
    ----------
    kind : one of `KINDS`
    steps : pairs (letter, coefficient), A the drift and B the kick; for a composition the fractions alone
    degrees : the largest degree of words; for "near-integrable" it may be a falling sequence, a degree for each power
        of eps from 1 on
    """
    degrees = (degrees,) if isinstance(degrees, int) else degrees
    with mpmath.workdps(max(DIGITS, mpmath.mp.dps)):
        if kind == "near-integrable":
            return {key: r for key, r in _blocks(steps, degrees).items() if key != (0, 0)}
        if kind == "composition":
            every = odd_residuals(steps, max(degrees))
        elif kind in KINDS:
            every = words(steps, max(degrees))
        else:
            raise ValueError(f"there is no kind '{kind}'; known are {', '.join(KINDS)}")
        return {(n, 0): normal_form(r) if kind == "nystrom" else r for n, r in enumerate(every) if n}


def next_degrees(order: Sequence[int]) -> tuple[int, ...]:
    """The degrees p + 1 at which a method of the order (p,) or (p_1, p_2, ...) has its first nonzero residuals."""
    return tuple(p + 1 for p in order)


def norm(residual: Iterable) -> mpmath.mpf:
    """The 2-norm, in full precision."""
    with mpmath.workdps(DIGITS):
        return mpmath.sqrt(mpmath.fsum(x * x for x in residual))


def conditions(errors: Residuals, order: Sequence[int]) -> list[Key]:
    """The keys of those residuals, from `residuals`, that are zero for a method of an order (p,) or (p_1, p_2, ...)."""
    return [(n, k) for n, k in errors if n <= _limit(order, k)]


def excess(errors: Residuals, order: Sequence[int]) -> mpmath.mpf:
    """The largest residual, in absolute value, of the `conditions` of an order."""
    return max(abs(x) for key in conditions(errors, order) for x in errors[key])


def leading_norms(errors: Residuals, order: Sequence[int]) -> tuple[mpmath.mpf, ...]:
    """The 2-norms of the first residuals beyond an order: of (p,), or of each power of eps of (p_1, p_2, ...)."""
    if len(order) == 1:
        return (norm(errors[order[0] + 1, 0]),)
    return tuple(norm(errors[p + 1, k]) for k, p in enumerate(order, 1))


def classical_order(kind: str, steps: Sequence, tolerance: mpmath.mpf | float = TOLERANCE, limit: int = 12) -> int:
    """The order of a method: the largest p such that all its residuals up to degree p are within ``tolerance``.

    ``kind`` and ``steps`` are as for `residuals`; raises ValueError if the order is ``limit`` or more.
    """
    for p in range(1, limit + 1):
        errors = residuals(kind, steps, p)
        if any(abs(x) > tolerance for (n, _), r in errors.items() if n == p for x in r):
            return p - 1
    raise ValueError(f"the order is at least {limit}")
