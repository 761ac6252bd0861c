"""Cost by the number of degrees of freedom: the page."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from .large import COSTS, DERIVED, MADE, MANY, PATIENCE, TUPLE_LIMIT, exponent
from .systems import OMEGA, SPACING, SYSTEMS

#: An exponent may be above 1 (or 2 where every pair acts) by so much: caches.
ABOVE = 0.1
#: The most times as long as bare C that a step from `MANY` degrees of freedom on should take.
WANTED = 2.0
#: The sizes of the table, about.
SHOWN = (8, 24, 128, 1024, 10_000)


def exponents(costs: pd.DataFrame) -> pd.DataFrame:
    """Of each system the exponents of the time and of the memory from `MANY` on, with their intervals."""
    rows = []
    for name, part in costs[costs["d"] >= MANY].groupby("system", sort=False):
        if len(part) < 3:
            continue
        row = {"system": name, "wanted": 2 if SYSTEMS[name].pairs else 1}
        for what, column in (("time", "ns, ours"), ("C", "ns, C"), ("memory", "kB")):
            row |= dict(zip((what, f"{what}, low", f"{what}, high"), exponent(part["d"], part[column]), strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


@of(COSTS)
def scaling(costs: pd.DataFrame) -> Verdict | None:
    """Whether the cost grows as the work does."""
    found = exponents(costs)
    if found.empty:
        return None
    steep = found[found["time, low"] > found["wanted"] + ABOVE]
    parts = [
        f"{r['system']} {r['time']:.2f} [{r['time, low']:.2f}, {r['time, high']:.2f}]" for r in found.to_dict("records")
    ]
    text = f"From d = {MANY} on the cost of a step grows as d to the power {'; '.join(parts)}"
    text += (
        f"; steeper than the work: {listed(list(steep['system']))}" if len(steep) else "; nowhere steeper than the work"
    )
    memory = [f"{r['system']} {r['memory']:.2f}" for r in found.to_dict("records") if r["memory"] > 1 + ABOVE]
    text += f"; memory grows as d, but for {listed(memory)}" if memory else "; memory grows as d"
    return Verdict(f"{text}.", steep.empty, f"Cost by d: {'; '.join(p.partition(' [')[0] for p in parts)}.")


@of(COSTS)
def beside(costs: pd.DataFrame) -> Verdict | None:
    """The cost beside bare C, and REBOUND's."""
    if costs.empty:
        return None
    parts, holds = [], True
    for kind, what in (("tuple", "states in registers"), ("array", "on arrays")):
        part = costs[costs["values"] == kind]
        if part.empty:
            continue
        low, high = (part.loc[getattr(part["ours / C"], f)()] for f in ("idxmin", "idxmax"))
        parts.append(
            f"{what}, {number(low['ours / C'], 2)} ({_at(low)}) to {number(high['ours / C'], 2)} ({_at(high)})"
        )
    many = costs[costs["d"] >= MANY]
    holds = bool((many["ours / C"] <= WANTED).all())
    text = f"A step takes, in times of bare C: {'; '.join(parts)}"
    if "ours / REBOUND" in costs and costs["ours / REBOUND"].notna().any():
        last = costs[costs["ours / REBOUND"].notna()].sort_values("d")
        least, most = last["ours / REBOUND"].min(), last["ours / REBOUND"].max()
        text += f"; of REBOUND's leapfrog {number(least, 2)} to {number(most, 2)}"
    return Verdict(f"{text}.", holds, f"Large d: at most {number(many['ours / C'].max(), 2)} times bare C.")


def _at(row) -> str:
    return f"{row['system']}, d = {int(row['d'])}"


@of(MADE)
def limit(made: pd.DataFrame) -> Verdict | None:
    """How far formulae go, and what loops take."""
    derived, loops = (made[made["route"] == route] for route in ("formula", "loops"))
    if derived.empty or loops.empty:
        return None
    within = derived[derived["seconds"] <= PATIENCE]
    ends = {name: int(part["d"].max()) for name, part in within.groupby("system", sort=False)}
    parts = [f"{name} to d = {d}" for name, d in ends.items()]
    worst = loops.loc[loops["seconds"].idxmax()]
    text = f"Functions derived from a formula are ready within {PATIENCE:g} s for {listed(parts, 6)}"
    text += f"; loops for any d, at most {number(worst['seconds'], 2)} s ({_at(worst)})"
    return Verdict(
        f"{text}.", bool(worst["seconds"] <= PATIENCE), f"Formulae go to d = {min(ends.values(), default=0)}."
    )


@of(COSTS)
def draw(costs: pd.DataFrame, folder) -> list[Picture]:
    """Nanoseconds of a step by d."""
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
    caption = "Time of a step by the degrees of freedom; where it is grey states are in registers, else on arrays."
    return [Picture(style.save(figure, folder, "large.png"), "cost by d", caption)]


@of(COSTS)
def table(costs: pd.DataFrame) -> Table:
    """A few sizes of each system."""
    rows = []
    for _, part in costs.groupby("system", sort=False):
        near = sorted({int((part["d"] - d).abs().idxmin()) for d in SHOWN}, key=lambda k: part.loc[k, "d"])
        rows += [part.loc[k] for k in near]
    columns = ["system", "method", "d", "values", "ns, ours", "ns, C", "ours / C", "ours / C, low", "ours / C, high"]
    columns += ["ns, REBOUND", "ours / REBOUND", "kB"]
    caption = (
        "Nanoseconds of a step at sizes near the same for all, medians; ratios round by round with 95 % intervals."
    )
    return Table(pd.DataFrame(rows).reindex(columns=columns).head(ROWS), caption)


@of(MADE)
def whole(made: pd.DataFrame) -> pd.DataFrame:
    """Seconds until a system's functions are there."""
    return made


PAGE = Page(
    id="large",
    question="What does a step of many degrees of freedom cost?",
    tables=(COSTS, MADE),
    setting=(
        f"Stiff springs (fpu, omega = {OMEGA:g}), Toda's lattice, Klein-Gordon and Schroedinger waves on points {SPACING:g} apart, a "
        "Plummer sphere of N bodies: d from 2 to 10,000.",
        "Stormer-Verlet, one gradient a step; the Schroedinger lattice, which is not separable, by rk4, four fields a step.",
        f"To d = {TUPLE_LIMIT} functions are derived from the formula of H; above, they are loops written by hand. States are tuples "
        "in registers or arrays, as the column `values` says.",
        "Beside it the same loops in C (gcc -O3 -march=native, uncompensated) and, of bodies, REBOUND's leapfrog with direct "
        "summation; in turns, warm, without output.",
        f"Functions are derived for d = {', '.join(map(str, DERIVED))} until it takes longer than {PATIENCE:g} s, from an empty cache.",
    ),
    verdicts=(scaling, beside, limit),
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        "Exponents are slopes of logarithms by least squares with Student's interval, from sizes that caches treat differently.",
        "Explicit methods work in place on arrays, as C does; operations of all others return new arrays, which below a few "
        "hundred degrees of freedom costs more than the sums. Sums here are compensated, those of C and REBOUND are not.",
        "Memory is that of the arrays a run holds; of implicit methods it holds a dense matrix, of (d + 1)^2 numbers and more, "
        "unless they are solved in a band (the page `large-solvers`).",
        "A chaotic end is not compared: ours and C agree over the first steps.",
    ),
    command="pytest benchmarks/experiments/large",
)
