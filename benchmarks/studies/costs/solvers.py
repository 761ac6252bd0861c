"""Implicit steps of lattices: the usual solver (fixed-point iteration, then Newton's method) and banded Newton.

Each lattice is integrated with a step at which the fixed-point iteration contracts, and with one too long for it, where
the usual solver needs Newton's method with a full matrix.  Full matrices are timed up to `FULL` degrees of freedom;
their memory is given for all sizes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import clock, columns, median, ratio, time_in_turns
from phasebench.benchmarks.page.shared import worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Shown, Study, over
from phasebench.benchmarks.page.verdict import NONE, Range, at_most
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.families.banded import structure_of
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import method

from .large import ABOVE, PLACE, array_bytes, distance, enough, exponent
from .systems import SYSTEMS

TABLE, METHOD, BANDED = "large_solvers", "implicit-midpoint", {"solver": "banded"}
FIXED, MATRIX = "fixed point", "full Newton"
#: Degrees of freedom, those of the page's table; the largest at which full matrices are timed.
SIZES, SHOWN, FULL = (32, 128, 512, 2048, 10_000), (32, 128, 2048, 10_000), 128
#: Steps compared; rounds; the least steps of one; ends that differ by less, relative to the state, are equal.
FEW, ROUNDS, FEWEST, SAME = 3, 7, 2, 1e-12


class Steps(NamedTuple):
    """Step sizes of a lattice: ``short``, at which fixed-point iteration contracts, and ``long``, too long for it."""

    short: float
    long: float


LATTICES = {"fpu": Steps(0.01, 0.2), "toda": Steps(0.1, 3.0), "nls": Steps(0.02, 0.5)}


def solvers(system: str) -> list[dict]:
    """Both solvers of a lattice's steps: a row for each number of degrees of freedom and each of two step sizes."""
    return [row(system, d, step) for d in SIZES for step in Steps._fields]


def row(name: str, d: int, step: str) -> dict:
    """Both solvers at a "short" or a "long" step: times, evaluations a step, memory, distance of the end states."""
    problem, h = SYSTEMS[name].by_hand(d), getattr(LATTICES[name], step)
    runs = {"usual": prepare(problem, METHOD), "banded": prepare(problem, METHOD, parameters=BANDED)}
    out = {"d": d, "step": step, "h": h} | {f"kB, {who}": array_bytes(run) / 1e3 for who, run in runs.items()}
    if step == "long" and d > FULL:
        del runs["usual"]
    ends = {who: run(h, FEW) for who, run in runs.items()}
    solved = {who: ends[who][2] == run.SOLVED for who, run in runs.items()}
    for who, run in runs.items():
        out |= {f"solved, {who}": solved[who], f"evaluations, {who}": run.counts["gradient"] / FEW}
    if "usual" in runs:
        out["by"] = MATRIX if runs["usual"].counts["newton"] else FIXED
    if len(runs) == 2 and all(solved.values()):
        out["apart"] = distance(*([np.concatenate(ends[who][:2])] for who in ("banded", "usual")))
    out |= timed({who: run for who, run in runs.items() if solved[who]}, h)
    return out | {"s, structure": clock(lambda: structure_of(problem.system, 1))()}


def timed(runs: dict[str, PreparedRun], h: float) -> dict:
    """Nanoseconds of a step by each solver, in turns, and their ratio if both are timed."""
    steps = {who: max(FEWEST, enough(lambda n, run=run: run(h, n))) for who, run in runs.items()}
    times = time_in_turns({who: lambda run=run, n=steps[who]: run(h, n) for who, run in runs.items()}, ROUNDS)
    ns = {who: seconds / steps[who] * 1e9 for who, seconds in times.items()}
    out = {k: x for who in ns for k, x in columns(f"ns, {who}", median(ns[who])).items()}
    return out | columns("banded / usual", ratio(ns["banded"], ns["usual"])) if len(ns) == 2 else out


def extent(rows: pd.DataFrame) -> Range:
    """The intervals of the ratios."""
    return Range(rows["banded / usual, low"].min(), rows["banded / usual, high"].max())


def growth(rows: pd.DataFrame) -> pd.Series:
    """True where time and memory in the band grow no faster than d, by what grows as which power."""
    out = {}
    for name, part in rows.groupby("system", sort=False):
        if len(part) > 2:
            power, low, _ = exponent(part["d"], part["ns, banded"])
            memory, *_ = exponent(part["d"], part["kB, banded"])
            out[f"time of {name}: d^{power:.2f}"] = low <= 1 + ABOVE
            out[f"memory of {name}: d^{memory:.2f}"] = memory <= 1 + ABOVE
    return pd.Series(out, dtype=bool)


RATIO, LONG, SHORT = "`banded / usual`", "step == 'long'", "step == 'short'"
STUDY = Study(
    id="large-solvers",
    place=420,
    within="large",
    question="How are the implicit steps of a lattice solved?",
    answer="Implicit lattice steps too long for fixed-point iteration take banded Newton {long} to {longest} of the "
    "time of full matrices; shorter steps {short} to {shortest} times that of fixed-point iteration.",
    numbers={
        "long": Number(TABLE, RATIO, LONG, pd.Series.min, digits=2),
        "longest": Number(TABLE, RATIO, LONG, digits=2),
        "short": Number(TABLE, RATIO, SHORT, pd.Series.min, digits=2),
        "shortest": Number(TABLE, RATIO, SHORT, digits=2),
    },
    setting=(
        f"The implicit midpoint rule ({METHOD}) on stiff springs (fpu), Toda's ring and the Schrödinger ring (nls) "
        "of the page on [many degrees of freedom](large.md).",
        "Each at a step at which fixed-point iteration contracts, and at one that is too long for it: "
        f"{'; '.join(f'{name}: h = {s.short:g} and {s.long:g}' for name, s in LATTICES.items())}.",
        "Usual solver: fixed-point iteration from an extrapolated start; where it fails, Newton's method with full "
        f"matrices by differences, timed to d = {FULL}.",
        'Banded (`solver="banded"`): simplified Newton in the order of Cuthill and McKee, which folds a ring; a matrix '
        "by as many differences as the band has colours, kept from step to step until it converges badly.",
        "Both to round-off, run in turns, after compilation, without output.",
    ),
    runs=(
        Runs(TABLE, solvers, over(system=LATTICES),
             where=ALONE, own=True, needs=lambda system: (
                 LATTICES[system], SIZES, method(METHOD), method(METHOD, **BANDED), ProblemKey(system))),
    ),
    claims={
        "solves": Claim(
            "Newton's method in the band solves steps too long for the fixed point",
            TABLE, "`solved, banded`", rows=LONG, unit="cases", where=PLACE, fault=True,
        ),
        "same": Claim(
            "The band and the usual solver come to the same state",
            TABLE, "apart", at_most(SAME), unit="of the state", where=PLACE, fault=True,
        ),
        "faster": Claim(
            "At such long steps the band is faster than full matrices",
            TABLE, extent, at_most(1), rows=f"{LONG} and {RATIO} > 0", unit="times the time",
            where=worst("`banded / usual, high`", PLACE),
        ),
        "scaling": Claim(
            "Time and memory in the band grow no faster than the lattice",
            TABLE, growth, rows=LONG, unit="exponents", names=3,
        ),
        "contracts": Claim(
            "Where the fixed point contracts, the band is nowhere faster",
            TABLE, "`banded / usual, high` < 1", NONE, rows=f"{SHORT} and {RATIO} > 0", unit="cases", where=PLACE,
        ),
    },
    checks={
        "solves": Claim("Newton's method in the band solves every step", TABLE, "`solved, banded`", where=PLACE),
    },
    shown=Shown(
        TABLE,
        ("system", "d", "h", "by", "ns, usual", "ns, banded", "banded / usual", "banded / usual, low",
         "banded / usual, high", "evaluations, usual", "evaluations, banded", "kB, usual", "kB, banded"),
        "Nanoseconds of a step, medians; `by`: what the usual solver solved the step by; evaluations of the gradient "
        f"or field in a step, a mean over the first {FEW}; memory of the arrays that a run holds.",
        rows=f"d in {SHOWN}",
    ),
    limits=(
        f"Times are of runs of some milliseconds from the same start, at least {FEWEST} steps, {ROUNDS} rounds: for "
        "the longest lattices few steps, the first of which makes the matrix.",
        "The structure of the band is found once for a system, before a run; its seconds are in the CSV, not in a "
        "step's.",
        f"Exponents are slopes of logarithms from few sizes; they may be above 1 by {ABOVE:g}, because of caches. "
        f"Ends count as the same within {SAME:g} of the state; they are compared after {FEW} steps.",
        "Memory is that of the arrays a run holds; of an array that is never written the operating system gives none, "
        "so that a full matrix costs only where it is used.",
    ),
)  # fmt: skip
