"""Ours over the best of heyoka, REBOUND and SciPy on every scene and accuracy of the trade: who is slower, and why."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict
from phasebench.benchmarks.problems.questions import QUESTIONS

from .front import CHOICES, FINALS, RUNGS
from .reasons import ALIKE, MEANING, REST, UNREACHED, WANTED, WITHIN, above, cells, told
from .settled import TIMES, of_choices

#: So often ours should take no longer.
OFTEN = 0.95
#: Reasons that are points of the figure, by the factors of their ratio.
DRAWN = [reason for reason in MEANING if reason != UNREACHED]


@of_choices()
def share(front: pd.DataFrame) -> Verdict:
    """In how many cells ours takes no longer, on how many of the scenes."""
    found = cells(front)
    good, sure = int((found["ratio"] <= WANTED).sum()), int((found["ratio high"] <= WANTED).sum())
    measured = set(front["scene"])
    left = [q.id for q in QUESTIONS if q.id not in measured]
    percent = 100 * good / len(found)
    short = f"At most {WANTED:.1f} of the best peer's time in {good} of {len(found)} cells ({percent:.1f} %)"
    text = f"{short} of a scene and an accuracy, in {sure} with the whole interval; wanted: {100 * OFTEN:.0f} %"
    text += f". {len(measured)} of {len(QUESTIONS)} scenes are measured; not {listed(left, 9)}" if left else ""
    return Verdict(f"{text}.", good >= OFTEN * len(found) and not left, f"{short}.")


@of_choices()
def until(front: pd.DataFrame) -> Verdict:
    """From which accuracy on ours takes longer too often, and the scenes where it does."""
    found = cells(front).assign(good=lambda t: t["ratio"] <= WANTED)
    shares = found.groupby("accuracy")["good"].mean().sort_index(ascending=False)
    enough = shares[(shares >= OFTEN).cummin()]
    low = shares.idxmin()
    text = f"The share is at least {100 * OFTEN:.0f} % "
    if len(enough) == len(shares):
        text += "at every accuracy"
    else:
        text += f"down to {enough.index[-1]:g}" if len(enough) else "not even at the coarsest accuracy"
        text += f", and least at {low:g} with {100 * shares[low]:.0f} %"
    slow = found[~found["good"]].groupby("scene", sort=False).size().sort_values(ascending=False, kind="stable")
    text += f". Slower anywhere: {listed([f'{s} ({n})' for s, n in slow.items()], 6)}" if len(slow) else ""
    return Verdict(f"{text}.", len(enough) == len(shares), f"{text}.")


@of_choices(RUNGS)
def why(front: pd.DataFrame, rungs: pd.DataFrame) -> Verdict | None:
    """The reasons, by how many cells they explain."""
    found = above(front, rungs)
    if found.empty:
        return None
    number_of = found["reason"].value_counts()
    parts = [f"{int(number_of[r])} {r} ({meaning})" for r, meaning in MEANING.items() if r in number_of]
    unknown = int(found["reason"].isna().sum())
    text = f"Of {len(found)} cells above {WANTED:.1f}: {'; '.join(parts) or 'none explained'}"
    text += f"; {unknown} {'is' if unknown == 1 else 'are'} not explained by the rows" if unknown else ""
    grown = found[np.isfinite(found["ours grew"]) & ~found["reason"].isin([WITHIN])]
    if len(grown):
        ours, peer = (number(float(grown[f"{side} grew"].median()), 2) for side in (OURS, PEERS))
        text += (
            f". From the last accuracy at which ours is no slower its steps grow {ours} times in the median, the "
            f"peer's {peer} times"
        )
    return Verdict(f"{text}.", not unknown, f"{len(found) - unknown} of {len(found)} cells above are explained.")


@of_choices(RUNGS)
@style.drawn
def draw(front: pd.DataFrame, rungs: pd.DataFrame, folder) -> list[Picture]:
    """The share of the cells by accuracy; of those above the two factors of the ratio."""
    found, slow = cells(front), above(front, rungs)
    figure, ((left, right),) = style.panels(1, 2, 3.4)
    by = found.groupby("accuracy")
    for k, (label, column) in enumerate((("by its median", "ratio"), ("by its whole interval", "ratio high"))):
        shares = by[column].agg(lambda x: (x <= WANTED).mean())
        left.semilogx(shares.index, 100 * shares, label=label, **style.curve(k))
    left.axhline(100 * OFTEN, color=style.GREY, linewidth=0.8, linestyle=":")
    left.set(xlabel="error up to", ylabel=f"% of the scenes at most {WANTED:.1f}", ylim=(0, 103))
    left.invert_xaxis()
    left.legend(loc="lower left")
    for k, reason in enumerate(DRAWN):
        part = slow[slow["reason"] == reason]
        if len(part):
            look = style.curve(k) | {"linestyle": "none", "markevery": None}
            right.loglog(part["steps"].astype(float), part["step"].astype(float), label=reason, **look)
    factors = np.geomspace(0.1, 10, 2)
    right.loglog(factors, WANTED / factors, color=style.GREY, linewidth=0.8)
    right.set(xlabel="steps, ours over the peer's", ylabel="time of a step, ours over the peer's")
    if right.get_legend_handles_labels()[0]:
        right.legend(loc="best")
    caption = (
        f"Left: in how many scenes ours takes at most {WANTED:.1f} of the best peer's time (dotted: wanted). Right: "
        f"the cells above it, by the two factors of their ratio; on the line it is {WANTED:.1f}."
    )
    return [Picture(style.save(figure, folder, "trade-ratios.png"), "ours over the best peer", caption)]


def _side(row, side: str) -> str:
    """Who, at which step or tolerance."""
    name, h, tol = (row[f"{side} {x}"] for x in ("integrator", "h", "tol"))
    if not isinstance(name, str):
        return "none"
    return f"{name}, {'h' if pd.notna(h) else 'tol'} {number(h if pd.notna(h) else tol)}"


def _interval(row) -> str:
    if not 0 < row["ratio"] < np.inf:
        return "peer alone" if row["ratio"] else "ours alone"
    low, high = (number(row[f"ratio {x}"], 3) for x in ("low", "high"))
    return f"{number(row['ratio'], 3)} [{low}, {high}]"


@of_choices(RUNGS)
def table(front: pd.DataFrame, rungs: pd.DataFrame) -> Table | None:
    """The worst cell of every scene that has one, then the next worst, up to `ROWS`."""
    found = above(front, rungs)
    if found.empty:
        return None
    order = found.assign(place=found.groupby("scene").cumcount()).sort_values("place", kind="stable").head(ROWS)
    lines = [
        {
            "scene": f"[{r['scene']}](trade-{r['scene']}.md)",
            "error up to": f"{r['accuracy']:.0e}",
            "ours": _side(r, OURS),
            "peer": _side(r, PEERS),
            "ratio": _interval(r),
            "why": told(r, rungs),
        }
        for r in order.sort_values("ratio", ascending=False, kind="stable").to_dict("records")
    ]
    caption = (
        f"Cells above {WANTED:.1f}, of each scene its worst before any second one. Why: the reason; steps and a step's "
        "time of ours over the peer's, whose product is the ratio; what share of its time ours would take for its "
        f"evaluations at the scene's cheapest price ('{REST}': that share alone is at most the peer's time); how many "
        "times as many steps ours and the peer take since the last accuracy at which ours was no slower."
    )
    return Table(pd.DataFrame(lines), caption)


@of_choices(RUNGS)
def _whole(front: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """Every cell, those above with their reason."""
    found, slow = cells(front), above(front, rungs)
    reasons = {(r["scene"], r["accuracy"]): told(r, rungs) for r in slow.to_dict("records")}
    keys = zip(found["scene"], found["accuracy"], strict=True)
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "steps", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper", "why"]
    return found.assign(why=[reasons.get(key, "") for key in keys])[columns]


PAGE = Page(
    id="trade-ratios",
    question="On which scenes and accuracies are the established integrators faster, and why?",
    tables=(CHOICES, FINALS, TIMES, RUNGS),
    setting=(
        f"A cell is one of {len(QUESTIONS)} scenes and an accuracy of 1e-1 to 1e-13 that somebody reaches: the time of "
        "the cheapest method of this project over that of the cheapest of heyoka, REBOUND and SciPy, at their best.",
        "Both run in turns, warm, without output; the ratio is the median over the rounds, with its 95 % interval. "
        "All of it is from the rows of [the trade](trade.md), which says how they are measured and shows every ratio.",
        "A ratio is the product of two: of the numbers of steps, and of the times of a step.",
        "Evaluations (of the gradient of V where H is separated, else of the whole) times the time of the cheapest "
        "evaluation of any method of this project on the scene are a share of a run; the rest are sums, solving, "
        "evaluations out of lanes.",
    ),
    verdicts=(share, until, why),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        "The price of an evaluation is that of a whole run divided by its evaluations, of the method where this is "
        "least: an upper bound, by which the share of the evaluations may be too large; one of V alone is cheaper than "
        "one of all of H.",
        "The best peer is not the same at each accuracy, nor is ours: steps that grew are of whoever was the cheapest.",
        "Steps of a Taylor series whose order follows the tolerance are not steps of a fixed order: that they "
        "hardly grow is what their order pays for.",
        "The cheapest of many is the fastest found; who was dropped on the way is in data/front_dropped.csv.",
        f"Cells that no side reaches are left out. WANTED = {WANTED:g}, OFTEN = {OFTEN:g}, ALIKE = {ALIKE:g}.",
    ),
    command="pytest benchmarks/experiments/trade",
)
