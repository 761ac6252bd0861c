"""Kepler orbits with and without the Schwarzschild term: who keeps the phase over 10^4 of them, and for which time."""

from __future__ import annotations

from math import inf, nan, pi

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, together, worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.page.verdict import NONE, at_least, at_most
from phasebench.benchmarks.store.cells import ALONE, ProblemKey
from phasebench.integrators.driver import OK

from . import runs as measure
from .runs import COST, GROWTH, LONG, MEMBERS, PRICED, PROBLEMS, STANDARD

TIMES, OWN, KEY = "kepler_times", "phasebench", ["problem", "e", "method", "setting"]
#: Phase errors at the end, in radians, for which the cheapest integrators are listed.
PHASES = (1e-2, 1e-6, 1e-9)
#: An exponent of growth within NEAR of 1 counts as linear; LINEAR is the wanted share of such runs.
NEAR, LINEAR = 0.15, 0.9
#: Phase errors below this at the end, in radians, count as round-off.
PHASE_ROUND_OFF = 1e-7
#: A phase error above this many times the largest that the energy error explains is an error of the time.
CLOCK = 5.0
#: The error of the end state over 100.5 orbits at which settings of peers are compared, and these peers.
TRIED_TO, TRIED = 1e-8, {"heyoka": "heyoka", "IAS15": "rebound-ias15"}
#: Largest difference in radians between closed form and Taylor series; the error that the best integrator must reach.
AWAY, BEST = 1e-9, 1e-6
TITLES = {"kepler": "Kepler", "perturbed-kepler": "Kepler, Schwarzschild term"}
#: Runs with a phase error above round-off, without those at a tolerance looser than a peer's own.
SETTLED = (
    f"status == '{OK}' and phase > {PHASE_ROUND_OFF} and `phase growth` == `phase growth` "
    "and not setting.str.startswith('tolerance')"
)
#: The time of the integrator is wrong: its frequency is (-2 H)^(3/2), so that a relative energy error d changes the
#: angle by at most 3/2 d of it.
UNEXPLAINED = f"phase > {CLOCK * 1.5} * energy * 2 * {pi} * orbits"
#: Errors below this are drawn at it.
FLOOR = 1e-16
#: What is shown of a run at its end.
ENDS = ["energy", "momentum", "phase", "phase median", "starts", "perihelion", "status"]
QUANTITIES = {"energy": "energy", "momentum": "ang. momentum", "phase": "phase (rad)", "perihelion": "perihelion (rad)"}


def _who(rows: pd.DataFrame) -> pd.Series:
    return rows["method"].where(rows["setting"] == "adaptive", rows["method"] + " (" + rows["setting"] + ")")


@of(LONG, GROWTH)
def ends(runs: pd.DataFrame, growth: pd.DataFrame) -> pd.DataFrame:
    """Every run, except those of the reference, with its errors at the end."""
    last = growth.sort_values("orbits").groupby(KEY, sort=False, as_index=False).last()
    runs = runs[runs["kind"] != "reference"].merge(last[[*KEY, *QUANTITIES]], on=KEY, how="left")
    return runs.assign(who=_who(runs))


@of(LONG, TIMES)
def cases(runs: pd.DataFrame, times: pd.DataFrame) -> pd.DataFrame:
    """The cheapest of this project and of peers for each orbit and phase error, among the longest runs."""
    costs = ["us, low", "us per orbit", "us, high"]
    ran = runs[(runs["status"] == OK) & (runs["kind"] != "reference")].merge(times, on=KEY).dropna(subset=costs)
    lines = []
    for (name, e), members in ran.assign(who=_who(ran)).groupby(["problem", "e"], sort=False):
        members = members[members["orbits"] == members["orbits"].max()]
        for wanted in PHASES:
            line, paid = {"problem": TITLES.get(name, name), "e": e, "phase up to (rad)": f"{wanted:.0e}"}, {}
            for side, part in ((OURS, members["kind"] == OWN), (PEERS, members["kind"] != OWN)):
                line[side], paid[side] = _cheapest(members[part], wanted)
                line[f"{side}, µs an orbit"] = paid[side].value if paid[side].value < inf else nan
            lines.append(line | {"cheaper": cheaper(paid[OURS], paid[PEERS])})
    return pd.DataFrame(lines)


def _cheapest(members: pd.DataFrame, wanted: float) -> tuple[str, Median]:
    """(The cheapest run with a median phase error of at most ``wanted``, µs an orbit).

    The interval is from the lowest possible cost (phase errors and times at the lower ends of theirs) to the highest.
    """
    ends = ((" median", " per orbit"), (", low", ", low"), (", high", ", high"))
    costs = [members.loc[members[f"phase{phase}"] <= wanted, f"us{time}"] for phase, time in ends]
    best = members["who"][costs[0].idxmin()] if len(costs[0]) else "none"
    return best, Median(*(float(c.min()) if len(c) else inf for c in costs))


def least(lines: pd.DataFrame) -> pd.Series:
    """The least cost of each case."""
    return lines[[f"{side}, µs an orbit" for side in (OURS, PEERS)]].min(axis=1)


def _settings_tried(rows: pd.DataFrame) -> str:
    """A sentence on settings of peers: the time to `TRIED_TO` over the fastest one's, the larger of both problems."""
    seconds = rows[rows["error"] <= TRIED_TO].groupby(["problem", "method"], sort=False)["seconds"].min()
    seconds = seconds.unstack("problem")
    parts = []
    for name, stem in TRIED.items():
        members = seconds[[m.startswith(stem) for m in seconds.index]]
        ratios = (members / members.min()).max(axis=1).sort_values().items()
        told = ", ".join(f"{method.removeprefix('rebound-')} {number(x, 2)}" for method, x in ratios)
        parts += [f"{name}: {told}"] if told else []
    return f" Settings of peers, their time to {TRIED_TO:g} over the best one's: {'; '.join(parts)}." if parts else ""


@picture(
    GROWTH, "kepler-errors", "errors over the orbits",
    f"{TITLES[PROBLEMS[-1]]}: the greatest error so far over the number of orbits; methods of high order at {STANDARD} "
    "steps an orbit, or adaptive.",
)  # fmt: skip
def _draw_errors(rows: pd.DataFrame) -> style.Figure | None:
    rows = rows[(rows["problem"] == PROBLEMS[-1]) & (rows["group"] == "high order")]
    rows = rows[rows["setting"].isin([f"{STANDARD} steps", "adaptive"])]
    columns, names = sorted(rows["e"].unique()), list(dict.fromkeys(rows["method"]))
    if not columns:
        return None
    figure, axes = style.panels(len(QUANTITIES), len(columns), 7.6, sharex=True, sharey="row")
    for row, (quantity, label) in zip(axes, QUANTITIES.items(), strict=True):
        for ax, e in zip(row, columns, strict=True):
            part = rows[rows["e"] == e]
            style.curves("method", "orbits", quantity, names, span=(FLOOR, None))(ax, part)
            ax.grid(color="0.9", linewidth=0.5)
            if not np.isfinite(part[quantity]).any():
                ax.text(0.5, 0.5, "undefined\non a circle", transform=ax.transAxes, ha="center", va="center")
        row[0].set_ylabel(label)
        low, high = (np.log10(y) for y in row[0].get_ylim())
        row[0].set_yticks(10.0 ** np.arange(np.ceil(low), high + 1e-9, max(1, int(np.ceil((high - low) / 6)))))
        row[0].minorticks_off()
    for above, below, e in zip(axes[0], axes[-1], columns, strict=True):
        above.set_title(f"e = {e:g}")
        below.set_xlabel("orbits")
    style.legend_above(figure, axes[0][0], 3)
    figure.align_ylabels()
    return figure


def _fastest(rows: pd.DataFrame, most: int) -> list[str]:
    """At most ``most`` methods that are the fastest at some of 25 errors: first the one with the most such errors."""
    enough = [rows[rows["error"] <= wanted] for wanted in np.logspace(-13, -1, 25)]
    wins = pd.Series([part.loc[part["seconds"].idxmin(), "method"] for part in enough if len(part)], dtype=object)
    return sorted(wins.unique(), key=lambda name: -(wins == name).sum())[:most]


@picture(COST, "kepler-cost", "error against time")
def _draw_costs(rows: pd.DataFrame) -> tuple[style.Figure, str] | None:
    rows = rows[rows["status"] == OK]
    if rows.empty:
        return None
    shown = [*_fastest(rows[rows["kind"] == OWN], 4), *_fastest(rows[rows["kind"] != OWN], 3)]
    shown += [m for m in ("stormer-verlet", "scipy-dop853-numba") if m in set(rows["method"]) and m not in shown]
    of_method = style.curves("method", "seconds", "error", shown, span=(FLOOR, None))
    problems, text = rows.groupby("problem", sort=False), ("warm integration (s)", "error at the end, maximum norm")
    return style.row(problems, of_method, 3.6, *text, legend=3, sharex=True, sharey=True), (
        f"Error of the state after {rows['orbits'].max():g} orbits at e = {rows['e'].max():g} over the seconds of a "
        f"warm run; {len(shown)} methods: the fastest of each side, and two usual ones.{_settings_tried(rows)}"
    )


@of(cases, LONG)
def _table(lines: pd.DataFrame, runs: pd.DataFrame) -> Table:
    ran = runs[runs["kind"] != "reference"]
    stopped = int((~ran["status"].isin([OK, "skipped"])).sum())
    caption = (
        f"The cheapest of ours and of the peers that follow the phase over {runs['orbits'].max():.0f} orbits, in the "
        "median of starts an ulp apart. A side is the cheaper if it is so at both ends of the intervals of phase "
        f"error and time; else it is a tie. {stopped} of {len(ran)} runs end with another status than ok."
    )
    return Table(lines.head(ROWS), caption)


def _record(method: str) -> list:
    return [MEMBERS[method].record] if method in MEMBERS else []


#: The keys of orbits.
ORBITS_OF = [{"problem": problem, "e": e} for problem in PROBLEMS for e in measure.ECCENTRICITIES]
STUDY = Study(
    id="kepler",
    place=240,
    question="Over 10⁴ Kepler orbits, who keeps the phase, and for which time?",
    answer="Over {orbits} orbits following the phase costs {cheap} to {dear} µs an orbit; phasebench is cheapest in "
    "{ours} of {all} cases (orbit, error), heyoka or REBOUND in {peers}; {tied} tie.",
    setting=(
        "H = |p|²/2 − 1/|q| − μ/(3|q|³), with μ = 0 (Kepler) and with the Schwarzschild term; e = 0, 0.2, 0.6, 0.9.",
        "Errors are the greatest so far, at pericentres and apocentres: energy and angular momentum relative; phase "
        "(mean longitude) and perihelion against exact angles, linear in time, from elliptic integrals.",
        f"Fixed steps: {measure.LADDER[0]} to {measure.LADDER[-1]} an orbit. Adaptive peers at their own tolerance; "
        "heyoka (with high_accuracy and without) and IAS15 also at looser ones.",
        "Where round-off may decide, a phase error is the median of nine starts whose coordinates are an ulp less, "
        "the same or an ulp more, with its 95 % interval.",
        "Times are warm, without output, all integrators in turns, medians of nine rounds with 95 % intervals. heyoka, "
        "REBOUND and SciPy's right-hand side are compiled.",
    ),
    runs=(
        Runs(
            LONG, measure.follow, [orbit | {"method": m} for orbit in ORBITS_OF for m in (measure.TAYLOR, *MEMBERS)],
            more=(GROWTH,), needs=lambda problem, e, method: [ProblemKey(problem, (("e", e),)), *_record(method)],
        ),
        Runs(
            TIMES, measure.orbit_times, ORBITS_OF, where=ALONE, own=True,
            needs=lambda problem, e: [ProblemKey(problem, (("e", e),)), *(c.record for c in MEMBERS.values())],
        ),
        Runs(
            COST, measure.cost, over(method=tuple(PRICED), problem=PROBLEMS), where=ALONE, own=True,
            needs=lambda problem, method: [ProblemKey(problem), PRICED[method].record],
        ),
    ),
    claims={
        "costs": Claim(
            "This project's methods follow the phase at the least cost as often as peers",
            cases, f"cheaper == '{OURS}'", at_least(0.5), rows=f"cheaper in ('{OURS}', '{PEERS}')",
            unit="cases that one side wins", where="{problem} e = {e:g} to {phase up to (rad)} rad", names=2,
        ),
        "laws": Claim(
            "Phase errors above round-off grow linearly with time",
            ends, f"abs(`phase growth` - 1) <= {NEAR}", at_least(LINEAR), rows=SETTLED, unit="runs",
            where=worst("abs(`phase growth` - 1)", "{who}, e = {e:g}: t^{phase growth:.2f}"),
        ),
        "clocks": Claim(
            "No adaptive method has a phase error that its energy error does not explain",
            ends, UNEXPLAINED, NONE, rows=f"status == '{OK}' and mu == 0 and setting == 'adaptive' and phase == phase",
            unit="runs on pure Kepler orbits", where="{method}, e = {e:g}: {phase:.3g} rad", names=3,
        ),
    },
    numbers={
        "orbits": Number(LONG, "orbits", digits=5),
        "cheap": Number(cases, least, take=pd.Series.min),
        "dear": Number(cases, least),
        "all": Number(cases, len),
        "ours": Number(cases, f"cheaper == '{OURS}'", take=pd.Series.sum),
        "peers": Number(cases, f"cheaper == '{PEERS}'", take=pd.Series.sum),
        "tied": Number(cases, f"cheaper == '{TIED}'", take=pd.Series.sum),
    },
    checks={
        "references": Claim(
            "The closed form agrees with the Taylor series",
            GROWTH, "phase", at_most(AWAY), rows="kind == 'reference'", where="{problem}, e = {e}",
        ),
        "followed": Claim(
            "Some integrator follows every orbit to its end",
            GROWTH, lambda rows: rows.groupby(["problem", "e"])["phase"].min(), at_most(BEST),
            rows=f"kind != 'reference' and orbits == {measure.ORBITS + 0.5}", whole=True,
        ),
        "peers": Claim(
            "Some integrator of another package comes near the reference",
            COST, lambda rows: rows.groupby("problem")["error"].min(), at_most(BEST),
            rows=f"kind != '{OWN}' and status == '{OK}'", whole=True,
        ),
        "times": Claim(
            "Times are positive, and in their intervals",
            TIMES, "(0 < `us, low`) & (`us, low` <= `us per orbit`) & (`us per orbit` <= `us, high`)",
            rows="`us per orbit` == `us per orbit`",
        ),
    },
    figure=together(_draw_errors, _draw_costs),
    shown=_table,
    whole=of(ends)(lambda rows: rows.reindex(columns=[*KEY, *ENDS])),
    tables=(LONG, GROWTH, TIMES, COST),
    limits=(
        f"Linear means an exponent within {NEAR} of 1, wanted of {100 * LINEAR:g} % of the runs; phase errors up to "
        f"{PHASE_ROUND_OFF:g} rad, and peers at a tolerance looser than their own, are not judged.",
        f"A phase error is unexplained above {CLOCK:g} times what the energy error can do: the integrator's time is "
        "wrong.",
        f"Starts an ulp apart are run for phase errors from {measure.DRAWN[0]:g} to {measure.DRAWN[1]:g} rad; those of "
        f"{measure.DEAR[0]} at its default tolerance take long: its phase errors are taken to be known within a factor "
        f"{measure.SPREAD:g}.",
        "Without the Schwarzschild term a Wisdom–Holman splitting is the exact flow: this says nothing of a perturbed "
        "problem.",
        f"The most steps an orbit are {max(measure.LADDER)}, and {measure.USUAL_STEPS} or fewer where a run would take "
        "much more than a second; SciPy is left out over 10⁴ orbits. A step between two that were tried might be "
        "cheaper.",
    ),
)  # fmt: skip
