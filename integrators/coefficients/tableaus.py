r"""Tableaus of implicit Runge-Kutta methods and of HBVM as `families.collocation` takes them, at any precision.

HBVM are Hamiltonian boundary value methods.  Collocation at nodes c, with their Lagrange polynomials :math:`\ell_j`:
:math:`a_{ij} = \int_0^{c_i} \ell_j`, :math:`b_j = \int_0^1 \ell_j`: Gauss, Lobatto IIIA, Radau IIA.  Lobatto IIIB is
the symplectic conjugate of IIIA, :math:`b_i a^q_{ij} + b_j a^p_{ji} = b_i b_j`.

Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), II.1.2, II.2.2, VI.4; L. Brugnano,
F. Iavernaro, D. Trigiante, J. Numer. Anal. Ind. Appl. Math. 5 (2010) 17-37 (HBVM).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

from phasebench.integrators.compile.lazy import mpmath

from .quadrature import gauss_legendre, gauss_lobatto, legendre, legendre_integrals, radau_right

#: The start of a stage equation is extrapolated from its solutions in at most this many steps.
LEVELS = 5
#: The highest degree of the polynomial that extrapolates the increments.
DEGREE = 9
#: The kinds of `runge_kutta` whose rules are symmetric.
SYMMETRIC = ("gauss", "lobatto-iiia-iiib")


def collocation(nodes: Sequence) -> tuple:
    """(A, b) of the collocation method with these nodes, as mpmath matrices in the working precision."""
    s = len(nodes)
    P = mpmath.matrix([legendre(s, c) for c in nodes]).T
    integrals = mpmath.matrix([legendre_integrals(s, c) for c in nodes]).T
    inverse = P**-1
    return (inverse * integrals).T, inverse * mpmath.matrix([1] + [0] * (s - 1))


def runge_kutta(kind: str, s: int) -> tuple:
    """(A^q, A^p, b, c) of an s-stage method, as mpmath matrices and a list, in the working precision.

    ``kind`` is "gauss", "radau-iia" or "lobatto-iiia-iiib" (A^q of IIIA, A^p its symplectic conjugate, IIIB).
    """
    rule = {"gauss": gauss_legendre, "radau-iia": radau_right, "lobatto-iiia-iiib": gauss_lobatto}[kind]
    c = [x for x, _ in rule(s, mpmath.mp.dps)]
    A, b = collocation(c)
    conjugate = A
    if kind == "lobatto-iiia-iiib":
        conjugate = mpmath.matrix(s, s)
        for i in range(s):
            for j in range(s):
                conjugate[i, j] = b[j] - b[j] * A[j, i] / b[i]
    return A, conjugate, b, c


def round_to_grid(A: mpmath.matrix, unit: mpmath.mpf) -> mpmath.matrix:
    """Round a matrix A to multiples of ``unit``: if two entries add up to 1, the rounded ones do so exactly."""
    return A.apply(lambda x: mpmath.nint(x / unit) * unit)


def nystrom_rounded(A: mpmath.matrix, c: Sequence[mpmath.mpf], unit: mpmath.mpf) -> tuple:
    """Round A and c to multiples of ``unit`` so that A_ij - A_ji = c_i - c_j holds exactly.

    It is a condition of symplecticity for methods on H = p . M^-1 p / 2 + V(q), which rounding must not violate.  Both
    are returned unrounded if the given A and c do not fulfil it.
    """
    s = len(c)
    if A.rows != A.cols or max(abs(A[i, j] - A[j, i] - c[i] + c[j]) for i in range(s) for j in range(s)) > 1e-30:
        return A, c
    A, c = round_to_grid(A, unit), list(round_to_grid(mpmath.matrix(c), unit))
    for i in range(s):
        for j in range(i):
            A[i, j] = A[j, i] + c[i] - c[j]
    return A, c


def rounded_weights(b: Sequence[mpmath.mpf], unit: mpmath.mpf) -> list:
    """Round the weights of a symmetric rule of k nodes so that b_i = b_{k+1-i} and sum_i b_i = 1 hold exactly.

    Otherwise a method would change the phase, and HBVM(k, s) the energy, by the same rounding error in every step.
    Weighted sums must be formed before they are multiplied by h: the rounded h b_i do not add up to h.
    """
    k = len(b)
    b = [mpmath.nint(4 * x / unit) * unit / 4 for x in b]
    inner = (k - 1) // 2
    b[inner] = b[k - 1 - inner] = (1 - 2 * mpmath.fsum(b[:inner])) / (1 if k % 2 else 2)
    return b


def rounded_rule(c: Sequence[mpmath.mpf], b: Sequence[mpmath.mpf], unit: mpmath.mpf) -> tuple[list, list]:
    """Round a Gauss rule such that c_i + c_{k+1-i} = 1, sum_i b_i = 1 and sum_i b_i c_i = 1/2 hold exactly."""
    return [mpmath.nint(2 * x / unit) * unit / 2 for x in c], rounded_weights(b, unit)


def exact(kind: str, s: int, k: int) -> tuple:
    """(A^q, A^p, B, w, c) of a method in the form of `families.collocation`, unrounded mpmath matrices.

    With s increments x and the nodes c the stages are y + A x, the equations x = h B f(stages), the result y + w x.
    ``kind`` is "hbvm" (k nodes) or a kind of `runge_kutta` (then k = s).
    """
    if kind != "hbvm":
        A, conjugate, b, c = runge_kutta(kind, s)
        divided = [mpmath.matrix(s, s), mpmath.matrix(s, s)]
        for i in range(s):
            for j in range(s):
                divided[0][i, j], divided[1][i, j] = A[i, j] / b[j], conjugate[i, j] / b[j]
        return *divided, mpmath.diag(list(b)), mpmath.ones(1, s), c
    rule = gauss_legendre(k, mpmath.mp.dps)
    A = mpmath.matrix([legendre_integrals(s, x) for x, _ in rule])
    B = mpmath.matrix([[b * P for P in legendre(s, x)] for x, b in rule]).T
    return A, A, B, mpmath.matrix([[1] + [0] * (s - 1)]), [x for x, _ in rule]


def extrapolation(B: mpmath.matrix, c: Sequence[mpmath.mpf]) -> list[tuple]:
    """Weights that predict a step's s increments from those of the last m steps: s rows for each m = 1, 2, ... .

    They are exact for f a polynomial in time of degree `DEGREE`, or of the highest degree that m steps determine if
    that is lower.  m goes up to `LEVELS` for s = 1, else up to 2.  ``B`` and ``c`` are the method's, as from `exact`.
    """
    s = B.rows
    shared = int(c[0] == 0 and c[-1] == 1)
    out = []
    for m in range(1, max(2, LEVELS // s) + 1):
        degree = min(m * (s - shared) + shared - 1, DEGREE)
        basis = [[[mpmath.chebyt(k, 2 * (x - n) / m + 1) for k in range(degree + 1)] for x in c] for n in range(m + 1)]
        following, *earlier = [B * mpmath.matrix(T) for T in basis]
        past = mpmath.matrix([row for T in earlier for row in T.tolist()])
        weights = following * mpmath.inverse(past.T * past) * past.T  # the smallest of all that are exact
        out += [tuple(map(float, row)) for row in weights.tolist()]
    return out


class Tableau(NamedTuple):
    """The coefficients of a method with stages y + A x, increments x = h B f(stages) and result y + w x.

    Attributes
    ----------
    weights : rows w^q and w^p, for q and for p
    c : nodes
    A_q, A_p : rows of A for q and for p
    B : rows of the transpose of B
    extrapolation : weights that predict x from earlier steps, as from `extrapolation`
    """

    weights: tuple
    c: tuple
    A_q: tuple
    A_p: tuple
    B: tuple
    extrapolation: list


@cache
def tableau(kind: str, s: int, k: int, nystrom: bool, digits: int, unit: mpmath.mpf) -> Tableau:
    """The `Tableau` of a method with s increments and k nodes, rounded to ``unit`` where symplecticity requires it.

    ``kind`` is as for `exact`, ``digits`` the working precision.  With ``nystrom`` only the increments of p are unknown
    (H = p . M^-1 p / 2 + V(q)): then A_q and A_p are both A^q B A^p, and w^q is w B A^p.
    """
    with mpmath.workdps(digits):
        A, C, B, w, c = exact(kind, s, k)
        if kind == "hbvm":
            c, b = rounded_rule(c, [B[0, i] for i in range(k)], unit)
            for i in range(k):
                A[i, 0], B[0, i] = c[i], b[i]
        weights = w
        if nystrom:
            A, weights = A * B * C, w * B * C
            A, c = nystrom_rounded(A, c, unit)
            if kind != "hbvm" and max(abs(weights[j] - 1 + c[j]) for j in range(s)) < 2 * unit:
                weights = [1 - x for x in c]
            C = A
        elif kind != "hbvm":
            A, C = round_to_grid(A, unit), round_to_grid(C, unit)
        start = extrapolation(B, c)
        if kind in SYMMETRIC:
            B = mpmath.diag(rounded_weights([B[i, i] for i in range(k)], unit))
        A_q, A_p, B_T = (tuple(map(tuple, M.tolist())) for M in (A, C, B.T))
        return Tableau((tuple(weights), tuple(w)), tuple(c), A_q, A_p, B_T, start)
