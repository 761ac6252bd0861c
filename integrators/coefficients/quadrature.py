r"""Quadrature on [0, 1] and the polynomials behind it, at any precision.

Gauss-Legendre: the nodes are the zeros of the Legendre polynomial :math:`L_n`, the rule is exact to degree 2n - 1.
Gauss-Lobatto: both ends and the zeros of :math:`L_{n-1}'`, exact to degree 2n - 3.
Radau: the right end and the other zeros of :math:`L_n - L_{n-1}`, exact to degree 2n - 2.

The orthonormal Legendre polynomials on [0, 1] and their integrals are

.. math::
    P_j(c) = \sqrt{2j + 1}\,L_j(2c - 1),\qquad
    \int_0^c P_j = \frac{L_{j+1}(2c - 1) - L_{j-1}(2c - 1)}{2\sqrt{2j + 1}},\quad j \ge 1 .

Source: M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions (1964), chapters 22 and 25; E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II (1996), IV.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

from phasebench.integrators.compile.lazy import mpmath

#: Sizes of the rules for an H that is no polynomial, in doubles and at higher precision.
RULES, LARGE = (2, 3, 4, 6, 8, 12, 16, 24, 32), (8, 12, 16, 24, 32, 48, 64)


def sizes(s: int, degree: int | None, rules: tuple[int, ...] = RULES) -> tuple[int, ...]:
    """The numbers of nodes of quadrature rules for integrals of grad H along a polynomial of degree s in time.

    If H is a polynomial of a known ``degree``, a single number, with which Gauss's rule is exact; if that is None, the
    numbers among ``rules`` from s on, which are tried in turn.
    """
    if degree:
        return (max(s, -(-s * degree // 2)),)
    return tuple(k for k in rules if k >= s)


def _legendre(n: int, x: mpmath.mpf) -> list:
    """The values [L_0(x), ..., L_n(x)] of the Legendre polynomials on [-1, 1]."""
    values = [mpmath.mpf(1), mpmath.mpf(x)]
    for k in range(2, n + 1):
        values.append(((2 * k - 1) * x * values[-1] - (k - 1) * values[-2]) / k)
    return values[: n + 1]


def _slope(n: int, x: mpmath.mpf, values: Sequence[mpmath.mpf]) -> mpmath.mpf:
    """The derivative L_n'(x) of the Legendre polynomial inside (-1, 1), from ``values`` = [L_0(x), ..., L_n(x)]."""
    return n * (x * values[n] - values[n - 1]) / (x * x - 1)


def _root(x: mpmath.mpf, move: Callable, digits: int) -> mpmath.mpf:
    """The zero near x by Newton's method; ``move(x)`` is the function's value divided by its slope."""
    for _ in range(100):
        step = move(x)
        x -= step
        if abs(step) < mpmath.mpf(10) ** (-digits - 5):
            break
    return x


@cache
def gauss_legendre(nodes: int, digits: int = 40) -> list[tuple]:
    """[(node, weight), ...] of the Gauss-Legendre rule on [0, 1], as mpmath numbers to ``digits`` digits."""

    def move(x: mpmath.mpf) -> mpmath.mpf:
        values = _legendre(nodes, x)
        return values[nodes] / _slope(nodes, x, values)

    with mpmath.workdps(digits + 10):
        rule = []
        for i in range(nodes):
            x = _root(mpmath.cos(mpmath.pi * (i + mpmath.mpf(3) / 4) / (nodes + mpmath.mpf(1) / 2)), move, digits)
            slope = _slope(nodes, x, _legendre(nodes, x))
            rule.append(((1 - x) / 2, 1 / ((1 - x * x) * slope * slope)))
        return rule


def gauss_lobatto(nodes: int, digits: int = 40) -> list[tuple]:
    """[(node, weight), ...] of the Gauss-Lobatto rule of at least 2 nodes on [0, 1]."""
    n = nodes - 1

    def move(x: mpmath.mpf) -> mpmath.mpf:
        values = _legendre(n, x)
        slope = _slope(n, x, values)
        return slope * (1 - x * x) / (2 * x * slope - n * (n + 1) * values[n])  # L'' from Legendre's equation

    with mpmath.workdps(digits + 10):
        inner = [_root(mpmath.cos(mpmath.pi * i / n), move, digits) for i in range(1, n)]
        points = [mpmath.mpf(1), *inner, mpmath.mpf(-1)]
        return [((1 - x) / 2, 1 / (n * (n + 1) * _legendre(n, x)[n] ** 2)) for x in points]


def radau_right(nodes: int, digits: int = 40) -> list[tuple]:
    """[(node, weight), ...] of the Radau rule on [0, 1] with the right end as a node."""
    n = nodes

    def move(x: mpmath.mpf) -> mpmath.mpf:
        values = _legendre(n, x)
        return (values[n] - values[n - 1]) / (_slope(n, x, values) - _slope(n - 1, x, values))

    with mpmath.workdps(digits + 10):
        # The zeros lie between those of L_n, near these points (Abramowitz & Stegun 25.4.31).
        inner = [_root(-mpmath.cos(mpmath.pi * (2 * i - 1) / (2 * n - 1)), move, digits) for i in range(1, n)]
        rule = []
        for x in [*inner, mpmath.mpf(1)]:
            rule.append(((1 + x) / 2, (1 + x) / (2 * n * n * _legendre(n, x)[n - 1] ** 2)))
        return rule


def legendre(count: int, c: mpmath.mpf) -> list:
    """The values [P_0(c), ..., P_{count-1}(c)] of the Legendre polynomials that are orthonormal on [0, 1]."""
    values = _legendre(count, 2 * c - 1)
    return [mpmath.sqrt(2 * j + 1) * values[j] for j in range(count)]


def legendre_integrals(count: int, c: mpmath.mpf) -> list:
    """The integrals from 0 to c of the Legendre polynomials P_0, ..., P_{count-1} that are orthonormal on [0, 1]."""
    values = _legendre(count, 2 * c - 1)
    higher = [(values[j + 1] - values[j - 1]) / (2 * mpmath.sqrt(2 * j + 1)) for j in range(1, count)]
    return [mpmath.mpf(c), *higher][:count]
