r"""The largest step at which runs survive, by bisection on a geometric grid, and how the next larger one fails.

A run fails if it ends badly, or if its energy error is as large as the terms of H, the least of :math:`\sum_k |H_k|`,
H = H_1 + H_2 + ..., along the orbit.  A method that keeps the energy passes this test on any orbit: on a regular one a
run is therefore also wrong if a coordinate leaves its range on the true orbit, and has a wrong clock if its first
coordinate crosses the middle of that range too seldom or too often: steps longer than half a period cannot follow the
motion, whatever they keep.  (An ellipse that precesses leaves its range: for Kepler only the clock is judged.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pandas as pd
import sympy as sp

from phasebench.benchmarks import style
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.registry import BY_ID

TABLE, SWEPT = "extremes_steps", "extremes_lambda"
#: The methods that are pushed, one of each kind, cheap ones first.
REPRESENTATIVE = (
    *("symplectic-euler-p", "stormer-verlet", "rk4", "mclachlan-s2", "forest-ruth", "pefrl", "blanes-moan-s6"),
    *("kahan-li-8", "implicit-midpoint", "scheme-i", "scheme-ii", "scheme-iii", "gauss-2", "gauss-4", "avf"),
    *("scheme-iv", "scheme-v", "rk4-projected-energy"),
)
LOST, WRONG, CLOCK = "energy-lost", "wrong-orbit", "wrong-clock"
TRUTH, FINE, TIMES, LONGER = "dop853", 8, 400, 8000
#: Share of its range by which a coordinate may leave it; crossings needed to judge a rate; the factor it may be off.
MARGIN, CROSSINGS, OFF = 0.5, 8, 2.0
#: Rows of a run that are judged, and the seconds after which it counts as failed.
SEEN, SECONDS = 1000, 4.0
#: Steps of a run, steps of a shorter run before it, and grid points in a factor of two of the step.
STEPS, FIRST, PARTS = 100_000, 300, 8
#: Largest number of halvings and of doublings of the problem's own step.
DOWN, UP = 8, 14
#: The lambdas at which Schemes I to III are run on two of the orbits, and the steps of these runs.
LAMBDAS = ("-1000", "-100", "-10", "-3", "-1", "0", "1/3", "1/2", "2/3", "1", "2", "4", "11", "101", "1000")
SWEPT_STEPS = 10_000


@dataclass(frozen=True)
class Case:
    """An orbit on which methods are pushed to their largest step.

    Of a run |q| is at most ``bound``, if the energy bounds it; past ``escapes`` it is gone for good, and rightly so.
    ``ranged``: the orbit soon fills the range of its coordinates; ``timed``: the first one crosses ``middle``, by
    default the middle of its range, at a steady rate.  (q, p) is the start, if it is not the problem's.
    """

    problem: str
    q: tuple[float, ...] | None = None
    p: tuple[float, ...] | None = None
    bound: float | None = None
    escapes: float | None = None
    ranged: bool = False
    timed: bool = False
    middle: float | None = None


#: The start (q, p) of the orbit of Henon-Heiles with H = 0.18 and q2 = 0.1.
ABOVE = (0.0, 0.1), ((2 * 0.18 - 0.1**2 + 2 * 0.1**3 / 3) ** 0.5, 0.0)
CASES = {
    "pendulum": Case("pendulum:swinging", bound=math.pi, ranged=True, timed=True),
    "pendulum, 1e-12 below the separatrix": Case("pendulum", (0.0,), (2 * (1 - 1e-12) ** 0.5,), bound=math.pi),
    "pendulum, on the separatrix": Case("pendulum", (0.0,), (2.0,)),
    "Lotka-Volterra": Case("lotka-volterra-log:4-2", ranged=True, timed=True),
    "Henon-Heiles, box": Case("henon-heiles:box", escapes=3.0, ranged=True, timed=True),
    "Henon-Heiles, at escape": Case("henon-heiles:chaotic", escapes=3.0),
    "Henon-Heiles, beyond escape": Case("henon-heiles", *ABOVE, escapes=3.0),
    "Kepler, e = 0.6": Case("kepler", bound=2.0, timed=True, middle=0.0),
}


class Course(NamedTuple):
    """The range of each coordinate (arrays (d,)); a value of the first one, and its crossings in a unit of time.

    ``size`` is the least, along the beginning of the orbit, of the sum of the absolute values of H's terms.
    """

    low: np.ndarray
    high: np.ndarray
    middle: float
    rate: float
    size: float


@lru_cache(maxsize=32)
def course(case: Case) -> Course:
    """The extent and the frequency of a case's orbit, by a long run of `TRUTH`."""
    made = problem(case.problem)
    truth = integrate(made, TRUTH, h=made.pace.step / FINE, steps=LONGER, q0=case.q, p0=case.p)
    q, p, terms = truth.q[: TIMES + 1], truth.p[: TIMES + 1], sp.Add.make_args(sp.expand(made.system.H))
    size = float(sum(np.abs(made.system.observe(term, q, p)) for term in terms).min())
    low, high = truth.q.min(axis=0), truth.q.max(axis=0)
    middle = (low[0] + high[0]) / 2 if case.middle is None else case.middle
    return Course(low, high, middle, crossings(truth.q[:, 0], middle) / truth.t[-1], size)


def crossings(x: np.ndarray, middle: float) -> int:
    """How often a series crosses the value ``middle``."""
    return int(np.count_nonzero(np.diff(np.signbit(x - middle))))


def strays(case: Case, Q: np.ndarray, span: float, every_step: bool) -> str:
    """Judge rows Q of a run over a time ``span`` by the true orbit's ranges and rate: `OK`, `WRONG` or `CLOCK`.

    The rate is judged only if Q has a row of every step.
    """
    known = course(case)
    room = MARGIN * (known.high - known.low)
    if case.ranged and ((known.low - room > Q).any() or (known.high + room < Q).any()):
        return WRONG
    expected = known.rate * span
    if not (case.timed and every_step and expected >= CROSSINGS):
        return OK
    return OK if expected / OFF <= crossings(Q[:, 0], known.middle) <= expected * OFF else CLOCK


def judge_run(case: Case, method: str, h: float, steps: int, parameters: dict | None = None) -> str:
    """Run a method on a case and judge the run: `OK`, the status of a run that stopped, `LOST`, `WRONG` or `CLOCK`."""
    made, every = problem(case.problem), max(1, steps // SEEN)
    more = {"parameters": parameters, "timeout": SECONDS, "save_every": every}
    s = integrate(made, method, h=h, steps=steps, q0=case.q, p0=case.p, **more)
    Q, P, status = s.q, s.p, s.status
    if case.escapes is not None:
        gone = np.flatnonzero(np.abs(Q).max(axis=1) > case.escapes)
        if len(gone):
            Q, P, status = Q[: gone[0]], P[: gone[0]], OK
    with np.errstate(all="ignore"):
        H = made.system.observe(made.system.H, Q, P)
        off = ~(np.abs(H - H[0]) <= course(case).size)
    if off.any():
        return LOST
    if case.bound is not None and np.abs(Q).max() > case.bound:
        return WRONG
    if status == OK and (case.ranged or case.timed):
        return strays(case, Q, s.t[len(Q) - 1], steps <= SEEN)
    return status


def largest(survives: Callable[[float], str], first: float) -> tuple[float, str]:
    """(The largest step that survives, how the next larger one fails); 0 if none survives, inf if all do.

    ``survives`` is a function from h to `OK` or to the way in which the run fails; the search begins at ``first``.
    """
    k, failure = 0, ""
    while k > -DOWN * PARTS and (failure := survives(first * 2 ** (k / PARTS))) != OK:
        k -= PARTS
    if k <= -DOWN * PARTS:
        return 0.0, failure
    good, bad = k, None
    while bad is None and good < UP * PARTS:
        found = survives(first * 2 ** ((good + PARTS) / PARTS))
        good, bad, failure = (good + PARTS, None, "") if found == OK else (good, good + PARTS, found)
    while bad is not None and bad - good > 1:
        middle = (good + bad) // 2
        found = survives(first * 2 ** (middle / PARTS))
        good, bad, failure = (middle, bad, failure) if found == OK else (good, middle, found)
    return (math.inf if bad is None else first * 2 ** (good / PARTS)), failure


def push(orbit: str, method: str, first: float, steps: int, parameters: dict | None = None) -> dict:
    """A row with the largest step; before each run a shorter one is made, to save time if it fails."""

    def survives(h: float) -> str:
        found = judge_run(CASES[orbit], method, h, FIRST, parameters)
        return judge_run(CASES[orbit], method, h, steps, parameters) if found == OK else found

    h, fails = largest(survives, first)
    return {"largest h": h, "fails": fails, "steps": steps}


def pushed(method: str) -> list[dict]:
    """The largest step on each orbit that the method can integrate."""
    made = {name: problem(case.problem) for name, case in CASES.items()}
    able = {name: found.pace.step for name, found in made.items() if not BY_ID[method].lacks(found.system)}
    return [{"orbit": name} | push(name, method, step, STEPS) for name, step in able.items()]


def swept(method: str, orbit: str) -> list[dict]:
    """A scheme's largest step: a row for each of `LAMBDAS`."""
    rows, step = [], problem(CASES[orbit].problem).pace.step
    for value in LAMBDAS:
        lam = float(Fraction(value))
        # Far from lambda = 1/2 the first stable interval ends at 2 / |1 - 2 lambda|; some have another one beyond.
        found = push(orbit, method, step / (1 + abs(1 - 2 * lam)), SWEPT_STEPS, {"lam": value})
        rows.append({"lam": lam} | found)
    return rows


@picture(
    SWEPT, "extremes-lambda", "largest steps over lambda",
    "The largest step of Schemes I to III that survives, over λ from −1000 to 1000.",
)  # fmt: skip
def draw(rows: pd.DataFrame) -> style.Figure:
    """The largest surviving step of Schemes I to III over their parameter lambda, a panel for each orbit."""
    parts = rows.replace({"largest h": {0: np.nan, np.inf: np.nan}}).groupby("orbit", sort=False)
    of_method = style.curves("method", "lam", "largest h", most=9)
    figure = style.row(parts, of_method, 2.8, "λ", "largest h", legend=3, grid=False, sharey=True)
    for axes in figure.axes:
        axes.set_xscale("symlog", linthresh=1)
    return figure


RUNS = (
    Runs(TABLE, pushed, over(method=REPRESENTATIVE),
         needs=lambda method: (BY_ID[method], *(ProblemKey(case.problem) for case in CASES.values()))),
    Runs(SWEPT, swept, [{"method": id, "orbit": orbit} for id in ("scheme-i", "scheme-ii", "scheme-iii")
                        for orbit in ("pendulum", "Henon-Heiles, box")],
         needs=lambda method, orbit: (BY_ID[method], ProblemKey(CASES[orbit].problem))),
)  # fmt: skip
