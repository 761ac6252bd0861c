"""Conservation of an invariant along a run: its largest error, and the drift of the error with an interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .drift import drift
from .metrics import invariant_error

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


def conservation(t: np.ndarray, values: np.ndarray, scale: float) -> dict[str, float]:
    """Return a row of results, name -> number: the largest error of an invariant along a run, and its drift.

    Parameters
    ----------
    t, values : arrays (n,): equidistant times, and the invariant's values
    scale : the size of the invariant's terms, which is copied to the row

    Returns
    -------
    dict
        value: the largest absolute error; slope: the drift per unit of time, with the 95 % interval low, high; time:
        the last time; scale
    """
    found, slope = invariant_error(values), drift(t, values - values[0])
    moved = {"slope": slope.value, "low": slope.low, "high": slope.high}
    return {"value": float(found.max)} | moved | {"time": float(t[-1]), "scale": scale}


def energy(
    system: PartitionedSystem, t: np.ndarray, q: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, dict[str, float]]:
    """Return (H at each row of q and p, array (n,); the dict of its largest error and its drift).

    t has shape (n,), q and p have shape (n, d).  The dict is that of `conservation`, with max |H| + max |p.q'| as the
    scale.
    """
    H = system.observe(system.H, q, p)
    kinetic = sum(system.observe(e, q, p) * p[:, i] for i, e in enumerate(system.dq))
    return H, conservation(t, H, float(np.abs(H).max() + np.abs(kinetic).max()))
