"""Maps of Henon-Heiles at one energy: a Poincare section, and the chaos of a grid of starts on the same plane.

The section is q1 = 0, p1 > 0.  Each start of the grid has a neighbour at the distance `APART`; the logarithm of the
growth of their distance is small where the motion is regular (it grows as log t) and large where it is chaotic.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.arrays import pack
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.section import section

TABLE = "ensembles_maps"
PROBLEM, ENERGY = "henon-heiles", 1 / 8
METHOD, STEP = "blanes-moan-srkn11b", 0.25
SECTION, GRID = "section", "chaos"
ORBITS, CROSSINGS, LONG = 100, 100, 720.0
SIDE, T_GRID, APART = 100, 200.0, 1e-8
#: (q2, p2) of the corners of the grid.
CORNERS = ((-0.45, -0.5), (0.7, 0.5))


def on_plane(q2: np.ndarray, p2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States q = (0, q2), p = (p1, p2) with p1 > 0 and H = `ENERGY`, arrays (n, 2); NaN where there is none."""
    with np.errstate(invalid="ignore"):
        p1 = np.sqrt(2 * ENERGY - q2**2 + 2 * q2**3 / 3 - p2**2)
    return np.stack([0 * q2, q2], axis=1), np.stack([p1, p2], axis=1)


def poincare() -> list[dict]:
    """The section: a row for each of `ORBITS` random starts, with its points (q2, p2) packed as text."""
    made, random = problem(PROBLEM), np.random.default_rng(1)
    Q, P = on_plane(*(random.uniform(low, high, 20 * ORBITS) for low, high in zip(*CORNERS, strict=True)))
    Q, P = (x[np.isfinite(P[:, 0])][:ORBITS] for x in (Q, P))
    section(made, METHOD, Q, P, of="q1", h=STEP, steps=4)  # compiles
    found = section(made, METHOD, Q, P, of="q1", h=STEP, t_end=LONG)
    rows = []
    for i in range(ORBITS):
        mine = np.flatnonzero(found.orbit == i)[:CROSSINGS]
        energies = made.system.observe(made.system.H, found.q[mine], found.p[mine])
        row = {"line": i, "x": pack(found.q[mine, 1], 4), "y": pack(found.p[mine, 1], 4)}
        row |= {"energy error": float(np.abs(energies - ENERGY).max()), "crossings": len(mine)}
        rows.append(row | {"status": found.status[i], "seconds": found.seconds, "orbits": ORBITS})
    return rows


def chaos() -> list[dict]:
    """A row for each line (one p2) of the grid, with logarithms of growths; NaN where no start is, or a run fails."""
    q2, p2 = np.meshgrid(*(np.linspace(*ends, SIDE) for ends in zip(*CORNERS, strict=True)))
    Q, P = on_plane(q2.ravel(), p2.ravel())
    inside = np.isfinite(P[:, 0])
    both = np.vstack([Q[inside], Q[inside] + [0.0, APART]]), np.vstack([P[inside]] * 2)
    ensemble = integrate_ensemble(problem(PROBLEM), METHOD, *both, h=STEP, t_end=T_GRID)
    ended = (ensemble.status == "ok").reshape(2, -1).all(0)
    a, b = np.hstack([ensemble.q, ensemble.p]).reshape(2, -1, 4)
    value = np.full(SIDE * SIDE, np.nan)
    value[inside] = np.where(ended, np.log(np.maximum(np.linalg.norm(a - b, axis=1), 1e-300) / APART), np.nan)
    same = {"energy error": np.nan, "crossings": 0, "status": "ok", "seconds": ensemble.seconds}
    lines = enumerate(value.reshape(SIDE, SIDE))
    return [{"line": i, "x": "", "y": pack(line, 3)} | same | {"orbits": len(ensemble)} for i, line in lines]


def maps(map: str) -> list[dict]:
    """The rows of the section or of the grid."""
    return poincare() if map == SECTION else chaos()
