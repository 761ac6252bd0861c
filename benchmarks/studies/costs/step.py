"""The time of one step of every method, and ratios of two step times, each within one process.

Times are warm: everything is compiled before, and no output is stored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.c_loop import Loop
from phasebench.benchmarks.measure.timing import columns, median, time_in_turns
from phasebench.benchmarks.measure.timing import ratio as quotient
from phasebench.benchmarks.measure.variants import variants
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.shared import picture, worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Shown, Study, over
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.index import PROBLEMS as ALL
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, Unavailable
from phasebench.integrators.driver import integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method as method_of
from phasebench.reference.peers import peer as peer_of

from .peers import BARE, CALLS, FACTOR, MORE, PROBLEM, SLOWER, TOLERANCES, TRANSLATED, TRANSLATION, calls, translated

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

STEPS_OF, RATIOS, WANTED = "speed", "ratios", "wanted, at most"
H, STEPS, ROUNDS = 0.01, 10_000, 11
HENON, KEPLER = "henon-heiles:chaotic", "perturbed-kepler"
#: Traits of the problems that methods require: of all, and of each.
EVERYWHERE = {
    *("Poisson structure", "canonical", "separable"),
    *("quadratic kinetic energy", "constant mass matrix", "elementary derivatives"),
}
PROBLEMS = {
    "pendulum:swinging": EVERYWHERE,
    HENON: EVERYWHERE | {"linear fast part"},
    KEPLER: EVERYWHERE | {"further invariants", "Kepler part", "singular distances"},
}
METHODS = {m.label: m for m in (method_of(id, **dict(parameters)) for id, parameters in variants())}
#: Methods of the quick tier.
HANDFUL = ("explicit-euler", "stormer-verlet", "rk4", "implicit-midpoint")
AGAINST_C = ("kepler", HENON, "pendulum:swinging", "outer-solar-system")
#: The names of the C loops: whether kicks are merged.
LOOPS = {"C": False, "C merged": True}
#: For the ratios: steps of a run beside the C loop, steps of a run beside another method, rounds.
LONG, SHORT, MANY = 400_000, 50_000, 21
#: Name -> (numerator, denominator, largest ratio wanted or None, problems); a method id or one of `LOOPS`.
KINDS = {
    "Stormer-Verlet / C loop": ("stormer-verlet", "C", 1.05, AGAINST_C),
    "Stormer-Verlet / C loop with merged kicks": ("stormer-verlet", "C merged", None, AGAINST_C),
    "Scheme I(1/3) / C Stormer-Verlet": ("scheme-i", "C", 10, (HENON,)),
    "Scheme V / Scheme III(1/3)": ("scheme-v", "scheme-iii", 3, PROBLEMS),
    "Scheme IV / implicit midpoint": ("scheme-iv", "implicit-midpoint", None, PROBLEMS),
    "AVF / implicit midpoint": ("avf", "implicit-midpoint", None, PROBLEMS),
}
#: Name of a ratio on a problem -> (numerator, denominator, largest ratio wanted, problem).
PAIRS = {f"{kind}, {name}": (*what, name) for kind, (*what, names) in KINDS.items() for name in names}


def step(problem: str, method: str) -> dict:
    """The time of a step of a compiled run without output, and the energy error."""
    made, chosen = problem_of(problem), METHODS[method]
    full, run = integrate(made, chosen, h=H, steps=STEPS), prepare(made, chosen)
    ns = median(time_in_turns({"it": lambda: run(H, STEPS)}, ROUNDS)["it"] / STEPS * 1e9)
    row = dict(zip(("ns per step", "ns, low", "ns, high"), ns, strict=True))
    row["gradients per step"] = full.counts["gradient"] / STEPS
    return row | {"energy error": float(metrics.invariant_error(full.energy()).max), "status": full.status}


def _work(made: Problem, id: str, steps: int) -> Callable[[], object]:
    if id not in LOOPS:
        run = prepare(made, method_of(id))
        return lambda: run(H, steps)
    try:
        loop = Loop(made, LOOPS[id])
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    return lambda: loop.run(H, steps)


def pair(ratio: str) -> dict:
    """The ratio of two step times, timed in turns.

    Raises Unavailable without a C compiler, RuntimeError if the C loop ends elsewhere on a regular orbit.
    """
    one, other, limit, problem = PAIRS[ratio]
    steps = LONG if other in LOOPS else SHORT
    work = {id: _work(problem_of(problem), id, steps) for id in (one, other)}
    if (one, other, problem) == ("stormer-verlet", "C", "pendulum:swinging"):
        (q, p, _), (_, end) = (run() for run in work.values())
        if not abs(q[0] - end[0]) + abs(p[0] - end[1]) < 1e-6:
            raise RuntimeError(f"the C loop ends at {end}, this project's at {q}, {p}")
    times = time_in_turns(work, MANY)
    includes = f"{steps} steps of h = {H}, warm, no output"
    includes += "; C: gcc -O3 -march=native, uncompensated" if other in LOOPS else ""
    return columns("median", quotient(times[one], times[other])) | {WANTED: limit, "what is timed": includes}


def slow(rows: pd.DataFrame) -> str:
    """Up to five problems on which heyoka takes longer; the slowest if there are none."""
    within = rows["within"].astype(bool)
    found = rows[~within] if not within.all() else rows.nlargest(1, "ratio")
    return ", ".join(f"{p} {number(r)}" for p, r in found.groupby("problem")["ratio"].max().nlargest(5).items())


@picture(
    RATIOS, "speed", "ratios of times",
    "Ratios of times: medians of rounds in turns with 95 % intervals; upright marks: the most that is wanted.",
)  # fmt: skip
def _draw(ratios: pd.DataFrame) -> style.Figure:
    y, middle = np.arange(len(ratios)), ratios["median"]
    figure, ((axes,),) = style.panels(1, 1, 1.0 + 0.2 * len(ratios))
    ends = [middle - ratios["median, low"], ratios["median, high"] - middle]
    axes.errorbar(middle, y, xerr=ends, fmt="o", color=style.BLUE, label="median, 95 % interval")
    axes.plot(ratios[WANTED], y, "|", color=style.VERMILION, markersize=11, markeredgewidth=1.6, label=WANTED)
    axes.set_yticks(y, ratios["ratio"])
    axes.set_ylim(len(ratios) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("ratio of the times of a step")
    axes.grid(axis="x", color="0.93", linewidth=0.5)
    style.legend_above(figure, axes, 2)
    return figure


def _needs_of_pair(ratio: str) -> tuple:
    *both, _, problem = PAIRS[ratio]
    return (*(method_of(id) for id in both if id not in LOOPS), ProblemKey(problem))


RAN, BESIDE_C = "status == 'ok'", "ratio.str.startswith('Stormer-Verlet / C loop,')"
STUDY = Study(
    id="speed",
    place=390,
    question="What does a step cost, beside a bare C loop and beside the other schemes?",
    answer="A step takes {least} ns to {most} µs, {middle} ns in the median of {count} pairs of method and problem; "
    "Störmer–Verlet takes {low} to {high} of a C loop's time.",
    numbers={
        "least": Number(STEPS_OF, "`ns per step`", RAN, pd.Series.min),
        "most": Number(STEPS_OF, "`ns per step` / 1e3", RAN),
        "middle": Number(STEPS_OF, "`ns per step`", RAN, pd.Series.median),
        "count": Number(STEPS_OF, "`ns per step`", RAN, len),
        "low": Number(RATIOS, "median", BESIDE_C, pd.Series.min),
        "high": Number(RATIOS, "median", BESIDE_C),
    },
    setting=(
        "The seconds of a warm integration, without output and compilation, divided by its steps; pendulum, "
        "Hénon–Heiles and perturbed Kepler motion.",
        "400,000 steps of h = 0.01 beside a C loop (gcc -O3 -march=native, uncompensated), 50,000 between schemes.",
        "Competitors run in turns, round by round; medians of the rounds' ratios, 95 % intervals.",
        "A peer's prepared run (`pb.prepare`) beside a bare script of its package: a reset and the package's own "
        f"call; at most {FACTOR:g} times and {MORE * 1e6:g} µs longer counts as no longer.",
        "heyoka's run of each problem (`pb.prepare`) beside the fastest of: equations written for heyoka by hand, "
        f"heyoka's own model, the derivatives as they stand; at most {TRANSLATED:g} times longer.",
    ),
    runs=(
        Runs(RATIOS, pair, over(ratio=PAIRS), needs=_needs_of_pair, where=ALONE, own=True,
             quick=({"ratio": "Stormer-Verlet / C loop, kepler"},)),
        Runs(STEPS_OF, step, [{"problem": p, "method": label} for p, traits in PROBLEMS.items()
                              for label, m in METHODS.items() if {*m.requires} <= traits],
             needs=lambda problem, method: (METHODS[method], ProblemKey(problem)), where=ALONE, own=True,
             quick=over(problem=(KEPLER,), method=HANDFUL)),
        Runs(CALLS, calls, over(peer=BARE), needs=lambda peer: (BARE[peer][0], ProblemKey(PROBLEM)), where=ALONE,
             own=True),
        Runs(TRANSLATION, translated, [{"problem": p, "tol": tol} for p in ALL for tol in TOLERANCES],
             needs=lambda problem, tol: (peer_of("heyoka"), ProblemKey(problem)), where=ALONE, own=True),
    ),
    claims={
        "limits": Claim(
            "Every ratio of times is at most what is wanted",
            RATIOS, f"median <= `{WANTED}`", rows=f"`{WANTED}` > 0", unit="ratios",
            where=worst(f"median / `{WANTED}`", f"{{ratio}}: {{median:.3g}}, wanted {{{WANTED}:g}}"),
        ),
        "calls": Claim(
            "A peer's prepared run takes no longer than a bare script of its package",
            CALLS, "within", unit="peers", where=worst("ratio", "{peer}: {ratio:.3g} times"), fault=True,
        ),
        "translation": Claim(
            "heyoka's runs take no longer than equations written for it by hand",
            TRANSLATION, "within", unit="problems and tolerances", where=slow,
        ),
    },
    checks={
        "translation": Claim(
            "heyoka's runs take no longer, where compiled alike", TRANSLATION, "within",
            rows=lambda rows: ~rows["problem"].isin(SLOWER), where="{problem} at {tol}",
        ),
    },
    figure=_draw,
    shown=Shown(
        RATIOS, ("ratio", "median", "median, low", "median, high", WANTED),
        "Ratios of the times of a step, taken round by round in one run, the competitors in turns.",
    ),
    whole=STEPS_OF,
    limits=(
        "Times are the machine's own: another processor or compiler changes the ratios, a busy machine even more.",
        "Sums here are compensated, those of the C loops are not.",
        "The last kick of a step and the first of the next are one here, and in the C loop with merged kicks; the "
        "other C loop makes both.",
    ),
)  # fmt: skip
