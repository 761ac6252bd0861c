"""Exact step matrices of methods on the oscillator q' = z p, p' = -z q, from their published coefficients.

A step matrix maps (q, p) to the state after one step of length 1; its entries are functions of the symbol z = `Z`.
"""

from __future__ import annotations

import itertools

import sympy as sp

Z = sp.Symbol("z", positive=True)
HALF = sp.Rational(1, 2)
#: Digits of irrational coefficients; magnitude that counts as zero; distance at which roots count as equal.
DIGITS, TINY, NEAR = 60, sp.Float("1e-45"), sp.Float("1e-18")


def kick(c):
    """Return the matrix of the kick p -> p - c z q on (q, p)."""
    return sp.Matrix([[1, 0], [-c * Z, 1]])


def drift(c):
    """Return the matrix of the drift q -> q + c z p on (q, p)."""
    return sp.Matrix([[1, c * Z], [0, 1]])


def product(*matrices):
    """Return the product of step matrices, the first argument applied first."""
    total = sp.eye(2)
    for M in matrices:
        total = (M * total).applyfunc(sp.expand)
    return total


def splitting(drifts, kicks):
    """Return the step matrix of the splitting method that applies kick k before drift k, k = 1, 2, ...

    ``drifts`` and ``kicks`` are their lengths, equally many.
    """
    return product(*(M for a, b in zip(drifts, kicks, strict=True) for M in (kick(b), drift(a))))


def two_stages(b):
    """Return the step matrix of the symmetric splitting with kicks b, 1 - 2 b, b and drifts 1/2 between them."""
    return product(kick(b), drift(HALF), kick(1 - 2 * b), drift(HALF), kick(b))


def verlets(*fractions):
    """Return the step matrix of a composition of Stormer-Verlet steps whose lengths are these fractions of the step."""
    return product(*(M for c in fractions for M in (kick(c / 2), drift(c), kick(c / 2))))


def parametric(*substeps):
    """Return the step matrix of a composition of substeps (c, lam) of Scheme I.

    A substep is dq = c z (p + lam dp), dp = -c z (q + (1 - lam) dq).
    """
    total = sp.eye(2)
    for c, lam in substeps:
        x = c * Z
        left = sp.Matrix([[1, -x * lam], [x * (1 - lam), 1]])
        total = (left.inv() * sp.Matrix([[1, x * (1 - lam)], [-x * lam, 1]]) * total).applyfunc(sp.cancel)
    return total


def runge_kutta(A, b, conjugate=None):
    """Return the step matrix of a partitioned Runge-Kutta method with weights b.

    The tableau is A for q, and ``conjugate`` (default A) for p.
    """
    A, s = sp.Matrix(A), len(b)
    C = A if conjugate is None else sp.Matrix(conjugate)
    left = sp.eye(2 * s)
    left[:s, s:], left[s:, :s] = -Z * A, Z * C  # Q - z A P = q, P + z C Q = p
    start = sp.Matrix([[1, 0]] * s + [[0, 1]] * s)
    stages = left.LUsolve(start)
    weights = sp.Matrix([list(b)])
    change = sp.Matrix.vstack(Z * weights * stages[s:, :], -Z * weights * stages[:s, :])
    return (sp.eye(2) + change).applyfunc(sp.cancel)


def pade(above: int, below: int):
    """Return the step matrix of the method whose stability function is a Pade approximation of exp.

    ``above`` and ``below`` are the degrees of its numerator and denominator.
    """
    x = sp.Symbol("x")

    def series(k, j):
        f = sp.factorial
        return sum(
            f(k) * f(k + j - i) / (f(k - i) * f(k + j) * f(i)) * (x if j == below else -x) ** i for i in range(k + 1)
        )

    P, Q = series(above, below), series(below, above) if above != below else series(below, above).subs(x, -x)
    R = sp.cancel((P / Q).subs(x, sp.I * Z))
    real, imaginary = (sp.cancel(part) for part in ((R + R.conjugate()) / 2, (R - R.conjugate()) / (2 * sp.I)))
    return sp.Matrix([[real, imaginary], [-imaginary, real]])


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
