r"""The powers of time with which errors of energy and of position grow on a Kepler orbit.

Each revolution gives two errors: the largest energy error within it, and the distance from the start at its end (it is
a whole number of steps).  The largest errors up to n revolutions are fitted by :math:`c\,n^a` over the last decade.
The methods are those of OrdinaryDiffEq.jl's guide that this suite has, and two that are not symplectic.

Source: OrdinaryDiffEq.jl, documentation of OrdinaryDiffEqSymplecticRK; E. Hairer, Ch. Lubich, G. Wanner, Geometric
Numerical Integration (2006), X.3.1.
"""

from __future__ import annotations

from math import pi

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import BY_ID

from .cost import METHODS

TABLE = "field_says_growth"
PROBLEM, VALUES = "kepler", {"e": 0.2}
#: Those of the guide but KahanLi8, whose error is round-off soon, and others; by their names in OrdinaryDiffEq.jl.
SYMPLECTIC = {id: name for id, name in METHODS.items() if id != "kahan-li-8"}
STANDARD = {"rk4": "RK4", "dop853": "DP8"}
#: Steps of a revolution: enough that the error is small, and few enough that it is above round-off.
STEPS = {"symplectic-euler-q": 2000, "kahan-li-6": 50, "dop853": 20}
USUAL = 200
ORBITS = 1000
#: Positions that are off by more than this are on another part of the orbit, and not fitted.
LARGEST = 0.3
#: Rows of a revolution, of which the largest energy error counts.
PHASES = 100


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each method; none if ``quick``."""
    return [] if quick else [_cell(id) for id in (*SYMPLECTIC, *STANDARD)]


def _cell(id: str) -> Cell:
    needs = content(
        TABLE, BY_ID[id], ProblemKey(PROBLEM, tuple(VALUES.items())), STEPS.get(id, USUAL), ORBITS, code=[__name__]
    )
    return Cell("field_says", (TABLE,), {"method": id}, measure_rows, (id,), needs, frozenset({id, PROBLEM}))


def power(errors: np.ndarray) -> float:
    """Fit the power a with which the running maximum of errors grows as n^a, over the last decade of n revolutions.

    ``errors`` is an array of one error for each revolution.
    """
    n = np.arange(1, len(errors) + 1)
    late = n >= len(errors) / 10
    return float(np.polyfit(np.log(n[late]), np.log(np.maximum.accumulate(errors)[late]), 1)[0])


def measure_rows(id: str) -> Rows:
    """Measure with which powers of time a method's errors of energy and position grow: one row, by table name.

    The powers are fitted as by `power`.  The row also has the largest energy error and the last position error.
    """
    made, steps = problem(PROBLEM, **VALUES), STEPS.get(id, USUAL)
    s = integrate(made, id, h=2 * pi / steps, steps=steps * ORBITS, save_every=max(1, steps // PHASES))
    rows = len(s.q) // ORBITS
    off = np.hypot(*(s.q[rows::rows] - s.q[0]).T)
    off = off[: next((k for k, x in enumerate(off) if x > LARGEST), len(off))]
    energy = np.abs(s.energy()[1:] / s.energy()[0] - 1).reshape(ORBITS, rows).max(axis=1)
    symplectic = id in SYMPLECTIC
    row = {"method": id, "called": (SYMPLECTIC | STANDARD)[id], "symplectic": symplectic, "status": s.status}
    row |= {"energy power": power(energy), "position power": power(off)}
    return {TABLE: [row | {"energy error": float(energy.max()), "position error": float(off[-1])}]}
