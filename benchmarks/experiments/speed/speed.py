"""Measure the time of one step of every method, and ratios of two step times, each ratio within one process.

Times are warm: everything is compiled before, and no output is stored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import median, ratio, time_in_turns
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import ALONE, Cell, ProblemKey, Rows, Unavailable, content
from phasebench.integrators.driver import integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

H, STEPS, ROUNDS = 0.01, 10_000, 11
PROBLEMS = ("pendulum", "henon-heiles:chaotic", "perturbed-kepler")
AGAINST_C = ("kepler", "henon-heiles:chaotic", "pendulum", "outer-solar-system")
#: The names of the C loops among `RATIOS`: whether kicks are merged.
LOOPS = {"C": False, "C merged": True}
#: For the ratios: steps of a run beside the C loop, steps of a run beside another method, rounds.
LONG, SHORT, MANY = 400_000, 50_000, 21
#: Methods of the quick tier.
HANDFUL = ("explicit-euler", "stormer-verlet", "rk4", "implicit-midpoint")
#: Name -> (numerator, denominator, largest ratio wanted or None); a method id or one of `LOOPS`.
RATIOS = {
    "Stormer-Verlet / C loop": ("stormer-verlet", "C", 1.05),
    "Stormer-Verlet / C loop with merged kicks": ("stormer-verlet", "C merged", None),
    "Scheme I(1/3) / C Stormer-Verlet": ("scheme-i", "C", 10),
    "Scheme V / Scheme III(1/3)": ("scheme-v", "scheme-iii", 3),
    "Scheme IV / implicit midpoint": ("scheme-iv", "implicit-midpoint", None),
    "AVF / implicit midpoint": ("avf", "implicit-midpoint", None),
}


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements: a `Cell` for each method on each problem, and one for each ratio on each problem.

    A `Cell` is a function, its arguments and the tables that its rows go to.  The list does not depend on ``quick``:
    each `Cell` is marked by a flag of its own as part of a quick run or not.
    """
    able = [(n, *of) for n in PROBLEMS for of in variants() if not method(of[0]).lacks(problem(n).system)]
    return [_time(*of) for of in able] + [_ratio(what, name) for what in RATIOS for name in _on(what)]


def _on(what: str) -> tuple[str, ...]:
    if what.startswith("Scheme I("):
        return ("henon-heiles:chaotic",)
    return AGAINST_C if "/ C loop" in what else PROBLEMS


def _time(name: str, id: str, parameters: tuple) -> Cell:
    chosen = method(id, **dict(parameters))
    return Cell(
        "speed",
        ("speed",),
        {"problem": problem(name).label, "method": chosen.label},
        measure_method_rows,
        (name, id, parameters),
        content("speed", chosen, ProblemKey(name), code=[__name__]),
        frozenset({name.partition(":")[0], id}),
        ALONE,
        own=True,
        quick=name == "perturbed-kepler" and id in HANDFUL,
    )


def _ratio(what: str, name: str) -> Cell:
    chosen = [method(m) for m in RATIOS[what][:2] if m not in LOOPS]
    return Cell(
        "speed",
        ("ratios",),
        {"ratio": f"{what}, {problem(name).label}"},
        measure_ratio_rows,
        (what, name),
        content("ratio", what, *chosen, ProblemKey(name), code=[__name__]),
        frozenset({name.partition(":")[0], *(m.id for m in chosen)}),
        ALONE,
        own=True,
        quick=(what, name) == ("Stormer-Verlet / C loop", "kepler"),
    )


def measure_method_rows(name: str, id: str, parameters: tuple) -> Rows:
    """Measure the time of a step of the method ``id`` on the problem ``name``, and the method's energy error.

    Returns {"speed": [row]}.  Times are of compiled runs without output, in ns per step, with an interval.
    ``parameters`` are pairs (name, value) of the method.
    """
    found, chosen = problem(name), method(id, **dict(parameters))
    full = integrate(found, chosen, h=H, steps=STEPS)
    E = found.system.observe(found.system.H, full.q, full.p)
    run = prepare(found, chosen)
    seconds = median(time_in_turns({"it": lambda: run(H, STEPS)}, ROUNDS)["it"])
    row = {"problem": found.label, "method": chosen.label, "ns per step": seconds.value / STEPS * 1e9}
    row |= {"ns, low": seconds.low / STEPS * 1e9, "ns, high": seconds.high / STEPS * 1e9}
    row |= {
        "gradients per step": full.counts["gradient"] / STEPS,
        "energy error": float(metrics.invariant_error(E).max),
    }
    return {"speed": [row | {"status": full.status}]}


def _work(found: Problem, id: str, steps: int) -> Callable[[], object]:
    if id not in LOOPS:
        run = prepare(found, method(id))
        return lambda: run(H, steps)
    try:
        loop = Loop(found, LOOPS[id])
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    return lambda: loop.run(H, steps)


def measure_ratio_rows(what: str, name: str) -> Rows:
    """Measure the ratio ``what`` of two step times (a key of `RATIOS`) on the problem ``name``.

    Both are timed in turns in one process.  Returns {"ratios": [row]}: the median ratio, its interval and its limit.

    Raises
    ------
    Unavailable
        If there is no C compiler.
    RuntimeError
        If the C loop ends at another state than this project's method on a regular orbit.
    """
    found = problem(name)
    one, other, limit = RATIOS[what]
    steps = LONG if other in LOOPS else SHORT
    work = {id: _work(found, id, steps) for id in (one, other)}
    if (one, other, name) == ("stormer-verlet", "C", "pendulum"):
        (q, p, _), (_, end) = (run() for run in work.values())
        if not abs(q[0] - end[0]) + abs(p[0] - end[1]) < 1e-6:
            raise RuntimeError(f"the C loop ends at {end}, this project's at {q}, {p}")
    times = time_in_turns(work, MANY)
    r = ratio(times[one], times[other])
    includes = f"{steps} steps of h = {H}, warm, no output"
    includes += "; C: gcc -O3 -march=native, uncompensated" if other in LOOPS else ""
    row = {"ratio": f"{what}, {found.label}", "median": r.value, "median, low": r.low, "median, high": r.high}
    return {"ratios": [row | {"wanted, at most": limit, "what is timed": includes}]}
