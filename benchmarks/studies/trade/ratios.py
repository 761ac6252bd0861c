r"""This project's best time over the best peer's, and why it is above 1 where it is, from measured steps and times.

A peer is another package's integrator; a case is a scene (problem, end time, quantity) at an accuracy.  On either side,
the time t is the number of steps n times the time of a step (primes mark the peer):

.. math:: \frac{t}{t'} = \frac{n}{n'} \cdot \frac{t/n}{t'/n'} .

The evaluations in a step of this project's method are counted (of grad V if H is separable, else of grad H).  Their
number times the least time per evaluation of any method of this project on the scene is a share of the step's time.
The rest is a lower bound for everything else in a step (sums, equation solving, evaluations that are not vectorized).
Not all peers count their evaluations.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure.integrator import OURS as PROJECT
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Study
from phasebench.benchmarks.page.verdict import EVERY, at_least
from phasebench.benchmarks.problems.questions import QUESTIONS

from .front import CHOICES, FINALS, RUNGS, TIMES
from .joined import cases
from .trade import MEASURED

#: Largest ratio wanted of our time to the best peer's; factors up to `ALIKE` count as 1.
WANTED, ALIKE = 1.0, 1.1
#: Smallest share of the cells (scene, accuracy) in which this project should take no longer.
OFTEN = 0.95
#: Reasons why the ratio of a cell is above `WANTED`.
UNREACHED, WITHIN, REST = "not reached", "within the interval", "beside evaluations"
MORE, DEARER, BOTH = "more steps", "dearer steps", "more and dearer steps"
#: Reason -> its meaning.
MEANING = {
    UNREACHED: "a peer alone gets there",
    WITHIN: f"the ratio's interval holds {WANTED:.1f}",
    REST: "for its evaluations alone ours would not take longer",
    MORE: "not dearer ones",
    DEARER: "not more of them",
    BOTH: "ours takes more, and each longer",
}


@of(cases, RUNGS)
def above(told: pd.DataFrame, rungs: pd.DataFrame) -> pd.DataFrame:
    """The cases whose ratio of times is above `WANTED`, the largest first, with its factors and the reason.

    Added columns: ``steps`` and ``step``, the two factors of the ratio; ``share``, that of our time which evaluations
    take at the scene's `price`; ``until``, the last coarser accuracy at which the ratio is at most `WANTED`; ``ours
    grew``, ``peer grew``, each side's number of steps over that at the accuracy ``until``; ``reason``, a key of
    `MEANING` or None; ``why``, these in words.
    """
    slow, fast = told[~(told["ratio"] <= WANTED)].reset_index(), told[told["ratio"] <= WANTED]
    before = fast.assign(until=fast["accuracy"])[["scene", "accuracy", "until", f"{OURS} steps", f"{PEERS} steps"]]
    on = {"on": "accuracy", "by": "scene", "direction": "forward", "allow_exact_matches": False}
    slow, before = slow.sort_values("accuracy"), before.sort_values("accuracy")
    slow = pd.merge_asof(slow, before, suffixes=("", " before"), **on).set_index("index").sort_index()
    steps = slow[f"{OURS} steps"] / slow[f"{PEERS} steps"].replace(0, np.nan)
    share = slow[f"{OURS} evaluations"] * slow["scene"].map(price(rungs)) / slow[f"{OURS} seconds"]
    grew = {f"{side} grew": slow[f"{side} steps"] / slow[f"{side} steps before"] for side in (OURS, PEERS)}
    slow = slow.assign(steps=steps, step=slow["ratio"] / steps, share=share.clip(upper=1).fillna(1.0), **grew)
    slow = slow.assign(reason=_reasons(slow)).sort_values("ratio", ascending=False, kind="stable")
    return slow.assign(why=[sentence(row, rungs) for row in slow.to_dict("records")]).reset_index(drop=True)


def price(rungs: pd.DataFrame) -> pd.Series:
    """The least seconds per gradient evaluation of this project's methods in the runs of each scene."""
    own = rungs[(rungs["kind"] == PROJECT) & (rungs["evaluations"] > 0) & (rungs["seconds"] > 0)]
    return (own["seconds"] / own["evaluations"]).groupby(own["scene"]).min()


def _reasons(slow: pd.DataFrame) -> np.ndarray:
    """Why the ratio of each case is above `WANTED`, keys of `MEANING`; None if numbers of steps are not known."""
    more, dearer = slow["steps"] > ALIKE, slow["step"] > ALIKE
    conditions = {
        UNREACHED: np.isinf(slow["ratio"]),
        WITHIN: slow["ratio low"] <= WANTED,
        REST: slow["ratio"] * slow["share"] <= WANTED,
        None: ~(slow["steps"] > 0),
        BOTH: more == dearer,
        MORE: more,
    }
    return np.select([*conditions.values()], [*conditions], DEARER)


def sentence(row: dict, rungs: pd.DataFrame) -> str:
    """Why this project is slower in a case, a row of `above`, in words with the measured numbers."""
    if row["reason"] == UNREACHED:
        own = rungs[(rungs["scene"] == row["scene"]) & (rungs["kind"] == PROJECT) & (rungs["error"] > 0)]
        if own.empty:
            return f"{UNREACHED}: no run of ours is kept"
        best = own.loc[own["error"].idxmin()]
        return f"{UNREACHED}: ours end at {number(float(best['error']), 2)} ({best['integrator']})"
    text = f"{row['reason'] or 'not told'}: steps x {number(row['steps'], 2)}, a step's time x {number(row['step'], 2)}"
    text += f"; evaluations {100 * row['share']:.0f} %" if row["share"] == row["share"] else ""
    if row["ours grew"] == row["ours grew"]:
        grew = f"{number(row['ours grew'], 2)} and {number(row['peer grew'], 2)}"
        text += f"; steps since {row['until']:.0e} x {grew}"
    return text


def slowest(rows: pd.DataFrame) -> str:
    """The scene with the most cases in which a peer is faster, and their number; "" if there is none."""
    scenes = rows[~(rows["ratio"] <= WANTED)].groupby("scene", sort=False).size()
    return f"{scenes.idxmax()}: slower in {scenes.max()} cases" if len(scenes) else ""


def shares(rows: pd.DataFrame) -> pd.Series:
    """The share of the scenes in which this project takes no longer than the best peer, by accuracy."""
    found = (rows["ratio"] <= WANTED).groupby(rows["accuracy"]).mean().sort_index(ascending=False)
    return found.rename("errors up to {:g}".format)


@of(cases)
def _answer(found: pd.DataFrame) -> str:
    slow = found[~(found["ratio"] <= WANTED)]
    certain = slow[~(slow["ratio low"] <= WANTED)]
    text = f"In {len(slow)} of {len(found)} cases (a scene, an error) another package is faster than phasebench"
    if certain.empty:
        return f"{text}, in none beyond the times' scatter."
    return f"{text}; in {len(certain)} beyond the times' scatter: {join_list(certain['scene'].unique(), 2)}."


@picture(
    (cases, above), "trade-ratios", "ours over the best peer",
    "Left: the share of the scenes in which ours takes no longer than the best peer (dotted: wanted). Right: "
    "the cases in which it takes longer, by the two factors of the ratio; on the line both take as long.",
)  # fmt: skip
def _draw(found: pd.DataFrame, slow: pd.DataFrame) -> style.Figure:
    figure, ((left, right),) = style.panels(1, 2, 3.4)
    by = found.groupby("accuracy")
    for k, (label, column) in enumerate((("by its median", "ratio"), ("by its whole interval", "ratio high"))):
        shares = by[column].agg(lambda x: (x <= WANTED).mean())
        left.semilogx(shares.index, 100 * shares, label=label, **style.curve(k))
    left.axhline(100 * OFTEN, color=style.GREY, linewidth=0.8, linestyle=":")
    left.set(xlabel="error up to", ylabel="% of the scenes in which ours is no slower", ylim=(0, 103))
    left.invert_xaxis()
    left.legend(loc="lower left")
    for k, reason in enumerate(reason for reason in MEANING if reason != UNREACHED):
        part = slow[slow["reason"] == reason]
        if len(part):
            look = style.curve(k) | {"linestyle": "none", "markevery": None}
            right.loglog(part["steps"], part["step"], label=reason, **look)
    factors = np.geomspace(0.1, 10, 2)
    right.loglog(factors, WANTED / factors, color=style.GREY, linewidth=0.8)
    right.set(xlabel="steps, ours over the peer's", ylabel="time of a step, ours over the peer's")
    if right.get_legend_handles_labels()[0]:
        right.legend(loc="best")
    return figure


def _side(row: dict, side: str) -> str:
    """The best integrator of a side in a case, with its step or tolerance."""
    name, h, tol = (row[f"{side} {x}"] for x in ("integrator", "h", "tol"))
    if not isinstance(name, str):
        return "none"
    return f"{name}, h {number(h)}" if pd.notna(h) else f"{name}, tol {number(tol)}"


def _interval(row: dict) -> str:
    if not 0 < row["ratio"] < np.inf:
        return "peer alone" if row["ratio"] else "ours alone"
    return f"{number(row['ratio'])} [{number(row['ratio low'])}, {number(row['ratio high'])}]"


@of(above)
def _table(found: pd.DataFrame) -> Table:
    order = found.assign(place=found.groupby("scene").cumcount()).sort_values("place", kind="stable").head(ROWS)
    lines = [
        {
            "scene": f"[{r['scene']}](trade-{r['scene']}.md)",
            "error up to": f"{r['accuracy']:.0e}",
            "ours": _side(r, OURS),
            "peer": _side(r, PEERS),
            "ratio": _interval(r),
            "why": r["why"],
        }
        for r in order.sort_values("ratio", ascending=False, kind="stable").to_dict("records")
    ]
    caption = (
        "Cases in which ours takes longer: the worst of each scene first, then the next worst. Why: the reason; "
        "steps and a step's time, ours over the peer's; the share of our time that its evaluations take at their "
        "cheapest; the growth of both sides' steps since the last error at which ours was no slower."
    )
    return Table(pd.DataFrame(lines), caption)


@of(cases, above)
def _full_table(found: pd.DataFrame, slow: pd.DataFrame) -> pd.DataFrame:
    sides = [f"{side} {x}" for side in (OURS, PEERS) for x in ("integrator", "steps", "seconds")]
    columns = ["scene", "quantity", "accuracy", *sides, "ratio", "ratio low", "ratio high", "cheaper", "why"]
    return found.merge(slow[["scene", "accuracy", "why"]], how="left").fillna({"why": ""})[columns]


STUDY = Study(
    id="trade-ratios",
    place=20,
    question="On which scenes and accuracies are the established integrators faster, and why?",
    reads=(CHOICES, FINALS, TIMES, RUNGS),
    runs=(),
    answer=_answer,
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
    figure=_draw,
    shown=_table,
    whole=_full_table,
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
