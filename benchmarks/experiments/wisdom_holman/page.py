"""Wisdom-Holman splittings beside REBOUND's."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.measure.timing import NOWHERE, OURS, PEERS, TIED, Median, cheaper
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from .rivals import TABLE

#: Energy errors below this have a part of round-off, in which the two differ.
ROUND_OFF = 1e-11
#: Energy errors above that which differ by less than this, relatively, are the same.
SAME = 0.05
#: A step that takes at most this many times as long as REBOUND's keeps up with it.
SLOWER = 1.5
#: Relative energy errors for which the cheapest is named.
WANTED = (1e-6, 1e-9, 1e-12)
ERROR, THEIR_ERROR = "energy error", "REBOUND's energy error"
COST, LOW, HIGH = "ns a unit of time", "ns, low", "ns, high"
OWN = "phasebench"
#: The two whose times are compared where both run, at each step.
VECTORS, SCALAR = "rebound-whfast512-corrector-17", "rebound-whfast-corrector-17"


@of("wisdom_holman")
def same(frame: pd.DataFrame) -> Verdict | None:
    """Whether the splittings are REBOUND's."""
    truncated = frame[(frame[ERROR] > ROUND_OFF) & (frame[THEIR_ERROR] > ROUND_OFF)]
    if truncated.empty:
        return None
    apart = float((truncated[ERROR] / truncated[THEIR_ERROR] - 1).abs().max())
    positions = float(frame["distance of early positions"].max())
    return Verdict(
        f"Where the energy error exceeds {ROUND_OFF:g} ({len(truncated)} of {len(frame)} rows) it differs from REBOUND's "
        f"of the same splitting and step by at most {number(100 * apart, 2)} %; early positions by at most "
        f"{number(positions)} of the orbit's size.",
        apart <= SAME,
        f"Energy errors differ from REBOUND's by at most {number(100 * apart, 2)} %.",
    )


@of("wisdom_holman")
def cost(frame: pd.DataFrame) -> Verdict:
    """What a step costs beside REBOUND's."""
    medians = frame.groupby("problem", sort=False)["time ratio"].median()
    parts = [f"{name} {x:.2f}" for name, x in medians.items()]
    return Verdict(
        f"A step takes, in units of REBOUND's (medians): {'; '.join(parts)}.",
        bool(medians.max() <= SLOWER),
        f"A step takes up to {medians.max():.2f} times as long as REBOUND's.",
    )


def cheapest(rivals: pd.DataFrame) -> pd.DataFrame:
    """A row for each problem and energy error: the cheapest of each side, what it costs, and who is the cheaper."""
    ran = rivals[(rivals["status"] == "ok") & rivals[COST].notna()]
    lines = []
    for name, members in ran.groupby("problem", sort=False):
        for wanted in WANTED:
            enough = members[members[ERROR] <= wanted].sort_values(COST)
            line, costs = {"problem": name, "energy error up to": f"{wanted:.0e}"}, {}
            for who, part in ((OURS, enough[enough["kind"] == OWN]), (PEERS, enough[enough["kind"] != OWN])):
                best = None if part.empty else part.iloc[0]
                costs[who] = NOWHERE if best is None else Median(best[COST], best[LOW], best[HIGH])
                line |= _shown("phasebench" if who == OURS else "REBOUND", best)
            lines.append(line | {"cheaper": cheaper(costs[OURS], costs[PEERS])})
    return pd.DataFrame(lines)


def _shown(side: str, best: pd.Series | None) -> dict[str, str]:
    if best is None:
        return {f"cheapest of {side}": "none", f"ns, {side}": ""}
    interval = f"{number(best[COST])} [{number(best[LOW])}, {number(best[HIGH])}]"
    return {f"cheapest of {side}": f"{best['method']}, h = {number(best['h'])}", f"ns, {side}": interval}


@of(TABLE)
def winners(rivals: pd.DataFrame) -> Verdict | None:
    """Who is the cheapest for an energy error, of all that were measured."""
    lines = cheapest(rivals)
    if lines.empty:
        return None
    ours, theirs, tied = (int((lines["cheaper"] == who).sum()) for who in (OURS, PEERS, TIED))
    none = len(lines) - ours - theirs - tied
    counts = f"one of this project's splittings in {ours}, one of REBOUND's in {theirs}, a tie in {tied}"
    text = f"The cheapest for an energy error is, of {len(lines)} pairs of a problem and an error: {counts}"
    text += f"; none gets there in {none}" if none else ""
    short = f"Cheapest for an energy error: ours {ours}, REBOUND {theirs}, ties {tied} of {len(lines)}."
    return Verdict(f"{text}. {vectors(rivals)}", ours >= theirs, short)


def vectors(rivals: pd.DataFrame) -> str:
    """What WHFast512 takes beside WHFast, or why it did not run."""
    of_vectors = rivals[rivals["method"] == VECTORS]
    ran = of_vectors[of_vectors["status"] == "ok"]
    if ran.empty:
        why = "; ".join(dict.fromkeys(of_vectors["reason"].dropna())) or "it was not measured"
        return f"WHFast512 has no row: {why.rstrip('.')}."
    key = ["problem", "h"]
    both = ran.merge(
        rivals[(rivals["method"] == SCALAR) & (rivals["status"] == "ok")], on=key, suffixes=("", " of one")
    )
    if both.empty:
        return "WHFast512 ran where WHFast did not."
    gain = both[f"{COST} of one"] / both[COST]
    return f"WHFast512 with corrector 17 is {number(gain.min(), 2)} to {number(gain.max(), 2)} times as fast as WHFast with it."


def draw(data, folder) -> list[Picture]:
    """The pairs' energy errors against time, and the fronts of all."""
    return [p for p in (_pairs(data, folder), _fronts(data, folder)) if p is not None]


@of("wisdom_holman")
def _pairs(frame: pd.DataFrame, folder) -> Picture:
    """Energy error against time of the same splittings."""
    methods = list(dict.fromkeys(frame["method"]))

    def curves(axes, part):
        for k, method in enumerate(methods):
            rows, look = part[part["method"] == method], style.curve(k % len(style.CURVES))
            axes.loglog(rows["ns per step"] / rows["h"], rows[ERROR], label=method, **look)
            theirs = {"linestyle": ":", "marker": look["marker"], "markerfacecolor": "none", "color": look["color"]}
            axes.loglog(rows["REBOUND's ns per step"] / rows["h"], rows[THEIR_ERROR], **theirs)

    file = _panels(frame, curves, folder, "wisdom_holman.png")
    caption = "The same splittings: filled marks are this project's, open marks on dotted lines REBOUND's."
    return Picture(file, "energy error against time", caption)


@of(TABLE)
def _fronts(rivals: pd.DataFrame, folder) -> Picture | None:
    """Of each side the rows that nothing of that side beats in both error and time."""
    ran = rivals[(rivals["status"] == "ok") & rivals[COST].notna()]
    if ran.empty:
        return None

    def curves(axes, part):
        for k, (label, side) in enumerate((("phasebench", part["kind"] == OWN), ("REBOUND", part["kind"] != OWN))):
            rows = part[side].sort_values(COST)
            best = rows[rows[ERROR] < rows[ERROR].cummin().shift(fill_value=float("inf"))]
            axes.loglog(best[COST], best[ERROR], label=f"front of {label}", **style.curve(k))

    file = _panels(ran, curves, folder, "wisdom_holman-fronts.png")
    caption = "All splittings, settings and steps: of each side those that no other of it beats in both error and time."
    return Picture(file, "the fronts of both", caption)


def _panels(frame: pd.DataFrame, curves, folder, file: str) -> str:
    """A panel for each problem, energy error against time."""
    problems = list(dict.fromkeys(frame["problem"]))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.0, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            curves(axes, frame[frame["problem"] == name])
            axes.set(title=name, xlabel="ns a unit of time")
            axes.grid(color="0.93", linewidth=0.5)
            style.plain_ticks(axes.xaxis)
        panels[0].set_ylabel("relative energy error")
        style.legend_above(figure, panels[0], 3)
        return style.save(figure, folder, file)


@of(TABLE)
def table(rivals: pd.DataFrame) -> Table | None:
    """The cheapest of each side."""
    lines = cheapest(rivals)
    if lines.empty:
        return None
    caption = (
        "The cheapest of each side whose energy error is at most so much, and its ns a unit of time of the problem: medians "
        "with 95 % intervals. Whose interval lies whole below the other's is the cheaper; else it is a tie."
    )
    return Table(lines.head(ROWS), caption)


@of(TABLE)
def _whole(rivals: pd.DataFrame) -> pd.DataFrame:
    return rivals.reindex(columns=["problem", "method", "h", ERROR, COST, LOW, HIGH, "status"])


PAGE = Page(
    id="wisdom_holman",
    question="Wisdom–Holman splittings: are they REBOUND's, what does a step cost, and who is the cheapest?",
    tables=("wisdom_holman", TABLE),
    setting=(
        "H = H_Kepler + ε H_interaction in Jacobi coordinates; drifts solve Kepler's equation, kicks are the rest.",
        "The outer solar system (days), and perturbed Kepler at e = 0.2 and 0.6; the same splittings in pairs, then "
        "everybody at each step.",
        "Of REBOUND: WHFast with safe_mode = 0, correctors 3 to 17, the second corrector, the kernels lazy, modified kick "
        "and composition, other coordinates; WHFast512 without and with corrector 17; every type of SABA.",
        "Energy errors are relative, the greatest over 200 rows; distances are relative to the largest coordinate.",
        "Times are warm, without output; all of a problem in turns, the first round not counted; medians, 95 % intervals.",
    ),
    verdicts=(same, cost, winners),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Errors below {ROUND_OFF:g} are left out of the comparison of pairs: sums here are compensated, REBOUND's are not.",
        f"The same means within {100 * SAME:g} %; keeping up means {SLOWER} times REBOUND's time or less.",
        "Modified kicks and WHFast512 are for Newtonian gravity alone: they have no row on perturbed Kepler.",
        "An energy error says nothing of the phase; steps are a factor of two apart, and one in between might just do.",
    ),
    command="pytest benchmarks/experiments/wisdom_holman",
)
