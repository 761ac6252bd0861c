"""IAS15's energy errors on Kepler orbits of all eccentricities, "in most cases accurate down to machine precision".

Measured is the largest relative energy error over 100 revolutions, at 1009 times whose phases on the orbit all
differ, with energies in extended precision.

Source: REBOUND's documentation of IAS15; H. Rein, D. S. Spiegel, Mon. Not. R. Astron. Soc. 446 (2015) 1424.
"""

from __future__ import annotations

from math import pi

import numpy as np

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import SKIPPED

TABLE = "field_says_ias15"
ID = "rebound-ias15"
ECCENTRICITIES = (0.0, 0.3, 0.6, 0.9, 0.99, 0.999)
ORBITS, ROWS = 100, 1009


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each eccentricity; none if ``quick``."""
    return [] if quick else [_cell(e) for e in ECCENTRICITIES]


def _cell(e: float) -> Cell:
    needs = content(TABLE, integrator(ID).record, ProblemKey("kepler", (("e", e),)), ORBITS, ROWS, code=[__name__])
    return Cell("field_says", (TABLE,), {"e": e}, measure_rows, (e,), needs, frozenset({ID, "kepler"}))


def measure_rows(e: float) -> Rows:
    """Measure IAS15's largest relative energy error on the orbit of eccentricity e: one row, by table name.

    Raises Unavailable if REBOUND is not installed.
    """
    s = integrator(ID).run(problem("kepler", e=e), t_end=2 * pi * ORBITS, steps=ROWS)
    if s.status == SKIPPED:
        raise Unavailable(s.reason)
    q, p = s.q.astype(np.longdouble), s.p.astype(np.longdouble)
    energy = (p**2).sum(axis=1) / 2 - 1 / np.sqrt((q**2).sum(axis=1))
    return {TABLE: [{"e": e, "status": s.status, "energy error": float(np.abs(energy / energy[0] - 1).max())}]}
