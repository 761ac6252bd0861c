"""The problems of the audit, with start states in general position and reference states later on the orbit.

A problem's own start is often a turning point or lies on an axis, where leading error terms may vanish.  A case
therefore starts at a later point of the orbit, computed with heyoka's long double Taylor series and rounded to double.
The reference states come from that series, restarted from the rounded state and checked in quadruple precision
(`reference.solvers.taylor`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.problems.base import Problem

#: Methods of this project that every audit includes: their proved properties must be confirmed.
CONTROLS = ("stormer-verlet", "rk4", "scheme-iii", "gauss-2")
#: Rows of a run that measures the order, equally spaced in time; the error is the largest over them.
ROWS = 2
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Case:
    """A problem of the audit, whose start, step and span follow from its `pace`.

    ``unit`` says whether one finite-difference displacement suits all components, ``lasting`` whether the orbit has no
    close encounters.
    """

    problem: str
    letter: str
    separable: bool = True
    unit: bool = True
    lasting: bool = True
    parameters: tuple[tuple[str, float], ...] = ()

    @property
    def after(self) -> float:
        """The time on the problem's own orbit at which the case starts."""
        return problem(self).pace.later

    @property
    def span(self) -> float:
        """The time span over which the order is measured."""
        return problem(self).pace.span

    @property
    def h(self) -> float:
        """The step size of all measures but the order."""
        return problem(self).pace.step


#: The measures that compare with the reference states.
AGAINST_TRUTH = ("order", "tolerance")
#: In order of preference.  The perturbation is strong, so that every error term of a Wisdom-Holman splitting shows.
CASES = (
    Case("henon-heiles:box", "H"),
    Case("pendulum:swinging", "P"),
    Case("perturbed-kepler", "D", parameters=(("e", 0.2), ("mu", 0.1))),
    Case("n-body", "N", lasting=False),
    Case("outer-solar-system", "O", unit=False),
    Case("kepler", "K", parameters=(("e", 0.2),)),
    Case("double-pendulum:regular", "W", separable=False),
    Case("schwarzschild:precessing", "S", separable=False),
)
OSCILLATOR = Case("harmonic-oscillator", "L")
BY_NAME = {c.problem: c for c in (*CASES, OSCILLATOR)}


@lru_cache(maxsize=32)
def problem(case: Case) -> Problem:
    """The problem of a case, with the case's parameters."""
    from phasebench.benchmarks.problems import problem

    return problem(case.problem, **dict(case.parameters))


@lru_cache(maxsize=32)
def start(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """The state q, p, arrays (d,), at which a case starts."""
    from phasebench.reference.solvers import taylor

    made = problem(case)
    if not case.after:
        return np.array(made.q0), np.array(made.p0)
    row = taylor.states(made.system, np.longdouble, made.q0, made.p0, [case.after])[0].astype(float)
    return row[: made.system.d], row[made.system.d :]


@dataclass(frozen=True)
class Truth:
    """The reference states of a case at `ROWS` equally spaced times, arrays (ROWS, d), and the error that is noise.

    ``sizes`` are the largest |q| and the largest |p|, to which errors and the noise are relative.
    """

    q: np.ndarray
    p: np.ndarray
    sizes: tuple[float, float]
    noise: float

    def error(self, q: np.ndarray, p: np.ndarray) -> float:
        """The largest error of states q, p, arrays (ROWS, d), relative to the size of coordinates or of momenta."""
        return max(float(np.abs(x - y).max()) / s for x, y, s in zip((q, p), (self.q, self.p), self.sizes, strict=True))


@lru_cache(maxsize=32)
def truth(case: Case) -> Truth:
    """The reference states of a case."""
    from phasebench.reference.solvers import taylor

    made, (q, p) = problem(case), start(case)
    times = [case.span * (k + 1) / ROWS for k in range(ROWS)]
    long, quad = taylor.extended_types()
    rows = taylor.states(made.system, long, q, p, times)
    exact = taylor.states(made.system, quad, q, p, times)
    halves = (slice(0, made.system.d), slice(made.system.d, None))
    Q, P = (rows[:, part].astype(float) for part in halves)
    sizes = float(np.abs(Q).max()), float(np.abs(P).max())
    away = 0.0
    for part, size in zip(halves, sizes, strict=True):
        apart = (abs(float(quad(x) - y)) for x, y in zip(rows[:, part].flat, exact[:, part].flat, strict=True))
        away = max(away, max(apart) / size)
    return Truth(Q, P, sizes, 100 * (EPS + away))


def able(peer: Integrator, wanted: Iterable[Case]) -> list[Case]:
    """The cases of ``wanted`` that a peer can integrate."""
    return [case for case in wanted if peer.lacks(problem(case)) is None]


def select(peer: Integrator, measure: str, quick: bool = False) -> list[Case]:
    """The cases for a measure that a peer can integrate."""
    if measure == "stability":
        return able(peer, (OSCILLATOR,))
    split = able(peer, [c for c in CASES if c.separable])
    if measure == "symplecticity":
        split = [c for c in split if c.unit]
    elif measure not in AGAINST_TRUTH:
        split = [c for c in split if c.lasting]
    mixed = able(peer, [c for c in CASES if not c.separable])
    if measure == "cost" or quick:
        return (split or mixed)[:1]
    if measure in AGAINST_TRUTH:
        return split[:2] + mixed[: 1 if len(split) > 1 else 2]
    return split[:1] + mixed[:1]
