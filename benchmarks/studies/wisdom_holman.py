"""Wisdom-Holman splittings beside REBOUND's: the same ones at equal steps, and all of both by energy error and cost.

REBOUND's WHFast and SABA use Jacobi coordinates and the same splittings; safe_mode = 0 joins the drifts of neighbouring
steps and applies the corrector only for output, as the methods here always do.  WHFast's sums are not compensated.
All runs on a problem are timed in turns in one measurement, so that a busy machine slows all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import NOWHERE, OURS, PEERS, TIED, Median, cheaper, in_turns, median, ratio
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import Count, at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, Unavailable
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.records.wisdom_holman import CORRECTORS
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.registry import method as method_of
from phasebench.reference.peers import PEERS as ALL_PEERS
from phasebench.reference.peers import peer, rebound

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from phasebench.benchmarks.problems.base import Problem

EQUAL, ALL = "wisdom_holman", "wisdom_holman_rivals"
#: Method of this project -> the peer with the same splitting.
PAIRS = {
    "wisdom-holman": "rebound-whfast-plain",
    "wisdom-holman-corrector": "rebound-whfast-corrector-17",
    "wisdom-holman-saba-4": "rebound-saba-4",
    "wisdom-holman-aba-8-6-4": "rebound-saba-8-6-4",
    "wisdom-holman-aba-10-6-4": "rebound-saba-10-6-4",
}
#: Name of a case -> (problem, its parameters, steps, end time).
CASES = {
    "perturbed-kepler, e = 0.2": ("perturbed-kepler", {"e": 0.2}, [2 * pi / n for n in (25, 50, 100)], 2000.0),
    "perturbed-kepler, e = 0.6": ("perturbed-kepler", {"e": 0.6}, [2 * pi / n for n in (50, 100, 200)], 2000.0),
    "outer-solar-system": ("outer-solar-system", {}, [50.0, 100.0, 200.0, 400.0], 500_000.0),
}
#: Stored rows of a run.
SAVED = 200
#: Steps of a timed run, enough for one synchronization not to matter, and rounds: of pairs, and of all.
TIMED, ROUNDS, TIMED_OF_ALL, ROUNDS_OF_ALL = 5_000, 15, 2_500, 11
#: Prefixes of the ids of REBOUND's Wisdom-Holman integrators; its vectorized and scalar ones that are compared.
SPLIT = ("rebound-whfast", "rebound-saba")
VECTORS, SCALAR = "rebound-whfast512-corrector-17", "rebound-whfast-corrector-17"
#: Energy errors below this contain round-off, which differs between the two sides.
ROUND_OFF = 1e-11
#: Relative energy errors for which the fastest splitting is named.
WANTED = (1e-6, 1e-9, 1e-12)
ERROR, THEIR_ERROR = "energy error", "REBOUND's energy error"
COST, LOW, HIGH = "ns a unit of time", "ns, low", "ns, high"
OWN = "phasebench"


# -- measuring ---------------------------------------------------------------------------------------------------------


def made(case: str) -> ProblemKey:
    """What identifies the problem of a case."""
    name, parameters, *_ = CASES[case]
    return ProblemKey(name, tuple(parameters.items()))


def pair(problem: str, method: str, h: float) -> dict:
    """Energy errors, positions and times of a splitting by this project and by REBOUND; ``problem`` is of `CASES`."""
    name, parameters, _, t_end = CASES[problem]
    at, both = problem_of(name, **parameters), {"ours": integrator(method), "theirs": integrator(PAIRS[method])}
    every = round(t_end / h / SAVED)
    runs = {who: c.run(at, h=h, steps=every * SAVED, save_every=every) for who, c in both.items()}
    if runs["theirs"].status == SKIPPED:
        raise Unavailable(runs["theirs"].reason)
    for s in runs.values():
        if s.status != OK:
            raise RuntimeError(f"{s.method.label} on {problem}: {s.reason}")
    s, r = runs.values()
    times = in_turns({who: clock.clock(c, at, t_end=h * TIMED, steps=TIMED) for who, c in both.items()}, ROUNDS)
    size, paid = np.abs(r.q).max(), ratio(times["ours"], times["theirs"])
    return {
        "problem": problem,
        "method": method,
        "REBOUND's": PAIRS[method],
        "h": h,
        "steps": every * SAVED,
        ERROR: energy_error(at, s.q, s.p),
        THEIR_ERROR: energy_error(at, r.q, r.p),
        "distance of early positions": float(np.abs(s.q[: SAVED // 10] - r.q[: SAVED // 10]).max() / size),
        "distance of end positions": float(np.abs(s.q[-1] - r.q[-1]).max() / size),
        "ns per step": median(times["ours"]).value / TIMED * 1e9,
        "REBOUND's ns per step": median(times["theirs"]).value / TIMED * 1e9,
        "time ratio": paid.value,
        "ratio, low": paid.low,
        "ratio, high": paid.high,
    }


def rivals() -> list[Integrator]:
    """All splittings: this project's, with each order of the corrector, then REBOUND's in all their settings."""
    ours = [m for m in METHODS if m.family == "wisdom_holman" and not m.parameters]
    corrected = [method_of("wisdom-holman-corrector", corrector=n) for n in CORRECTORS]
    theirs = [p for p in ALL_PEERS if p.id.startswith(SPLIT)]
    return [Integrator(r) for r in (*ours, *corrected, *theirs, *rebound.TRIED)]


def every_rival(problem: str) -> list[dict]:
    """Energy error and cost, in ns a unit of the problem's time, of all splittings at each step."""
    name, parameters, steps, _ = CASES[problem]
    at = problem_of(name, **parameters)
    rows = {(c.label, h): _row(problem, at, c, h) for c in rivals() for h in steps}
    able = {(c.label, h): c for c in rivals() for h in steps if rows[c.label, h]["status"] == OK}

    clocks = {key: clock.clock(c, at, t_end=key[1] * TIMED_OF_ALL, steps=TIMED_OF_ALL) for key, c in able.items()}
    times = in_turns(clocks, ROUNDS_OF_ALL)
    for (label, h), found in times.items():
        cost = median(found / TIMED_OF_ALL / h * 1e9)
        rows[label, h] |= {COST: cost.value, LOW: cost.low, HIGH: cost.high}
    return list(rows.values())


def _row(case: str, at: Problem, c: Integrator, h: float) -> dict:
    row = {"kind": c.kind, "method": c.label, "h": h}
    lack = c.lacks(at)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    every = round(CASES[case][3] / h / SAVED)
    s = c.run(at, h=h, steps=every * SAVED, save_every=every)
    row |= {"status": s.status, "reason": s.reason}
    return row if s.status != OK else row | {ERROR: energy_error(at, s.q, s.p)}


# -- judging -----------------------------------------------------------------------------------------------------------


def apart(rows: pd.DataFrame) -> pd.Series:
    """The difference of the energy errors of a pair, in percent."""
    return 100 * (rows[ERROR] / rows[THEIR_ERROR] - 1).abs()


def medians(rows: pd.DataFrame) -> pd.Series:
    """The time of a step over REBOUND's, by problem: the median over splittings and steps."""
    return rows.groupby("problem", sort=False)["time ratio"].median()


def cheapest(rows: pd.DataFrame) -> pd.DataFrame:
    """The fastest splitting of either side, and who is faster: a row for each problem and energy error."""
    ran = rows[(rows["status"] == OK) & rows[COST].notna()]
    lines = []
    for name, members in ran.groupby("problem", sort=False):
        for wanted in WANTED:
            enough = members[members[ERROR] <= wanted].sort_values(COST)
            line, costs = {"problem": name, "energy error up to": f"{wanted:.0e}"}, {}
            for who, part in ((OURS, enough[enough["kind"] == OWN]), (PEERS, enough[enough["kind"] != OWN])):
                best = None if part.empty else part.iloc[0]
                costs[who] = NOWHERE if best is None else Median(best[COST], best[LOW], best[HIGH])
                line |= _cheapest_columns("phasebench" if who == OURS else "REBOUND", best)
            lines.append(line | {"cheaper": cheaper(costs[OURS], costs[PEERS])})
    return pd.DataFrame(lines)


def _cheapest_columns(side: str, best: pd.Series | None) -> dict[str, str]:
    if best is None:
        return {f"cheapest of {side}": "none", f"ns, {side}": ""}
    interval = f"{number(best[COST])} [{number(best[LOW])}, {number(best[HIGH])}]"
    return {f"cheapest of {side}": f"{best['method']}, h = {number(best['h'])}", f"ns, {side}": interval}


def _scores(lines: pd.DataFrame) -> tuple[int, ...]:
    """(Number of cases in which this project is faster, in which REBOUND is, tied ones)."""
    return tuple(int((lines["cheaper"] == who).sum()) if len(lines) else 0 for who in (OURS, PEERS, TIED))


def won(rows: pd.DataFrame) -> Count | None:
    """The cases that this project wins, of those that one side wins."""
    lines = cheapest(rows)
    ours, theirs, _ = _scores(lines)
    return None if lines.empty else Count(ours, ours + theirs)


def lost(rows: pd.DataFrame) -> str:
    """The cases that REBOUND wins."""
    lines = cheapest(rows)
    cases = [f"{r['problem']}, to {r['energy error up to']}" for _, r in lines[lines["cheaper"] == PEERS].iterrows()]
    return join_list(cases, 3) if cases else ""


def answer(data: Data) -> str | None:
    """The ratio of the times of a step, and how often either side is the fastest."""
    pairs, rows = data(EQUAL), data(ALL)
    parts = []
    if pairs is not None and len(pairs):
        found = medians(pairs)
        low, high = number(found.min(), 2), number(found.max(), 2)
        parts.append(f"A Wisdom–Holman step takes {low} to {high} of REBOUND's time for the same splitting")
    lines = cheapest(rows) if rows is not None and len(rows) else pd.DataFrame()
    if len(lines):
        ours, theirs, tied = _scores(lines)
        parts.append(
            f"Of {len(lines)} cases (problem, energy error) phasebench is cheapest in {ours}, REBOUND in "
            f"{theirs}, {tied} tie"
        )
    return f"{'. '.join(parts)}." if parts else None


# -- what is shown -----------------------------------------------------------------------------------------------------


def vectors(rows: pd.DataFrame) -> str:
    """How many times as fast WHFast512 is as WHFast, where both ran; or why it did not run."""
    ran = rows[rows["status"] == OK]
    of_vectors, of_one = (ran[ran["method"] == name].set_index(["problem", "h"])[COST] for name in (VECTORS, SCALAR))
    gain = (of_one / of_vectors).dropna()
    if len(gain):
        low, high = number(gain.min(), 2), number(gain.max(), 2)
        return f"WHFast512 with corrector 17 is {low} to {high} times as fast as WHFast with it."
    reasons = rows.loc[rows["method"] == VECTORS, "reason"].dropna().unique()
    return f"{': '.join(['WHFast512 did not run here', *reasons[:1]]).rstrip('.')}."


def draw(data: Data, folder: Path) -> list[Picture]:
    """Energy error against time: of pairs, and of the best runs of either side."""
    return [p for p in (_pairs(data, folder), _fronts(data, folder)) if p is not None]


@of(EQUAL)
def _pairs(frame: pd.DataFrame, folder: Path) -> Picture:
    methods = list(dict.fromkeys(frame["method"]))

    def curves(axes: Axes, part: pd.DataFrame) -> None:
        for k, method in enumerate(methods):
            rows, look = part[part["method"] == method], style.curve(k)
            axes.loglog(rows["ns per step"] / rows["h"], rows[ERROR], label=method, **look)
            theirs = {"linestyle": ":", "marker": look["marker"], "markerfacecolor": "none", "color": look["color"]}
            axes.loglog(rows["REBOUND's ns per step"] / rows["h"], rows[THEIR_ERROR], **theirs)

    file = _panels(frame, curves, folder, "wisdom_holman.png")
    early = number(frame["distance of early positions"].max())
    caption = (
        "The same splittings: filled marks are this project's, open marks on dotted lines REBOUND's. Early "
        f"positions of a pair differ by at most {early} of the orbit's size."
    )
    return Picture(file, "energy error against time", caption)


@of(ALL)
def _fronts(rows: pd.DataFrame, folder: Path) -> Picture | None:
    """Of each side the runs that no other run of it beats in both error and time."""
    ran = rows[(rows["status"] == OK) & rows[COST].notna()]
    if ran.empty:
        return None

    def curves(axes: Axes, part: pd.DataFrame) -> None:
        for k, (label, side) in enumerate((("phasebench", part["kind"] == OWN), ("REBOUND", part["kind"] != OWN))):
            found = part[side].sort_values(COST)
            best = found[found[ERROR] < found[ERROR].cummin().shift(fill_value=float("inf"))]
            axes.loglog(best[COST], best[ERROR], label=f"front of {label}", **style.curve(k))

    file = _panels(ran, curves, folder, "wisdom_holman-fronts.png")
    caption = (
        "All splittings, settings and steps: of each side those that no other of it beats in both error and time. "
        f"{vectors(rows)}"
    )
    return Picture(file, "the fronts of both", caption)


def _panels(frame: pd.DataFrame, curves: Callable[[Axes, pd.DataFrame], None], folder: Path, file: str) -> str:
    """Save a figure with a panel for each problem, whose curves ``curves(axes, rows)`` draws; return its file."""
    problems = list(dict.fromkeys(frame["problem"]))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.0, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            curves(axes, frame[frame["problem"] == name])
            axes.set(title=name, xlabel="ns a unit of time")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("relative energy error")
        style.legend_above(figure, panels[0], 3)
        return style.save(figure, folder, file)


@of(ALL)
def table(rows: pd.DataFrame) -> Table | None:
    """The fastest splitting of either side at each energy error."""
    lines = cheapest(rows)
    if lines.empty:
        return None
    caption = (
        "The cheapest of each side at each energy error, in ns per unit of the problem's time: medians with 95 % "
        "intervals. Intervals that overlap are a tie."
    )
    return Table(lines.head(ROWS), caption)


@of(ALL)
def whole(rows: pd.DataFrame) -> pd.DataFrame:
    """Error and cost of every splitting at every step."""
    return rows.reindex(columns=["problem", "method", "h", ERROR, COST, LOW, HIGH, "status"])


STUDY = Study(
    id="wisdom_holman",
    place=250,
    question="Wisdom–Holman splittings: are they REBOUND's, what does a step cost, and who is the cheapest?",
    answer=answer,
    setting=(
        "H = H_Kepler + ε H_interaction in Jacobi coordinates: a drift solves Kepler's equation, a kick applies the "
        "rest.",
        "The outer solar system (days), and perturbed Kepler orbits at e = 0.2 and 0.6; first the same splittings "
        "in pairs, then all of ours and REBOUND's at each step.",
        "Of REBOUND: WHFast with safe_mode = 0, correctors 3 to 17, the second corrector, the kernels lazy, "
        "modified kick and composition, other coordinates; WHFast512 without and with corrector 17; every type of "
        "SABA.",
        "Energy errors are relative, the greatest over 200 rows; distances are relative to the largest coordinate.",
        "Times are warm, without output; all of a problem in turns, the first round not counted; medians, 95 % "
        "intervals.",
    ),
    runs=(
        Runs(
            EQUAL, pair, [{"problem": c, "method": m, "h": h} for c in CASES for m in PAIRS for h in CASES[c][2]],
            needs=lambda problem, method, h: (BY_ID[method], peer(PAIRS[method]), made(problem), CASES[problem][3]),
            where=ALONE, own=True,
        ),
        Runs(
            ALL, every_rival, over(problem=tuple(CASES)),
            needs=lambda problem: (made(problem), *(c.record for c in rivals()), *CASES[problem][2:]),
            where=ALONE, own=True,
        ),
    ),
    claims={
        "same": Claim(
            "Energy errors equal REBOUND's for the same splitting and step",
            EQUAL, apart, at_most(5.0), rows=f"`{ERROR}` > {ROUND_OFF} and `{THEIR_ERROR}` > {ROUND_OFF}",
            unit="% apart", where="{method}, {problem}", fault=True,
        ),
        "cost": Claim(
            "A step keeps up with REBOUND's on every problem",
            EQUAL, medians, at_most(1.5), unit="times REBOUND's time", span=True,
        ),
        "winners": Claim(
            "This project's splittings are the cheapest at least as often as REBOUND's",
            ALL, won, at_least(0.5), unit="cases that one side wins", where=lost,
        ),
    },
    checks={
        "early": Claim("Early positions are REBOUND's", EQUAL, "`distance of early positions`", at_most(1e-8)),
        "takes": Claim("Costs are in their intervals", ALL, lambda rows: rows[COST].between(rows[LOW], rows[HIGH]),
                       rows="status == 'ok'"),
        "time": Claim("Every step takes a time", ALL, f"`{LOW}` > 0", rows="status == 'ok'"),
    },
    figure=draw,
    shown=table,
    whole=whole,
    limits=(
        f"Pairs are compared where both energy errors exceed {ROUND_OFF:g}: below, round-off decides, and sums here "
        "are compensated while REBOUND's are not.",
        "Modified kicks and WHFast512 are for Newtonian gravity alone: they have no row on perturbed Kepler orbits.",
        "An energy error says nothing of the phase. Steps are a factor of two apart; one in between might be cheaper.",
    ),
)  # fmt: skip
