"""Round-off of Stormer-Verlet with plain and with compensated sums, in single and in double precision.

The same step map is iterated from the same starts by plain sums in single, double and extended precision (one loop of
NumPy over all starts), and by the method itself, whose sums are compensated.  The distance of an end state from that of
the run in extended precision is pure round-off; for the problem's own start, the first, a certified end state gives the
error too.  The cost of compensation is the method's time over that of a C loop with plain sums, timed in turns.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content, states
from phasebench.integrators.driver import OK
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.reference.certificates import stored

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem
    from phasebench.integrators.systems.hamiltonian import Hamiltonian

ERRORS, COSTS, METHOD = "knobs_arithmetic", "knobs_arithmetic_costs", "stormer-verlet"
SINGLE, PLAIN, COMPENSATED = "single, plain", "double, plain", "double, compensated"
TYPES = {SINGLE: np.float32, PLAIN: np.float64}
#: Number of starts, the first of which is the problem's own; seed and size of the displacements of the others.
STARTS, SEED, SPREAD = 16, 7, 1e-2
#: Significant bits that the extended precision must have at least; a double has 53.
BITS = 64
TIMED, ROUNDS = 100_000, 15


class Run(NamedTuple):
    """A problem with its orbit, the end time, and the numbers of steps of the runs.

    Attributes
    ----------
    problem : id and orbit, such as "pendulum:swinging"
    t_end : end time, at which there is a certified state
    steps : the numbers of steps of the runs
    """

    problem: str
    t_end: float
    steps: tuple[int, ...]


SCENES = (
    Run("henon-heiles:box", 100.0, (400, 1600, 6400, 25600, 102400)),
    Run("pendulum:swinging", 100.0, (400, 1600, 6400, 25600, 102400)),
)


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one of the round-off and one of the times of each orbit; none if ``quick``."""
    return [] if quick else [*(_cell(k) for k in range(len(SCENES))), *(_time_cell(k) for k in range(len(SCENES)))]


def _cell(k: int) -> Cell:
    scene = SCENES[k]
    made = ProblemKey(scene.problem)
    needs = content("arithmetic", tuple(scene), STARTS, method(METHOD), made, states(made.id), code=[__name__])
    names = frozenset({METHOD, scene.problem.partition(":")[0]})
    return Cell("options", (ERRORS,), {"scene": scene.problem}, measure_rows, (k,), needs, names)


def _time_cell(k: int) -> Cell:
    name = SCENES[k].problem
    needs = content("arithmetic-cost", TIMED, method(METHOD), ProblemKey(name), code=[__name__])
    names = frozenset({METHOD, name.partition(":")[0]})
    return Cell("options", (COSTS,), {"scene": name}, measure_time_rows, (k,), needs, names, ALONE, own=True)


def starts(made: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return initial states (q, p) near that of the problem ``made``, arrays (`STARTS`, d).

    The first is the problem's own, the others are displaced at random with a fixed seed.
    """
    moved = SPREAD * np.random.default_rng(SEED).uniform(-1, 1, (2, STARTS, made.system.d))
    moved[:, 0] = 0
    return np.array(made.q0) + moved[0], np.array(made.p0) + moved[1]


def slope(system: Hamiltonian) -> Callable[[np.ndarray], list]:
    """Return a function of q, array (d, starts), that computes grad V in the precision of q.

    The derivatives of V must have no fractions as coefficients, which would be rounded to double.
    """
    return sp.lambdify([list(system.q)], [sp.expand(sp.diff(system.potential, x)) for x in system.q], "numpy")


def plain(
    system: Hamiltonian, q: np.ndarray, p: np.ndarray, h: float, steps: int, kind: type[np.floating]
) -> np.ndarray:
    """Integrate by Stormer-Verlet with plain sums in the NumPy type ``kind``, for unit masses.

    ``q`` and ``p`` are arrays (starts, d); returns the end states, array (starts, 2 d).
    """
    gradient = slope(system)
    q, p, h = q.T.astype(kind), p.T.astype(kind), kind(h)
    half = h / kind(2)
    for _ in range(steps):
        p = p - half * np.array(gradient(q))
        q = q + h * p
        p = p - half * np.array(gradient(q))
    return np.concatenate([q, p]).T


def ends(made: Problem, h: float, steps: int) -> dict[str, np.ndarray]:
    """Integrate from all `starts` in each arithmetic: name of the arithmetic -> end states, array (`STARTS`, 2 d).

    The arithmetics are plain sums in single and in double precision, and compensated sums (the method itself).

    Raises RuntimeError if a run stops.
    """
    q, p = starts(made)
    found = {name: plain(made.system, q, p, h, steps, kind) for name, kind in TYPES.items()}
    ours = integrate_ensemble(made, METHOD, q, p, h=h, steps=steps)
    if (ours.status != OK).any():
        raise RuntimeError(f"a run stopped: {ours.reason[ours.status != OK][0]}")
    return found | {COMPENSATED: np.hstack([ours.q, ours.p])}


def measure_rows(k: int) -> Rows:
    """Measure the round-off of each arithmetic with each number of steps on the orbit ``SCENES[k]``: a row for each.

    An arithmetic is plain sums in single or in double precision, or compensated sums.  Raises Unavailable if long
    double is no wider than double.
    """
    if np.finfo(np.longdouble).nmant + 1 < BITS:
        raise Unavailable("long double is no wider than double on this machine")
    name, t_end, numbers = SCENES[k]
    made = problem(name)
    end = stored.end(made, t_end)
    true = np.concatenate([end.q, end.p])
    rows = []
    for steps in numbers:
        h = t_end / steps
        exact = plain(made.system, *starts(made), h, steps, np.longdouble)
        for arithmetic, found in ends(made, h, steps).items():
            off = np.abs(found - exact).max(axis=1).astype(float)
            row = {"scene": name, "arithmetic": arithmetic, "h": h, "steps": steps, "starts": STARTS}
            row |= {"round-off rms": float(np.sqrt((off**2).mean())), "error": float(np.abs(found[0] - true).max())}
            rows.append(row)
    return {ERRORS: rows}


def measure_time_rows(k: int) -> Rows:
    """Time Stormer-Verlet steps with compensated sums beside plain ones in C on the orbit ``SCENES[k]``: one row.

    Returns {`COSTS`: [row]}, with the nanoseconds of a step and their ratio.  Raises Unavailable without a C compiler.
    """
    name, t_end, numbers = SCENES[k]
    made, h = problem(name), t_end / numbers[-1]
    try:
        loop = Loop(made)
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    run = prepare(made, METHOD)

    seconds = time_in_turns({COMPENSATED: lambda: run(h, TIMED), PLAIN: lambda: loop.run(h, TIMED)}, ROUNDS)
    row = {"scene": name, "h": h, "steps": TIMED}
    for kind, each in seconds.items():
        row[f"ns, {kind}"] = median(1e9 / TIMED * each).value
    times = ratio(seconds[COMPENSATED], seconds[PLAIN])
    return {COSTS: [row | dict(zip(("ratio", "ratio, low", "ratio, high"), times, strict=True))]}
