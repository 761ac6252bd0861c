"""Solvers at the edge: over (h, lambda) and (h, e), how an implicit equation is solved, or how it is not.

Every point is a short run with one of the outcomes: solved by the fixed point, by Newton's method where the fixed point
has stopped contracting, with roots of the energy's equation missed, solved but with the energy lost (a spurious
solution, or another orbit), or the status with which it ended.
"""

from __future__ import annotations

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.kepler import pericentre
from phasebench.benchmarks.rows.cells import Cell, Problem, Rows, content
from phasebench.integrators.driver import OK, integrate

from .methods import record

FIXED_POINT, NEWTON, MISSED, LOST = "fixed point", "Newton", "roots missed", "energy lost"
STEPS, SECONDS = 200, 1.0
#: From this share of the steps on.
OFTEN = 0.01
LAMBDAS = tuple(float(x) for x in np.linspace(-10, 11, 22))
ECCENTRICITIES = tuple(float(x) for x in np.round(np.linspace(0, 0.98, 15), 3))
H_PENDULUM = tuple(float(f"{x:.3g}") for x in np.geomspace(0.02, 6, 19))
H_KEPLER = tuple(float(f"{x:.3g}") for x in np.geomspace(0.003, 3, 19))
#: (method, problem, the name of what is varied besides h)
MAPS = (
    ("scheme-i", "pendulum", "lam"),
    ("scheme-ii", "pendulum", "lam"),
    ("implicit-midpoint", "kepler", "e"),
    ("scheme-iv", "kepler", "e"),
    ("scheme-v", "kepler", "e"),
)
TABLES = ("extremes_solvers",)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each map."""
    return [] if quick else [_cell(*of) for of in MAPS]


def _cell(id: str, on: str, over: str) -> Cell:
    needs = content("edge", record(id), Problem(on), LAMBDAS, ECCENTRICITIES, code=[__name__])
    key = {"method": id, "problem": on, "over": over}
    return Cell("extremes", TABLES, key, measured, (id, on, over), needs, frozenset({id, on}))


def measured(id: str, on: str, over: str) -> Rows:
    """The rows of a map."""
    values, steps = (LAMBDAS, H_PENDULUM) if over == "lam" else (ECCENTRICITIES, H_KEPLER)
    made, rows = problem(on), []
    for value in values:
        start = {} if over == "lam" else dict(zip(("q0", "p0"), _pericentre(value), strict=True))
        parameters = {"lam": value} if over == "lam" else None
        for h in steps:
            s = integrate(made, id, h=h, steps=STEPS, parameters=parameters, timeout=SECONDS, **start)
            rows.append(
                {"method": id, "problem": on, "over": over, "value": value, "h": h, "outcome": outcome(made, s)}
            )
    return {TABLES[0]: rows}


def _pericentre(e: float):
    orbit = pericentre(e, ())
    return orbit.q, orbit.p


def outcome(made, s) -> str:
    """How a run went."""
    H = made.system.observe(made.system.H, s.q, s.p)
    with np.errstate(all="ignore"):
        if not np.abs(H - H[0]).max() <= max(abs(H[0]), 0.1):
            return LOST
    if s.status != OK:
        return s.status
    taken = max(1, s.counts["steps"])
    if s.counts.get("fallbacks", 0) > OFTEN * taken:
        return MISSED
    return NEWTON if s.counts.get("newton", 0) > OFTEN * taken else FIXED_POINT
