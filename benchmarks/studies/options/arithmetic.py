"""Round-off of Stormer-Verlet with plain and with compensated sums, in single and in double precision.

The same step map is iterated from the same starts by plain sums in single, double and extended precision (one loop of
NumPy over all starts), and by the method itself, whose sums are compensated.  The distance of an end state from that of
the run in extended precision is pure round-off; for the problem's own start, the first, a certified end state gives the
error too.  The cost of compensation is the method's time over that of a C loop with plain sums, timed in turns.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import columns, median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.store.cells import Unavailable
from phasebench.integrators.driver import OK
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.prepared import prepare
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.reference.certificates import stored

ERRORS, COSTS, METHOD = "knobs_arithmetic", "knobs_arithmetic_costs", "stormer-verlet"
ARITHMETICS = SINGLE, PLAIN, COMPENSATED = "single, plain", "double, plain", "double, compensated"
#: Number of starts, the first of which is the problem's own; seed and size of the displacements of the others.
STARTS, SEED, SPREAD = 16, 7, 1e-2
#: Significant bits that the extended precision must have at least; a double has 53.
BITS = 64
#: Orbits, the end time, at which they have certified states, and the numbers of steps.
SCENES, T_END, NUMBERS = ("henon-heiles:box", "pendulum:swinging"), 100.0, (400, 1600, 6400, 25600, 102400)
TIMED, ROUNDS = 100_000, 15


def starts(made: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Initial states (q, p) near that of the problem, arrays (`STARTS`, d)."""
    moved = SPREAD * np.random.default_rng(SEED).uniform(-1, 1, (2, STARTS, made.system.d))
    moved[:, 0] = 0
    return np.array(made.q0) + moved[0], np.array(made.p0) + moved[1]


def slope(system: Hamiltonian) -> Callable[[np.ndarray], list]:
    """A function of q, array (d, starts), to grad V in the precision of q; V must have no fractions, which round."""
    return sp.lambdify([list(system.q)], [sp.expand(sp.diff(system.potential, x)) for x in system.q], "numpy")


def plain(made: Problem, h: float, steps: int, kind: type[np.floating]) -> np.ndarray:
    """End states of Stormer-Verlet with plain sums in a NumPy type, for unit masses, from `starts`, (`STARTS`, 2 d)."""
    gradient = slope(made.system)
    (q, p), h = (x.T.astype(kind) for x in starts(made)), kind(h)
    half = h / kind(2)
    for _ in range(steps):
        p = p - half * np.array(gradient(q))
        q = q + h * p
        p = p - half * np.array(gradient(q))
    return np.concatenate([q, p]).T


def ends(made: Problem, h: float, steps: int) -> dict[str, np.ndarray]:
    """End states from all `starts` in each arithmetic, arrays (`STARTS`, 2 d)."""
    found = {name: plain(made, h, steps, kind) for name, kind in ((SINGLE, np.float32), (PLAIN, np.float64))}
    ours = integrate_ensemble(made, METHOD, *starts(made), h=h, steps=steps)
    if (ours.status != OK).any():
        raise RuntimeError(f"a run stopped: {ours.reason[ours.status != OK][0]}")
    return found | {COMPENSATED: np.hstack([ours.q, ours.p])}


def round_off(scene: str) -> list[dict]:
    """The round-off of each arithmetic with each number of steps."""
    if np.finfo(np.longdouble).nmant + 1 < BITS:
        raise Unavailable("long double is no wider than double on this machine")
    made, rows = problem_of(scene), []
    end = stored.end(made, T_END)
    true = np.concatenate([end.q, end.p])
    for steps in NUMBERS:
        h = T_END / steps
        exact = plain(made, h, steps, np.longdouble)
        for arithmetic, found in ends(made, h, steps).items():
            off = np.abs(found - exact).max(axis=1).astype(float)
            row = {"arithmetic": arithmetic, "h": h, "steps": steps, "starts": STARTS}
            row |= {"round-off rms": float(np.sqrt((off**2).mean())), "error": float(np.abs(found[0] - true).max())}
            rows.append(row)
    return rows


def costs(scene: str) -> dict:
    """Nanoseconds of a step with compensated sums and with plain ones in C, and their ratio."""
    made, h = problem_of(scene), T_END / NUMBERS[-1]
    try:
        loop = Loop(made)
    except RuntimeError as error:  # no C compiler
        raise Unavailable(str(error)) from None
    run = prepare(made, METHOD)
    seconds = time_in_turns({COMPENSATED: lambda: run(h, TIMED), PLAIN: lambda: loop.run(h, TIMED)}, ROUNDS)
    row = {"h": h, "steps": TIMED} | {f"ns, {kind}": median(1e9 / TIMED * each).value for kind, each in seconds.items()}
    return row | columns("ratio", ratio(seconds[COMPENSATED], seconds[PLAIN]))
