r"""Filter functions and linear propagators of the trigonometric integrators, as functions of :math:`\xi = h\omega`.

Source: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), XIII.2.
"""

from __future__ import annotations

from phasebench.integrators.compile.lazy import mpmath


def one(x: mpmath.mpf) -> mpmath.mpf:
    """The filter that changes nothing: 1 for every x."""
    return mpmath.mpf(1)


def sinc(x: mpmath.mpf) -> mpmath.mpf:
    """The filter sin(x) / x, 1 at 0; mpmath forms it to full relative precision, also at multiples of pi."""
    return mpmath.sinc(x)


def sinc_squared(x: mpmath.mpf) -> mpmath.mpf:
    """The filter sinc^2 x, with sinc x = sin(x) / x."""
    return sinc(x) ** 2


def tanc_half(x: mpmath.mpf) -> mpmath.mpf:
    """The filter tan(x/2) / (x/2) = sinc^2(x/2) / sinc x; poles at the odd multiples of pi."""
    return sinc(x / 2) / mpmath.cos(x / 2)


def hochbruck_lubich(x: mpmath.mpf) -> mpmath.mpf:
    """The filter of Hochbruck and Lubich, sinc x (1 + sin^2(x/2) / 3), with sinc x = sin(x) / x."""
    return sinc(x) * (1 + mpmath.sin(x / 2) ** 2 / 3)


# -- propagators: (R11, R12 / h, -R21 h / x^2) of the matrix R that maps (q, p) over the step h, with x = h omega


def rotation(x: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]:
    """The propagator of the exact flow of an oscillator."""
    return mpmath.cos(x), sinc(x), sinc(x)


def cayley(x: mpmath.mpf) -> tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]:
    """The propagator of the implicit midpoint rule."""
    d = 1 + x**2 / 4
    return (1 - x**2 / 4) / d, 1 / d, 1 / d


def verlet_power(x: mpmath.mpf, n: int) -> tuple[mpmath.mpf, mpmath.mpf, mpmath.mpf]:
    """The propagator of n Stormer-Verlet steps of h / n: Chebyshev polynomials T_n and U_(n-1) at 1 - (x/n)^2 / 2."""
    z = (x / n) ** 2
    c = 1 - z / 2
    u = mpmath.chebyu(n - 1, c) / n
    return mpmath.chebyt(n, c), u, u * (1 - z / 4)
