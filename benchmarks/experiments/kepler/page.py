"""The report page on Kepler orbits: errors over 10^4 orbits, and error against cost, of our methods and of peers.

Peers are the integrators of other packages.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import NONE, Count, Verdict, at_least

from . import figures as drawings
from .comparison import DEAR, DRAWN, LADDER, LONGEST, SPREAD
from .runs import STANDARD
from .times import TABLE as TIMES

if TYPE_CHECKING:
    from pathlib import Path

    from phasebench.benchmarks.page.page import Data

#: Phase errors at the end, in radians, for which the cheapest integrators are listed.
PHASES = (1e-2, 1e-6, 1e-9)
#: Wanted share of our wins, among the cases that are no tie.
HALF = 0.5
#: An exponent of growth within NEAR of 1 counts as linear; LINEAR is the wanted share of such runs.
NEAR, LINEAR = 0.15, 0.9
#: Phase errors below this at the end, in radians, count as round-off.
PHASE_ROUND_OFF = 1e-7
#: A phase error above this many times the largest that the energy error explains is an error of the time.
CLOCK = 5.0
#: The error of the end state over 100.5 orbits at which settings of peers are compared, and these peers.
TRIED_TO = 1e-8
TRIED = {"heyoka": "heyoka", "IAS15": "rebound-ias15"}
TITLES = {"kepler": "Kepler", "perturbed-kepler": "Kepler, Schwarzschild term"}
OWN = "phasebench"
KEY = ["problem", "e", "method", "setting"]


def ends(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """Join each run, except those of the reference, with its errors at the end.

    ``runs`` and ``growth`` are the tables "kepler" (one row a run) and "kepler_growth" (errors on the way).
    """
    last = growth.sort_values("orbits").groupby(KEY, sort=False, as_index=False).last()
    joined = runs.merge(last[[*KEY, "energy", "momentum", "phase", "perihelion"]], on=KEY, how="left")
    return joined[joined["kind"] != "reference"]


def _completed_runs(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """Select the runs that reached their end and have a phase error, each joined with its errors at the end.

    ``runs`` and ``growth`` are as in `ends`.
    """
    joined = ends(runs, growth)
    return joined[(joined["status"] == "ok") & joined["phase"].notna()]


def _who(row: pd.Series) -> str:
    """Format an integrator with its setting (steps or tolerance) as text; ``row`` is a row of a run."""
    return row["method"] if row["setting"] == "adaptive" else f"{row['method']} ({row['setting']})"


def _paid(members: pd.DataFrame, wanted: float) -> tuple[pd.Series | None, Median]:
    """Return the cheapest run with a median phase error of at most ``wanted``, and the cost of that accuracy.

    The run is a row of ``members`` (runs with their times), None if none is so accurate.  The cost is in µs an orbit;
    its interval reaches from the lowest possible (phase errors and times at the lower ends of their intervals) to the
    highest (both at the upper ends).
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
    """Find, for each orbit and phase error, the cheapest integrator of ours and of the peers, among the longest runs.

    ``runs`` and ``times`` are the tables of runs and of times.  The column "cheaper" says which of the two is cheaper,
    or that they tie.
    """
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
    """Judge whether our methods are the cheapest at given phase errors as often as those of other packages, or more.

    ``runs`` and ``times`` are the tables of runs and of times; None without timed runs.
    """
    lines = cheapest(runs, times)
    if lines.empty:
        return None
    ours, peers = (int((lines["cheaper"] == who).sum()) for who in (OURS, PEERS))
    lost = [
        f"{r['problem']} e = {r['e']:g} to {r['phase up to (rad)']} rad"
        for _, r in lines[lines["cheaper"] == PEERS].iterrows()
    ]
    return Verdict(
        "This project's methods follow the phase at the least cost as often as peers",
        Count(ours, ours + peers),
        at_least(HALF),
        "cases that one side wins",
        where=join_list(lost, 2) if lost else "",
    )


@of("kepler", "kepler_growth")
def laws(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict | None:
    """Judge whether phase errors above round-off grow linearly with time.

    ``runs`` and ``growth`` are as in `ends`; runs at a tolerance other than the integrator's default are left out.
    None if no run has a phase error above round-off.
    """
    finished = _completed_runs(runs, growth)
    if "phase growth" not in finished:
        return None
    asked = ~finished["setting"].str.startswith("tolerance")  # a tolerance that is looser than a peer's own drifts
    truncated = finished[asked & finished["phase growth"].notna() & (finished["phase"] > PHASE_ROUND_OFF)]
    if truncated.empty:
        return None
    off = (truncated["phase growth"] - 1).abs()
    worst = truncated.loc[off.idxmax()]
    return Verdict(
        "Phase errors above round-off grow linearly with time",
        Count(int((off <= NEAR).sum()), len(truncated)),
        at_least(LINEAR),
        "runs",
        where=f"{_who(worst)}, e = {worst['e']:g}: t^{worst['phase growth']:.2f}",
    )


@of("kepler", "kepler_growth")
def clocks(runs: pd.DataFrame, growth: pd.DataFrame) -> Verdict:
    """Judge whether no adaptive method has, on pure Kepler orbits, a phase error larger than its energy error explains.

    An error of the energy changes the frequency; a larger phase error means that the integrator's time is wrong.
    ``runs`` and ``growth`` are as in `ends`.
    """
    finished = _completed_runs(runs, growth)
    adaptive = finished[(finished["mu"] == 0) & (finished["setting"] == "adaptive")]
    # The frequency is (-2 H)^(3/2): a relative energy error d changes the angle by at most 3/2 d of it.
    most = 1.5 * adaptive["energy"] * 2 * pi * adaptive["orbits"]
    unexplained = adaptive[adaptive["phase"] > CLOCK * most]
    lost = [f"{r['method']}, e = {r['e']:g}: {number(r['phase'])} rad" for _, r in unexplained.iterrows()]
    return Verdict(
        "No adaptive method has a phase error that its energy error does not explain",
        Count(len(lost), len(adaptive)),
        NONE,
        "runs on pure Kepler orbits",
        where=join_list(lost, 3) if lost else "",
    )


@of("kepler", TIMES)
def answer(runs: pd.DataFrame, times: pd.DataFrame) -> str | None:
    """Write the page's answer, a sentence: how often ours or the peers are cheapest, and what following an orbit costs.

    None without timed runs.
    """
    lines = cheapest(runs, times)
    if lines.empty:
        return None
    ours, peers, tied = (int((lines["cheaper"] == who).sum()) for who in (OURS, PEERS, TIED))
    least = lines[[f"{side}, µs an orbit" for side in (OURS, PEERS)]].min(axis=1)
    return (
        f"Over {runs['orbits'].max():.0f} orbits following the phase costs {number(least.min())} to "
        f"{number(least.max())} µs an orbit; phasebench is cheapest in {ours} of {len(lines)} cases (orbit, error), "
        f"heyoka or REBOUND in {peers}; {tied} tie."
    )


def settings_tried(cost: pd.DataFrame) -> dict[str, pd.Series]:
    """Compare the times of the settings that were tried for heyoka and IAS15: integrator's name -> series by setting.

    A value is the least time with an end error of at most `TRIED_TO`, over that of the integrator's fastest setting; of
    the two problems, the larger ratio counts.  ``cost`` is the table "kepler_cost".
    """
    enough = cost[(cost["status"] == "ok") & (cost["error"] <= TRIED_TO)]
    seconds = enough.groupby(["problem", "method"], sort=False)["seconds"].min().unstack("problem")
    found = {}
    for name, stem in TRIED.items():
        members = seconds[[m.startswith(stem) and "batch" not in m for m in seconds.index]]
        if len(members):
            found[name] = (members / members.min()).max(axis=1).sort_values()
    return found


def _settings_sentence(cost: pd.DataFrame) -> str:
    """Write a sentence for the caption: which settings of heyoka and IAS15 were tried, and their relative times."""
    parts = []
    for name, ratios in settings_tried(cost).items():
        settings = (f"{method.removeprefix('rebound-')} {number(x, 2)}" for method, x in ratios.items())
        parts.append(f"{name}: {', '.join(settings)}")
    if not parts:
        return ""
    return f" Settings of peers, their time to {TRIED_TO:g} over the best one's: {'; '.join(parts)}."


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw two figures: the errors over the orbits, and the error against time for our methods and other packages.

    ``data`` maps a table's name to the table; a figure whose table is missing is left out.
    """
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
            f"{TITLES.get(problem, problem)}: the greatest error so far over the number of orbits; methods of high "
            f"order at {STANDARD} steps an orbit, or adaptive."
        )
        pictures.append(Picture(file, "errors over the orbits", caption))
    if cost is not None and (cost["status"] == "ok").any():
        file, shown = drawings.work_precision(cost[cost["status"] == "ok"], folder)
        caption = (
            f"Error of the state after {cost['orbits'].max():g} orbits at e = {cost['e'].max():g} over the seconds "
            f"of a warm run; {shown} methods: the fastest of each side, and two usual ones.{_settings_sentence(cost)}"
        )
        pictures.append(Picture(file, "error against time", caption))
    return pictures


@of("kepler", TIMES)
def table(runs: pd.DataFrame, times: pd.DataFrame) -> Table | None:
    """Make the page's table: for each orbit and phase error, the cheapest integrator of ours and of the peers.

    None without timed runs.
    """
    lines = cheapest(runs, times)
    if lines.empty:
        return None
    ran = runs[runs["kind"] != "reference"]
    stopped = int((~ran["status"].isin(["ok", "skipped"])).sum())
    caption = (
        f"The cheapest of ours and of the peers that follow the phase over {runs['orbits'].max():.0f} orbits, in the "
        "median of starts an ulp apart. A side is the cheaper if it is so at both ends of the intervals of phase "
        f"error and time; else it is a tie. {stopped} of {len(ran)} runs end with another status than ok."
    )
    return Table(lines.head(ROWS), caption)


@of("kepler", "kepler_growth")
def _full_table(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """Make the page's longer table: the errors at the end of every run except those of the reference."""
    columns = ["energy", "momentum", "phase", "phase median", "starts", "perihelion", "status"]
    return ends(runs, growth).reindex(columns=[*KEY, *columns])


PAGE = Page(
    id="kepler",
    question="Over 10⁴ Kepler orbits, who keeps the phase, and for which time?",
    tables=("kepler", "kepler_growth", TIMES, "kepler_cost"),
    setting=(
        "H = |p|²/2 − 1/|q| − μ/(3|q|³), with μ = 0 (Kepler) and with the Schwarzschild term; e = 0, 0.2, 0.6, 0.9.",
        "Errors are the greatest so far, at pericentres and apocentres: energy and angular momentum relative; phase "
        "(mean longitude) and perihelion against exact angles, linear in time, from elliptic integrals.",
        f"Fixed steps: {LADDER[0]} to {LADDER[-1]} an orbit. Adaptive peers at their own tolerance; heyoka (with "
        "high_accuracy and without) and IAS15 also at looser ones.",
        "Where round-off may decide, a phase error is the median of nine starts whose coordinates are an ulp less, "
        "the same or an ulp more, with its 95 % interval.",
        "Times are warm, without output, all integrators in turns, medians of nine rounds with 95 % intervals. heyoka, "
        "REBOUND and SciPy's right-hand side are compiled.",
    ),
    verdicts=(costs, laws, clocks),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"Linear means an exponent within {NEAR} of 1, wanted of {100 * LINEAR:g} % of the runs; phase errors up to "
        f"{PHASE_ROUND_OFF:g} rad, and peers at a tolerance looser than their own, are not judged.",
        f"A phase error is unexplained above {CLOCK:g} times what the energy error can do: the integrator's time is "
        "wrong.",
        f"Starts an ulp apart are run for phase errors from {DRAWN[0]:g} to {DRAWN[1]:g} rad; runs of more than "
        f"{DEAR:g} s are made once, and their phase errors taken to be known within a factor {SPREAD:g}.",
        "Without the Schwarzschild term a Wisdom–Holman splitting is the exact flow: this says nothing of a perturbed "
        "problem.",
        f"Steps at which a run would take more than {LONGEST:g} s are left out, and so is SciPy over 10⁴ orbits; a "
        "step between two that were tried might be cheaper.",
    ),
    command="pytest benchmarks/experiments/kepler",
)
