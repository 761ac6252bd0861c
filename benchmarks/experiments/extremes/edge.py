"""Maps of how the equations of implicit methods are solved, or fail to be, over the step h and a second parameter.

The second one is the parameter lambda of Schemes I and II, on the pendulum, or the eccentricity e of Kepler's orbit.
Every point is a short run with one of these outcomes: solved by fixed-point iteration; solved by Newton's method where
the iteration no longer contracts; root missed (Schemes IV and V, which choose a parameter in each step so that H is
kept, find none); energy lost (a spurious solution, or another orbit); or the status with which the run ended.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.kepler import pericentre
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK, integrate

from .methods import record

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

FIXED_POINT, NEWTON, MISSED, LOST = "fixed point", "Newton", "roots missed", "energy lost"
STEPS, SECONDS = 200, 1.0
#: Fallbacks or Newton solves count if they occur in more than this share of the steps.
OFTEN = 0.01
LAMBDAS = tuple(float(x) for x in np.linspace(-10, 11, 22))
ECCENTRICITIES = tuple(float(x) for x in np.round(np.linspace(0, 0.98, 15), 3))
H_PENDULUM = tuple(float(f"{x:.3g}") for x in np.geomspace(0.02, 6, 19))
H_KEPLER = tuple(float(f"{x:.3g}") for x in np.geomspace(0.003, 3, 19))
#: (method, problem, the parameter that is varied besides h)
MAPS = (
    ("scheme-i", "pendulum", "lam"),
    ("scheme-ii", "pendulum", "lam"),
    ("implicit-midpoint", "kepler", "e"),
    ("scheme-iv", "kepler", "e"),
    ("scheme-v", "kepler", "e"),
)
TABLES = ("extremes_solvers",)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each map; none if ``quick``."""
    return [] if quick else [_cell(*of) for of in MAPS]


def _cell(id: str, on: str, over: str) -> Cell:
    needs = content("edge", record(id), ProblemKey(on), LAMBDAS, ECCENTRICITIES, code=[__name__])
    key = {"method": id, "problem": on, "over": over}
    return Cell("extremes", TABLES, key, measure_rows, (id, on, over), needs, frozenset({id, on}))


def measure_rows(id: str, on: str, over: str) -> Rows:
    """Classify short runs of an implicit method: a row for each (h, lambda) if ``over`` is "lam", else for each (h, e).

    ``id`` is the method, ``on`` the problem; lambda is the method's parameter, e the eccentricity of the orbit.
    """
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


def _pericentre(e: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the start (q, p) of a Kepler orbit of eccentricity e at its pericentre."""
    orbit = pericentre(e, ())
    return orbit.q, orbit.p


def outcome(made: Problem, s: Solution) -> str:
    """Classify a run ``s`` of the problem ``made`` by how its equations were solved.

    Returns `FIXED_POINT`, `NEWTON`, `MISSED` (no root of the energy's equation in some steps), `LOST` (the energy), or
    the status of a run that ended early.
    """
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
