r"""The coefficients of the parameterized generating function, from the Hamilton-Jacobi equation.

.. math::
    \partial_t S(u, v, t) = H\bigl(u - (1-\lambda)\,\partial_v S,\; v + \lambda\,\partial_u S\bigr),\qquad
    S = \sum_{i \ge 1} K_i(u, v)\,t^i .

Comparing powers of t: (i + 1) K_{i+1} is the coefficient of t^i of the right-hand side, a Taylor expansion of H about
(u, v) in the increments -(1-lambda) S_v and lambda S_u.  K_1 = H, K_2 = (lambda - 1/2) H_u . H_v.  The arguments of H
are in the order (p, q): u is p and v is q.

Source: Y. Wang, Y. Bo, W. Cai, "A general symplectic integrator for canonical Hamiltonian systems" (talk), equations
(13)-(18); K. Feng et al., J. Comput. Math. 7 (1989) 71-96.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from math import factorial

from phasebench.integrators.compile.lazy import sympy as sp


def __getattr__(name: str) -> sp.Symbol:
    # The symbol of the parameter; made with SymPy when it is asked for.
    if name == "LAMBDA":
        return sp.Symbol("family parameter", real=True)  # no name of a coordinate has a blank
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def _times(a: list[sp.Expr], b: list[sp.Expr], order: int) -> list[sp.Expr]:
    """The product of two power series in t, truncated after t**order; a series is the list of its coefficients."""
    c = [sp.Integer(0)] * (order + 1)
    for i, x in enumerate(a):
        if x != 0:
            for j, y in enumerate(b[: order + 1 - i]):
                if y != 0:
                    c[i + j] += x * y
    return c


def gradient(e: sp.Expr, variables: Sequence[sp.Symbol]) -> list[sp.Expr]:
    """The list of derivatives of ``e`` by each variable; terms of a sum without the variable are skipped, for speed."""
    terms: dict[sp.Symbol, list[sp.Expr]] = {x: [] for x in variables}
    for term in sp.Add.make_args(e):
        for x in term.free_symbols & terms.keys():
            terms[x].append(term)
    return [sp.diff(sp.Add(*found), x) for x, found in terms.items()]


def coefficients(
    H: sp.Expr, q: Sequence[sp.Symbol], p: Sequence[sp.Symbol], order: int, lam: sp.Expr | None = None
) -> list[sp.Expr]:
    """The coefficients K_1, ..., K_order of the generating function, as expressions in v = q, u = p and ``lam``.

    ``lam`` is the parameter lambda, by default the symbol `LAMBDA`.  Raises ValueError for order < 1.
    """
    if order < 1:
        raise ValueError(f"the order of a generating function is at least 1, not {order}")
    lam = __getattr__("LAMBDA") if lam is None else lam
    polynomial = H.is_polynomial(*q, *p)
    tidy = sp.expand if polynomial else (lambda e: e)
    variables = [*q, *p]
    K: list[sp.Expr] = [H]
    derivatives: dict[tuple[int, ...], sp.Expr] = {(): H}

    def derivative(indices: tuple[int, ...]) -> sp.Expr:
        if indices not in derivatives:
            derivatives[indices] = sp.diff(derivative(indices[:-1]), variables[indices[-1]])
        return derivatives[indices]

    for i in range(1, order):
        v = zip(*(gradient(k, p) for k in K), strict=True)  # v + lambda S_u
        u = zip(*(gradient(k, q) for k in K), strict=True)  # u - (1 - lambda) S_v
        shifts = [[sp.Integer(0), *(tidy(s * d) for d in x)] for s, side in ((lam, v), (lam - 1, u)) for x in side]
        terms = []
        products: dict[tuple[int, ...], list[sp.Expr]] = {(): [sp.Integer(1)]}
        for degree in range(1, i + 1):
            for indices in combinations_with_replacement(range(len(variables)), degree):
                D = derivative(indices)
                if D == 0:
                    continue
                products.setdefault(indices, _power(indices, shifts, products, i))
                c = products[indices][i] if len(products[indices]) > i else 0
                multiplicity = 1
                for k in set(indices):
                    multiplicity *= factorial(indices.count(k))
                terms.append(D * c / multiplicity)
        K.append(tidy(sp.Add(*terms) / (i + 1)))
    return K


def _power(
    indices: tuple[int, ...],
    shifts: list[list[sp.Expr]],
    products: dict[tuple[int, ...], list[sp.Expr]],
    order: int,
) -> list[sp.Expr]:
    """The product of the power series ``shifts[i]`` for i in ``indices``, up to t**order.

    A series is the list of its coefficients; ``products`` caches the products computed before, by their indices.
    """
    if indices in products:
        return products[indices]
    products[indices] = _times(_power(indices[:-1], shifts, products, order), shifts[indices[-1]], order)
    return products[indices]
