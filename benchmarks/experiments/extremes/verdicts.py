"""The sentences of the page of extremes: functions of tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import brouwer, encounters, meetings
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes.brouwer_kepler import LABEL as KEPLER
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Verdict, of
from phasebench.integrators.registry import BY_ID

#: Peers whose steps solve Kepler's problem exactly.
KEPLERIAN = ("rebound-whfast", "rebound-mercurius", "rebound-trace")
#: A closed form is met to this.
SHARP = 1e-10
#: Brouwer's exponents, how far above them an interval may begin, and the energy error that is round-off's in its units.
ENERGY, PHASE, ABOVE, UNITS = 0.5, 1.5, 0.05, 10.0


@of("extremes_published", "extremes_scheme_i", "extremes_linear")
def limits(known: pd.DataFrame, sweep: pd.DataFrame, linear: pd.DataFrame) -> Verdict:
    """Whether stability limits are those that are known, and long runs agree with the step maps."""
    wrong = [r.method for r in known[~known["agrees"].astype(bool)].itertuples()]
    finite = sweep[np.isfinite(sweep["closed form"])]
    off = float((finite["limit"] / finite["closed form"] - 1).abs().max())
    mapped = linear[linear["runs"].fillna(0) > 0]
    right, runs = int(mapped["confirmed"].sum()), int(mapped["runs"].sum())
    astray = list(mapped[mapped["confirmed"] < mapped["runs"]]["label"])
    said = f"{len(known) - len(wrong)} of {len(known)} known stability limits are met to the digits that are given"
    how = " and ".join(f"{int(known['evidence'].str.contains(word).sum())} {word}" for word in ("derived", "printed"))
    text = (
        f"{said}{f' (not {listed(wrong, 3)})' if wrong else ''}, {how}; Scheme I's closed form for {len(sweep)} values "
        f"of lambda to {number(off, 2)}; {right} of {runs} long runs stay or grow as the step maps of {len(mapped)} "
        f"methods say{f' (not of {listed(astray, 3)})' if astray else ''}."
    )
    return Verdict(text, not wrong and off < SHARP and right == runs, f"{said}.")


def reach(table: pd.DataFrame) -> pd.Series:
    """Integrator -> the largest eccentricity up to which it holds at every one; 0 where it holds at none."""
    out = {}
    for method, rows in table.groupby("method", sort=False):
        rows = rows.sort_values("e")
        held = rows["held"].astype(bool)
        out[method] = float(rows["e"][held.cummin()].max()) if held.iloc[0] else 0.0
    return pd.Series(out, dtype=float)


def kind(method: str, measured: str) -> str:
    """The kind of an integrator's steps: as it was measured, but apart where it solves Kepler's problem exactly."""
    family = BY_ID[method].family if method in BY_ID else ""
    return "Kepler-solving" if family == "wisdom_holman" or method in KEPLERIAN else measured


@of("extremes_encounters")
def close(table: pd.DataFrame) -> Verdict:
    """How far steps of each kind go into a close encounter."""
    worst, first = reach(table), table.drop_duplicates("method")
    kinds = pd.Series({r.method: kind(r.method, r.kind) for r in first.itertuples()})
    last = float(table["e"].max())
    parts = []
    for each in dict.fromkeys(kinds):
        found = worst[kinds[worst.index] == each]
        best = found[found == found.max()]
        names = listed(list(best.index), 3) if best.iloc[0] > 0 else "none"
        parts.append(f"{each} steps reach e = {best.iloc[0]:.10g} ({names})")
    all_the_way = list(worst[worst == last].index)
    said = f"{len(all_the_way)} of {len(worst)} integrators hold {number(encounters.HELD)} at e = {last:.10g}"
    asked = f"Over {encounters.ORBITS} Kepler orbits with a relative error of {number(encounters.HELD)}"
    text = f"{asked}, {'; '.join(parts)}; {said}."
    return Verdict(text, bool(all_the_way), f"{said}.")


@of("extremes_meetings")
def met(table: pd.DataFrame) -> Verdict:
    """Which kind of steps holds three bodies and a zoom-whirl orbit, and in how many steps."""
    best, parts, lost = meetings.cheapest(table), [], []
    for scene, rows in best.groupby("scene", sort=False):
        said = []
        for each, of_kind in rows.groupby("kind", sort=False):
            held = of_kind[of_kind["held"]]
            if held.empty:
                lost.append(f"{each} steps in {scene}")
                least = of_kind["error"].min()
                said.append(f"{each} steps do not ({'all lost' if np.isinf(least) else f'least {number(least, 2)}'})")
            else:
                first = held.loc[held["steps"].idxmin()]
                said.append(f"{each} steps do in {int(first['steps'])} ({first['method']})")
        parts.append(f"{scene}: {', '.join(said)}")
    text = f"With an error of {number(encounters.HELD)} at the end, {'; '.join(parts)}."
    adaptive = best[best["kind"] == "adaptive"]
    short = f"Not held: {listed(lost, 3)}." if lost else "Every kind of steps holds."
    return Verdict(text, bool(adaptive["held"].all()), short)


@of("extremes_growth")
def brouwers_law(table: pd.DataFrame) -> Verdict | None:
    """Whether round-off grows as Brouwer's law has it, and plain sums do not stay as small."""
    fitted = table[table["energy exponent"].notna()]
    ours, control = fitted[fitted["kind"].isin(brouwer.UNBIASED)], fitted[fitted["label"] == brouwer.CONTROL]
    if ours.empty or control.empty:
        return None
    fast, late = ours[_faster(ours)], ours[ours["phase low"] > PHASE + ABOVE]
    long = table[table["energy exponent"].isna()]
    large = pd.concat([ours, long])["in units"] > UNITS
    caught = bool((control["in units"] > UNITS).all())
    text = (
        f"Brouwer's law: in {len(ours) - len(fast)} of {len(ours)} ensembles the energy's round-off grows no faster "
        f"than n^{ENERGY:g} (fastest {_named(ours.loc[ours['energy exponent'].idxmax()])}), in "
        f"{len(ours) - len(late)} the phase's than n^{PHASE:g}; the energy's is at most "
        f"{number(ours['in units'].max())} eps h n^(1/2) after {number(float(ours['steps'].max()))} steps"
    )
    if len(long):
        text += f", {number(long['in units'].max())} after {number(float(long['steps'].max()))}"
    for _, row in ours[ours["label"] == KEPLER].iterrows():
        exponents = f"n^{row['energy exponent']:.2f} and n^{row['phase exponent']:.2f}"
        text += f"; {KEPLER}, where the frequency depends on the energy, has {exponents}"
    text += f"; plain sums, the control, have {number(control['in units'].max())}"
    text += "." if caught else ": not told apart."
    holds = fast.empty and late.empty and not large.any() and caught
    said = f"Round-off grows by Brouwer's law in {len(ours) - len(fast)} of {len(ours)} ensembles."
    return Verdict(text, holds, said)


@of("extremes_growth_every")
def every_method(table: pd.DataFrame) -> Verdict | None:
    """Of how many of our methods round-off grows no faster than Brouwer's law has it, and which have no ensemble."""
    reasons = table["reason"].astype(object).fillna("")
    run, left = table[reasons == ""], table[reasons != ""]
    if run.empty:
        return None
    fitted = run[run["energy exponent"].notna()]
    fast, late = fitted[_faster(fitted)], fitted[fitted["phase low"] > PHASE + ABOVE]
    large = run[run["in units"] > UNITS]
    told, worst = int(run["phase exponent"].notna().sum()), run.loc[run["in units"].idxmax()]
    said = f"{len(run) - len(fast)} of {len(run)} methods at h = {run['h'].iloc[0]:.3g}"
    whose = f"Every symplectic or energy-preserving method, {int(run['starts'].min())} starts"
    phase = f"the phase's than n^{PHASE:g} in {told - len(late)} of {told}{_but(late)}"
    text = (
        f"{whose}: the energy's round-off grows no faster than n^{ENERGY:g} in {said}{_but(fast)}, {phase}; in units "
        f"of eps h n^(1/2) the energy's is at most {number(worst['in units'])} ({worst['label']})"
    )
    if len(left):
        text += f"; {len(left)} have none here: {listed(list(left['label']), 4)}"
    return Verdict(f"{text}.", fast.empty and late.empty and large.empty, f"Round-off grows by the law in {said}.")


def _but(rows: pd.DataFrame) -> str:
    return f" (not {listed(list(rows['label']), 6)})" if len(rows) else ""


def _faster(rows: pd.DataFrame) -> pd.Series:
    return rows["energy low"] > ENERGY + ABOVE


def _named(row) -> str:
    return f"{row['label']} at h = {row['h']:g}, n^{row['energy exponent']:.2f}"


@of("extremes_growth")
def small_denominators(table: pd.DataFrame) -> Verdict | None:
    """Whether the drift next to fractions of small denominators is there, and is what it is said to be.

    It must go where the fraction is left by a little, stay where products alone are exact, and go where velocity and
    force see the whole state.
    """
    parts = {kind: table[table["kind"] == kind] for kind in (brouwer.FRACTION, brouwer.ASIDE_OF)}
    parts |= {label: table[table["label"] == label] for label in (controls.HALF, controls.WHOLE)}
    if any(rows.empty for rows in parts.values()):
        return None
    drifting = {kind: rows[_faster(rows)] for kind, rows in parts.items()}
    fractions, beside = drifting[brouwer.FRACTION], drifting[brouwer.ASIDE_OF]
    asked, near = parts[brouwer.FRACTION], parts[brouwer.ASIDE_OF]
    product, whole = (drifting[label] for label in (controls.HALF, controls.WHOLE))
    explained = beside.empty and whole.empty and not product.empty
    text = f"Next to a fraction of a small denominator the energy drifts in {len(fractions)} of {len(asked)} ensembles"
    if len(fractions):
        text += f" ({listed([_named(row) for _, row in fractions.iterrows()], 4)})"
    text += (
        f", a little beside it in {len(beside)} of {len(near)}; with exact products Stormer-Verlet "
        f"{'still drifts' if len(product) else 'does not drift'}, and where velocity and force see the lost part of "
        f"the state too it {'still does' if len(whole) else 'does not'}: "
    )
    text += "the bias is of the rounded state's few residues" if explained else "the drift is not explained"
    said = f"Steps such as {brouwer.DECIMAL:g} drift by the state's rounding{'' if explained else ', or so it seems'}."
    return Verdict(f"{text}.", fractions.empty, said)
