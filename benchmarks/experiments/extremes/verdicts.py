"""The sentences of the page of extremes: functions of tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import encounters, meetings
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Verdict, of
from phasebench.integrators.registry import BY_ID

#: Peers whose steps solve Kepler's problem exactly.
KEPLERIAN = ("rebound-whfast", "rebound-mercurius", "rebound-trace")
#: A closed form is met to this.
SHARP = 1e-10


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
