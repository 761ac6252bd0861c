"""This project's best time over the best peer's, and why it is above 1 where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Study
from phasebench.benchmarks.page.verdict import EVERY, at_least
from phasebench.benchmarks.problems.questions import QUESTIONS

from .front import CHOICES, FINALS, RUNGS, TIMES
from .reasons import ALIKE, MEANING, UNREACHED, WANTED, above, cases, sentence
from .trade import MEASURED

#: Smallest share of the cells (scene, accuracy) in which this project should take no longer.
OFTEN = 0.95
#: Reasons that the figure shows, as points over the two factors of the ratio.
DRAWN = [reason for reason in MEANING if reason != UNREACHED]


def slowest(rows: pd.DataFrame) -> str:
    """The scene with the most cases in which a peer is faster, and their number; "" if there is none."""
    slow = rows[~(rows["ratio"] <= WANTED)]
    if slow.empty:
        return ""
    scenes = slow.groupby("scene", sort=False).size()
    return f"{scenes.idxmax()}: slower in {scenes.max()} cases"


def shares(rows: pd.DataFrame) -> pd.Series:
    """The share of the scenes in which this project takes no longer than the best peer, by accuracy."""
    found = (rows["ratio"] <= WANTED).groupby(rows["accuracy"]).mean().sort_index(ascending=False)
    return found.rename("errors up to {:g}".format)


@of(cases)
def answer(found: pd.DataFrame) -> str:
    """In how many cases a peer is faster, and in how many of them beyond the scatter of the times."""
    slow = found[~(found["ratio"] <= WANTED)]
    certain = slow[~(slow["ratio low"] <= WANTED)]
    text = f"In {len(slow)} of {len(found)} cases (a scene, an error) another package is faster than phasebench"
    if certain.empty:
        return f"{text}, in none beyond the times' scatter."
    return f"{text}; in {len(certain)} beyond the times' scatter: {join_list(certain['scene'].unique(), 2)}."


@style.styled
def draw(data: Data, folder: Path) -> list[Picture] | None:
    """The share of the scenes in which this project is no slower, and the cases in which it is, by the two factors."""
    found, slow = cases(data), above(data)
    if found is None or slow is None:
        return None
    figure, ((left, right),) = style.panels(1, 2, 3.4)
    by = found.groupby("accuracy")
    for k, (label, column) in enumerate((("by its median", "ratio"), ("by its whole interval", "ratio high"))):
        shares = by[column].agg(lambda x: (x <= WANTED).mean())
        left.semilogx(shares.index, 100 * shares, label=label, **style.curve(k))
    left.axhline(100 * OFTEN, color=style.GREY, linewidth=0.8, linestyle=":")
    left.set(xlabel="error up to", ylabel="% of the scenes in which ours is no slower", ylim=(0, 103))
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
        "Left: the share of the scenes in which ours takes no longer than the best peer (dotted: wanted). Right: "
        "the cases in which it takes longer, by the two factors of the ratio; on the line both take as long."
    )
    return [Picture(style.save(figure, folder, "trade-ratios.png"), "ours over the best peer", caption)]


def _side(row: dict, side: str) -> str:
    """The best integrator of a side in a case, with its step or tolerance."""
    name, h, tol = (row[f"{side} {x}"] for x in ("integrator", "h", "tol"))
    if not isinstance(name, str):
        return "none"
    return f"{name}, {'h' if pd.notna(h) else 'tol'} {number(h if pd.notna(h) else tol)}"


def _interval(row: dict) -> str:
    if not 0 < row["ratio"] < np.inf:
        return "peer alone" if row["ratio"] else "ours alone"
    low, high = (number(row[f"ratio {x}"], 3) for x in ("low", "high"))
    return f"{number(row['ratio'], 3)} [{low}, {high}]"


@of(above, RUNGS)
def table(found: pd.DataFrame, rungs: pd.DataFrame) -> Table:
    """Cases in which this project is slower, with the reason: the worst of each scene first, then the next ones."""
    order = found.assign(place=found.groupby("scene").cumcount()).sort_values("place", kind="stable").head(ROWS)
    lines = [
        {
            "scene": f"[{r['scene']}](trade-{r['scene']}.md)",
            "error up to": f"{r['accuracy']:.0e}",
            "ours": _side(r, OURS),
            "peer": _side(r, PEERS),
            "ratio": _interval(r),
            "why": sentence(r, rungs),
        }
        for r in order.sort_values("ratio", ascending=False, kind="stable").to_dict("records")
    ]
    caption = (
        "Cases in which ours takes longer: the worst of each scene first, then the next worst. Why: the reason; "
        "steps and a step's time, ours over the peer's; the share of our time that its evaluations take at their "
        "cheapest; the growth of both sides' steps since the last error at which ours was no slower."
    )
    return Table(pd.DataFrame(lines), caption)


@of(cases, above, RUNGS)
def full_table(found: pd.DataFrame, slow: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """Our time over the best peer's in every case, and the reason if this project is slower."""
    reasons = {(r["scene"], r["accuracy"]): sentence(r, rungs) for r in slow.to_dict("records")}
    keys = zip(found["scene"], found["accuracy"], strict=True)
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "steps", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper", "why"]
    return found.assign(why=[reasons.get(key, "") for key in keys])[columns]


STUDY = Study(
    id="trade-ratios",
    place=20,
    question="On which scenes and accuracies are the established integrators faster, and why?",
    reads=(CHOICES, FINALS, TIMES, RUNGS),
    runs=(),
    answer=answer,
    setting=(
        f"A case is one of {len(QUESTIONS)} scenes and an error from 0.1 to 1e-13 that some integrator reaches. Its "
        "ratio is the time of this project's fastest method over that of the fastest of other packages "
        "at their best settings.",
        "Both run in turns, warm, without output; the interval of a ratio is where a further sweep lies. All is "
        "from the rows of [the trade](trade.md), which says how they are measured and shows every ratio.",
        "A ratio is a product: of the ratio of the numbers of steps, and that of the times of a step.",
        "A run's time is its evaluations (of the gradient of V where H is separable, else of all of H) at the price "
        "of the cheapest evaluation on the scene, and a rest: sums, solving, evaluations outside SIMD lanes.",
        f"Reasons: {'; '.join(f'{reason} ({meaning})' for reason, meaning in MEANING.items())}.",
    ),
    claims={
        "share": Claim(
            "This project's fastest method takes no longer than the fastest peer",
            cases, f"ratio <= {WANTED}", at_least(OFTEN), unit="cases", where=slowest,
        ),
        "everywhere": Claim(
            "At every error this project takes no longer than peers in nearly every scene",
            cases, shares, at_least(OFTEN), unit="of the scenes", span=True,
        ),
        "explanations": Claim(
            "Measured steps and evaluations explain every case in which this project is slower",
            above, "reason == reason", EVERY, unit="cases", where="{scene} to {accuracy:g}", names=3,
        ),
        "scenes": MEASURED,
    },
    figure=draw,
    shown=table,
    whole=full_table,
    command="pytest benchmarks -k trade",
    limits=(
        "The price of an evaluation is a whole run's time divided by its evaluations, where this is least: an upper "
        "bound, by which the share of the evaluations may be too large. One of V alone costs less than one of all "
        "of H.",
        "The fastest peer is not the same at each error, nor is ours: the growth of steps compares whoever was the "
        "fastest.",
        "The order of a Taylor series follows the tolerance: its steps hardly grow in number, but each gets dearer.",
        "The fastest is the fastest found; who was dropped on the way is in data/front_dropped.csv.",
        "Cases that no side reaches are left out. Factors of steps or of a step's time up to "
        f"{ALIKE:g} count as the same; at least {100 * OFTEN:.0f} % of the cases are wanted.",
        "On the page of [the trade](trade.md) a ratio whose interval comes close to 1 is a tie, too: there peers win "
        "fewer cases.",
    ),
)  # fmt: skip
