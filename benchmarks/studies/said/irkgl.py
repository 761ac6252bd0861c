"""The published problems of IRKGL16: Gauss's method of order 16 beside explicit symplectic ones at equal energy errors.

Of each method the widest step of a ladder whose energy error is small enough; these runs are timed in turns.  Figure 3
has the outer planets and an orbit of Henon and Heiles, figure 4 a charge around a black hole in a magnetic field; the
planets are this suite's, of other initial data.

Source: M. Antonana, J. Makazaga, A. Murua, arXiv 2511.03655 (2026), figures 3 and 4.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, pi, sqrt

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.conservation import energy_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import columns, in_turns, median, ratio
from phasebench.benchmarks.page.study import Runs, over
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID

TABLE = "printed_numbers_irkgl16"
GAUSS = "gauss-8"
SPLITTINGS = ("stormer-verlet", "suzuki-4", "sofroniou-spaletta-6", "sofroniou-spaletta-8", "sofroniou-spaletta-10-31",
              "blanes-moan-srkn14a", "blanes-casas-escorihuela-srkn19a")  # fmt: skip
PARTS = ("abc-2", "abc-yoshida-4", "abc-4", "abc-6")
#: Problem -> (parameters, start where it is not the problem's, span, widest step, explicit methods).
SCENES = {
    "henon-heiles": ({}, ((0.0, 0.3), (sqrt(41 / 750), 0.2)), 2e4 * pi, 3.0, SPLITTINGS),
    "outer-solar-system": ({}, None, 1e7, 1000.0, SPLITTINGS),
    "magnetized-schwarzschild:inner": ({"beta": 8.9e-5}, None, 1e5, 40.0, PARTS),
}
#: Relative energy errors that are asked for; rows by which they are judged; the most steps of a run; timed rounds.
WANTED, ROWS, MOST, ROUNDS = (1e-7, 1e-9, 1e-11), 200, 1_000_000, 11


def published(problem: str) -> Problem:
    """The problem from its published start."""
    values, start, *_ = SCENES[problem]
    found = problem_of(problem, **values)
    return found if start is None else replace(found, orbits=(replace(found.orbits[0], q=start[0], p=start[1]),))


def ladder(problem: str, method: str) -> list[tuple[int, float]]:
    """[(number of steps, largest relative energy error)] of runs, each of steps sqrt(2) times shorter.

    It ends with an error as small as any that is asked for, or before runs of more than `MOST` steps.
    """
    made, (*_, span, widest, _), out, k = published(problem), SCENES[problem], [], 0
    while (steps := ROWS * ceil(span / widest * 2 ** (k / 2) / ROWS)) <= MOST:
        s = integrator(method).run(made, t_end=span, steps=steps, save_every=steps // ROWS)
        if s.status == OK:
            out.append((steps, energy_error(made, s.q, s.p)))
            if out[-1][1] <= min(WANTED):
                break
        k += 1
    return out


def gains(problem: str) -> list[dict]:
    """The time of each method over Gauss's (``times gauss-8``), at each energy error that both reach."""
    made, (*_, span, _, explicit) = published(problem), SCENES[problem]
    ladders, rows = {method: ladder(problem, method) for method in (GAUSS, *explicit)}, []
    for wanted in WANTED:
        able = {m: next((rung for rung in found if rung[1] <= wanted), None) for m, found in ladders.items()}
        able = {m: rung for m, rung in able.items() if rung}
        if GAUSS not in able:
            continue
        clocks = {m: clock.clock(integrator(m), made, t_end=span, steps=n) for m, (n, _) in able.items()}
        times = in_turns(clocks, ROUNDS)
        for m, (n, error) in able.items():
            row = {"wanted": wanted, "method": m, "h": span / n, "steps": n, "energy error": error}
            row |= {"seconds": median(times[m]).value} | columns("times gauss-8", ratio(times[m], times[GAUSS]))
            rows.append(row)
    return rows


def _needs(problem: str) -> tuple:
    values, *_, explicit = SCENES[problem]
    return (*(BY_ID[m] for m in (GAUSS, *explicit)), ProblemKey(problem, tuple(values.items())))


RUNS = Runs(TABLE, gains, over(problem=tuple(SCENES)), _needs, ALONE, own=True)
