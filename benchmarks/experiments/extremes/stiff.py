"""Stiffness: the Fermi-Pasta-Ulam problem with omega from 50 to 10^6, at h omega from 10^-3 to 10^3.

The oscillatory energy I of the stiff springs is an adiabatic invariant: over the time of a run it changes by
O(1/omega).  A method's cliff is the largest h omega such that the method changes I by less than `CLIFF` there and at
every smaller h omega.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.fpu import oscillatory_energies
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate

from .methods import record

OMEGAS = (50.0, 1e3, 1e4, 1e6)
STEPS_TIMES_OMEGA = tuple(float(f"{10 ** (k / 2):.3g}") for k in range(-6, 7))
METHODS = (
    "stormer-verlet",
    "pefrl",
    "blanes-moan-s6",
    "rk4",
    "implicit-midpoint",
    "gauss-2",
    "imex",
    "deuflhard",
    "mollified-impulse",
    "hairer-lubich",
    "grimm-hochbruck",
)
STEPS, SEEN, SECONDS = 10_000, 500, 2.0
CLIFF = 0.2
TABLES = ("extremes_stiffness",)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(id) for id in METHODS]


def _cell(id: str) -> Cell:
    parts = [ProblemKey("fpu", (("omega", w),)) for w in OMEGAS]
    needs = content("stiff", record(id), *parts, STEPS_TIMES_OMEGA, code=[__name__])
    return Cell("extremes", TABLES, {"method": id}, measure_rows, (id,), needs, frozenset({id, "fpu"}))


def measure_rows(id: str) -> Rows:
    """Measure the changes of H and of the oscillatory energy I under a method: a row for each omega and h omega."""
    rows = []
    for omega in OMEGAS:
        made = problem("fpu", omega=omega)
        adiabatic = sum(oscillatory_energies(made))
        for z in STEPS_TIMES_OMEGA:
            s = integrate(made, id, h=z / omega, steps=STEPS, save_every=STEPS // SEEN, timeout=SECONDS)
            with np.errstate(all="ignore"):
                fast, H = (made.system.observe(e, s.q, s.p) for e in (adiabatic, made.system.H))
            rows.append(
                {
                    "method": id,
                    "omega": omega,
                    "h omega": z,
                    "status": s.status,
                    "I changes": _change(fast) if s.status == "ok" else np.inf,
                    "H changes": _change(H) if s.status == "ok" else np.inf,
                }
            )
    return {TABLES[0]: rows}


def _change(values: np.ndarray) -> float:
    """Compute the largest relative change of a series from its first value; infinite if any value is not finite."""
    change = np.abs(values / values[0] - 1)
    return float(change.max()) if np.isfinite(change).all() else np.inf
