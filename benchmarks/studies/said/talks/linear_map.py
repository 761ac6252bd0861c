r"""Figure of a linear symplectic map, which keeps the sum of a parallelogram's oriented areas in the (p_i, q_i) planes.

For vectors :math:`\xi, \eta` of :math:`\mathbb R^{2d}` that span the parallelogram,
:math:`\omega(\xi, \eta) = \sum_i (\xi^p_i\eta^q_i - \xi^q_i\eta^p_i)`; A is symplectic iff
:math:`\omega(A\xi, A\eta) = \omega(\xi, \eta)`.  The maps are one step of a method on coupled oscillators.

Source: talk on symplectic integration, 'Symplectic Transformations', Fig. 2.1; E. Hairer, C. Lubich, G. Wanner,
Geometric Numerical Integration (2006), figure VI.2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks import style
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.style import number
from phasebench.integrators import Hamiltonian

from . import measure
from .measure import Figure

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure as Drawing

STEP = 0.9
#: The vectors (q1, q2, p1, p2) that span the parallelogram.
XI, ETA = np.array([0.2, 0.1, 1.2, 0.7]), np.array([1.0, -0.5, 0.3, -0.6])
METHODS = (("implicit midpoint", "implicit-midpoint"), ("explicit Euler", "explicit-euler"))


def oscillators() -> Hamiltonian:
    """The linear Hamiltonian system of two oscillators coupled by a spring."""
    return Hamiltonian(q="q1, q2", p="p1, p2", H="(p1**2 + p2**2)/2 + (q1**2 + 2*q2**2)/2 + (q1 - q2)**2/2")


def image(id: str) -> tuple[np.ndarray, np.ndarray]:
    """The images, arrays (4,), of `XI` and `ETA` under one step of the method ``id`` on coupled oscillators."""
    return tuple(measure.carry(oscillators(), id, np.stack([XI, ETA]), STEP, 1)[1])


def areas(xi: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """The oriented areas of a parallelogram's projections onto the planes (p_i, q_i): array (d,)."""
    return np.array([measure.polygon_area(_project(xi, eta, i)) for i in range(len(xi) // 2)])


def _project(xi: np.ndarray, eta: np.ndarray, i: int) -> np.ndarray:
    """Project the corners 0, xi, xi + eta, eta of a parallelogram onto the plane (p_i, q_i): array (4, 2)."""
    d = len(xi) // 2
    corners = np.stack([0 * xi, xi, xi + eta, eta])
    return corners[:, [d + i, i]]


def _measure() -> list[dict]:
    shapes = {"before": (XI, ETA)} | {title: image(id) for title, id in METHODS}
    return [measure.row(title, "xi and eta", xi, eta, digits=17) for title, (xi, eta) in shapes.items()]


@style.styled
def parallelograms(rows: pd.DataFrame) -> tuple[Drawing, str]:
    """A parallelogram and its images under a step of two methods, projected onto both planes (p_i, q_i)."""
    figure, grid = style.panels(2, 3, 4.4, sharex=True, sharey=True)
    for column, r in enumerate(rows.itertuples()):
        xi, eta = unpack(r.x), unpack(r.y)
        oriented = areas(xi, eta)
        for i, axes in enumerate(grid[:, column]):
            corners = _project(xi, eta, i)
            colour = style.BLUE if oriented[i] > 0 else style.VERMILION
            axes.fill(
                *corners.T, facecolor=colour, alpha=0.25, hatch=None if oriented[i] > 0 else "///", edgecolor=colour
            )
            for vector, line in ((corners[1], "-"), (corners[3], "--")):
                axes.annotate(
                    "", vector, (0, 0), arrowprops={"arrowstyle": "->", "linestyle": line, "shrinkA": 0, "shrinkB": 0}
                )
            first = f"{r.panel}, $\\omega$ = {oriented.sum():.4f}\n" if i == 0 else ""
            axes.set_title(f"{first}area {i + 1}: {oriented[i]:+.4f}")
            axes.set(xlabel=f"$p_{i + 1}$", ylabel=f"$q_{i + 1}$" if column == 0 else "")
            axes.margins(0.12)
            axes.set_aspect("equal")
    caption = (
        f"A parallelogram (solid arrow ξ, dashed η) and its image under one step, h = {number(STEP)}, of two methods "
        "on two coupled oscillators, projected onto the planes (p_1, q_1) (above) and (p_2, q_2) (below), with the "
        "oriented areas and their sum ω; hatched: negative orientation."
    )
    return figure, caption


FIGURES = (
    Figure(
        "linear-symplectic-map",
        "A linear symplectic map on a parallelogram",
        _measure,
        parallelograms,
    ),
)
