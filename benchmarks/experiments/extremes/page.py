"""How far can a method be pushed: the page of extremes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import brouwer, cases, encounters, figures, push, verdicts
from phasebench.benchmarks.experiments.extremes import linear as maps
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as round_off
from phasebench.benchmarks.experiments.extremes.methods import REPRESENTATIVE, transformed
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table
from phasebench.integrators.registry import BY_ID

#: The orbits of the table, by their headings.
SHOWN = {
    "pendulum": "pendulum",
    "Henon-Heiles, box": "H-H box",
    "Henon-Heiles, at escape": "H-H at escape",
    "Kepler, e = 0.6": "Kepler",
}
DRAWN = {
    "extremes_linear": figures.intervals,
    "extremes_encounters": figures.encountered,
    "extremes_stiffness": figures.stiffness,
    "extremes_growth_curves": figures.growth,
    "extremes_solvers": figures.solvers,
    "extremes_lambda": figures.lambdas,
    "extremes_resonances": figures.resonances,
    "extremes_regions": figures.regions,
}


def draw(data, folder) -> list[Picture]:
    """The figures of the tables that were measured."""
    found = {name: data(name) for name in DRAWN}
    return [draw_(found[name], folder) for name, draw_ in DRAWN.items() if found[name] is not None and len(found[name])]


def _limit(value) -> str:
    return "none" if value == np.inf else number(float(value), 5)


def _step(value) -> str:
    return "any" if value == np.inf else number(float(value), 2)


def summary(linear, steps, met, grown) -> pd.DataFrame:
    """A row for each method that is pushed, of its own parameters, and each of transformed time; the tables may be None."""
    worst = verdicts.reach(met) if met is not None else {}
    out = []
    for id in (*REPRESENTATIVE, *transformed()):
        row = {"method": id}
        if linear is not None:
            own = linear[linear["method"] == id]
            row["limit of h ω"] = _limit(own["limit"].iloc[0]) if len(own) else ""
        fails: Counter = Counter()
        if steps is not None:
            mine = steps[steps["method"] == id].set_index("orbit")
            row |= {head: _step(mine["largest h"][name]) if name in mine.index else "" for name, head in SHOWN.items()}
            fails.update(x for x in mine["fails"] if isinstance(x, str) and x)
        row["worst e"] = f"{worst[id]:.10g}" if id in worst else ""
        if grown is not None:
            same = (grown["label"] == BY_ID[id].label) & (grown["h"] == brouwer.PLAIN)
            mine = grown[same & grown["energy exponent"].notna()]
            row["growth"] = f"{mine['energy exponent'].iloc[0]:.2f}" if len(mine) else ""
        row["how it fails"] = ", ".join(name for name, _ in fails.most_common(2))
        out.append(row)
    return pd.DataFrame(out)


def table(data) -> Table | None:
    """How far can I push it."""
    tables = [data(name) for name in ("extremes_linear", "extremes_steps", "extremes_encounters", "extremes_growth")]
    if all(t is None for t in tables):
        return None
    caption = (
        f"How far each method goes: the stability limit of h ω; the largest h that survives {push.STEPS} steps on four orbits; the "
        f"largest eccentricity held to {encounters.HELD:g} over {encounters.ORBITS} orbits (0: not the smallest one, "
        f"{encounters.ECCENTRICITIES[0]:g}; nothing: not run); the exponent of the energy's round-off at h = {brouwer.PLAIN:.3g}; the commonest ways to fail."
    )
    return Table(summary(*tables).head(ROWS), caption)


def whole(data) -> pd.DataFrame | None:
    """The stable intervals of every method."""
    linear = data("extremes_linear")
    return None if linear is None else linear.drop(columns=["method"])


PAGE = Page(
    id="extremes",
    question="How far can I push it?",
    tables=(
        "extremes_linear",
        "extremes_scheme_i",
        "extremes_published",
        "extremes_steps",
        "extremes_lambda",
        "extremes_encounters",
        "extremes_stiffness",
        "extremes_growth",
        "extremes_growth_curves",
        "extremes_solvers",
        "extremes_resonances",
        "extremes_regions",
    ),
    setting=(
        "Linear stability: the trace of the step map on H = (p² + ω² q²) / 2, ends refined to ten digits and confirmed by "
        f"{maps.STEPS} steps beside them; maps that are not linear by long runs.",
        f"Largest step: {push.STEPS} steps survive where the energy error stays below the size of H's terms, the orbit in its "
        f"range and its clock right; bisected to a part 2^(1/{push.PARTS}).",
        f"Close encounters: Kepler from pericentre, {encounters.ORBITS} orbits, at most {encounters.LADDER[-1]} steps from an "
        "apside to the next.",
        f"Long times: {brouwer.STARTS} starts on the oscillator, |w|² and arg w of the exact step map in {brouwer.DIGITS} "
        "digits, and on Kepler's problem by Wisdom-Holman's exact step; whether errors are bounded is [another page](drift.md)'s.",
        f"Orbits: {'; '.join(c.id for c in cases.CASES)}.",
    ),
    verdicts=(verdicts.limits, verdicts.close, round_off.brouwers_law),
    figures=draw,
    table=table,
    whole=whole,
    limits=(
        "Pages of their own: [limits beside those that are known](extremes-limits.md), [three bodies and a zoom-whirl orbit](extremes-encounters.md), "
        "[step-size resonances of FPU](extremes-springs.md).",
        "A gap in which the trace exceeds 2 by less than 1e-10 counts as a touch; beyond h ω = 10 intervals narrower than "
        "0.25 may be missed.",
        "Survival is not monotone in h: the largest step is the end of the first interval that doublings see.",
        f"What keeps its energy is convicted on regular orbits alone, where a coordinate leaves its range by more than MARGIN = {cases.MARGIN:g} "
        f"of it or crosses its middle {cases.OFF:g} times too often or too seldom; on chaotic ones by the energy's bounds.",
        f"Brouwer's law is judged at UNITS = {round_off.UNITS:g} eps h n^(1/2) and exponents whose interval begins at most "
        f"ABOVE = {round_off.ABOVE:g} over it; the oscillator is linear, and its rounding need not be that of other problems.",
        f"Next to fractions of small denominators, such as h = {brouwer.DECIMAL:g}, round-off drifts: see [why](extremes-round-off.md).",
        f"A run that takes longer than {cases.SECONDS:g} s counts as failed there (timeout).",
    ),
    command="pytest benchmarks/experiments/extremes",
)
