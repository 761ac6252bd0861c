"""Stability functions of Runge-Kutta methods, R(z) = det(I - z A + z 1 b^T) / det(I - z A), from their tableaus."""

from __future__ import annotations

import mpmath
import numpy as np

from phasebench.benchmarks.store.cells import Cell, Rows, content
from phasebench.integrators.coefficients.tableaus import runge_kutta
from phasebench.integrators.registry import BY_ID

#: Explicit methods, whose records have the tableau; implicit ones with the kind and stages of their tableau.
EXPLICIT = ("explicit-euler", "rk4", "dop853")
IMPLICIT = {"gauss-2": ("gauss", 2), "radau-iia-2": ("radau-iia", 2), "radau-iia-3": ("radau-iia", 3)}
TABLES = ("extremes_regions",)


def cells(quick: bool = False) -> list[Cell]:
    """List the single measurement (`Cell`), of all methods; none if ``quick``."""
    needs = content("regions", *(BY_ID[id] for id in (*EXPLICIT, *IMPLICIT)), code=[__name__])
    return [] if quick else [Cell("extremes", TABLES, {"regions": True}, measure_rows, (), needs, frozenset())]


def measure_rows() -> Rows:
    """Compute every method's stability function: rows with the coefficients of its numerator and denominator."""
    rows = []
    for id in (*EXPLICIT, *IMPLICIT):
        above, below = stability_function(*_tableau(id))
        texts = {name: " ".join(repr(float(c)) for c in poly) for name, poly in (("above", above), ("below", below))}
        rows.append({"regions": True, "method": id} | texts)
    return {TABLES[0]: rows}


def _tableau(id: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix A (s, s) and the weights b (s,) of a method."""
    if id in IMPLICIT:
        with mpmath.workdps(30):
            A, _, b, _ = runge_kutta(*IMPLICIT[id])
            return np.array(A.tolist(), float), np.array(list(b), float)
    *rows, weights = BY_ID[id].data
    s = len(weights)
    A = np.zeros((s, s))
    for i, row in enumerate(rows):
        row = row if isinstance(row, (tuple, list)) else (row,)
        A[i, : len(row)] = [float(x) for x in row]
    return A, np.array([float(x) for x in weights])


def stability_function(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute (numerator, denominator) of the stability function R(z), polynomials with the highest power of z first.

    A (s, s) and b (s,) are the matrix and the weights of the method.
    """
    # det(I - z B) = z^s chi_B(1 / z): the characteristic polynomial with its coefficients reversed.
    return np.poly(A - np.outer(np.ones(len(b)), b))[::-1], np.poly(A)[::-1]
