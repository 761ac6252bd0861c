"""Rooted trees and the order conditions of Runge-Kutta methods.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), II.2, Theorem 2.13.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

import mpmath
import numpy as np

DIGITS = 50


@cache
def trees(n: int) -> tuple[tuple, ...]:
    """The rooted trees with n vertices, each a sorted tuple of its branches."""

    def forests(vertices: int, largest: int) -> Iterator[tuple]:
        if vertices == 0:
            yield ()
        for k in range(1, min(vertices, largest) + 1):
            for tree in trees(k):
                for rest in forests(vertices - k, k):
                    yield tuple(sorted((tree, *rest)))

    return tuple(sorted(set(forests(n - 1, n - 1))))


def density(tree: tuple) -> tuple[int, int]:
    """(number of vertices, density gamma) of a tree."""
    parts = [density(branch) for branch in tree]
    vertices = 1 + sum(n for n, _ in parts)
    return vertices, vertices * int(np.prod([g for _, g in parts], dtype=object))


def order_residual(A: np.ndarray, b: np.ndarray, orders: Iterable[int]) -> mpmath.mpf:
    """Largest residual of a Runge-Kutta method's conditions of all rooted trees with ``orders`` vertices."""
    known = {}

    def weights(tree: tuple) -> np.ndarray:
        if tree not in known:
            known[tree] = b * 0 + 1
            for branch in tree:
                known[tree] = known[tree] * (A @ weights(branch))
        return known[tree]

    return max(abs((b * weights(t)).sum() - mpmath.mpf(1) / density(t)[1]) for n in orders for t in trees(n))


def vector(x: Iterable[Any]) -> np.ndarray:
    """Convert numbers to an object array of mpmath numbers."""
    return np.array([mpmath.mpf(a) for a in x], dtype=object)
