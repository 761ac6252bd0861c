"""Close encounters: Kepler's orbit at e up to 0.999999, three bodies, and a zoom-whirl orbit about a black hole.

Kepler's apocentres are q = (-(a + c), 0) exactly; the semi-axis a and the period follow in extended precision from the
doubles of the start, a pericentre.  Three bodies come as near as 4e-4 at t = 15.83 (Szebehely & Peters 1967); a
zoom-whirl orbit circles at 4.7 M, close to the last stable circle, and swings out to 14 M (Glampedakis & Kennefick
2002).  Methods marked `TRANSFORMED` integrate Poincare's transformed Hamiltonian with a symplectic method; their runs
end at other times and are compared with a run of `JUDGE` to the same time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import mpmath
import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey, Unavailable, states
from phasebench.integrators.driver import OK, SKIPPED, integrate
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.systems.transformed import TransformedHamiltonian
from phasebench.reference.certificates import stored
from phasebench.reference.peers import BY_ID as PEERS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.solution import Solution

KEPLER, TABLE = "extremes_encounters", "extremes_meetings"
FIXED_STEPS, ADAPTIVE, CHANGED = "fixed", "adaptive", "transformed"
#: Methods that change the step along the orbit.
STEP_CHANGING = tuple(m.id for m in METHODS if m.family in ("adaptive", "field"))
HELD = 1e-6
#: Kepler: eccentricities, orbits, numbers of steps from one apside to the next, tolerances.
ECCENTRICITIES, ORBITS = (0.9, 0.99, 0.999, 0.999999), 10
LADDER, TOLERANCES = (64, 256, 1024, 4096, 16384, 65536), (1e-8, 1e-11, 1e-14)
#: Methods with fixed steps: cheap ones, high orders, implicit ones, one made for Kepler; then those of other packages.
FIXED = (
    *("symplectic-euler-p", "stormer-verlet", "rk4", "dop853", "forest-ruth", "pefrl", "blanes-moan-s6", "kahan-li-8"),
    *("sofroniou-spaletta-10", "implicit-midpoint", "scheme-i", "scheme-iii", "gauss-2", "gauss-4", "gauss-8", "avf"),
    *("scheme-v", "rk4-projected-energy", "wisdom-holman"),
)
OTHERS = ("rebound-ias15", "rebound-whfast", "rebound-mercurius", "rebound-trace", "heyoka", "rebound-bs")
#: The other encounters: tolerances, and the seconds after which a run is stopped if it can be.
FINER, SECONDS = (1e-8, 1e-10, 1e-12, 1e-14), 2.0
JUDGE, TRANSFORMED = "heyoka", " of K"


class Encounter(NamedTuple):
    """A problem (with its orbit), the end of the runs, numbers of steps to try, and the integrators."""

    problem: str
    t_end: float
    ladder: tuple[int, ...]
    methods: tuple[str, ...]


SCENES = {
    "three bodies": Encounter("n-body", 16.0, (1024, 4096, 16384, 65536, 262144), (
        *("stormer-verlet", "kahan-li-8", "dop853", "implicit-midpoint", "gauss-4"),
        *("stormer-verlet-adaptive", "gauss-4-adaptive", "gauss-8-adaptive"),
        *("rebound-ias15", "rebound-bs", "heyoka"),
    )),
    "zoom-whirl": Encounter("schwarzschild:zoom-whirl", 1000.0, (64, 256, 1024, 4096, 16384, 65536), (
        *("rk4", "dop853", "implicit-midpoint", "scheme-i", "gauss-2", "gauss-4", "gauss-8"),
        *(f"{id}{TRANSFORMED}" for id in ("implicit-midpoint", "gauss-4")),
        *("heyoka", "scipy-dop853"),
    )),
}  # fmt: skip


def kind(method: str) -> str:
    """The kind of an integrator's steps."""
    if method in STEP_CHANGING or method.endswith(TRANSFORMED):
        return CHANGED
    return ADAPTIVE if integrator(method).adaptive else FIXED_STEPS


def climb(
    chosen: Integrator, made: Problem, h: float, rows: int, ladder: Sequence[int], tolerances: Sequence[float], **limit
) -> Iterator[tuple[float, Solution]]:
    """(Steps in a time h, or tolerance; solution with ``rows`` rows, h apart) at ever smaller ones."""
    if chosen.adaptive:
        runs = ((tol, {"h": h, "steps": rows, "tol": max(tol, chosen.record.least)}) for tol in tolerances)
    else:
        runs = ((n, {"h": h / n, "steps": rows * n, "save_every": n, **limit}) for n in ladder)
    for asked, options in runs:
        s = chosen.run(made, **options)
        if s.status == SKIPPED:
            raise Unavailable(s.reason)
        yield asked, s


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


def kepler(method: str) -> list[dict]:
    """The first run whose error is at most `HELD`, else the most accurate one: a row for each eccentricity."""
    chosen, rows = integrator(method), []
    for e in ECCENTRICITIES:
        made, tried = problem("kepler", e=e), []
        half, far = apocentre(made.q0[0], made.p0[1])
        for asked, s in climb(chosen, made, half, 2 * ORBITS - 1, LADDER, TOLERANCES):
            off = error(s, far)
            tried.append({"error": off, "status": s.status, "asked": asked, "steps": s.counts["steps"]})
            # The longest run is skipped if the error before it is too large for one more rung to suffice.
            hopeless = asked == LADDER[-2] and not off <= HELD * 4 ** ((chosen.order or 2) + 1)
            if off <= HELD or hopeless:
                break
        best = min(tried, key=lambda row: row["error"])
        rows.append({"kind": kind(method), "e": e, "held": best["error"] <= HELD, **best})
    return rows


def distance(q: ArrayLike, known: ArrayLike) -> float:
    """The largest difference of a coordinate of q from ``known``, relative where ``known`` exceeds 1."""
    known = np.asarray(known, float)
    return float((np.abs(np.asarray(q) - known) / np.maximum(1, np.abs(known))).max())


def meet(scene: str, method: str) -> list[dict]:
    """The error after an encounter at ever smaller steps or tolerances: a row for each run."""
    rows = []
    for asked, s, known in _through(SCENES[scene], method):
        off = distance(s.q[-1][: len(known)], known) if s.status == OK else np.inf
        row = {"kind": kind(method), "asked": asked, "status": s.status, "error": off}
        rows.append(row | {"steps": s.counts.get("steps", 0), "evaluations": s.counts.get("gradient", 0)})
        if off <= HELD:
            break
    return rows


def _through(scene: Encounter, method: str) -> Iterator[tuple[float, Solution, Sequence[float] | np.ndarray]]:
    """(Steps or tolerance, solution, true q at its end) of an integrator at ever smaller steps or tolerances."""
    made = problem(scene.problem)
    if not method.endswith(TRANSFORMED):
        chosen, known = integrator(method), [float(x) for x in stored.end(made, scene.t_end).q]
        limit = {"timeout": SECONDS} if chosen.stoppable else {}
        finer = [max(tol, chosen.record.least) for tol in FINER] if chosen.adaptive else ()
        yield from ((n, s, known) for n, s in climb(chosen, made, scene.t_end, 1, scene.ladder, finer, **limit))
        return
    system, judge = TransformedHamiltonian(made.system), integrator(JUDGE)
    q0, p0 = system.start(made.q0, made.p0)
    span = scene.t_end / float(system.observe(system.time_scale, np.array([q0]), np.array([p0]))[0])
    options = {"q0": q0, "p0": p0, "save_every": 0, "timeout": SECONDS}
    for n in scene.ladder:
        s = integrate(system, method.removesuffix(TRANSFORMED), h=span / n, steps=n, **options)
        t = float(s.q[-1][-1])
        known = judge.run(made, h=t, steps=1, tol=judge.record.least).q[-1] if s.status == OK and t > 0 else made.q0
        yield n, s, known


def cheapest(rows: pd.DataFrame) -> pd.DataFrame:
    """Each method's run with the fewest steps and an error of at most `HELD` in each scene, else its most accurate."""
    rows = rows.assign(held=rows["error"] <= HELD)
    by = rows["steps"].where(rows["held"], rows["error"])
    first = rows.assign(by=by).sort_values(["held", "by", "steps"], ascending=[False, True, True])
    return first.drop_duplicates(["scene", "method"]).drop(columns="by")


@of(TABLE)
def _answer(rows: pd.DataFrame) -> str:
    parts = []
    for scene, part in cheapest(rows).groupby("scene", sort=False):
        fewest = part[part["held"]].groupby("kind", sort=False)["steps"].min()
        needs = " or ".join(f"{steps} {kind}" for kind, steps in fewest.items())
        lost = [kind for kind in part["kind"].unique() if kind not in fewest]
        parts.append(f"{scene}: {needs or 'none'}{f' ({join_list(lost)} fail)' if lost else ''}")
    return f"Steps needed for an error of {HELD:g} after close encounters: {'; '.join(parts)}."


@picture(
    TABLE, "extremes-meetings", "other close encounters",
    "The error over the number of steps, with ever smaller steps until it is below the grey line; at the top: the "
    "orbit is lost. At most nine integrators a panel.",
)  # fmt: skip
def draw(rows: pd.DataFrame) -> style.Figure:
    """The error at the end over the number of steps, a panel for each scene."""
    of_method = style.curves("method", "steps", "error", order="min", most=9, span=(1e-14, 10), level=HELD)
    return style.row(rows.groupby("scene", sort=False), of_method, 3.8, "steps", "error at the end", grid=False)


@picture(
    KEPLER, "extremes-encounters", "close encounters",
    f"Kepler, {ORBITS} orbits: the first error below {HELD:g}, else the least, on a ladder of steps or tolerances; "
    "what is lost altogether stands at the top. At most nine integrators a panel.",
)  # fmt: skip
def draw_kepler(rows: pd.DataFrame) -> style.Figure:
    """Each integrator's error on Kepler orbits over 1 - e, e the eccentricity."""
    rows = rows.assign(near=1 - rows["e"])
    fixed = rows["kind"] == FIXED_STEPS
    parts = ("fixed steps", rows[fixed]), ("adaptive or transformed", rows[~fixed])
    of_method = style.curves("method", "near", "error", order="max", most=9, span=(1e-16, 10), level=HELD)
    figure = style.row(parts, of_method, 4.0, "1 − e", "relative error", grid=False, sharey=True)
    for axes in figure.axes:
        axes.invert_xaxis()
    return figure


@of(TABLE)
def _table(rows: pd.DataFrame) -> Table:
    found = cheapest(rows).sort_values(["scene", "held", "steps"], ascending=[True, False, True]).head(ROWS)
    shown = found[["scene", "method", "kind", "steps", "evaluations", "error", "status"]]
    caption = (
        f"The fewest steps with an error of at most {HELD:g}, else the run of the least error; evaluations are empty "
        "for packages that do not count them."
    )
    return Table(shown.assign(evaluations=shown["evaluations"].replace(0, np.nan)), caption)


def needs(method: str) -> object:
    """The record on which a row depends."""
    own = method.removesuffix(TRANSFORMED)
    return BY_ID.get(own) or PEERS[own]


STUDY = Study(
    id="extremes-encounters",
    place=210,
    question="Which steps hold close encounters of three bodies, and a zoom-whirl orbit?",
    answer=_answer,
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
                needs(method), SCENES[scene].t_end, ProblemKey(SCENES[scene].problem),
                states(SCENES[scene].problem.partition(":")[0]),
            ),
        ),
    ),
    claims={
        "adaptive": Claim(
            "Integrators with adaptive steps reach the wanted error in every scene",
            of(TABLE)(cheapest), "held", rows=f"kind == '{ADAPTIVE}'", unit="cases of an integrator and a scene",
            where="{method}, {scene}", names=3,
        ),
    },
    figure=draw,
    shown=_table,
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
