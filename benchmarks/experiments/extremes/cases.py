r"""The orbits on which methods are pushed to their largest step, and the judgement of a run.

A run fails if it ends badly, or if it loses the energy: its error is as large as the terms of H, the least of
:math:`\sum_k |H_k|`, H = H_1 + H_2 + ..., along the orbit, computed by a run of `TRUTH` with a small step.

A method that keeps the energy passes this test on any orbit.  On a regular orbit a run is therefore also wrong if a
coordinate leaves its range on the true orbit by more than `MARGIN` of it, and has a wrong clock if its first coordinate
crosses the middle of that range less than half or more than twice as often as on the true orbit: steps longer than half
a period cannot follow the motion, whatever they keep.  (An ellipse that precesses leaves its range: for Kepler only the
clock is judged.)  On other orbits a run is wrong if a coordinate leaves the range that the energy allows.  If the orbit
itself escapes, a run that escapes with its energy kept is right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import OK, integrate

LOST, WRONG, CLOCK = "energy-lost", "wrong-orbit", "wrong-clock"
TRUTH, FINE, TIMES, LONGER = "dop853", 8, 400, 8000
#: Share of its range by which a coordinate may leave it; crossings needed to judge a rate; the factor it may be off.
MARGIN, CROSSINGS, OFF = 0.5, 8, 2.0
#: Rows of a run that are judged, and the seconds after which it counts as failed.
SEEN, SECONDS = 1000, 4.0


@dataclass(frozen=True)
class Case:
    """An orbit on which methods are pushed to their largest step.

    Attributes
    ----------
    id, problem : the case's name, and the problem (with its orbit)
    q, p : the start, if it is not the problem's
    bound : the largest |q| that the energy allows; None if it allows any
    escapes : the |q| beyond which an orbit that can escape is gone for good
    ranged : whether the orbit soon fills the range of its coordinates, so that runs may be judged by it
    timed : whether the first coordinate crosses the middle of its range at a steady rate
    middle : the value of the first coordinate whose crossings are counted; None for the middle of its range
    """

    id: str
    problem: str
    q: tuple[float, ...] | None = None
    p: tuple[float, ...] | None = None
    bound: float | None = None
    escapes: float | None = None
    ranged: bool = False
    timed: bool = False
    middle: float | None = None


def _henon_heiles(H0: float, q2: float) -> tuple[float, float]:
    return (2 * H0 - q2**2 + 2 * q2**3 / 3) ** 0.5, 0.0


CASES = (
    Case("pendulum", "pendulum:swinging", bound=math.pi, ranged=True, timed=True),
    Case("pendulum, 1e-12 below the separatrix", "pendulum", (0.0,), (2 * (1 - 1e-12) ** 0.5,), bound=math.pi),
    Case("pendulum, on the separatrix", "pendulum", (0.0,), (2.0,)),
    Case("Lotka-Volterra", "lotka-volterra-log:4-2", ranged=True, timed=True),
    Case("Henon-Heiles, box", "henon-heiles:box", escapes=3.0, ranged=True, timed=True),
    Case("Henon-Heiles, at escape", "henon-heiles:chaotic", escapes=3.0),
    Case("Henon-Heiles, beyond escape", "henon-heiles", (0.0, 0.1), _henon_heiles(0.18, 0.1), escapes=3.0),
    Case("Kepler, e = 0.6", "kepler", bound=2.0, timed=True, middle=0.0),
)
BY_ID = {c.id: c for c in CASES}


@lru_cache(maxsize=32)
def size(case: Case) -> float:
    """Compute the least, along a case's orbit, of the sum of the absolute values of H's terms."""
    made = problem(case.problem)
    truth = integrate(made, TRUTH, h=made.pace.step / FINE, steps=TIMES, q0=case.q, p0=case.p)
    terms = sp.Add.make_args(sp.expand(made.system.H))
    return float(sum(np.abs(made.system.observe(t, truth.q, truth.p)) for t in terms).min())


class Course(NamedTuple):
    """The extent and the frequency of a case's true orbit.

    Attributes
    ----------
    low, high : the range of each coordinate, arrays (d,)
    middle : the value of the first coordinate whose crossings are counted
    rate : crossings in a unit of time
    """

    low: np.ndarray
    high: np.ndarray
    middle: float
    rate: float


@lru_cache(maxsize=32)
def course(case: Case) -> Course:
    """Compute the extent and the frequency of a case's regular orbit, by a long run of the method `TRUTH`."""
    made = problem(case.problem)
    truth = integrate(made, TRUTH, h=made.pace.step / FINE, steps=LONGER, q0=case.q, p0=case.p)
    low, high = truth.q.min(axis=0), truth.q.max(axis=0)
    middle = (low[0] + high[0]) / 2 if case.middle is None else case.middle
    return Course(low, high, middle, crossings(truth.q[:, 0], middle) / truth.t[-1])


def crossings(x: np.ndarray, middle: float) -> int:
    """Count how often a series crosses the value ``middle``."""
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
    """Run a method on a case and judge the run: `OK`, the status of a run that stopped, `LOST`, `WRONG` or `CLOCK`.

    `LOST`: the energy is not kept; `WRONG`: it is another orbit; `CLOCK`: the frequency is that of another orbit.
    """
    made = problem(case.problem)
    s = integrate(
        made,
        method,
        h=h,
        steps=steps,
        q0=case.q,
        p0=case.p,
        save_every=max(1, steps // SEEN),
        parameters=parameters,
        timeout=SECONDS,
    )
    Q, P, status = s.q, s.p, s.status
    if case.escapes is not None:
        gone = np.flatnonzero(np.abs(Q).max(axis=1) > case.escapes)
        if len(gone):
            Q, P, status = Q[: gone[0]], P[: gone[0]], OK
    with np.errstate(all="ignore"):
        H = made.system.observe(made.system.H, Q, P)
        off = ~(np.abs(H - H[0]) <= size(case))
    if off.any():
        return LOST
    if case.bound is not None and np.abs(Q).max() > case.bound:
        return WRONG
    if status == OK and (case.ranged or case.timed):
        return strays(case, Q, s.t[len(Q) - 1], steps <= SEEN)
    return status
