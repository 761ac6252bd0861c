"""The report page on the cost of a step over the number d of degrees of freedom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, Count, Range, Verdict, at_most

from .large import COSTS, DERIVED, MADE, MANY, PATIENCE, TUPLE_LIMIT, exponent
from .systems import OMEGA, SPACING, SYSTEMS

if TYPE_CHECKING:
    from pathlib import Path

#: An exponent may exceed 1 (2 if all pairs interact) by this, because of caches.
ABOVE = 0.1
#: Wanted largest ratio of a step's time to that in C, from `MANY` degrees of freedom on.
WANTED = 2.0
#: Approximate sizes in the table.
SHOWN = (8, 24, 128, 1024, 10_000)


def exponents(costs: pd.DataFrame) -> pd.DataFrame:
    """Fit, for each system, the powers of d with which the time (ours and C's) and the memory of a step grow.

    ``costs`` is the table of costs, of which the rows from `MANY` degrees of freedom on count.  A row of the result has
    each power with the ends of its interval, and the expected power: 2 if all pairs of bodies interact, else 1.
    """
    rows = []
    for name, part in costs[costs["d"] >= MANY].groupby("system", sort=False):
        if len(part) < 3:
            continue
        row = {"system": name, "expected": 2 if SYSTEMS[name].pairs else 1}
        for what, column in (("time", "ns, ours"), ("C", "ns, C"), ("memory", "kB")):
            row |= dict(zip((what, f"{what}, low", f"{what}, high"), exponent(part["d"], part[column]), strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


def at(row: pd.Series | dict) -> str:
    """Format the system and the number of degrees of freedom of a row as text."""
    return f"{row['system']}, d = {int(row['d'])}"


@of(COSTS)
def scaling(costs: pd.DataFrame) -> Verdict | None:
    """Judge whether the time of a step grows no faster than the work: as d, or as d^2 if all pairs interact.

    ``costs`` is the table of costs of a step; None if it has too few sizes.
    """
    found = exponents(costs)
    if found.empty:
        return None
    fits = found["time, low"] <= found["expected"] + ABOVE
    worst = found.loc[(found["time"] - found["expected"]).idxmax()]
    return Verdict(
        "The time of a step grows no faster than the work",
        Count(int(fits.sum()), len(fits)),
        EVERY,
        "systems",
        where=f"{worst['system']}: d to the power {worst['time']:.2f} [{worst['time, low']:.2f}, {worst['time, high']:.2f}]",
    )


@of(COSTS)
def beside(costs: pd.DataFrame) -> Verdict | None:
    """Judge whether a step of a large system (d of at least `MANY`) takes at most `WANTED` times as long as in C.

    ``costs`` is the table of costs of a step; None if it has no such system.
    """
    ratios = _many(costs)["ours / C"]
    if ratios.empty:
        return None
    where = at(costs.loc[ratios.idxmax()])
    return Verdict(
        "A step of a large system costs little more than in bare C",
        Range(ratios.min(), ratios.max()),
        at_most(WANTED),
        "times the time in C",
        where,
    )


def _many(costs: pd.DataFrame) -> pd.DataFrame:
    """Select the rows with at least `MANY` degrees of freedom from the table of costs."""
    return costs[costs["d"] >= MANY]


@of(MADE)
def loops(made: pd.DataFrame) -> Verdict | None:
    """Judge whether functions written by hand as loops are compiled within `PATIENCE` seconds at any size.

    ``made`` is the table of compilation times; None if it has no such functions.
    """
    by_hand = made[made["route"] == "loops"]
    if by_hand.empty:
        return None
    worst = by_hand.loc[by_hand["seconds"].idxmax()]
    return Verdict(
        "Functions written as loops are soon compiled, at any size",
        float(worst["seconds"]),
        at_most(PATIENCE),
        "s",
        at(worst),
    )


@of(COSTS)
def answer(costs: pd.DataFrame) -> str | None:
    """Write the page's answer, a sentence: how the time of a step grows with d, and its ratio to the time in C.

    None if the table of costs has too few sizes.
    """
    found = exponents(costs)
    if found.empty:
        return None
    parts = []
    for power, kind in ((1, "on lattices"), (2, "for bodies")):
        times = found.loc[found["expected"] == power, "time"]
        ends = sorted({f"d^{times.min():.2f}", f"d^{times.max():.2f}"})
        parts += [f"{' to '.join(ends)} {kind}"] if len(times) else []
    ratios = _many(costs)["ours / C"]
    text = f"An explicit step of d ≥ {MANY} degrees of freedom takes {number(ratios.min(), 2)} to"
    return f"{text} {number(ratios.max(), 2)} times as long as in C, growing as {', '.join(parts)}."


@of(COSTS)
def draw(costs: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw nanoseconds of a step over d, by this project, C and REBOUND: a panel for each system."""
    names = list(dict.fromkeys(costs["system"]))
    with style.settings():
        figure, (panels,) = style.panels(1, len(names), 2.9, sharey=True)
        looks = dict(zip(("ours", "C", "REBOUND"), style.looks(), strict=False))
        for axes, name in zip(np.atleast_1d(panels), names, strict=True):
            part = costs[costs["system"] == name].sort_values("d")
            for who, look in looks.items():
                if f"ns, {who}" in part and part[f"ns, {who}"].notna().any():
                    axes.loglog(part["d"], part[f"ns, {who}"], label=who, **look)
            in_registers = part.loc[part["values"] == "tuple", "d"]
            if len(in_registers):
                axes.axvspan(in_registers.min() / 1.2, in_registers.max() * 1.2, color="0.95", zorder=0)
            axes.set(title=name, xlabel="d")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("ns a step")
        style.legend_above(figure, panels[-1], 3)
    caption = "Time of a step over the degrees of freedom d; grey: the state is held in registers, elsewhere in arrays."
    return [Picture(style.save(figure, folder, "large.png"), "cost by d", caption)]


def table(data: Data) -> Table | None:
    """Make the page's table: the cost of a step at a few sizes of each system; None if it was not measured.

    The caption says up to which size functions are derived from a formula.  ``data`` maps a table's name to the table.
    """
    costs, made = data(COSTS), data(MADE)
    if costs is None or costs.empty:
        return None
    rows = []
    for _, part in costs.groupby("system", sort=False):
        near = sorted({int((part["d"] - d).abs().idxmin()) for d in SHOWN}, key=lambda k: part.loc[k, "d"])
        rows += [part.loc[k] for k in near]
    columns = ["system", "method", "d", "values", "ns, ours", "ns, C", "ours / C", "ours / C, low", "ours / C, high"]
    columns += ["ns, REBOUND", "ours / REBOUND", "kB"]
    caption = (
        "Nanoseconds of a step, medians; ratios round by round with 95 % intervals; kB: the arrays that a run holds."
    )
    ends = {} if made is None else largest_derived(made)
    if ends:
        ends = join_list([f"{name} to d = {d}" for name, d in ends.items()])
        caption += f" Functions derived from a formula are ready within {PATIENCE:g} s for {ends}."
    return Table(pd.DataFrame(rows).reindex(columns=columns).head(ROWS), caption)


def largest_derived(made: pd.DataFrame) -> dict[str, int]:
    """Return, for each system, the largest d whose functions are derived from a formula within `PATIENCE` seconds.

    ``made`` is the table of compilation times.
    """
    within = made[(made["route"] == "formula") & (made["seconds"] <= PATIENCE)]
    return {name: int(d) for name, d in within.groupby("system", sort=False)["d"].max().items()}


@of(MADE)
def full_table(made: pd.DataFrame) -> pd.DataFrame:
    """Return the page's longer table: for every system and size, the seconds to generate and compile its functions."""
    return made


PAGE = Page(
    id="large",
    question="What does a step of many degrees of freedom cost?",
    tables=(COSTS, MADE),
    setting=(
        f"Stiff springs (fpu, ω = {OMEGA:g}), Toda's lattice, Klein–Gordon and Schrödinger waves on points {SPACING:g} apart, "
        "a Plummer sphere of N bodies: d from 2 to 10,000.",
        "Störmer–Verlet, one gradient a step; the Schrödinger lattice, which is not separable, by rk4, four fields a step.",
        f"To d = {TUPLE_LIMIT} functions are derived from the formula of H, above they are loops written by hand; the "
        "column `values` says whether the state is a tuple in registers or in arrays.",
        "Beside it the same loops in C (gcc -O3 -march=native, uncompensated) and, for bodies, REBOUND's leapfrog with "
        "direct summation; run in turns, after compilation, without output.",
        f"Compilation: functions derived for d = {', '.join(map(str, DERIVED))} until it takes longer than {PATIENCE:g} s, "
        "and from loops, both from an empty cache.",
    ),
    verdicts=(scaling, beside, loops),
    answer=answer,
    figures=draw,
    table=table,
    whole=full_table,
    limits=(
        f"Exponents are slopes of log t over log d from d = {MANY} on, by least squares with Student's 95 % interval; caches "
        f"treat the sizes differently, so that the interval may begin {ABOVE:g} above the work's power.",
        "Explicit methods work in place on arrays, as C does; all others return new arrays, which below a few hundred "
        "degrees of freedom costs more than the sums.",
        "Sums here are compensated, those of C and REBOUND are not.",
        "Memory is that of the arrays a run holds; for implicit methods that includes a dense matrix of (d + 1)^2 numbers "
        "and more, unless they are [solved in a band](large-solvers.md).",
        "Ends after a long time are not compared, as the systems are chaotic: ours and C agree over the first steps.",
    ),
    command="pytest benchmarks/experiments/large",
)
