"""How far a method can be pushed before it fails: the page that sums up the others, with maps of its own."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.page import Data
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import BY_ID

from . import encounters, figures, limits, maps, push, round_off

#: Peers whose steps solve Kepler's problem exactly.
KEPLERIAN = ("rebound-whfast", "rebound-mercurius", "rebound-trace")
#: Adaptive peers must keep the error small up to this eccentricity.
HARD = 0.999


def whole(data: Data) -> pd.DataFrame | None:
    """The stable intervals of h omega of every method."""
    linear = data(limits.LINEAR)
    return None if linear is None else linear.drop(columns=["method"])


def holding(rows: pd.DataFrame) -> float:
    """The number of integrators that hold Kepler's orbit at every eccentricity."""
    return float((figures.reach(rows) == rows["e"].max()).sum())


def kind(method: str, measured: str) -> str:
    """The kind of an integrator's steps: "Kepler-solving" if they solve Kepler's problem, else as measured."""
    family = BY_ID[method].family if method in BY_ID else ""
    return "Kepler-solving" if family in ("wisdom_holman", "fcirk") or method in KEPLERIAN else measured


def first_to_fail(rows: pd.DataFrame) -> str:
    """The kind of steps that fails first, and where."""
    kinds = {r.method: kind(r.method, r.kind) for r in rows.drop_duplicates("method").itertuples()}
    best = figures.reach(rows).groupby(kinds, sort=False).max()
    return f"{best.idxmin()} steps: to e = {best.min():.10g}, error {encounters.HELD:g}"


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
            [{"method": id} for id in (*encounters.FIXED, *encounters.step_changing_methods(), *encounters.OTHERS)],
            needs=lambda method: (*encounters.needs(method), ProblemKey("kepler")),
        ),
        *maps.RUNS,
    ),
    claims={
        **limits.CLAIMS,
        "kepler": Claim(
            "Some integrators hold Kepler's orbit up to the largest eccentricity",
            encounters.KEPLER, holding, at_least(1),
            unit=lambda rows: f"of {rows['method'].nunique()} integrators", where=first_to_fail,
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
    figure=figures.draw,
    shown=figures.table,
    whole=whole,
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
