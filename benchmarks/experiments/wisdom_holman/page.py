"""The report's page "wisdom_holman": this project's splittings beside REBOUND's, in energy error and cost.

The table ``wisdom_holman`` has pairs of equal splittings; `TABLE` has all splittings of both sides, a row for each
problem and step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import NOWHERE, OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import FAIL, Count, Range, Verdict, at_least, at_most

from .rivals import TABLE

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

#: Energy errors below this contain round-off, which differs between the two sides.
ROUND_OFF = 1e-11
#: Largest relative difference of two energy errors above `ROUND_OFF` that count as equal.
SAME = 0.05
#: Largest time of a step over REBOUND's that counts as keeping up.
SLOWER = 1.5
#: Smallest share of the decided cases that this project should win.
HALF = 0.5
#: Relative energy errors for which the fastest splitting is named.
WANTED = (1e-6, 1e-9, 1e-12)
ERROR, THEIR_ERROR = "energy error", "REBOUND's energy error"
COST, LOW, HIGH = "ns a unit of time", "ns, low", "ns, high"
OWN = "phasebench"
#: REBOUND's vectorized and scalar integrators whose times are compared.
VECTORS, SCALAR = "rebound-whfast512-corrector-17", "rebound-whfast-corrector-17"


@of("wisdom_holman")
def same(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether this project's energy errors equal REBOUND's for the same splitting and step.

    Errors near round-off do not count; None if all are.  ``frame`` has a row for each splitting, problem and step.
    """
    truncated = frame[(frame[ERROR] > ROUND_OFF) & (frame[THEIR_ERROR] > ROUND_OFF)]
    if truncated.empty:
        return None
    apart = 100 * (truncated[ERROR] / truncated[THEIR_ERROR] - 1).abs()
    worst = truncated.loc[apart.idxmax()]
    return Verdict(
        "Energy errors equal REBOUND's for the same splitting and step",
        apart.max(),
        at_most(100 * SAME),
        "% apart",
        where=f"{worst['method']}, {worst['problem']}",
        otherwise=FAIL,
    )


@of("wisdom_holman")
def cost(frame: pd.DataFrame) -> Verdict:
    """Judge whether a step takes at most `SLOWER` times as long as REBOUND's of the same splitting, on every problem.

    The time ratio of a problem is the median over splittings and steps.  ``frame`` has a row for each splitting,
    problem and step.
    """
    medians = frame.groupby("problem", sort=False)["time ratio"].median()
    return Verdict(
        "A step keeps up with REBOUND's on every problem",
        Range(medians.min(), medians.max()),
        at_most(SLOWER),
        "times REBOUND's time",
        where=medians.idxmax(),
    )


def cheapest(rivals: pd.DataFrame) -> pd.DataFrame:
    """Select the fastest splitting of this project and of REBOUND: a row for each problem and energy error.

    A row has both splittings with their costs, and which side is faster.  ``rivals`` has all splittings at each step.
    """
    ran = rivals[(rivals["status"] == "ok") & rivals[COST].notna()]
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


@of(TABLE)
def winners(rivals: pd.DataFrame) -> Verdict | None:
    """Judge whether this project's splittings are the fastest at an energy error at least as often as REBOUND's.

    ``rivals`` has all splittings of both at each step; None if none ran.
    """
    lines = cheapest(rivals)
    if lines.empty:
        return None
    ours, theirs, _ = _scores(lines)
    lost = [f"{r['problem']}, to {r['energy error up to']}" for _, r in lines[lines["cheaper"] == PEERS].iterrows()]
    return Verdict(
        "This project's splittings are the cheapest at least as often as REBOUND's",
        Count(ours, ours + theirs),
        at_least(HALF),
        "cases that one side wins",
        where=join_list(lost, 3) if lost else "",
    )


def _scores(lines: pd.DataFrame) -> tuple[int, ...]:
    """Count the rows, each a problem and an energy error: (this project is faster, REBOUND is faster, tied)."""
    return tuple(int((lines["cheaper"] == who).sum()) for who in (OURS, PEERS, TIED))


def answer(data: Data) -> str | None:
    """Return the page's answer: the ratio of the step times, and how often this project or REBOUND is the fastest.

    ``data`` maps a table's name to the table; None if nothing was measured.
    """
    pairs, rivals = data("wisdom_holman"), data(TABLE)
    parts = []
    if pairs is not None and len(pairs):
        medians = pairs.groupby("problem", sort=False)["time ratio"].median()
        low, high = number(medians.min(), 2), number(medians.max(), 2)
        parts.append(f"A Wisdom–Holman step takes {low} to {high} of REBOUND's time for the same splitting")
    lines = cheapest(rivals) if rivals is not None and len(rivals) else pd.DataFrame()
    if len(lines):
        ours, theirs, tied = _scores(lines)
        parts.append(
            f"Of {len(lines)} cases (problem, energy error) phasebench is cheapest in {ours}, REBOUND in "
            f"{theirs}, {tied} tie"
        )
    return f"{'. '.join(parts)}." if parts else None


def vector_gain(rivals: pd.DataFrame) -> pd.Series:
    """Return WHFast's time over WHFast512's, by problem and step; empty if one of them did not run.

    Both have the symplectic corrector of order 17; WHFast512 is REBOUND's version with AVX-512 vectors.
    """
    ran = rivals[rivals["status"] == "ok"]
    of_vectors, of_one = (ran[ran["method"] == name].set_index(["problem", "h"])[COST] for name in (VECTORS, SCALAR))
    return (of_one / of_vectors).dropna()


def _vectors(rivals: pd.DataFrame) -> str:
    """Return a sentence for the caption: how many times as fast WHFast512 is as WHFast, or why it did not run."""
    gain = vector_gain(rivals)
    if len(gain):
        low, high = number(gain.min(), 2), number(gain.max(), 2)
        return f"WHFast512 with corrector 17 is {low} to {high} times as fast as WHFast with it."
    reasons = rivals.loc[rivals["method"] == VECTORS, "reason"].dropna().unique()
    return f"{': '.join(['WHFast512 did not run here', *reasons[:1]]).rstrip('.')}."


def draw(data: Data, folder: Path) -> list[Picture]:
    """Draw two figures of energy error against time, a panel for each problem; save them in ``folder``.

    The first has pairs, a method of this project and REBOUND's integrator with the same splitting; the second the best
    runs of either side, whatever the splitting.  ``data`` maps a table's name to the table; a figure without rows is
    left out.
    """
    return [p for p in (_pairs(data, folder), _fronts(data, folder)) if p is not None]


@of("wisdom_holman")
def _pairs(frame: pd.DataFrame, folder: Path) -> Picture:
    """Draw energy error against time of this project's splittings and of the same ones in REBOUND.

    ``frame`` has a row for each splitting, problem and step; the figure is saved in ``folder``.
    """
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


@of(TABLE)
def _fronts(rivals: pd.DataFrame, folder: Path) -> Picture | None:
    """Draw the fronts of this project and of REBOUND: the runs that no other run of that side beats in error and time.

    ``rivals`` has all splittings at each step; None if no splitting ran.
    """
    ran = rivals[(rivals["status"] == "ok") & rivals[COST].notna()]
    if ran.empty:
        return None

    def curves(axes: Axes, part: pd.DataFrame) -> None:
        for k, (label, side) in enumerate((("phasebench", part["kind"] == OWN), ("REBOUND", part["kind"] != OWN))):
            rows = part[side].sort_values(COST)
            best = rows[rows[ERROR] < rows[ERROR].cummin().shift(fill_value=float("inf"))]
            axes.loglog(best[COST], best[ERROR], label=f"front of {label}", **style.curve(k))

    file = _panels(ran, curves, folder, "wisdom_holman-fronts.png")
    caption = (
        "All splittings, settings and steps: of each side those that no other of it beats in both error and time. "
        f"{_vectors(rivals)}"
    )
    return Picture(file, "the fronts of both", caption)


def _panels(frame: pd.DataFrame, curves: Callable[[Axes, pd.DataFrame], None], folder: Path, file: str) -> str:
    """Save a figure with a panel of energy error against time for each problem; return the file's name.

    ``curves(axes, rows)`` draws the curves of a problem; ``file`` is the name in ``folder``.
    """
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


@of(TABLE)
def table(rivals: pd.DataFrame) -> Table | None:
    """Return the page's table: the fastest splitting of this project and of REBOUND at each energy error.

    ``rivals`` has all splittings of both at each step; None if none ran.
    """
    lines = cheapest(rivals)
    if lines.empty:
        return None
    caption = (
        "The cheapest of each side at each energy error, in ns per unit of the problem's time: medians with 95 % "
        "intervals. Intervals that overlap are a tie."
    )
    return Table(lines.head(ROWS), caption)


@of(TABLE)
def _full_table(rivals: pd.DataFrame) -> pd.DataFrame:
    return rivals.reindex(columns=["problem", "method", "h", ERROR, COST, LOW, HIGH, "status"])


PAGE = Page(
    id="wisdom_holman",
    question="Wisdom–Holman splittings: are they REBOUND's, what does a step cost, and who is the cheapest?",
    tables=("wisdom_holman", TABLE),
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
    verdicts=(same, cost, winners),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"Pairs are compared where both energy errors exceed {ROUND_OFF:g}: below, round-off decides, and sums here "
        "are compensated while REBOUND's are not.",
        "Modified kicks and WHFast512 are for Newtonian gravity alone: they have no row on perturbed Kepler orbits.",
        "An energy error says nothing of the phase. Steps are a factor of two apart; one in between might be cheaper.",
    ),
    command="pytest benchmarks/experiments/wisdom_holman",
)
