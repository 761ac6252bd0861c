"""The Kepler comparison: four errors to 10^4 orbits, and error against cost, here and in the established integrators."""

from __future__ import annotations

from math import pi

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import NONE, OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from . import figures as drawings
from .comparison import DEAR, DRAWN, LADDER, LONGEST, SPREAD
from .runs import STANDARD
from .times import TABLE as TIMES

#: Phase errors, radians at the end, for which the cheapest is named.
PHASES = (1e-2, 1e-6, 1e-9)
#: An exponent of growth within this of 1 is called linear.
NEAR = 0.15
#: Errors of the phase below this at the end, in radians, are of round-off.
PHASE_ROUND_OFF = 1e-7
#: A phase error larger than this many times what the energy error can do is a lost time.
CLOCK = 5.0
#: The error of the end state over 100.5 orbits to which the settings of a peer are compared, and which they are.
TRIED_TO = 1e-8
TRIED = {"heyoka": "heyoka", "IAS15": "rebound-ias15"}
TITLES = {"kepler": "Kepler", "perturbed-kepler": "Kepler, Schwarzschild term"}
OWN = "phasebench"
KEY = ["problem", "e", "method", "setting"]


def ends(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """The runs, without the reference's, with the errors at their ends beside them."""
    last = growth.sort_values("orbits").groupby(KEY, sort=False, as_index=False).last()
    joined = runs.merge(last[[*KEY, "energy", "momentum", "phase", "perihelion"]], on=KEY, how="left")
    return joined[joined["kind"] != "reference"]


def _finished(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    joined = ends(runs, growth)
    return joined[(joined["status"] == "ok") & joined["phase"].notna()]


def _who(row) -> str:
    return row["method"] if row["setting"] == "adaptive" else f"{row['method']} ({row['setting']})"


def _paid(members: pd.DataFrame, wanted: float) -> tuple[pd.Series | None, Median]:
    """The cheapest whose median phase error is at most so much, and what following the phase so well costs.

    The interval reaches from the least that it may cost, where the median lies at the lower end of its interval, to what
    it costs at most, where it lies at the upper end.
    """
    cost = members["us per orbit"]
    reached = {c: members[members[f"phase{c}"] <= wanted] for c in (" median", ", low", ", high")}
    least, best, most = (
        float(part[of].min()) if len(part) else float("inf")
        for part, of in zip((reached[", low"], reached[" median"], reached[", high"]), COSTS, strict=True)
    )
    chosen = None if np.isinf(best) else members.loc[cost[reached[" median"].index].idxmin()]
    return chosen, Median(best, least, most)


COSTS = ("us, low", "us per orbit", "us, high")


def cheapest(runs: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """Who follows the phase for the least time over the longest runs: a row for each orbit and accuracy."""
    ran = runs[(runs["status"] == "ok") & (runs["kind"] != "reference")].merge(times, on=KEY).dropna(subset=[*COSTS])
    lines = []
    for (name, e), members in ran.groupby(["problem", "e"], sort=False):
        members = members[members["orbits"] == members["orbits"].max()]
        for wanted in PHASES:
            line, paid = {"problem": TITLES.get(name, name), "e": e, "phase up to (rad)": f"{wanted:.0e}"}, {}
            for who, part in ((OURS, members["kind"] == OWN), (PEERS, members["kind"] != OWN)):
                best, paid[who] = _paid(members[part], wanted)
                line[who] = "none" if best is None else _who(best)
                line[f"{who}, µs an orbit"] = float("nan") if best is None else paid[who].value
            lines.append(line | {"cheaper": cheaper(paid[OURS], paid[PEERS])})
    return pd.DataFrame(lines)


@of("kepler", TIMES)
def costs(runs: pd.DataFrame, times: pd.DataFrame) -> Verdict | None:
    """Who is the cheaper, this project's methods or the peers."""
    lines = cheapest(runs, times)
    if lines.empty:
        return None
    wins, losses, ties, none = (int((lines["cheaper"] == who).sum()) for who in (OURS, PEERS, TIED, NONE))
    text = (
        f"Following the phase over {runs['orbits'].max():.0f} orbits, of {len(lines)} pairs of an orbit and an accuracy: "
        f"the cheapest is one of this project's methods in {wins}, a peer in {losses}; "
        f"{ties} {'is a tie' if ties == 1 else 'are ties'}{f', {none} reached by none' if none else ''}"
    )
    short = (
        f"Cheapest over {runs['orbits'].max():.0f} orbits: ours {wins}, peers {losses}, ties {ties} of {len(lines)}."
    )
    return Verdict(f"{text}.", wins >= losses, short)


@of("kepler", "kepler_growth")
def laws(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict | None:
    """How the phase errors grow."""
    finished = _finished(runs, growth)
    if "phase growth" not in finished:
        return None
    asked = ~finished["setting"].str.startswith("tolerance")  # a tolerance that is looser than a peer's own drifts
    truncated = finished[asked & finished["phase growth"].notna() & (finished["phase"] > PHASE_ROUND_OFF)]
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


def tried(cost: pd.DataFrame) -> str:
    """What each setting of heyoka and IAS15 takes to an error beside the best of them, over the problems."""
    enough = cost[(cost["status"] == "ok") & (cost["error"] <= TRIED_TO)]
    seconds = enough.groupby(["problem", "method"], sort=False)["seconds"].min().unstack("problem")
    parts = []
    for name, stem in TRIED.items():
        members = seconds[[m.startswith(stem) and "batch" not in m for m in seconds.index]]
        times_as_long = (members / members.min()).max(axis=1).sort_values()
        told = ", ".join(f"{m.removeprefix('rebound-')} {number(x, 2)}" for m, x in times_as_long.items())
        parts += [f"{name}: {told}"] if told else []
    if not parts:
        return ""
    return f"Settings tried, their time to {TRIED_TO:g} over the best one's (the worse problem): {'; '.join(parts)}."


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
            f"{shown} curves in all: of each side those that are cheapest somewhere. {tried(cost)}"
        )
        pictures.append(Picture(file, "error against time", caption))
    return pictures


@of("kepler", TIMES)
def table(runs: pd.DataFrame, times: pd.DataFrame) -> Table | None:
    """Who follows the phase for the least time."""
    lines = cheapest(runs, times)
    if lines.empty:
        return None
    caption = (
        f"The cheapest that follow the phase over {runs['orbits'].max():.0f} orbits, ours and the peers', in the median of "
        "starts an ulp apart. A side is the cheaper where this holds at either end of the intervals of its phase error and "
        "of its time; else it is a tie."
    )
    return Table(lines.head(ROWS), caption)


@of("kepler", "kepler_growth")
def _whole(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    columns = ["energy", "momentum", "phase", "phase median", "starts", "perihelion", "status"]
    return ends(runs, growth).reindex(columns=[*KEY, *columns])


PAGE = Page(
    id="kepler",
    question="Over 10⁴ Kepler orbits, who keeps the phase, and for which time?",
    tables=("kepler", "kepler_growth", TIMES, "kepler_cost"),
    setting=(
        "H = |p|²/2 − 1/|q| − μ/(3|q|³), with μ = 0 (Kepler) and with the Schwarzschild term; e = 0, 0.2, 0.6, 0.9.",
        "Errors are the greatest so far, at pericentres and apocentres: energy and angular momentum relative, "
        "phase (mean longitude) and perihelion against exact angles, linear in time, from elliptic integrals.",
        f"Fixed steps: {LADDER[0]} to {LADDER[-1]} an orbit; adaptive peers at their own tolerance, heyoka (with "
        "high_accuracy and without) and IAS15 at looser ones too.",
        "Where round-off may decide, a phase error is the median of nine starts whose coordinates are an ulp less, the same "
        "or an ulp more, with its 95 % interval.",
        "Times are warm and without output, all settings of all in turns, medians of nine rounds with 95 % intervals; "
        "heyoka and REBOUND are compiled, and so is SciPy's right-hand side.",
    ),
    verdicts=(costs, laws, clocks),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Linear means an exponent within {NEAR} of 1; phase errors up to {PHASE_ROUND_OFF:g} rad are not asked for it, nor "
        "are peers at a tolerance looser than their own.",
        f"Phase errors from {DRAWN[0]:g} to {DRAWN[1]:g} are drawn again; those of runs of more than {DEAR:g} s are taken to "
        f"be known within a factor of {SPREAD:g}.",
        "Without the term a Wisdom–Holman splitting is the exact flow: it says nothing of a problem with a perturbation.",
        f"Finer steps are left out where the whole run would take more than {LONGEST:g} s, SciPy over 10⁴ orbits altogether; "
        "a step between two of the ladder might just do.",
    ),
    command="pytest benchmarks/experiments/kepler",
)
