"""Close encounters: Kepler's orbit at e up to 0.999999, three bodies, and a zoom-whirl orbit about a black hole.

**Kepler**, over ten orbits.  The error is the largest distance from the exact apocentres, relative to their distance
from the centre.  An apocentre is q = (-(a + c), 0) exactly; the semi-axis a and the period follow in extended precision
from the doubles of the start, a pericentre.

**Others**.  Three bodies of masses 3, 4, 5 come as near as 4e-4 at t = 15.83 (Szebehely & Peters 1967); a zoom-whirl
orbit circles at 4.7 M, close to the last stable circle, and swings out to 14 M (Glampedakis & Kennefick 2002).  The
error is that of the coordinates at the time of a certified state, relative where a coordinate is above 1.  Methods
marked `TRANSFORMED` integrate Poincare's transformed Hamiltonian with a symplectic method; their runs end at other
times and are compared with a run of `JUDGE` to the same time.

Each integrator is run at ever smaller steps, or tolerances, until the error is at most `HELD` or the smallest step or
tolerance is reached.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import mpmath
import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey, Unavailable, states
from phasebench.integrators.driver import OK, SKIPPED, integrate
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.systems.transformed import TransformedHamiltonian
from phasebench.reference.certificates import stored
from phasebench.reference.peers import BY_ID as PEERS

from .curves import best, curves, legend_below

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.record import Method
    from phasebench.integrators.solution import Solution

#: (Steps or tolerance, solution, the true q at the end)
Run = tuple[float, "Solution", "Sequence[float] | np.ndarray"]

KEPLER, TABLE = "extremes_encounters", "extremes_meetings"
FIXED_STEPS, ADAPTIVE, CHANGED = "fixed", "adaptive", "transformed"
#: Words in the names of families whose methods change the step along the orbit.
CHANGING = ("transform", "variable", "adaptive", "field", "sundman", "controller")
HELD = 1e-6
#: Kepler: eccentricities, orbits, numbers of steps from one apside to the next, tolerances.
ECCENTRICITIES, ORBITS = (0.9, 0.99, 0.999, 0.999999), 10
LADDER = tuple(2**k for k in range(6, 17, 2))
TOLERANCES = (1e-8, 1e-11, 1e-14)
#: Methods with fixed steps: cheap ones, high orders, implicit ones, one made for Kepler.
FIXED = (
    *("symplectic-euler-p", "stormer-verlet", "rk4", "dop853", "forest-ruth", "pefrl", "blanes-moan-s6", "kahan-li-8"),
    *("sofroniou-spaletta-10", "implicit-midpoint", "scheme-i", "scheme-iii", "gauss-2", "gauss-4", "gauss-8", "avf"),
    *("scheme-v", "rk4-projected-energy", "wisdom-holman"),
)
OTHERS = ("rebound-ias15", "rebound-whfast", "rebound-mercurius", "rebound-trace", "heyoka", "rebound-bs")
#: The other encounters: tolerances, and the seconds after which a run is stopped if it can be.
FINER, SECONDS = (1e-8, 1e-10, 1e-12, 1e-14), 2.0
JUDGE, TRANSFORMED = "heyoka", " of K"


def step_changing_methods() -> tuple[str, ...]:
    """The ids of methods that change the step along the orbit, or are built on a method that does."""
    return tuple(m.id for m in METHODS if any(word in family for family in _families(m) for word in CHANGING))


def _families(method: Method) -> list[str]:
    return [method.family, *(f for part in method.data if hasattr(part, "family") for f in _families(part))]


def kind(method: str) -> str:
    """The kind of an integrator's steps."""
    if method.endswith(TRANSFORMED):
        return CHANGED
    return ADAPTIVE if integrator(method).adaptive else CHANGED if method in step_changing_methods() else FIXED_STEPS


def needs(method: str, **_: object) -> tuple[Method | object, ...]:
    """The records on which a row depends."""
    own = method.removesuffix(TRANSFORMED)
    return (BY_ID.get(own) or PEERS[own],)


# -- Kepler's orbit ----------------------------------------------------------------------------------------------------


def apocentre(q0: float, p0: float) -> tuple[float, float]:
    """(Half the period, distance of the apocentre) of the orbit from the pericentre (q0, 0), (0, p0)."""
    with mpmath.workdps(40):
        r, v = mpmath.mpf(q0), mpmath.mpf(p0)
        a = 1 / (2 / r - v**2)
        return float(mpmath.pi * a**1.5), float(2 * a - r)


def error(s: Solution, far: float) -> float:
    """The largest distance from the exact apocentre, relative to ``far``, over every other row; infinite if some miss.

    ``far`` is the apocentre's distance from the centre; a row is half an orbit.
    """
    q = s.q[1::2]
    return float(np.hypot(q[:, 0] + far, q[:, 1]).max() / far) if s.status == OK and len(q) >= ORBITS else np.inf


def around(method: str, made: Problem, half: float, far: float) -> Iterator[tuple[float, Solution]]:
    """(Steps in half a period or tolerance, solution) at ever smaller ones, on an orbit (see `apocentre`)."""
    chosen, last, rows = integrator(method), np.inf, 2 * ORBITS - 1
    if chosen.adaptive:
        for tol in TOLERANCES:
            yield tol, chosen.run(made, h=half, steps=rows, tol=max(tol, chosen.record.least))
        return
    for m in LADDER:
        # The longest run is skipped if the error before it is too large for one more rung to suffice.
        if m == LADDER[-1] and not last <= HELD * (LADDER[-1] / LADDER[-2]) ** ((chosen.order or 2) + 1):
            return
        s = chosen.run(made, h=half / m, steps=rows * m, save_every=m)
        last = error(s, far)
        yield m, s


def kepler(method: str) -> list[dict]:
    """The first run whose error is at most `HELD`, else the most accurate one: a row for each eccentricity."""
    rows = []
    for e in ECCENTRICITIES:
        made = problem("kepler", e=e)
        half, far = apocentre(made.q0[0], made.p0[1])
        best = {"error": np.inf, "status": "", "asked": np.nan, "steps": 0}
        for asked, s in around(method, made, half, far):
            if s.status == SKIPPED:
                raise Unavailable(s.reason)
            found = error(s, far)
            if found < best["error"] or not best["status"]:
                best = {"error": found, "status": s.status, "asked": asked, "steps": s.counts["steps"]}
            if found <= HELD:
                break
        rows.append({"kind": kind(method), "e": e, "held": best["error"] <= HELD, **best})
    return rows


# -- other encounters --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Encounter:
    """A problem (with its orbit), the end of the runs, numbers of steps to try, and the integrators."""

    problem: str
    t_end: float
    ladder: tuple[int, ...]
    methods: tuple[str, ...]


SCENES = {
    "three bodies": Encounter(
        "n-body",
        16.0,
        tuple(4**k for k in range(5, 10)),
        (
            *("stormer-verlet", "kahan-li-8", "dop853", "implicit-midpoint", "gauss-4"),
            *("stormer-verlet-adaptive", "gauss-4-adaptive", "gauss-8-adaptive"),
            *("rebound-ias15", "rebound-bs", "heyoka"),
        ),
    ),
    "zoom-whirl": Encounter(
        "schwarzschild:zoom-whirl",
        1000.0,
        tuple(4**k for k in range(3, 9)),
        (
            *("rk4", "dop853", "implicit-midpoint", "scheme-i", "gauss-2", "gauss-4", "gauss-8"),
            *(f"{id}{TRANSFORMED}" for id in ("implicit-midpoint", "gauss-4")),
            *("heyoka", "scipy-dop853"),
        ),
    ),
}


def distance(q: ArrayLike, known: ArrayLike) -> float:
    """The largest difference of a coordinate of q from ``known``, relative where ``known`` exceeds 1."""
    known = np.asarray(known, float)
    return float((np.abs(np.asarray(q) - known) / np.maximum(1, np.abs(known))).max())


def meet(scene: str, method: str) -> list[dict]:
    """The error after an encounter at ever smaller steps or tolerances: a row for each run."""
    rows = []
    for asked, s, known in through(SCENES[scene], method):
        if s.status == SKIPPED:
            raise Unavailable(s.reason)
        off = distance(s.q[-1][: len(known)], known) if s.status == OK else np.inf
        row = {"kind": kind(method), "asked": asked, "status": s.status, "error": off}
        rows.append(row | {"steps": s.counts.get("steps", 0), "evaluations": s.counts.get("gradient", 0)})
        if off <= HELD:
            break
    return rows


def through(scene: Encounter, method: str) -> Iterator[Run]:
    """The runs of an integrator at ever smaller steps or tolerances."""
    made = problem(scene.problem)
    if method.endswith(TRANSFORMED):
        yield from of_transformed(made, scene, method.removesuffix(TRANSFORMED))
        return
    known = [float(x) for x in stored.end(made, scene.t_end).q]
    chosen = integrator(method)
    if chosen.adaptive:
        for tol in (max(tol, chosen.record.least) for tol in FINER):
            yield tol, chosen.run(made, h=scene.t_end, steps=1, tol=tol), known
        return
    limit = {"timeout": SECONDS} if chosen.stoppable else {}
    for n in scene.ladder:
        yield n, chosen.run(made, h=scene.t_end / n, steps=n, save_every=0, **limit), known


def of_transformed(made: Problem, scene: Encounter, method: str) -> Iterator[Run]:
    """The runs of a method on Poincare's transformed Hamiltonian; the true q is that of the time at which they end."""
    system = TransformedHamiltonian(made.system)
    q0, p0 = system.start(made.q0, made.p0)
    pace = 1 / float(system.observe(system.time_scale, np.array([q0]), np.array([p0]))[0])
    judge = integrator(JUDGE)
    for n in scene.ladder:
        s = integrate(system, method, h=pace * scene.t_end / n, steps=n, q0=q0, p0=p0, save_every=0, timeout=SECONDS)
        t = float(s.q[-1][-1])
        known = judge.run(made, h=t, steps=1, tol=judge.record.least).q[-1] if s.status == OK and t > 0 else made.q0
        yield n, s, known


# -- judging, and what is shown ----------------------------------------------------------------------------------------


def cheapest(rows: pd.DataFrame) -> pd.DataFrame:
    """Each method's run with the fewest steps and an error of at most `HELD` in each scene, else its most accurate."""
    ordered = rows.assign(held=rows["error"] <= HELD)
    ordered = ordered.assign(by=ordered["steps"].where(ordered["held"], ordered["error"]))
    first = ordered.sort_values(["held", "by", "steps"], ascending=[False, True, True])
    return first.drop_duplicates(["scene", "method"]).drop(columns="by")


def adaptive(rows: pd.DataFrame) -> pd.Series:
    """True where an integrator with adaptive steps reaches the wanted error, by integrator and scene."""
    found = cheapest(rows)
    found = found[found["kind"] == ADAPTIVE]
    return found["held"].set_axis([f"{r.method}, {r.scene}" for r in found.itertuples()])


@of(TABLE)
def answer(rows: pd.DataFrame) -> str:
    """For each scene the fewest steps of each kind that reach the wanted error, and the kinds that fail."""
    parts = []
    for scene, part in cheapest(rows).groupby("scene", sort=False):
        fewest = part[part["held"]].groupby("kind", sort=False)["steps"].min()
        needs = " or ".join(f"{steps} {kind}" for kind, steps in fewest.items())
        lost = [kind for kind in dict.fromkeys(part["kind"]) if kind not in fewest]
        parts.append(f"{scene}: {needs or 'none'}{f' ({join_list(lost)} fail)' if lost else ''}")
    return f"Steps needed for an error of {HELD:g} after close encounters: {'; '.join(parts)}."


@of(TABLE)
@style.styled
def draw(rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """The error at the end over the number of steps, a panel for each scene."""
    scenes = list(dict.fromkeys(rows["scene"]))
    figure, (panels,) = style.panels(1, len(scenes), 3.8)
    for axes, scene in zip(panels, scenes, strict=True):
        part = rows[rows["scene"] == scene]
        curves(axes, part, "method", "steps", "error", best(part), (1e-14, 10))
        axes.axhline(HELD, color=style.GREY, linewidth=0.8)
        axes.set(title=scene, xlabel="steps")
        legend_below(axes)
    panels[0].set_ylabel("error at the end")
    caption = (
        "The error over the number of steps, with ever smaller steps until it is below the grey line; at the top: the "
        "orbit is lost. At most nine integrators a panel."
    )
    return [Picture(style.save(figure, folder, "extremes-meetings.png"), "other close encounters", caption)]


@of(TABLE)
def table(rows: pd.DataFrame) -> Table:
    """The run with the fewest steps that follows an encounter, else the best, of each integrator."""
    order = ["scene", "held", "steps"]
    found = cheapest(rows).sort_values(order, ascending=[True, False, True]).head(ROWS)
    shown = found[["scene", "method", "kind", "steps", "evaluations", "error", "status"]]
    shown = shown.assign(evaluations=shown["evaluations"].where(shown["evaluations"] > 0, np.nan))
    caption = (
        f"The fewest steps with an error of at most {HELD:g}, else the run of the least error; evaluations are empty "
        "for packages that do not count them."
    )
    return Table(shown, caption)


STUDY = Study(
    id="extremes-encounters",
    place=210,
    question="Which steps hold close encounters of three bodies, and a zoom-whirl orbit?",
    answer=answer,
    setting=(
        "Three bodies: masses 3, 4, 5 at rest, to t = 16, past the approach to 4e-4 at t = 15.83 (Burrau 1913; "
        "Szebehely & Peters 1967).",
        "Zoom-whirl: a geodesic of Schwarzschild's metric of eccentricity 1/2 at the edge of stability, to t = 1000; "
        "H is not separable.",
        "The error is that of the coordinates at a certified state, relative where they are above 1; steps get smaller "
        f"by factors of 4, tolerances go from {FINER[0]:g} to {FINER[-1]:g}.",
        "Transformed: steps that change along the orbit, by Hairer and Söderlind's reversible control or (`of K`) by "
        "Poincaré's K = σ (H + p_t) with a symplectic method.",
    ),
    runs=(
        Runs(
            TABLE, meet, [{"scene": name, "method": id} for name, scene in SCENES.items() for id in scene.methods],
            needs=lambda scene, method: (
                *needs(method), SCENES[scene].t_end, ProblemKey(SCENES[scene].problem),
                states(SCENES[scene].problem.partition(":")[0]),
            ),
        ),
    ),
    claims={
        "adaptive": Claim(
            "Integrators with adaptive steps reach the wanted error in every scene",
            TABLE, adaptive, EVERY, unit="cases of an integrator and a scene", names=3,
        ),
    },
    figure=draw,
    shown=table,
    limits=(
        f"A run of a method of this project is stopped after {SECONDS:g} s, and counts with the status it had.",
        "The three bodies' motion multiplies an error by about 10^4 up to the end: a run with a large error is on "
        "another orbit.",
        "MERCURIUS and TRACE are made for one dominating body: they are among [Kepler's encounters](extremes.md).",
        "A step costs one evaluation or a hundred: steps are no cost; evaluations are in the table, seconds on the "
        "page [speed](speed.md).",
    ),
    within="extremes",
    listed=False,
)  # fmt: skip
