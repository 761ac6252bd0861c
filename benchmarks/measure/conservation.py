"""Conservation along a run: the largest error of an invariant, its drift with an interval, and when none is to be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drift import drift
from .metrics import invariant_error

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


def conservation(t: np.ndarray, values: np.ndarray, scale: float) -> dict[str, float]:
    """Return a row: the largest error of an invariant along a run and its drift with a 95 % interval.

    t, values are arrays (n,), equidistant times and the invariant's values; ``scale``, the size of its terms, is
    copied.
    """
    found, slope = invariant_error(values), drift(t, values - values[0])
    moved = {"slope": slope.value, "low": slope.low, "high": slope.high}
    return {"value": float(found.max)} | moved | {"time": float(t[-1]), "scale": scale}


def energy(
    system: PartitionedSystem, t: np.ndarray, q: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, dict[str, float]]:
    """Return (H at each row of q and p (n, d); its `conservation`, max |H| + max |p.q'| being the scale)."""
    H = system.observe(system.H, q, p)
    kinetic = sum(system.observe(e, q, p) * p[:, i] for i, e in enumerate(system.dq))
    return H, conservation(t, H, float(np.abs(H).max() + np.abs(kinetic).max()))


def energy_error(made: Problem, q: np.ndarray, p: np.ndarray) -> float:
    """Return the largest |H / H_0 - 1| over states q, p, arrays (n, d), of the problem ``made``; H_0 is the first H."""
    E = made.system.observe(made.system.H, q, p)
    return float(np.abs(E / E[0] - 1).max())


def too_few_nodes(method: str, system: PartitionedSystem) -> bool:
    """True if the method of the id "hbvm-k-s" has too few nodes to conserve a system's H; False for other methods.

    HBVM(k, s) conserves polynomials of degree at most 2k/s (L. Brugnano, F. Iavernaro, D. Trigiante, J. Numer. Anal.
    Ind. Appl. Math. 5 (2010) 17-37).
    """
    kind, *sizes = method.split("-")
    if kind != "hbvm":
        return False
    degree = system.polynomial_degree
    return degree is None or degree > 2 * int(sizes[0]) / int(sizes[1])
