"""Wisdom-Holman splittings beside REBOUND's: the same ones at equal steps, and all of both by energy error and cost.

REBOUND's WHFast and SABA use Jacobi coordinates and the same splittings; safe_mode = 0 joins the drifts of neighbouring
steps and applies the corrector only for output, as the methods here always do.  WHFast's sums are not compensated.
All runs on a problem are timed in turns in one measurement, so that a busy machine slows all of them.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.conservation import energy_error
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.measure.timing import NOWHERE, OURS, PEERS, TIED, Median, cheaper, in_turns, median, ratio
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, together
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.page.verdict import at_least, at_most
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.store.cells import ALONE, ProblemKey, Unavailable
from phasebench.integrators.driver import OK, SKIPPED
from phasebench.integrators.records.wisdom_holman import CORRECTORS
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.registry import method as method_of
from phasebench.reference.peers import PEERS as ALL_PEERS
from phasebench.reference.peers import peer, rebound

if TYPE_CHECKING:
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
OWN, AXES = "phasebench", ("ns a unit of time", "relative energy error")


def made(case: str) -> ProblemKey:
    """What identifies the problem of a case."""
    name, parameters, *_ = CASES[case]
    return ProblemKey(name, tuple(parameters.items()))


def pair(problem: str, method: str, h: float) -> dict:
    """Energy errors, positions and times of a splitting by this project and by REBOUND; ``problem`` is of `CASES`."""
    name, parameters, _, t_end = CASES[problem]
    at, both = problem_of(name, **parameters), {"ours": integrator(method), "theirs": integrator(PAIRS[method])}
    every = round(t_end / h / SAVED)
    s, r = (c.run(at, h=h, steps=every * SAVED, save_every=every) for c in both.values())
    if r.status == SKIPPED:
        raise Unavailable(r.reason)
    for found in (s, r):
        if found.status != OK:
            raise RuntimeError(f"{found.method.label} on {problem}: {found.reason}")
    times = in_turns({who: clock.clock(c, at, t_end=h * TIMED, steps=TIMED) for who, c in both.items()}, ROUNDS)
    distance, paid = np.abs(s.q - r.q) / np.abs(r.q).max(), ratio(times["ours"], times["theirs"])
    return {
        "problem": problem,
        "method": method,
        "REBOUND's": PAIRS[method],
        "h": h,
        "steps": every * SAVED,
        ERROR: energy_error(at, s.q, s.p),
        THEIR_ERROR: energy_error(at, r.q, r.p),
        "distance of early positions": float(distance[: SAVED // 10].max()),
        "distance of end positions": float(distance[-1].max()),
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
    name, parameters, steps, t_end = CASES[problem]
    at, rows, clocks = problem_of(name, **parameters), {}, {}
    for c in rivals():
        for h in steps:
            rows[c.label, h] = row = _row(at, c, h, round(t_end / h / SAVED))
            if row["status"] == OK:
                clocks[c.label, h] = clock.clock(c, at, t_end=h * TIMED_OF_ALL, steps=TIMED_OF_ALL)
    for (label, h), found in in_turns(clocks, ROUNDS_OF_ALL).items():
        cost = median(found / TIMED_OF_ALL / h * 1e9)
        rows[label, h] |= {COST: cost.value, LOW: cost.low, HIGH: cost.high}
    return list(rows.values())


def _row(at: Problem, c: Integrator, h: float, every: int) -> dict:
    row, lack = {"kind": c.kind, "method": c.label, "h": h}, c.lacks(at)
    if lack:
        return row | {"status": SKIPPED, "reason": lack}
    s = c.run(at, h=h, steps=every * SAVED, save_every=every)
    row |= {"status": s.status, "reason": s.reason}
    return row if s.status != OK else row | {ERROR: energy_error(at, s.q, s.p)}


@of(ALL)
def cheapest(rows: pd.DataFrame) -> pd.DataFrame:
    """The fastest splitting of either side, and who is faster: a row for each problem and energy error."""
    ran, lines = rows[(rows["status"] == OK) & rows[COST].notna()], []
    for name, members in ran.groupby("problem", sort=False):
        for wanted in WANTED:
            line, costs = {"problem": name, "energy error up to": f"{wanted:.0e}"}, []
            enough = members[members[ERROR] <= wanted].sort_values(COST)
            for side, ours in (("phasebench", True), ("REBOUND", False)):
                part = enough[(enough["kind"] == OWN) == ours]
                cost, which, interval = NOWHERE, "none", ""
                if len(part):
                    best = part.iloc[0]
                    cost = Median(best[COST], best[LOW], best[HIGH])
                    which = f"{best['method']}, h = {number(best['h'])}"
                    interval = f"{number(cost.value)} [{number(cost.low)}, {number(cost.high)}]"
                costs.append(cost)
                line |= {f"cheapest of {side}": which, f"ns, {side}": interval}
            lines.append(line | {"cheaper": cheaper(*costs)})
    return pd.DataFrame(lines)


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


@picture(EQUAL, "wisdom_holman", "energy error against time")
def _draw_pairs(rows: pd.DataFrame) -> tuple[style.Figure, str]:
    def curves(axes: style.Axes, part: pd.DataFrame) -> None:
        for k, (method, pair) in enumerate(part.groupby("method", sort=False)):
            look = style.curve(k)
            theirs = {"linestyle": ":", "marker": look["marker"], "markerfacecolor": "none", "color": look["color"]}
            axes.loglog(pair["ns per step"] / pair["h"], pair[ERROR], label=method, **look)
            axes.loglog(pair["REBOUND's ns per step"] / pair["h"], pair[THEIR_ERROR], **theirs)

    caption = (
        "The same splittings: filled marks are this project's, open marks on dotted lines REBOUND's. Early positions "
        f"of a pair differ by at most {number(rows['distance of early positions'].max())} of the orbit's size."
    )
    return style.row(rows.groupby("problem", sort=False), curves, 3.0, *AXES, legend=3, sharey=True), caption


@picture(ALL, "wisdom_holman-fronts", "the fronts of both")
def _draw_fronts(rows: pd.DataFrame) -> tuple[style.Figure, str] | None:
    ran = rows[(rows["status"] == OK) & rows[COST].notna()]
    if ran.empty:
        return None

    def fronts(axes: style.Axes, part: pd.DataFrame) -> None:
        for k, (label, side) in enumerate((("phasebench", part["kind"] == OWN), ("REBOUND", part["kind"] != OWN))):
            found = part[side].sort_values(COST)
            best = found[found[ERROR] < found[ERROR].cummin().shift(fill_value=float("inf"))]
            axes.loglog(best[COST], best[ERROR], label=f"front of {label}", **style.curve(k))

    caption = (
        "All splittings, settings and steps: of each side those that no other of it beats in both error and time. "
        f"{vectors(rows)}"
    )
    return style.row(ran.groupby("problem", sort=False), fronts, 3.0, *AXES, legend=3, sharey=True), caption


@of(cheapest)
def _table(lines: pd.DataFrame) -> Table:
    caption = (
        "The cheapest of each side at each energy error, in ns per unit of the problem's time: medians with 95 % "
        "intervals. Intervals that overlap are a tie."
    )
    return Table(lines.head(ROWS), caption)


STUDY = Study(
    id="wisdom_holman",
    place=250,
    question="Wisdom–Holman splittings: are they REBOUND's, what does a step cost, and who is the cheapest?",
    answer="A Wisdom–Holman step takes {cost.low} to {cost.high} of REBOUND's time for the same splitting. Of {cases} "
    "cases (problem, energy error) phasebench is cheapest in {ours}, REBOUND in {theirs}, {ties} tie.",
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
            EQUAL, f"abs(100 * (`{ERROR}` / `{THEIR_ERROR}` - 1))", at_most(5.0),
            rows=f"`{ERROR}` > {ROUND_OFF} and `{THEIR_ERROR}` > {ROUND_OFF}", unit="% apart",
            where="{method}, {problem}", fault=True,
        ),
        "cost": Claim(
            "A step keeps up with REBOUND's on every problem",
            EQUAL, lambda rows: rows.groupby("problem", sort=False)["time ratio"].median(), at_most(1.5),
            unit="times REBOUND's time", span=True,
        ),
        "winners": Claim(
            "This project's splittings are the cheapest at least as often as REBOUND's",
            cheapest, f"cheaper == '{OURS}'", at_least(0.5), f"cheaper in ('{OURS}', '{PEERS}')",
            unit="cases that one side wins", where="{problem}, to {energy error up to}", names=3,
        ),
    },
    numbers={
        "cases": Number(cheapest, len),
        **{
            name: Number(cheapest, f"cheaper == '{who}'", take=pd.Series.sum)
            for name, who in (("ours", OURS), ("theirs", PEERS), ("ties", TIED))
        },
    },
    checks={
        "early": Claim("Early positions are REBOUND's", EQUAL, "`distance of early positions`", at_most(1e-8)),
        "takes": Claim("Costs are in their intervals", ALL, lambda rows: rows[COST].between(rows[LOW], rows[HIGH]),
                       rows="status == 'ok'"),
        "time": Claim("Every step takes a time", ALL, f"`{LOW}` > 0", rows="status == 'ok'"),
    },
    figure=together(_draw_pairs, _draw_fronts),
    shown=_table,
    whole=of(ALL)(lambda rows: rows.reindex(columns=["problem", "method", "h", ERROR, COST, LOW, HIGH, "status"])),
    limits=(
        f"Pairs are compared where both energy errors exceed {ROUND_OFF:g}: below, round-off decides, and sums here "
        "are compensated while REBOUND's are not.",
        "Modified kicks and WHFast512 are for Newtonian gravity alone: they have no row on perturbed Kepler orbits.",
        "An energy error says nothing of the phase. Steps are a factor of two apart; one in between might be cheaper.",
    ),
)  # fmt: skip
