r"""Close encounters: the Kepler problem at e up to 0.999999, over ten orbits.

The error is the largest distance from the exact apocentres, relative to their distance from the centre.  An apocentre
is q = (-(a + c), 0) exactly; the semi-axis a and the period :math:`2\pi a^{3/2}` follow in extended precision from the
doubles of the start, a pericentre.  A method is run at ever smaller steps (`LADDER`) until the error is at most `HELD`;
an adaptive peer, an integrator of another package, at ever smaller tolerances.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import mpmath
import numpy as np

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import BY_ID as PEERS

from .methods import step_changing_methods

if TYPE_CHECKING:
    from phasebench.benchmarks.measure.integrator import Integrator
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

ECCENTRICITIES = (0.9, 0.99, 0.999, 0.999999)
HELD, ORBITS = 1e-6, 10
#: Numbers of steps from one apside to the next.
LADDER = tuple(2**k for k in range(6, 17, 2))
TOLERANCES = (1e-8, 1e-11, 1e-14)
#: Methods with fixed steps: cheap ones, high orders, implicit ones, one made for Kepler.
FIXED = (
    "symplectic-euler-p",
    "stormer-verlet",
    "rk4",
    "dop853",
    "forest-ruth",
    "pefrl",
    "blanes-moan-s6",
    "kahan-li-8",
    "sofroniou-spaletta-10",
    "implicit-midpoint",
    "scheme-i",
    "scheme-iii",
    "gauss-2",
    "gauss-4",
    "gauss-8",
    "avf",
    "scheme-v",
    "rk4-projected-energy",
    "wisdom-holman",
)
OTHERS = ("rebound-ias15", "rebound-whfast", "rebound-mercurius", "rebound-trace", "heyoka", "rebound-bs")
TABLES = ("extremes_encounters",)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each integrator; none if ``quick``."""
    return [] if quick else [_cell(id) for id in (*FIXED, *step_changing_methods(), *OTHERS)]


def _cell(id: str) -> Cell:
    needs = content("encounters", BY_ID.get(id) or PEERS[id], ProblemKey("kepler"), code=[__name__])
    return Cell("extremes", TABLES, {"method": id}, measure_rows, (id,), needs, frozenset({id}))


def apocentre(q0: float, p0: float) -> tuple[float, float]:
    """Compute (half the period, distance of the apocentre) of the orbit from the pericentre (q0, 0), (0, p0)."""
    with mpmath.workdps(40):
        r, v = mpmath.mpf(q0), mpmath.mpf(p0)
        a = 1 / (2 / r - v**2)
        return float(mpmath.pi * a**1.5), float(2 * a - r)


def error(s: Solution, far: float) -> float:
    """Compute the largest distance from the exact apocentre over rows 1, 3, 5, ... of a run with a row each half orbit.

    It is relative to ``far``, the apocentre's distance from the centre; infinite if rows are missing.
    """
    q = s.q[1::2]
    return float(np.hypot(q[:, 0] + far, q[:, 1]).max() / far) if len(q) >= ORBITS else np.inf


def measure_rows(id: str) -> Rows:
    """Run an integrator on Kepler orbits: a row for each eccentricity, by table name.

    The row is of the first run, of those with ever smaller steps or tolerances, whose error is at most `HELD`; if there
    is none, of the most accurate one.
    """
    rows = []
    for e in ECCENTRICITIES:
        made = problem("kepler", e=e)
        half, far = apocentre(made.q0[0], made.p0[1])
        chosen = integrator(id)
        runs = _adaptive(chosen, made, half) if chosen.adaptive else _ladder_runs(chosen, made, half, far)
        best = {"error": np.inf, "status": "", "asked": np.nan, "steps": 0}
        for asked, s in runs:
            if s.status == SKIPPED:
                raise Unavailable(s.reason)
            found = error(s, far) if s.status == OK else np.inf
            if found < best["error"] or not best["status"]:
                best = {"error": found, "status": s.status, "asked": asked, "steps": s.counts["steps"]}
            if found <= HELD:
                break
        kind = "adaptive" if chosen.adaptive else "transformed" if id in step_changing_methods() else "fixed"
        rows.append({"method": id, "kind": kind, "e": e, "held": best["error"] <= HELD, **best})
    return {TABLES[0]: rows}


def _ladder_runs(chosen: Integrator, made: Problem, half: float, far: float) -> Iterator[tuple[int, Solution]]:
    """Yield (steps in half a period, solution) for ever smaller steps.

    ``half``: half the period; ``far``: the distance of the apocentre from the centre.
    """
    last = np.inf
    for m in LADDER:
        # The longest run is skipped if the error before it is too large for one more rung to suffice.
        if m == LADDER[-1] and not last <= HELD * (LADDER[-1] / LADDER[-2]) ** ((chosen.order or 2) + 1):
            return
        s = chosen.run(made, h=half / m, steps=(2 * ORBITS - 1) * m, save_every=m)
        last = error(s, far) if s.status == OK else np.inf
        yield m, s


def _adaptive(chosen: Integrator, made: Problem, half: float) -> Iterator[tuple[float, Solution]]:
    """Yield (tolerance, solution) for ever smaller tolerances; rows are ``half``, half a period, apart."""
    for tol in TOLERANCES:
        yield tol, chosen.run(made, h=half, steps=2 * ORBITS - 1, tol=max(tol, chosen.record.least))
