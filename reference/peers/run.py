"""Determine the status at the end of a run of a peer, an integrator of another package, and the tolerance of a run."""

from __future__ import annotations

from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from phasebench.integrators.errors import InvalidInput

from .record import NOT_FINITE, Peer

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: For a singular system a relative change of the energy by more than this is a collision.
LOST = 10.0


def ending(
    system: PartitionedSystem, times: np.ndarray, q: np.ndarray, p: np.ndarray, failure: str | None
) -> tuple[str, str, int]:
    """Judge a peer's run by its states: (status, reason, number of rows to keep).

    q and p, arrays (n, d), are the states (rows) at the first n of ``times``; ``failure`` is the reason for which the
    package stopped, or None.  The rows before the first one in which the state or H is not finite are kept.
    """
    from phasebench.integrators.outcome import COLLISION, DIVERGED, energy_unit, judge

    finite = np.isfinite(q).all(axis=1) & np.isfinite(p).all(axis=1)
    rows = len(q) if finite.all() else int(np.argmin(finite))
    if rows < len(times):
        why = (failure or NOT_FINITE).rstrip(".")
        return DIVERGED, f"{why}; the rows end at t = {times[rows - 1]:.6g} of {times[-1]:.6g}", rows
    H = system.observe(system.H, q, p) if system.H is not None else np.zeros(rows)
    if not np.isfinite(H).all():
        rows = int(np.isfinite(H).argmin())
        return DIVERGED, f"the state is outside H's domain; the rows end at t = {times[rows - 1]:.6g}", rows
    if system.singular and system.H is not None:
        worst = float(np.abs(H - H[0]).max())
        if worst > LOST * energy_unit(system, q, p):
            return COLLISION, f"the energy {H[0]:.6g} changed by {worst:.3g}: the orbit met the singularity", rows
    return *judge(system, times[:rows], q, p, "take a smaller step or tolerance"), rows


def tolerance(integrator: Peer, tol: float | None) -> float | None:
    """The tolerance of a run, by default the peer's own; raises InvalidInput if the peer does not accept it."""
    if tol is None:
        return integrator.tol
    if not integrator.adaptive:
        raise InvalidInput(f"'{integrator.id}' takes steps of fixed size: give h, not tol")
    if isinstance(tol, bool) or not isinstance(tol, Real) or not isfinite(tol) or not 0 < tol < 1:
        raise InvalidInput(f"tol is {tol!r}; it must be a number between 0 and 1")
    if tol < integrator.least:
        raise InvalidInput(f"tol is {tol!r}; '{integrator.id}' takes none below {integrator.least:.3g}")
    return float(tol)
