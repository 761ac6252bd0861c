"""Conservation of an invariant along a run: its largest error, and the drift of the error with an interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drift import drift
from .metrics import invariant_error

if TYPE_CHECKING:
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
