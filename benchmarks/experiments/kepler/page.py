"""The Kepler comparison: four errors to 10^4 orbits, and error against cost, here and in the established integrators."""

from __future__ import annotations

from math import pi

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from . import figures as drawings
from .kepler import LONGEST, STANDARD

#: Phase errors, radians at the end, for which the cheapest is named.
PHASES = (1e-2, 1e-6, 1e-9)
#: A relative error of the energy or the angular momentum up to this counts as round-off.
ROUND_OFF = 1e-11
#: An exponent of growth within this of 1 is called linear.
NEAR = 0.15
#: Errors of the phase below this at the end, in radians, are of round-off.
PHASE_ROUND_OFF = 1e-7
#: A phase error larger than this many times what the energy error can do is a lost time.
CLOCK = 5.0
#: Times that differ by less than this factor are a tie.
TIE = 1.1
TITLES = {"kepler": "Kepler", "perturbed-kepler": "Kepler, Schwarzschild term"}
OWN = "phasebench"


def ends(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """The runs, without the reference's, with the errors at their ends beside them."""
    key = ["problem", "e", "method", "setting"]
    last = growth.sort_values("orbits").groupby(key, sort=False, as_index=False).last()
    joined = runs.merge(last[[*key, "energy", "momentum", "phase", "perihelion"]], on=key, how="left")
    return joined[joined["kind"] != "reference"]


def _finished(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    joined = ends(runs, growth)
    return joined[(joined["status"] == "ok") & joined["phase"].notna()]


def _who(row) -> str:
    steps = row["steps per orbit"]
    return f"{row['method']} ({'adaptive' if pd.isna(steps) else f'{int(steps)} steps'})"


def cheapest(finished: pd.DataFrame) -> pd.DataFrame:
    """Who follows the phase for the least time over the longest runs: a row for each orbit and accuracy."""
    lines = []
    for (name, e), members in finished.groupby(["problem", "e"], sort=False):
        members = members[(members["orbits"] == members["orbits"].max()) & members["us per orbit"].notna()]
        for wanted in PHASES:
            enough = members[members["phase"] <= wanted].sort_values("us per orbit")
            line = {"problem": TITLES.get(name, name), "e": e, "phase up to (rad)": wanted}
            for who, part in (("ours", enough["kind"] == OWN), ("peers", enough["kind"] != OWN)):
                best = enough[part].head(1)
                line[who] = "none" if best.empty else _who(best.iloc[0])
                line[f"{who}, µs an orbit"] = float("nan") if best.empty else best["us per orbit"].iloc[0]
            lines.append(line)
    return pd.DataFrame(lines)


@of("kepler", "kepler_growth")
def costs(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict | None:
    """Who is the cheaper, this project's methods or the peers."""
    lines = cheapest(_finished(runs, growth))
    if lines.empty:
        return None
    ours, peers = (lines[f"{who}, µs an orbit"].fillna(float("inf")) for who in ("ours", "peers"))
    neither = (ours == float("inf")) & (peers == float("inf"))
    wins, losses = (ours * TIE < peers) & ~neither, (peers * TIE < ours) & ~neither
    ties = len(lines) - int(wins.sum() + losses.sum() + neither.sum())
    text = (
        f"Following the phase over {runs['orbits'].max():.0f} orbits, of {len(lines)} pairs of an orbit and an accuracy: "
        f"the cheapest is one of this project's methods in {int(wins.sum())}, a peer in {int(losses.sum())}; {ties} {'is a tie' if ties == 1 else 'are ties'}"
    )
    short = f"Cheapest over 10⁴ orbits: ours {int(wins.sum())}, peers {int(losses.sum())}, ties {ties} of {len(lines)}."
    return Verdict(f"{text}.", bool(wins.sum() >= losses.sum()), short)


@of("kepler", "kepler_growth")
def laws(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict | None:
    """How the phase errors grow."""
    finished = _finished(runs, growth)
    if "phase growth" not in finished:
        return None
    truncated = finished[finished["phase growth"].notna() & (finished["phase"] > PHASE_ROUND_OFF)]
    if truncated.empty:
        return None
    straight = (truncated["phase growth"] - 1).abs() <= NEAR
    others = [
        f"{r['method']} at e = {r['e']:g} (t^{r['phase growth']:.2f})" for _, r in truncated[~straight].iterrows()
    ]
    text = f"Phase errors above {PHASE_ROUND_OFF:g} rad grow linearly in {int(straight.sum())} of {len(truncated)} runs"
    text += f"; else {listed(others, 3)}" if others else ""
    return Verdict(f"{text}.", bool(straight.mean() >= 0.9), "some phase errors do not grow linearly.")


@of("kepler", "kepler_growth")
def clocks(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict | None:
    """Phase errors of adaptive methods that are larger than their energy errors can make them."""
    finished = _finished(runs, growth)
    adaptive = finished[(finished["mu"] == 0) & (finished["setting"] == "adaptive")]
    # The frequency is (-2 H)^(3/2): an energy error within d turns the orbit by at most 3/2 d of its angle.
    most = 1.5 * adaptive["energy"] * 2 * pi * adaptive["orbits"]
    lost = adaptive[adaptive["phase"] > CLOCK * most]
    names = [f"{r['method']} at e = {r['e']:g} ({number(r['phase'])} rad)" for _, r in lost.iterrows()]
    runs = ends(runs, growth)
    stopped = int((~runs["status"].isin(["ok", "skipped"])).sum())
    if runs.empty:
        return None
    text = (
        f"{stopped} of {len(runs)} runs do not get through; a phase error beyond {CLOCK:g} times what the energy error "
        f"explains, a lost clock, has {listed(names, 3) if names else 'none of the adaptive runs without the term'}."
    )
    return Verdict(text, lost.empty, f"{listed(names, 1)} loses its clock.")


def draw(data, folder) -> list[Picture]:
    """The errors over the orbits, and the error against time on shared axes."""
    growth, cost = data("kepler_growth"), data("kepler_cost")
    pictures = []
    if growth is not None and len(growth):
        growth = growth[(growth["kind"] != "reference") & growth["group"].notna()]
    if growth is not None and len(growth):
        problem = "perturbed-kepler" if "perturbed-kepler" in set(growth["problem"]) else growth["problem"].iloc[0]
        rows = growth[(growth["problem"] == problem) & growth["setting"].isin([f"{STANDARD} steps", "adaptive"])]
        rows = rows[rows["group"] == ("high order" if "high order" in set(rows["group"]) else rows["group"].iloc[0])]
        file = drawings.errors(rows, list(dict.fromkeys(rows["method"])), folder, "kepler-errors.png")
        caption = (
            f"{TITLES.get(problem, problem)}: greatest errors so far over the orbits, methods of high order, {STANDARD} "
            "steps an orbit or adaptive."
        )
        pictures.append(Picture(file, "errors over the orbits", caption))
    if cost is not None and (cost["status"] == "ok").any():
        file, shown = drawings.work_precision(cost[cost["status"] == "ok"], folder)
        caption = (
            f"Error at the end after {cost['orbits'].max():g} orbits at e = {cost['e'].max():g} against warm seconds; "
            f"{shown} curves in all: of each side those that are cheapest somewhere. SciPy's right-hand side is Python."
        )
        pictures.append(Picture(file, "error against time", caption))
    return pictures


@of("kepler", "kepler_growth")
def table(runs: pd.DataFrame, growth: pd.DataFrame) -> Table | None:
    """Who follows the phase for the least time."""
    lines = cheapest(_finished(runs, growth))
    if lines.empty:
        return None
    caption = f"The cheapest that follow the phase over {runs['orbits'].max():.0f} orbits, ours and the peers'."
    return Table(lines.head(ROWS), caption)


@of("kepler", "kepler_growth")
def _whole(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    columns = [
        "problem",
        "e",
        "method",
        "setting",
        "us per orbit",
        "energy",
        "momentum",
        "phase",
        "perihelion",
        "status",
    ]
    return ends(runs, growth)[columns]


PAGE = Page(
    id="kepler",
    question="Over 10⁴ Kepler orbits, who keeps the phase, and for which time?",
    tables=("kepler", "kepler_growth", "kepler_cost"),
    setting=(
        "H = |p|²/2 − 1/|q| − μ/(3|q|³), with μ = 0 (Kepler) and with the Schwarzschild term; e = 0, 0.2, 0.6, 0.9.",
        "Errors are the greatest so far, at pericentres and apocentres: energy and angular momentum relative, "
        "phase (mean longitude) and perihelion against exact angles, linear in time, from elliptic integrals.",
        f"Fixed steps: {STANDARD} an orbit and finer, and as many as fit in the time of IAS15; adaptive: as they come.",
        "Times are warm and without output; heyoka and REBOUND are compiled.",
    ),
    verdicts=(costs, laws, clocks),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Times within a factor of {TIE} are a tie; round-off is a phase error up to {PHASE_ROUND_OFF:g} rad; linear means "
        f"an exponent within {NEAR} of 1.",
        "Without the term a Wisdom–Holman splitting is the exact flow: it says nothing of a problem with a perturbation.",
        f"Finer settings are left out where the whole run would take more than {LONGEST:g} s.",
    ),
    command="pytest benchmarks/experiments/kepler",
)
