"""The suite's `heyoka` beside equations written for heyoka directly, on every problem.

The other side is the fastest of: the equations written by hand (`hand_written`), heyoka's own model of the motion, and
the derivatives of H as they stand.  Both sides are compiled in the same mode and timed in turns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure.timing import median, ratio, time_in_turns
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.index import PROBLEMS
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content
from phasebench.reference.peers import heyoka_forms, peer
from phasebench.reference.peers.prepared import prepare_peer
from phasebench.reference.solvers.translate import translate

from .hand_written import SIDES

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

#: The largest ratio wanted, the tolerances, and the span in units of the problem's step.
FACTOR, TOLERANCES, SPAN = 1.05, (1e-4, 1e-12), 50
#: Seconds of a round, short enough to be seldom interrupted, and rounds.
ROUND, ROUNDS = 2e-4, 201
TABLE = "speed_translation"
#: Problems on which equations written by hand, or heyoka's model, are known to be faster.
SLOWER = {
    "butane": "products of cross products, which by hand are products of dot products",
    "kerr": "the squares of its W are multiplied out by hand, and terms gathered over r^2",
    "magnetized-schwarzschild": "V is multiplied out by hand",
    "n-body": "heyoka's model integrates velocities, which need no division by the masses",
    "solar-system": "heyoka's model compiles better in compact mode",
}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`), one for each problem and tolerance."""
    record = peer("heyoka")
    return (
        []
        if quick
        else [
            Cell(
                "speed",
                (TABLE,),
                {"problem": id, "tol": tol},
                measure_rows,
                (id, tol),
                content("translation", record, ProblemKey(id), tol, code=[__name__]),
                frozenset({"heyoka", id}),
                ALONE,
                own=True,
            )
            for id in PROBLEMS
            for tol in TOLERANCES
        ]
    )


def equations(made: Problem) -> Iterator[tuple[str, list, Callable[[np.ndarray], np.ndarray]]]:
    """Yield the ways to write a problem's equations for heyoka: (name, equations, (q, p) -> heyoka's state)."""
    import heyoka as hy

    system = made.system
    variables = hy.make_vars(*(f"x{i}" for i in range(2 * system.d)))
    q, p = variables[: system.d], variables[system.d :]
    if made.id in SIDES:
        yield "by hand", list(zip(variables, SIDES[made.id](made, q, p), strict=True)), np.array
    for name in heyoka_forms.names(system)[1:]:
        form = heyoka_forms.form(system, name)
        yield f"model {name}", list(form.equations), form.put
    if made.id not in SIDES:
        known = dict(zip((*system.q, *system.p), variables, strict=True))
        sides = [translate(e, known, float) for e in (*system.dq, *system.dp)]
        yield "as it stands", list(zip(variables, sides, strict=True)), np.array


def measure_rows(id: str, tol: float) -> Rows:
    """Time the suite's heyoka and the other ways to write the equations in turns: {table: [row]}.

    The row has the fastest other way, both times of an integration in microseconds, their ratio and whether it is
    within `FACTOR`.
    """
    import heyoka as hy

    made = problem(id)
    t_end, y = SPAN * made.pace.step, np.array([*made.q0, *made.p0])
    run = prepare_peer(made, peer("heyoka"), tol=tol)
    compact = run._calls.keep.compact_mode

    def bare(motion: list, start: np.ndarray) -> Callable[[], Any]:
        ta = hy.taylor_adaptive(motion, start, tol=tol, compact_mode=compact)

        def once() -> float:
            ta.time = 0.0
            ta.state[:] = start
            ta.propagate_until(t_end)
            return ta.time

        return once

    ways: dict[str, Callable[[], Any]] = {"suite": lambda: run.advance(t_end)}
    for name, motion, put in equations(made):
        ways[name] = bare(motion, put(y))
        if ways[name]() != t_end:
            raise Unavailable(f"heyoka did not come to the end with the equations {name}")
    calls = max(1, int(ROUND / median(time_in_turns(ways, 3)["suite"]).value))

    def often(call: Callable[[], Any]) -> Callable[[], None]:
        def repeat() -> None:
            for _ in range(calls):
                call()

        return repeat

    times = time_in_turns({name: often(call) for name, call in ways.items()}, ROUNDS)
    best = min((name for name in ways if name != "suite"), key=lambda name: median(times[name]).value)
    paid = ratio(times["suite"], times[best])
    ours, other = (1e6 * median(times[name] / calls).value for name in ("suite", best))
    row = {"problem": id, "tol": tol, "beside": best, "compact": compact, "us, suite": ours, "us, other": other}
    row |= {"ratio": paid.value, "ratio, low": paid.low, "ratio, high": paid.high}
    return {TABLE: [row | {"within": bool(paid.low <= FACTOR)}]}
