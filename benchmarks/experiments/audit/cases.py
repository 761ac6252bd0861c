"""On what integrators are audited: states in general position on regular orbits, and where they are later.

A problem's own start is often a turning point or an axis, where leading error terms may vanish: a case starts where
heyoka's long double Taylor series has the orbit a while later, rounded to double.  What is true later is that series
again from the rounded start, certified by quadruple precision (`reference.taylor`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

#: The rows of an order's run, equally spaced: the error is the largest at these.
ROWS = 2
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Case:
    """A problem to measure on, in the times of its `pace`.

    Attributes
    ----------
    problem, parameters : as `benchmarks.problems.problem` takes them
    letter : for the problem in tables
    separable : whether H = T(p) + V(q)
    unit : whether all components are of about one size, so that one displacement suits them all
    lasting : whether the orbit goes on without close encounters
    """

    problem: str
    letter: str
    separable: bool = True
    unit: bool = True
    lasting: bool = True
    parameters: tuple[tuple[str, float], ...] = ()

    @property
    def after(self) -> float:
        """The time at which its orbit is the start here."""
        return problem(self).pace.later

    @property
    def span(self) -> float:
        """The time over which an order is measured."""
        return problem(self).pace.span

    @property
    def h(self) -> float:
        """The step of the other measures."""
        return problem(self).pace.step


#: The measures that compare with what is true.
AGAINST_TRUTH = ("order", "tolerance")
#: In the order in which they are asked for.  The strong perturbation shows every term of a Wisdom-Holman splitting.
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
def problem(case: Case):
    """The problem of a case."""
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
    """The rows q, p, arrays (ROWS, d), their sizes, and below what relative error there is nothing to see."""

    q: np.ndarray
    p: np.ndarray
    sizes: tuple[float, float]
    noise: float

    def error(self, q, p) -> float:
        """The largest error of rows q, p, relative to the size of the coordinates or the momenta."""
        return max(float(np.abs(x - y).max()) / s for x, y, s in zip((q, p), (self.q, self.p), self.sizes, strict=True))


@lru_cache(maxsize=32)
def truth(case: Case) -> Truth:
    """Where the orbit of a case is after each half of its span."""
    from phasebench.reference.solvers import taylor

    made, (q, p) = problem(case), start(case)
    times = [case.span * (k + 1) / ROWS for k in range(ROWS)]
    long, quad = taylor.extended()
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


def able(peer, wanted) -> Iterator[Case]:
    """The cases that a peer can do, of those ``wanted``."""
    for case in wanted:
        made = problem(case)
        if peer.lacks(made) is None:
            yield case


def chosen(peer, measure: str, quick: bool = False) -> list[Case]:
    """The cases of a measure: two with H = T + V and one without where the peer can do them; fewer of slow measures."""
    if measure == "stability":
        return list(able(peer, (OSCILLATOR,)))
    split = list(able(peer, [c for c in CASES if c.separable]))
    if measure == "symplecticity":
        split = [c for c in split if c.unit]
    elif measure not in AGAINST_TRUTH:
        split = [c for c in split if c.lasting]
    mixed = list(able(peer, [c for c in CASES if not c.separable]))
    if measure == "cost" or quick:
        return (split or mixed)[:1]
    if measure in AGAINST_TRUTH:
        return split[:2] + mixed[: 1 if len(split) > 1 else 2]
    return split[:1] + mixed[:1]
