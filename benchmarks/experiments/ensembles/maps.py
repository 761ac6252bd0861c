"""Maps of Henon-Heiles at one energy: a Poincare section of 100 orbits, and the chaos of a grid of 100 x 100 starts.

The section is q1 = 0, p1 > 0.  The second map integrates each start of a grid on that plane with a neighbour at the
distance `APART`; the logarithm of the growth of their distance is small where the motion is regular (it grows as log t)
and large where it is chaotic.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.arrays import pack
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, content
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.registry import method
from phasebench.integrators.section import section

TABLE = "ensembles_maps"
PROBLEM, ENERGY = "henon-heiles", 1 / 8
METHOD, STEP = "blanes-moan-srkn11b", 0.25
SECTION, GRID = "section", "chaos"
ORBITS, CROSSINGS, LONG = 100, 100, 720.0
SIDE, T_GRID, APART = 100, 200.0, 1e-8
#: (q2, p2) of the corners of the grid.
CORNERS = ((-0.45, -0.5), (0.7, 0.5))


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), also if ``quick``: one for the Poincare section and one for the map of chaos."""
    return [
        Cell(
            "ensembles",
            (TABLE,),
            {"map": name},
            measure_rows,
            (name,),
            content(TABLE, name, method(METHOD), ProblemKey(PROBLEM), code=[__name__]),
            frozenset({PROBLEM, METHOD}),
            ALONE,
            own=True,
        )
        for name in (SECTION, GRID)
    ]


def on_plane(q2: np.ndarray, p2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Make states q = (0, q2), p = (p1, p2) with p1 > 0 and H = `ENERGY`, arrays (n, 2); NaN where there is none."""
    with np.errstate(invalid="ignore"):
        p1 = np.sqrt(2 * ENERGY - q2**2 + 2 * q2**3 / 3 - p2**2)
    return np.stack([0 * q2, q2], axis=1), np.stack([p1, p2], axis=1)


def random_starts(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw n random starts (q, p) on the section q1 = 0, p1 > 0 with H = `ENERGY`, arrays (n, 2)."""
    random = np.random.default_rng(1)
    Q, P = on_plane(*(random.uniform(low, high, 20 * n) for low, high in zip(*CORNERS, strict=True)))
    there = np.isfinite(P[:, 0])
    return Q[there][:n], P[there][:n]


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Make the starts of the grid on the section: (q, p), arrays (n, 2), one row of constant p2 after the other."""
    (left, low), (right, high) = CORNERS
    q2, p2 = np.meshgrid(np.linspace(left, right, SIDE), np.linspace(low, high, SIDE))
    return on_plane(q2.ravel(), p2.ravel())


def measure_rows(name: str) -> Rows:
    """Compute the Poincare section if ``name`` is `SECTION`, the map of chaos if it is `GRID`: rows, by table name."""
    return {TABLE: _section() if name == SECTION else _chaos()}


def _section() -> list[dict]:
    """Compute the Poincare section: a row for each orbit, with its points (q2, p2) packed as text."""
    made = problem(PROBLEM)
    Q, P = random_starts(ORBITS)
    section(made, METHOD, Q, P, of="q1", h=STEP, steps=4)  # compiles
    found = section(made, METHOD, Q, P, of="q1", h=STEP, t_end=LONG)
    rows = []
    for i in range(ORBITS):
        mine = np.flatnonzero(found.orbit == i)[:CROSSINGS]
        row = {"map": SECTION, "line": i, "x": pack(found.q[mine, 1], 4), "y": pack(found.p[mine, 1], 4)}
        energies = made.system.observe(made.system.H, found.q[mine], found.p[mine])
        row |= {"energy error": float(np.abs(energies - ENERGY).max()), "crossings": len(mine)}
        rows.append(row | {"status": found.status[i], "seconds": found.seconds, "orbits": ORBITS})
    return rows


def _chaos() -> list[dict]:
    """Compute the map of chaos: a row for each line (one value of p2) of the grid of starts.

    A row has, packed as text, the logarithms of the factors by which the distances between neighbours grow; NaN where
    no state on the section has H = `ENERGY`, or a run fails.
    """
    made = problem(PROBLEM)
    Q, P = grid()
    inside = np.isfinite(P[:, 0])
    near = Q[inside] + [0.0, APART]
    ensemble = integrate_ensemble(
        made, METHOD, np.vstack([Q[inside], near]), np.vstack([P[inside]] * 2), h=STEP, t_end=T_GRID
    )
    ended = (ensemble.status == "ok").reshape(2, -1).all(0)
    a, b = np.hstack([ensemble.q, ensemble.p]).reshape(2, -1, 4)
    value = np.full(SIDE * SIDE, np.nan)
    value[inside] = np.where(ended, np.log(np.maximum(np.linalg.norm(a - b, axis=1), 1e-300) / APART), np.nan)
    rows = []
    for i, line in enumerate(value.reshape(SIDE, SIDE)):
        row = {"map": GRID, "line": i, "x": "", "y": pack(line, 3), "energy error": np.nan, "crossings": 0}
        rows.append(row | {"status": "ok", "seconds": ensemble.seconds, "orbits": len(ensemble)})
    return rows
