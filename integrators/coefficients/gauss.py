r"""Splittings SABA_n for A + eps B from Gauss's quadrature: generalised order (2n, 2).

The kicks act at the nodes of the Gauss-Legendre formula on [0, 1] with its weights, the drifts lead from node to node.
The local error is O(eps h^(2n + 1) + eps^2 h^3).

Source: J. Laskar, P. Robutel, Celest. Mech. Dyn. Astron. 80 (2001) 39-62, section 3; McLachlan, BIT 35 (1995) 258-268.
"""

from __future__ import annotations

from fractions import Fraction

import mpmath

from .fractions import DIGITS
from .table import Table


def legendre(n: int) -> list[Fraction]:
    """The coefficients of the Legendre polynomial P_n, highest first."""
    previous, current = [], [Fraction(1)]
    for k in range(n):
        first = [Fraction(2 * k + 1, k + 1) * c for c in current] + [Fraction(0)]
        shifted = [Fraction(0)] * (len(first) - len(previous)) + [Fraction(k, k + 1) * c for c in previous]
        previous, current = current, [a - b for a, b in zip(first, shifted, strict=True)]
    return current


def gauss(n: int) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
    """The Gauss-Legendre rule of n nodes on [0, 1]: (nodes in increasing order, their weights), to `DIGITS` digits."""
    with mpmath.workdps(DIGITS + 10):
        P = [mpmath.mpf(c.numerator) / c.denominator for c in legendre(n)]
        slope = [c * (n - k) for k, c in enumerate(P[:-1])]
        roots = sorted(mpmath.polyroots(P, maxsteps=200, extraprec=200))
        weights = [1 / ((1 - x * x) * mpmath.polyval(slope, x) ** 2) for x in roots]
        return [(1 + x) / 2 for x in roots], weights


def saba(n: int) -> Table:
    """The coefficients of the splitting SABA_n of Laskar and Robutel: n kicks at the nodes of Gauss's rule.

    SABA_1 is the drift-kick-drift form of Stormer-Verlet.
    """
    nodes, weights = gauss(n)
    with mpmath.workdps(DIGITS):
        gaps = [x - y for x, y in zip(nodes, [mpmath.mpf(0), *nodes[:-1]], strict=True)]
        a = tuple(mpmath.nstr(x, DIGITS) for x in gaps[: n // 2 + 1])
        b = tuple(mpmath.nstr(x, DIGITS) for x in weights[: (n + 1) // 2])
    source = f"Laskar & Robutel 2001, SABA_{n}"
    return Table(f"saba-{n}", "near-integrable", (2 * n, 2), source, ("laskar-robutel2001",), a=a, b=b, first="A")


TABLES: tuple[Table, ...] = (saba(2), saba(3), saba(4))
