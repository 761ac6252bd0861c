"""How far a method can be pushed before it fails: the page that sums up the others, with maps of its own."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import together
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import BY_ID

from . import encounters, limits, maps, push, round_off

#: Peers whose steps solve Kepler's problem exactly.
KEPLERIAN = ("rebound-whfast", "rebound-mercurius", "rebound-trace")
#: Adaptive peers must keep the error small up to this eccentricity.
HARD = 0.999
#: The orbits in the table, and their column headings.
SHOWN = {
    "pendulum": "pendulum",
    "Henon-Heiles, box": "H-H box",
    "Henon-Heiles, at escape": "H-H at escape",
    "Kepler, e = 0.6": "Kepler",
}
FIGURES = (
    *(limits.draw, encounters.draw_kepler, maps.draw_stiffness, round_off.draw, maps.draw_solvers, push.draw),
    *(maps.draw_resonances, maps.draw_regions),
)


def reach(rows: pd.DataFrame) -> pd.Series:
    """The largest eccentricity up to which an integrator's error on Kepler's orbits is small; 0 if none, by method."""
    ordered = rows.sort_values("e")
    held = ordered["held"].astype(bool).groupby(ordered["method"]).cummin()
    return ordered["e"].where(held, 0.0).groupby(ordered["method"]).max().reindex(rows["method"].unique())


def kind(method: str, measured: str) -> str:
    """The kind of an integrator's steps: "Kepler-solving" if they solve Kepler's problem, else as measured."""
    family = BY_ID[method].family if method in BY_ID else ""
    return "Kepler-solving" if family in ("wisdom_holman", "fcirk") or method in KEPLERIAN else measured


def _first_to_fail(rows: pd.DataFrame) -> str:
    kinds = {r.method: kind(r.method, r.kind) for r in rows.drop_duplicates("method").itertuples()}
    best = reach(rows).groupby(kinds, sort=False).max()
    return f"{best.idxmin()} steps: to e = {best.min():.10g}, error {encounters.HELD:g}"


def _text(values: pd.Series, endless: str, digits: int) -> str:
    """The first of the values as text, ``endless`` if it is infinite; "" if there is none."""
    return "".join(endless if np.isinf(x) else number(float(x), digits) for x in values.head(1).dropna())


@of(limits.LINEAR, push.TABLE, encounters.KEPLER, round_off.CHOSEN)
def _table(linear: pd.DataFrame, steps: pd.DataFrame, met: pd.DataFrame, grown: pd.DataFrame) -> Table:
    worst, out = reach(met), []
    for id in (*push.REPRESENTATIVE, *encounters.STEP_CHANGING):
        row = {"method": id, "limit of h ω": _text(linear.loc[linear["method"] == id, "limit"], "none", 5)}
        own = steps[steps["method"] == id]
        row |= {head: _text(own.loc[own["orbit"] == orbit, "largest h"], "any", 2) for orbit, head in SHOWN.items()}
        row["largest e"] = f"{worst[id]:.10g}" if id in worst else ""
        same = grown[(grown["label"] == BY_ID[id].label) & (grown["h"] == round_off.STEP)]
        row["round-off"] = "".join(same["energy exponent"].dropna().head(1).map("{:.2f}".format))
        fails = Counter(x for x in own["fails"] if isinstance(x, str) and x)
        out.append(row | {"how it fails": ", ".join(name for name, _ in fails.most_common(2))})
    caption = (
        f"How far each method goes: the stability limit of h ω; the largest h that survives {push.STEPS} steps on four "
        f"orbits (H-H: Hénon–Heiles); the largest e of Kepler's orbit held to {encounters.HELD:g} over "
        f"{encounters.ORBITS} periods (0: not even {encounters.ECCENTRICITIES[0]:g}; empty: not run); the power of n "
        f"in the energy's round-off at h = {round_off.STEP:.3g}; the commonest failures."
    )
    return Table(pd.DataFrame(out).head(ROWS), caption)


STUDY = Study(
    id="extremes",
    place=180,
    question="How far can a method be pushed before it fails?",
    answer="{known} known stability limits are met; {kepler} of {integrators} integrators hold Kepler's orbit at e = "
    "{e}; energy round-off grows at most diffusively in {energy} ensembles.",
    setting=(
        "Stability: H = (p² + ω² q²) / 2; a step is stable where the trace of its matrix says so, ends refined to ten "
        f"digits and confirmed by {limits.STEPS} steps beside them; methods whose step is not linear by long runs.",
        f"Largest step: a run survives {push.STEPS} steps if its energy error stays below the size of H's terms, the "
        f"orbit in its range and its clock right; h is bisected to a factor 2^(1/{push.PARTS}).",
        f"Close encounters: Kepler from pericentre, {encounters.ORBITS} periods, at most {encounters.LADDER[-1]} steps "
        "from an apside to the next.",
        f"Round-off: {round_off.STARTS} starts on the oscillator, against the exact step map in {round_off.DIGITS} "
        "digits, and on Kepler's orbit by an integrator that solves it; whether errors are bounded is [another "
        "page](drift.md).",
        f"Orbits: {'; '.join(push.CASES)}.",
    ),
    runs=(
        *push.RUNS,
        Runs(
            encounters.KEPLER, encounters.kepler,
            [{"method": id} for id in (*encounters.FIXED, *encounters.STEP_CHANGING, *encounters.OTHERS)],
            needs=lambda method: (encounters.needs(method), ProblemKey("kepler")),
        ),
        *maps.RUNS,
    ),
    claims={
        **limits.CLAIMS,
        "kepler": Claim(
            "Some integrators hold Kepler's orbit up to the largest eccentricity",
            encounters.KEPLER, lambda rows: (reach(rows) == rows["e"].max()).sum(), at_least(1),
            unit=lambda rows: f"of {rows['method'].nunique()} integrators", where=_first_to_fail,
        ),
        "energy": round_off.LAW,
    },
    numbers={
        "integrators": Number(encounters.KEPLER, lambda rows: rows["method"].nunique()),
        "e": Number(encounters.KEPLER, "e", digits=10),
    },
    checks={
        "adaptive": Claim(
            "Adaptive integrators of other packages hold Kepler's orbit up to a high eccentricity",
            encounters.KEPLER, "error", at_most(encounters.HELD),
            rows=f"kind == '{encounters.ADAPTIVE}' and e <= {HARD}",
        ),
    },
    figure=together(*FIGURES),
    shown=_table,
    whole=of(limits.LINEAR)(lambda linear: linear.drop(columns="method")),
    tables=(
        limits.LINEAR, limits.SCHEME_I, limits.KNOWN, push.TABLE, push.SWEPT, encounters.KEPLER, maps.STIFFNESS,
        round_off.CHOSEN, round_off.EVERY, round_off.CURVES, maps.SOLVERS, maps.RESONANCES, maps.REGIONS,
    ),
    limits=(
        "More on pages of their own: [known limits](extremes-limits.md), [three bodies and a zoom-whirl "
        "orbit](extremes-encounters.md), [step-size resonances](extremes-springs.md), [multistep "
        "methods](extremes-multistep.md), [round-off](extremes-round-off.md).",
        "A gap between stable steps in which the trace exceeds 2 by less than 1e-10 is not counted; beyond h ω = 10 "
        "intervals narrower than 0.25 may be missed.",
        "Survival is not monotone in h: the largest step is the end of the first interval that doublings of h find.",
        "A method that keeps the energy may still be on another orbit: on regular orbits a run fails too where a "
        f"coordinate leaves its range by more than {push.MARGIN:g} of it, or crosses its middle {push.OFF:g} times too "
        "often or too seldom; on chaotic ones the energy alone is judged.",
        f"A run that takes longer than {push.SECONDS:g} s counts as failed (timeout).",
        "Round-off is measured on a linear problem, the oscillator: on others it may be different.",
    ),
)  # fmt: skip
