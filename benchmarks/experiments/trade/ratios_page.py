"""The report's page "trade-ratios": this project's best time over the best peer's, and why it is above 1 where it is.

A peer is another package's integrator; a case is a scene (problem, end time, quantity) at an accuracy.  ``front`` has
a row for each case, ``rungs`` one for each run of the search for the fastest integrators.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table
from phasebench.benchmarks.page.verdict import EVERY, Count, Range, Verdict, at_least
from phasebench.benchmarks.problems.questions import QUESTIONS

from .front import CHOICES, FINALS, RUNGS
from .page import scenes_with_rows
from .reasons import ALIKE, MEANING, UNREACHED, WANTED, above, cells, sentence
from .settled import TIMES, of_choices

if TYPE_CHECKING:
    from pathlib import Path

#: Smallest share of the cells (scene, accuracy) in which this project should take no longer.
OFTEN = 0.95
#: Reasons that the figure shows, as points over the two factors of the ratio.
DRAWN = [reason for reason in MEANING if reason != UNREACHED]


@of_choices()
def share(front: pd.DataFrame) -> Verdict:
    """Judge whether this project takes no longer than the best peer in nearly all cases.

    A case is a row of ``front``: a scene at an accuracy.
    """
    found = cells(front)
    slow = found[~(found["ratio"] <= WANTED)]
    return Verdict(
        "This project's fastest method takes no longer than the fastest peer",
        Count(len(found) - len(slow), len(found)),
        at_least(OFTEN),
        "cases",
        where=_slowest(slow),
    )


def _slowest(slow: pd.DataFrame) -> str:
    """Return a text: the scene with the most cases in which a peer is faster, and their number; "" if there is none.

    ``slow`` has a row for each case (a scene at an accuracy) in which a peer is faster.
    """
    if slow.empty:
        return ""
    scenes = slow.groupby("scene", sort=False).size()
    return f"{scenes.idxmax()}: slower in {scenes.max()} cases"


@of_choices()
def everywhere(front: pd.DataFrame) -> Verdict:
    """Judge whether, at each accuracy, this project takes no longer than the best peer in nearly all scenes."""
    found = cells(front)
    shares = (found["ratio"] <= WANTED).groupby(found["accuracy"]).mean().sort_index(ascending=False)
    return Verdict(
        "At every error this project takes no longer than peers in nearly every scene",
        Range(shares.min(), shares.max()),
        at_least(OFTEN),
        "of the scenes",
        where=f"errors up to {shares.idxmin():g}",
    )


@of_choices(RUNGS)
def explanations(front: pd.DataFrame, rungs: pd.DataFrame) -> Verdict | None:
    """Judge whether measured steps and evaluations explain every case in which this project is slower than a peer.

    None if there is no such case.
    """
    found = above(front, rungs)
    if found.empty:
        return None
    unknown = found[found["reason"].isna()]
    return Verdict(
        "Measured steps and evaluations explain every case in which this project is slower",
        Count(len(found) - len(unknown), len(found)),
        EVERY,
        "cases",
        where=", ".join(f"{r['scene']} to {r['accuracy']:g}" for _, r in unknown.head(3).iterrows()),
    )


@of_choices()
def answer(front: pd.DataFrame) -> str:
    """Return the page's answer, a sentence: in how many cases (a scene at an accuracy) a peer is faster.

    It says in how many of them the whole interval of the ratio is above 1, beyond the scatter of the times.
    """
    found = cells(front)
    slow = found[~(found["ratio"] <= WANTED)]
    certain = slow[~(slow["ratio low"] <= WANTED)]
    text = f"In {len(slow)} of {len(found)} cases (a scene, an error) another package is faster than phasebench"
    if certain.empty:
        return f"{text}, in none beyond the times' scatter."
    return f"{text}; in {len(certain)} beyond the times' scatter: {join_list(certain['scene'].unique(), 2)}."


@of_choices(RUNGS)
@style.styled
def draw(front: pd.DataFrame, rungs: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw in which share of the scenes this project is no slower than peers, by accuracy; and why it is slower.

    A ratio of times is the product of two factors, the ratio of the numbers of steps and that of the times of a step;
    the cases in which this project is slower are points in the plane of the two.
    """
    found, slow = cells(front), above(front, rungs)
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
    """Return a text: the best integrator of a side (ours or the peers) in a row, with its step or tolerance."""
    name, h, tol = (row[f"{side} {x}"] for x in ("integrator", "h", "tol"))
    if not isinstance(name, str):
        return "none"
    return f"{name}, {'h' if pd.notna(h) else 'tol'} {number(h if pd.notna(h) else tol)}"


def _interval(row: dict) -> str:
    if not 0 < row["ratio"] < np.inf:
        return "peer alone" if row["ratio"] else "ours alone"
    low, high = (number(row[f"ratio {x}"], 3) for x in ("low", "high"))
    return f"{number(row['ratio'], 3)} [{low}, {high}]"


@of_choices(RUNGS)
def table(front: pd.DataFrame, rungs: pd.DataFrame) -> Table | None:
    """Return the page's table: cases in which this project is slower than a peer, with the reason.

    The case with the largest ratio of each scene is taken first, then the next ones, up to `ROWS` lines.
    """
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


@of_choices(RUNGS)
def _full_table(front: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """Return the page's long table: for each scene and accuracy our time over the best peer's.

    The last column is the reason if this project is slower, or "".
    """
    found, slow = cells(front), above(front, rungs)
    reasons = {(r["scene"], r["accuracy"]): sentence(r, rungs) for r in slow.to_dict("records")}
    keys = zip(found["scene"], found["accuracy"], strict=True)
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "steps", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper", "why"]
    return found.assign(why=[reasons.get(key, "") for key in keys])[columns]


PAGE = Page(
    id="trade-ratios",
    question="On which scenes and accuracies are the established integrators faster, and why?",
    tables=(CHOICES, FINALS, TIMES, RUNGS),
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
    verdicts=(share, everywhere, explanations, scenes_with_rows),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
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
    command="pytest benchmarks/experiments/trade",
)
