"""Further close encounters: the Pythagorean problem of three bodies, and a zoom-whirl orbit about a black hole.

Three bodies of masses 3, 4, 5 come as near as 4e-4 at t = 15.83 (Szebehely & Peters 1967); a zoom-whirl orbit circles
at 4.7 M, close to the last stable circle, and swings out to 14 M (Glampedakis & Kennefick 2002).  The error is that of
the coordinates at the time of a certified state, relative where a coordinate is above 1.  Each integrator is run at
ever smaller steps, or tolerances, until the error is at most `HELD` or the smallest step or tolerance is reached.

MERCURIUS and TRACE need one dominating body and are left out here; `encounters` runs them on Kepler's problem.  Methods
marked `TRANSFORMED` integrate Poincare's transformed Hamiltonian with a symplectic method; their runs end at other
times and are compared with a run of `JUDGE` to the same time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, Unavailable, content, states
from phasebench.integrators.driver import OK, SKIPPED, integrate
from phasebench.integrators.registry import BY_ID
from phasebench.integrators.systems.transformed import TransformedHamiltonian
from phasebench.reference.certificates import stored
from phasebench.reference.peers import BY_ID as PEERS

from .encounters import HELD
from .methods import step_changing_methods

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

TOLERANCES = (1e-8, 1e-10, 1e-12, 1e-14)
#: Time limit in seconds, for methods that can be stopped.
SECONDS = 2.0
JUDGE, TRANSFORMED = "heyoka", " of K"
#: Name of the stored table.
TABLES = ("extremes_meetings",)


@dataclass(frozen=True)
class Encounter:
    """A problem with a close encounter, and how it is run.

    Attributes
    ----------
    id, problem : name of this encounter (scene) in the table, and the problem with its orbit
    t_end : end of the runs, after the encounter, at which the true state is certified
    ladder : numbers of steps to try, in rising order
    methods : ids of the integrators
    """

    id: str
    problem: str
    t_end: float
    ladder: tuple[int, ...]
    methods: tuple[str, ...]


ENCOUNTERS = (
    Encounter(
        "three bodies",
        "n-body",
        16.0,
        tuple(4**k for k in range(5, 10)),
        (
            *("stormer-verlet", "kahan-li-8", "dop853", "implicit-midpoint", "gauss-4"),
            *("stormer-verlet-adaptive", "gauss-4-adaptive", "gauss-8-adaptive"),
            *("rebound-ias15", "rebound-bs", "heyoka"),
        ),
    ),
    Encounter(
        "zoom-whirl",
        "schwarzschild:zoom-whirl",
        1000.0,
        tuple(4**k for k in range(3, 9)),
        (
            *("rk4", "dop853", "implicit-midpoint", "scheme-i", "gauss-2", "gauss-4", "gauss-8"),
            *(f"{id}{TRANSFORMED}" for id in ("implicit-midpoint", "gauss-4")),
            *("heyoka", "scipy-dop853"),
        ),
    ),
)
BY_SCENE = {e.id: e for e in ENCOUNTERS}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements to make (`Cell`), one for each close encounter and integrator; none if ``quick``."""
    return [] if quick else [_cell(e, id) for e in ENCOUNTERS for id in e.methods]


def _cell(encounter: Encounter, id: str) -> Cell:
    own = id.removesuffix(TRANSFORMED)
    used, made = BY_ID.get(own) or PEERS[own], ProblemKey(encounter.problem)
    needs = content("close_encounters", id, used, made, states(made.id), encounter.t_end, code=[__name__])
    key = {"scene": encounter.id, "method": id}
    return Cell("extremes", TABLES, key, measure_rows, (encounter.id, id), needs, frozenset({own}))


def distance(q: ArrayLike, known: ArrayLike) -> float:
    """Compute the largest difference of a coordinate of q from ``known``, relative where ``known`` exceeds 1."""
    known = np.asarray(known, float)
    return float((np.abs(np.asarray(q) - known) / np.maximum(1, np.abs(known))).max())


def measure_rows(scene: str, id: str) -> Rows:
    """Run an integrator through a close encounter at ever smaller steps or tolerances: a row for each run.

    ``scene`` is the name of an `Encounter`, ``id`` the integrator's; the rows are by table name.
    """
    encounter, rows = BY_SCENE[scene], []
    for asked, kind, s, known in _runs(encounter, id):
        if s.status == SKIPPED:
            raise Unavailable(s.reason)
        error = distance(s.q[-1][: len(known)], known) if s.status == OK else np.inf
        row = {"scene": scene, "method": id, "kind": kind, "asked": asked, "status": s.status, "error": error}
        rows.append(row | {"steps": s.counts.get("steps", 0), "evaluations": s.counts.get("gradient", 0)})
        if error <= HELD:
            break
    return {TABLES[0]: rows}


def _runs(encounter: Encounter, id: str) -> Iterator[tuple[float, str, Solution, Sequence[float] | np.ndarray]]:
    """Run an integrator at ever smaller steps or tolerances: yield (steps or tolerance, kind, solution, reference).

    The kind of steps is "fixed", "adaptive" or "transformed" (they change along the orbit by a transformation of time);
    the reference is the true q at the end.
    """
    made = problem(encounter.problem)
    known = [float(x) for x in stored.end(made, encounter.t_end).q]
    if id.endswith(TRANSFORMED):
        yield from _of_transformed(made, encounter, id.removesuffix(TRANSFORMED))
        return
    chosen = integrator(id)
    if chosen.adaptive:
        for tol in TOLERANCES:
            tol = max(tol, chosen.record.least)
            yield tol, "adaptive", chosen.run(made, h=encounter.t_end, steps=1, tol=tol), known
        return
    kind = "transformed" if id in step_changing_methods() else "fixed"
    limit = {"timeout": SECONDS} if chosen.stoppable else {}
    for n in encounter.ladder:
        yield n, kind, chosen.run(made, h=encounter.t_end / n, steps=n, save_every=0, **limit), known


def _of_transformed(
    made: Problem, encounter: Encounter, id: str
) -> Iterator[tuple[float, str, Solution, Sequence[float] | np.ndarray]]:
    """Yield (steps, "transformed", solution, reference coordinates) for a method on Poincare's transformed Hamiltonian.

    There is a run for each number of steps in the encounter's ``ladder``; its reference is computed for the time at
    which the run ends.
    """
    system = TransformedHamiltonian(made.system)
    q0, p0 = system.start(made.q0, made.p0)
    pace = 1 / float(system.observe(system.time_scale, np.array([q0]), np.array([p0]))[0])
    judge = integrator(JUDGE)
    for n in encounter.ladder:
        s = integrate(system, id, h=pace * encounter.t_end / n, steps=n, q0=q0, p0=p0, save_every=0, timeout=SECONDS)
        t = float(s.q[-1][-1])
        known = judge.run(made, h=t, steps=1, tol=judge.record.least).q[-1] if s.status == OK and t > 0 else made.q0
        yield n, "transformed", s, known


def cheapest(table: pd.DataFrame, by: str = "steps") -> pd.DataFrame:
    """Select each method's cheapest run with an error of at most `HELD` in each close encounter (column "scene").

    The cheapest has the least value in the column ``by``.  If no error is so small, the most accurate run is selected.
    """
    ordered = table.assign(held=table["error"] <= HELD).sort_values(["held", by], ascending=[False, True])
    held = ordered[ordered["held"]].drop_duplicates(["scene", "method"])
    rest = ordered[~ordered["held"]].sort_values("error", kind="stable").drop_duplicates(["scene", "method"])
    lost = rest[~rest.set_index(["scene", "method"]).index.isin(held.set_index(["scene", "method"]).index)]
    return pd.concat([held, lost])
