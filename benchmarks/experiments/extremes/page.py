"""The report page on the limits of methods: how far each can be pushed before it fails."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import brouwer, cases, encounters, figures, push, verdicts
from phasebench.benchmarks.experiments.extremes import linear as maps
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as round_off
from phasebench.benchmarks.experiments.extremes.methods import REPRESENTATIVE, step_changing_methods
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table
from phasebench.integrators.registry import BY_ID

if TYPE_CHECKING:
    from pathlib import Path

#: The orbits in the table, and their column headings.
SHOWN = {
    "pendulum": "pendulum",
    "Henon-Heiles, box": "H-H box",
    "Henon-Heiles, at escape": "H-H at escape",
    "Kepler, e = 0.6": "Kepler",
}
DRAWN = {
    "extremes_linear": figures.intervals,
    "extremes_encounters": figures.encounter_errors,
    "extremes_stiffness": figures.stiffness,
    "extremes_growth_curves": figures.growth,
    "extremes_solvers": figures.solvers,
    "extremes_lambda": figures.lambdas,
    "extremes_resonances": figures.resonances,
    "extremes_regions": figures.regions,
}


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw the figures of all tables of this experiment that have rows, each by its function in `DRAWN`."""
    found = {name: data(name) for name in DRAWN}
    return [draw_(found[name], folder) for name, draw_ in DRAWN.items() if found[name] is not None and len(found[name])]


def _limit(value: float) -> str:
    return "none" if value == np.inf else number(float(value), 5)


def _step(value: float) -> str:
    return "any" if value == np.inf else number(float(value), 2)


def summary(
    linear: pd.DataFrame | None, steps: pd.DataFrame | None, met: pd.DataFrame | None, grown: pd.DataFrame | None
) -> pd.DataFrame:
    """Make a row for each representative method: stability limit, largest steps, largest e, round-off, how it fails.

    The arguments are the tables of stability limits, of largest steps, of close encounters (e: the eccentricity of
    Kepler's orbit) and of round-off; columns of a table that is None are left out or empty.
    """
    worst = verdicts.reach(met) if met is not None else {}
    out = []
    for id in (*REPRESENTATIVE, *step_changing_methods()):
        row = {"method": id}
        if linear is not None:
            own = linear[linear["method"] == id]
            row["limit of h ω"] = _limit(own["limit"].iloc[0]) if len(own) else ""
        fails: Counter = Counter()
        if steps is not None:
            mine = steps[steps["method"] == id].set_index("orbit")
            row |= {head: _step(mine["largest h"][name]) if name in mine.index else "" for name, head in SHOWN.items()}
            fails.update(x for x in mine["fails"] if isinstance(x, str) and x)
        row["largest e"] = f"{worst[id]:.10g}" if id in worst else ""
        if grown is not None:
            same = (grown["label"] == BY_ID[id].label) & (grown["h"] == brouwer.PLAIN)
            mine = grown[same & grown["energy exponent"].notna()]
            row["round-off"] = f"{mine['energy exponent'].iloc[0]:.2f}" if len(mine) else ""
        row["how it fails"] = ", ".join(name for name, _ in fails.most_common(2))
        out.append(row)
    return pd.DataFrame(out)


def table(data: Data) -> Table | None:
    """Make the page's table: how far each representative method goes in every test (see `summary`)."""
    tables = [data(name) for name in ("extremes_linear", "extremes_steps", "extremes_encounters", "extremes_growth")]
    if all(t is None for t in tables):
        return None
    caption = (
        f"How far each method goes: the stability limit of h ω; the largest h that survives {push.STEPS} steps on four orbits (H-H: Hénon–Heiles); "
        f"the largest e of Kepler's orbit held to {encounters.HELD:g} over {encounters.ORBITS} periods (0: not even {encounters.ECCENTRICITIES[0]:g}; empty: not run); "
        f"the power of n in the energy's round-off at h = {brouwer.PLAIN:.3g}; the commonest failures."
    )
    return Table(summary(*tables).head(ROWS), caption)


def full_table(data: Data) -> pd.DataFrame | None:
    """Make the long table: the stable intervals of h omega of every method; None if they were not measured."""
    linear = data("extremes_linear")
    return None if linear is None else linear.drop(columns=["method"])


def answer(data: Data) -> str | None:
    """Write the page's answer: known limits met, integrators that follow the closest encounter, growth of round-off."""
    limits, met = verdicts.known_limits(data), verdicts.close(data)
    grown, table = round_off.energy(data), data("extremes_encounters")
    parts = [f"{limits.measured.n} of {limits.measured.of} known stability limits are met"] if limits else []
    parts += [f"{met.measured} {met.unit} hold Kepler's orbit at e = {table['e'].max():.10g}"] if met else []
    text = "energy round-off grows at most diffusively in"
    parts += [f"{text} {grown.measured.n} of {grown.measured.of} ensembles"] if grown else []
    return f"{'; '.join(parts)}." if parts else None


PAGE = Page(
    id="extremes",
    question="How far can a method be pushed before it fails?",
    tables=(
        "extremes_linear",
        "extremes_scheme_i",
        "extremes_published",
        "extremes_steps",
        "extremes_lambda",
        "extremes_encounters",
        "extremes_stiffness",
        "extremes_growth",
        "extremes_growth_every",
        "extremes_growth_curves",
        "extremes_solvers",
        "extremes_resonances",
        "extremes_regions",
    ),
    setting=(
        "Stability: H = (p² + ω² q²) / 2; a step is stable where the trace of its matrix says so, ends refined to ten digits and "
        f"confirmed by {maps.STEPS} steps beside them; methods whose step is not linear by long runs.",
        f"Largest step: a run survives {push.STEPS} steps if its energy error stays below the size of H's terms, the orbit in its "
        f"range and its clock right; h is bisected to a factor 2^(1/{push.PARTS}).",
        f"Close encounters: Kepler from pericentre, {encounters.ORBITS} periods, at most {encounters.LADDER[-1]} steps from an "
        "apside to the next.",
        f"Round-off: {brouwer.STARTS} starts on the oscillator, against the exact step map in {brouwer.DIGITS} digits, and on Kepler's "
        "orbit by an integrator that solves it; whether errors are bounded is [another page](drift.md).",
        f"Orbits: {'; '.join(c.id for c in cases.CASES)}.",
    ),
    verdicts=(verdicts.known_limits, verdicts.closed_form, verdicts.long_runs, verdicts.close, round_off.energy),
    answer=answer,
    figures=draw,
    table=table,
    whole=full_table,
    limits=(
        "More on pages of their own: [known limits](extremes-limits.md), [three bodies and a zoom-whirl orbit](extremes-encounters.md), "
        "[step-size resonances](extremes-springs.md), [multistep methods](extremes-multistep.md), "
        "[round-off](extremes-round-off.md).",
        "A gap between stable steps in which the trace exceeds 2 by less than 1e-10 is not counted; beyond h ω = 10 intervals "
        "narrower than 0.25 may be missed.",
        "Survival is not monotone in h: the largest step is the end of the first interval that doublings of h find.",
        "A method that keeps the energy may still be on another orbit: on regular orbits a run fails too where a coordinate "
        f"leaves its range by more than {cases.MARGIN:g} of it, or crosses its middle {cases.OFF:g} times too often or too seldom; "
        "on chaotic ones the energy alone is judged.",
        f"A run that takes longer than {cases.SECONDS:g} s counts as failed (timeout).",
        "Round-off is measured on a linear problem, the oscillator: on others it may be different.",
    ),
    command="pytest benchmarks/experiments/extremes",
)
