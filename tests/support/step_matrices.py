"""Exact step matrices of methods on the oscillator q' = z p, p' = -z q, from their published coefficients.

A step matrix maps (q, p) to the state after one step of length 1; its entries are functions of the symbol z = `Z`.
"""

from __future__ import annotations

import itertools

import sympy as sp

Z = sp.Symbol("z", positive=True)
#: Digits of irrational coefficients; magnitude that counts as zero; distance at which roots count as equal.
DIGITS, TINY, NEAR = 60, sp.Float("1e-45"), sp.Float("1e-18")


def drift(c):
    """Return the matrix of the drift q -> q + c z p on (q, p)."""
    return sp.Matrix([[1, c * Z], [0, 1]])


def product(*matrices):
    """Return the product of step matrices, the first argument applied first."""
    total = sp.eye(2)
    for M in matrices:
        total = (M * total).applyfunc(sp.expand)
    return total


def first_end(M):
    """Return the z at which the interval of stable steps from 0 ends; M(z) is a step matrix on the oscillator.

    0 if there is no such interval, infinity if it is unbounded. The eigenvalues lie in the unit disc if 1 - tr + det,
    1 + tr + det and 1 - det are not negative (Jury).
    """
    trace, det = M.trace(), M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
    ends = [_first_loss(margin) for margin in (1 - trace + det, 1 + trace + det, 1 - det)]
    return min(ends)


def _first_loss(margin):
    """Return the smallest z >= 0 just beyond which a rational function of z is negative; infinity if there is none."""
    above, below = (sp.Poly(sp.expand(part), Z) for part in sp.fraction(sp.together(margin)))
    if all(abs(c) < TINY for c in above.all_coeffs()):
        return sp.oo
    roots = sorted(
        {sp.re(r) for part in (above, below) for r in _roots(part) if abs(sp.im(r)) < NEAR and sp.re(r) > NEAR}
    )
    points = [sp.Integer(0), *roots, (roots[-1] if roots else 1) * 2]
    for a, b in itertools.pairwise(points):
        middle = (a + b) / 2
        if above.eval(middle) / below.eval(middle) < 0:
            return a
    return sp.oo


def _roots(poly):
    """Return the complex roots of a polynomial, without multiplicity if its coefficients are rational."""
    if poly.degree() <= 0:
        return []
    exactly = poly.sqf_part() if poly.domain.is_ZZ or poly.domain.is_QQ else poly
    return exactly.nroots(n=40, maxsteps=500)
