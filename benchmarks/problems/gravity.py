"""Formulae of bodies that attract each other: coordinates, distances, invariants, H, and its Kepler part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import sympy as sp

from phasebench.integrators.families.wisdom_holman import KeplerPart, jacobi

#: The mass of a test particle over the central body's: its pull on the others is below the rounding of doubles.
MASSLESS = 1e-20


def bodies(
    N: int, axes: str, first: int = 1
) -> tuple[list[sp.Symbol], list[sp.Symbol], list[tuple[int, int]], list[sp.Expr], dict[str, sp.Expr]]:
    """Make the formulae of N point masses: (symbols q, symbols p, pairs (i, j), their distances, name -> invariant).

    Coordinates stand body after body; their names have an axis ("xy" or "xyz") and a number, from ``first`` on.
    """
    D = len(axes)
    names = [f"{axis}{i}" for i in range(first, first + N) for axis in axes]
    q, p = sp.symbols(names, real=True), sp.symbols([f"p{n}" for n in names], real=True)
    x, v = ([sp.Matrix(z[i : i + D]) for i in range(0, len(z), D)] for z in (q, p))
    pairs = list(combinations(range(N), 2))
    distances = [sp.sqrt(sum(s**2 for s in x[j] - x[i])) for i, j in pairs]
    planes = [(0, 1)] if D == 2 else [(1, 2), (2, 0), (0, 1)]
    turning = [sp.Add(*(a[i] * b[j] - a[j] * b[i] for a, b in zip(x, v, strict=True))) for i, j in planes]
    kept = {f"momentum-{k + 1}": sp.Add(*(b[k] for b in v)) for k in range(D)}
    kept |= (
        {f"angular-momentum-{k + 1}": L for k, L in enumerate(turning)} if D == 3 else {"angular-momentum": turning[0]}
    )
    return q, p, pairs, distances, kept


def newton(
    p: Sequence[sp.Symbol],
    masses: Sequence,
    G: sp.Rational | int,
    pairs: Sequence[tuple[int, int]],
    distances: Sequence[sp.Expr],
) -> sp.Expr:
    """Return H = sum |p_i|^2 / (2 m_i) - sum G m_i m_j / r_ij, exact; pairs and distances are of `bodies`."""
    D = len(p) // len(masses)
    T = (x**2 / (2 * masses[i // D]) for i, x in enumerate(p))
    V = (-G * masses[i] * masses[j] / r for (i, j), r in zip(pairs, distances, strict=True))
    return sp.Add(*T, *V)


def kepler_part(masses: Sequence, G: sp.Rational | int, order: Sequence[int], dimension: int = 3) -> KeplerPart:
    """Return the Kepler part of H in Jacobi's coordinates, bodies in ``order`` (indices, the central one first)."""
    part = jacobi([masses[i] for i in order], G, dimension)
    place = {body: column for column, body in enumerate(order)}
    change = tuple(tuple(row[place[i]] for i in range(len(masses))) for row in part.change)
    return KeplerPart(part.dimension, part.masses, part.mu, change)


def barycentre(q: Sequence[sp.Symbol], masses: Sequence) -> Mapping[str, sp.Expr]:
    """Return name -> expression of the coordinates of the centre of mass, which rests if the total momentum is zero."""
    D, total = len(q) // len(masses), sum(masses)
    return {
        f"barycentre-{k + 1}": sp.Add(*(m / total * x for m, x in zip(masses, q[k::D], strict=True))) for k in range(D)
    }
