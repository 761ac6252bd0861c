"""Long runs among the rows of the experiment `trade` (cost at equal accuracy), and whether their energy drifts."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.conservation import too_few_nodes
from phasebench.benchmarks.measure.integrator import OURS
from phasebench.benchmarks.problems import problem, scenes
from phasebench.integrators.registry import BY_ID

from .page import once

#: A drift counts if its total over the whole time (by the end of its interval nearer to 0) and the error at the end
#: have the same sign and are both at least this share of the largest error.
SHARE = 0.5
#: An energy error up to this is round-off: its drift says nothing about the method.
NOISE = 1e-12


@once
def long_runs(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of long runs of this project's methods, those made to measure how conserved quantities drift.

    ``rows`` is the table of the experiment `trade`.  The column ``declared`` is added: how the method is declared to
    conserve the energy.
    """
    part = rows[rows["purpose"] == scenes.DRIFT]
    if "kind" in part:
        part = part[part["kind"] == OURS]
    part = part[part["status"] != "skipped"].copy()
    drift = ("energy_drift", "energy_drift_low", "energy_drift_high")
    for column in ("energy_max", "energy_end", *drift, "angular-momentum_max", "fallbacks"):
        if column not in part:
            part[column] = np.nan
    return part.assign(declared=[BY_ID[i].energy if i in BY_ID else "" for i in part["id"]])


@once
def completed_runs(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the long runs that reached the end, with columns that judge them.

    ``drifts`` is True if the energy drifts, ``canonical`` if the system is canonical, and ``few nodes`` if a
    Hamiltonian boundary value method has too few nodes to conserve H.
    """
    ran = long_runs(rows)
    ran = ran[ran["status"] == "ok"].copy()
    # An interval that contains 0 gives no certain drift.
    ran["sure"] = ran["energy_drift_low"].clip(lower=0) + ran["energy_drift_high"].clip(upper=0)
    ran["share"] = ran["sure"].abs() * ran["t_end"] / ran["energy_max"]
    gone = ran["energy_end"] * np.sign(ran["sure"]) < SHARE * ran["energy_max"]
    ran["drifts"] = (ran["share"] > SHARE) & ~gone
    names = ran["problem"].astype(str).str.split(":").str[0]
    systems = {n: problem(n).system for n in names.unique()}
    ran["canonical"] = names.map({n: s.canonical for n, s in systems.items()}).astype(bool)
    ran["few nodes"] = [too_few_nodes(id, systems[n]) for id, n in zip(ran["id"], names, strict=True)]
    return ran
