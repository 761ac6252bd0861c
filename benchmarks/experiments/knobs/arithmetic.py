"""Sums with and without compensation, in doubles and in single precision: what an arithmetic leaves of Stormer-Verlet.

The same step map is iterated from the same starts by plain sums in single, double and extended precision (one loop of
NumPy over all starts), and by the method itself, whose sums are compensated.  The distance of an end from that of the
extended run is round-off and nothing else; the problem's own start, which is the first, has a certified end besides.
What compensation costs is told by the bare C loop of plain sums, in turns; a loop in NumPy has no time worth telling.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import sympy as sp

from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import interleaved, median, ratio
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.rows.cells import ALONE, Cell, Problem, Rows, Unavailable, content
from phasebench.integrators.driver import OK
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.reference.certificates import stored

ERRORS, COSTS, METHOD = "knobs_arithmetic", "knobs_arithmetic_costs", "stormer-verlet"
SINGLE, PLAIN, COMPENSATED = "single, plain", "double, plain", "double, compensated"
TYPES = {SINGLE: np.float32, PLAIN: np.float64}
#: Starts about the problem's own, which is the first, with the seed and the size of their displacements.
STARTS, SEED, SPREAD = 16, 7, 1e-2
#: Significant bits that the extended precision must have: those of a double are 53.
BITS = 64
TIMED, ROUNDS = 100_000, 15


class Run(NamedTuple):
    """An orbit to a certified time, by so many steps."""

    problem: str
    t_end: float
    steps: tuple[int, ...]


SCENES = (
    Run("henon-heiles:box", 100.0, (400, 1600, 6400, 25600, 102400)),
    Run("pendulum:swinging", 100.0, (400, 1600, 6400, 25600, 102400)),
)


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each orbit's round-off, and one for its times."""
    return [] if quick else [*(_cell(k) for k in range(len(SCENES))), *(_timed(k) for k in range(len(SCENES)))]


def _cell(k: int) -> Cell:
    scene = SCENES[k]
    needs = content("arithmetic", tuple(scene), STARTS, method(METHOD), Problem(scene.problem), code=[__name__])
    names = frozenset({METHOD, scene.problem.partition(":")[0]})
    return Cell("knobs", (ERRORS,), {"scene": scene.problem}, measured, (k,), needs, names)


def _timed(k: int) -> Cell:
    name = SCENES[k].problem
    needs = content("arithmetic-cost", TIMED, method(METHOD), Problem(name), code=[__name__])
    names = frozenset({METHOD, name.partition(":")[0]})
    return Cell("knobs", (COSTS,), {"scene": name}, timed, (k,), needs, names, ALONE, own=True)


def starts(made) -> tuple[np.ndarray, np.ndarray]:
    """Starts (q, p), arrays (`STARTS`, d); the first is the problem's own."""
    moved = SPREAD * np.random.default_rng(SEED).uniform(-1, 1, (2, STARTS, made.system.d))
    moved[:, 0] = 0
    return np.array(made.q0) + moved[0], np.array(made.p0) + moved[1]


def slope(system) -> Callable[[np.ndarray], list]:
    """The gradient of V at q, an array (d, starts), in the precision of q; V' must have no fractions."""
    return sp.lambdify([list(system.q)], [sp.expand(sp.diff(system.potential, x)) for x in system.q], "numpy")


def plain(system, q: np.ndarray, p: np.ndarray, h: float, steps: int, kind) -> np.ndarray:
    """Ends (starts, 2 d) of Stormer-Verlet by plain sums in the precision ``kind``, for unit masses."""
    gradient = slope(system)
    q, p, h = q.T.astype(kind), p.T.astype(kind), kind(h)
    half = h / kind(2)
    for _ in range(steps):
        p = p - half * np.array(gradient(q))
        q = q + h * p
        p = p - half * np.array(gradient(q))
    return np.concatenate([q, p]).T


def ends(made, h: float, steps: int) -> dict[str, np.ndarray]:
    """Arithmetic -> ends (`STARTS`, 2 d), of the compensated method too."""
    q, p = starts(made)
    found = {name: plain(made.system, q, p, h, steps, kind) for name, kind in TYPES.items()}
    ours = integrate_ensemble(made, METHOD, q, p, h=h, steps=steps)
    if (ours.status != OK).any():
        raise RuntimeError(f"a run stopped: {ours.reason[ours.status != OK][0]}")
    return found | {COMPENSATED: np.hstack([ours.q, ours.p])}


def measured(k: int) -> Rows:
    """The rows of an orbit: an arithmetic and a step each."""
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


def timed(k: int) -> Rows:
    """The row of an orbit: the time of a compensated step and of a plain one."""
    name, t_end, numbers = SCENES[k]
    made, h = problem(name), t_end / numbers[-1]
    try:
        loop = Loop(made)
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    run = prepare(made, METHOD)

    seconds = interleaved({COMPENSATED: lambda: run(h, TIMED), PLAIN: lambda: loop.run(h, TIMED)}, ROUNDS)
    row = {"scene": name, "h": h, "steps": TIMED}
    for kind, each in seconds.items():
        row[f"ns, {kind}"] = median(1e9 / TIMED * each).value
    times = ratio(seconds[COMPENSATED], seconds[PLAIN])
    return {COSTS: [row | dict(zip(("ratio", "ratio, low", "ratio, high"), times, strict=True))]}
