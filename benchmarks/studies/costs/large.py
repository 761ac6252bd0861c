"""Costs over the number d of degrees of freedom: time of a step beside plain C and REBOUND, memory, compilation."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.metrics import power
from phasebench.benchmarks.measure.timing import clock, columns, median, ratio, time_in_turns
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import at_most
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, Unavailable
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import BY_ID
from phasebench.reference.peers import forms, particles

from .systems import OMEGA, SPACING, SYSTEMS, Large

COSTS, MADE = "large", "large_made"
#: Approximate degrees of freedom at which costs are measured, and in the table; exponents are fitted from `MANY` on.
SIZES = (2, 4, 8, 16, 24, 64, 128, 256, 512, 1024, 2048, 4096, 10_000)
SHOWN, MANY = (8, 24, 128, 1024, 10_000), 64
#: Degrees of freedom at which functions are derived from a formula, until that takes longer than `PATIENCE` seconds,
#: and those at which they are compiled from loops.
DERIVED, PATIENCE, BY_HAND = (8, 16, 32, 64, 128, 256, 512), 10.0, (32, 512, 10_000)
#: Seconds of a timed run, rounds; number of steps after which ends are compared with C, and their largest difference.
SECONDS, ROUNDS, FEW, APART = 4e-3, 11, 3, 1e-10
#: An exponent may exceed 1 (2 if all pairs interact) by this, because of caches; largest ratio to C that is wanted.
ABOVE, WANTED = 0.1, 2.0
PLACE = "{system}, d = {d:.0f}"


def costs(system: str, d: int) -> dict:
    """The cost of a step by this project, C and, for bodies, REBOUND, timed in turns; memory; the distance from C.

    Raises Unavailable without a C compiler, RuntimeError if C ends at another state.
    """
    large = SYSTEMS[system]
    run = prepare(large.fastest_form(d), large.method)
    try:
        loop = large.prepare_c(d)
    except RuntimeError as error:
        raise Unavailable(str(error)) from None
    apart = distance(run(large.h, FEW), loop(large.h, FEW))
    if not apart < APART:
        raise RuntimeError(f"{system} of d = {d}: C ends {apart:.1e} elsewhere after {FEW} steps")
    steps = enough(lambda n: loop(large.h, n))
    work: dict[str, Callable[[], object]] = {"ours": lambda: run(large.h, steps), "C": lambda: loop(large.h, steps)}
    if large.pairs:
        work["REBOUND"] = _rebound(large, d, steps)
    times = time_in_turns(work, ROUNDS)
    row = {"method": large.method, "values": run.values, "steps": steps}
    for who, seconds in times.items():
        row |= columns(f"ns, {who}", median(seconds / steps * 1e9))
        row |= columns(f"ours / {who}", ratio(times["ours"], seconds)) if who != "ours" else {}
    return row | {"kB": array_bytes(run) / 1e3, "difference from C": apart}


def distance(ours: tuple, other: tuple) -> float:
    """The largest relative distance of q and of p, each in the max norm."""
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in zip(ours[:2], other[:2], strict=True))


def enough(run: Callable[[int], object]) -> int:
    """A number of steps, a power of two of at most 2^20, of which a run takes at least `SECONDS`."""
    steps = 1
    while clock(partial(run, steps))() < SECONDS and steps < 2**20:
        steps *= 2
    return steps


def _rebound(system: Large, d: int, steps: int) -> Callable[[], object]:
    """A function that goes on by ``steps`` steps of REBOUND's leapfrog with direct summation."""
    N = d // system.unit
    setting = forms.Setting(forms.GRAVITY, (1.0 / N,) * N, 3, 0, (1.0,) * d)
    sim, _ = particles.build(setting, *system.start(d), "leapfrog")
    sim.dt = system.h
    return lambda: sim.steps(steps)


def array_bytes(run: PreparedRun) -> int:
    """The bytes of the arrays that a prepared run holds: state, memory of earlier steps, work."""
    carry = run._layout.carry
    return sum(a.nbytes for a in (carry.state, carry.memory, carry.work.rows, run._start, run._end))


def made(system: str) -> list[dict]:
    """The seconds to make a system's functions from scratch, derived from a formula and from hand-written loops."""
    large, rows = SYSTEMS[system], []
    for route, make, sizes in (("formula", large.from_formula, DERIVED), ("loops", large.by_hand, BY_HAND)):
        for d in map(large.size, sizes):
            seconds = getting_ready(partial(make, d))
            rows.append({"route": route, "d": d, "seconds": seconds})
            if route == "formula" and seconds > PATIENCE:
                break
    return rows


def getting_ready(make: Callable[[], SimpleNamespace]) -> float:
    """The seconds to make a problem and compile its energy and gradient (or field), from an empty cache."""
    with nothing_kept():
        started = time.perf_counter()
        system = make().system
        system.energy()
        (system.grad_V if system.separable else system.field)()
        return time.perf_counter() - started


@contextmanager
def nothing_kept() -> Iterator[None]:
    """Context manager that runs its block with an empty cache of compiled functions."""
    from phasebench.integrators.compile import codegen
    from phasebench.integrators.systems import hand

    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict(os.environ, PHASEBENCH_CACHE=folder),
        patch.dict(codegen._ready, clear=True),
    ):
        hand._compile.cache_clear()
        yield


def exponent(d: pd.Series, cost: pd.Series) -> tuple[float, float, float]:
    """Fit cost ~ d^e: (e, low, high), a 95 % interval; NaN for fewer than 3 sizes."""
    if len(np.unique(d)) < 3 or np.min(d) <= 0:
        return np.nan, np.nan, np.nan
    found = power(d, cost)
    return found.value, found.low, found.high


def _exponents(rows: pd.DataFrame) -> pd.DataFrame:
    """The power of d with which the time of a step grows, its interval and what is expected; indexed by system."""
    found = {name: exponent(part["d"], part["ns, ours"]) for name, part in rows.groupby("system", sort=False)}
    frame = pd.DataFrame.from_dict(found, orient="index", columns=["time", "low", "high"]).dropna()
    return frame.assign(expected=[2 if SYSTEMS[name].pairs else 1 for name in frame.index])


def fits(rows: pd.DataFrame) -> pd.Series:
    """True for a system whose steps grow no faster than the work: as d, or as d^2 if all pairs interact."""
    found = _exponents(rows)
    return found["low"] <= found["expected"] + ABOVE


def steepest(rows: pd.DataFrame) -> str:
    """The system whose steps grow fastest beside the work."""
    found = _exponents(rows)
    worst = found.loc[(found["time"] - found["expected"]).idxmax()]
    return f"{worst.name}: d to the power {worst['time']:.2f} [{worst['low']:.2f}, {worst['high']:.2f}]"


@of(COSTS)
def powers(rows: pd.DataFrame) -> str | None:
    """The ranges of the exponents, on lattices and for bodies."""
    found, parts = _exponents(rows[rows["d"] >= MANY]), []
    for expected, kind in ((1, "on lattices"), (2, "for bodies")):
        times = found.loc[found["expected"] == expected, "time"]
        ends = sorted({f"d^{x:.2f}" for x in (times.min(), times.max())})
        parts += [f"{' to '.join(ends)} {kind}"] if len(times) else []
    return ", ".join(parts) or None


@picture(
    COSTS, "large", "cost by d",
    "Time of a step over the degrees of freedom d; grey: the state is held in registers, elsewhere in arrays.",
)  # fmt: skip
def _draw(costs: pd.DataFrame) -> style.Figure:
    """Nanoseconds of a step over d, by this project, C and REBOUND: a panel for each system."""
    systems = costs.groupby("system", sort=False)
    figure, (panels,) = style.panels(1, len(systems), 2.9, sharey=True)
    for axes, (name, part) in zip(panels, systems, strict=True):
        part = part.sort_values("d")
        for who, look in zip(("ours", "C", "REBOUND"), style.looks(), strict=False):
            if f"ns, {who}" in part and part[f"ns, {who}"].notna().any():
                axes.loglog(part["d"], part[f"ns, {who}"], label=who, **look)
        in_registers = part.loc[part["values"] == "tuple", "d"]
        if len(in_registers):
            axes.axvspan(in_registers.min() / 1.2, in_registers.max() * 1.2, color="0.95", zorder=0)
        axes.set(title=name, xlabel="d")
        axes.grid(color="0.93", linewidth=0.5)
    panels[0].set_ylabel("ns a step")
    style.legend_above(figure, panels[-1], 3)
    return figure


@of(COSTS, MADE)
def _table(costs: pd.DataFrame, made: pd.DataFrame) -> Table:
    """The cost of a step at a few sizes of each system; the caption says up to which size a formula serves."""
    parts = [part for _, part in costs.groupby("system", sort=False)]
    near = [k for part in parts for k in sorted({(part["d"] - d).abs().idxmin() for d in SHOWN})]
    shown = ["system", "method", "d", "values", "ns, ours", "ns, C", "ours / C", "ours / C, low", "ours / C, high"]
    shown += ["ns, REBOUND", "ours / REBOUND", "kB"]
    within = made[(made["route"] == "formula") & (made["seconds"] <= PATIENCE)]
    largest = within.groupby("system", sort=False)["d"].max()
    caption = (
        "Nanoseconds of a step, medians; ratios round by round with 95 % intervals; kB: the arrays that a run holds. "
        f"Functions derived from a formula are ready within {PATIENCE:g} s for "
        f"{join_list([f'{name} to d = {d}' for name, d in largest.items()])}."
    )
    return Table(costs.loc[near].reindex(columns=shown).head(ROWS), caption)


def _needs(system: str, **key: object) -> tuple:
    return BY_ID[SYSTEMS[system].method], ProblemKey(system)


LARGE = f"d >= {MANY}"
STUDY = Study(
    id="large",
    place=410,
    question="What does a step of many degrees of freedom cost?",
    answer=f"An explicit step of d ≥ {MANY} degrees of freedom takes {{beside.low}} to {{beside.high}} times as long "
    "as in C, growing as {powers}.",
    numbers={"powers": powers},
    setting=(
        f"Stiff springs (fpu, ω = {OMEGA:g}), Toda's lattice, Klein–Gordon and Schrödinger waves on points {SPACING:g} "
        "apart, a Plummer sphere of N bodies: d from 2 to 10,000.",
        "Störmer–Verlet, one gradient a step; the Schrödinger lattice, which is not separable, by rk4, four fields a "
        "step.",
        f"To d = {TUPLE_LIMIT} functions are derived from the formula of H, above they are loops written by hand; the "
        "column `values` says whether the state is a tuple in registers or in arrays.",
        "Beside it the same loops in C (gcc -O3 -march=native, uncompensated) and, for bodies, REBOUND's leapfrog with "
        "direct summation; run in turns, after compilation, without output.",
        f"Compilation: functions derived for d = {', '.join(map(str, DERIVED))} until it takes longer than "
        f"{PATIENCE:g} s, and from loops, both from an empty cache.",
    ),
    runs=(
        Runs(COSTS, costs, [{"system": id, "d": d} for id, s in SYSTEMS.items() for d in sorted({*map(s.size, SIZES)})],
             needs=_needs, where=ALONE, own=True),
        Runs(MADE, made, over(system=SYSTEMS), needs=_needs, where=ALONE, own=True),
    ),
    claims={
        "scaling": Claim(
            "The time of a step grows no faster than the work", COSTS, fits, rows=LARGE, unit="systems", where=steepest,
        ),
        "beside": Claim(
            "A step of a large system costs little more than in bare C",
            COSTS, "`ours / C`", at_most(WANTED), rows=LARGE, unit="times the time in C", where=PLACE, span=True,
        ),
        "loops": Claim(
            "Functions written as loops are soon compiled, at any size",
            MADE, "seconds", at_most(PATIENCE), rows="route == 'loops'", unit="s", where=PLACE,
        ),
    },
    figure=_draw,
    shown=_table,
    whole=MADE,
    limits=(
        f"Exponents are slopes of log t over log d from d = {MANY} on, by least squares with Student's 95 % interval; "
        f"caches treat the sizes differently, so that the interval may begin {ABOVE:g} above the work's power.",
        "Explicit methods work in place on arrays, as C does; all others return new arrays, which below a few hundred "
        "degrees of freedom costs more than the sums.",
        "Sums here are compensated, those of C and REBOUND are not.",
        "Memory is that of the arrays a run holds; for implicit methods that includes a dense matrix of (d + 1)^2 "
        "numbers and more, unless they are [solved in a band](large-solvers.md).",
        "Ends after a long time are not compared, as the systems are chaotic: ours and C agree over the first steps.",
    ),
)  # fmt: skip
