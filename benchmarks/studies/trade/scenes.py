"""A page for each scene: its work-precision diagram, and the fastest integrators at each error."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.ladder.choice import choices, winner
from phasebench.benchmarks.ladder.race import UNCOMPILED
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Data, Picture, Table
from phasebench.benchmarks.page.study import Claim, Study, rows_of
from phasebench.benchmarks.page.verdict import EVERY, NONE, Count, at_least
from phasebench.benchmarks.problems.questions import QUESTIONS, Question

from .front import CHOICES, DROPPED, FINALS, RUNGS, TIMES
from .joined import joined
from .trade import HALF, counts

#: Name of a reference in the tables -> its description.
TRUTHS = {
    truths.CERTIFIED: "certified states",
    truths.LONG_DOUBLE: "Taylor series in long double at two tolerances",
    truths.ENSEMBLE: "the mean over an ensemble of orbits",
    truths.NONE: "the initial value, which is exact",
}
#: Largest number of curves of each side in a work-precision diagram; smaller errors are drawn at `FLOOR`.
CURVES, FLOOR = {OURS: 5, PEERS: 4}, 1e-16
#: What the table shows of the fastest integrator of a side.
COLUMNS = ["integrator", "h", "tol", "steps", "seconds"]


def _of_scene(question: Question, table: object, data: Data) -> pd.DataFrame | None:
    return rows_of(data, table, f"scene == '{question.id}'")


def won(rows: pd.DataFrame) -> Count:
    """The errors at which ours is the fastest, of those at which one side is."""
    ours, peers, _ = counts(choices(rows))
    return Count(ours, ours + peers)


def lost(rows: pd.DataFrame) -> str:
    """The errors at which a peer is the fastest."""
    errors = [f"{a:g}" for a in rows["accuracy"][choices(rows)["cheaper"] == PEERS]]
    return f"errors up to {join_list(errors, 3)}" if errors else ""


def truth_of(rows: pd.DataFrame) -> str:
    """The kind of reference against which a scene's errors are taken, and its uncertainty."""
    name, uncertainty = rows[["reference", "reference uncertainty"]].iloc[0]
    kind = TRUTHS.get(name, name)
    return f"{kind}, uncertain by {number(uncertainty, 2)}" if uncertainty > 0 else kind


def unjudged(question: Question, rows: pd.DataFrame) -> str:
    """The reference, if it is too uncertain for some error."""
    told = truth_of(rows)
    return "" if len(rows) == len(question.accuracies) else told


def _answer(question: Question, data: Data) -> str | None:
    found = _of_scene(question, joined, data)
    if found is None:
        return None
    ours, peers, _ = counts(found)
    most, least = found["accuracy"].max(), found["accuracy"].min()
    reached = [row for row in found.sort_values("accuracy").to_dict("records") if winner(row)]
    if not reached:
        return f"No integrator reaches an error of {most:g}."
    best = [f"{winner(row)} for {row['accuracy']:g}" for row in (reached[-1], reached[0])]
    return (
        f"Ties aside, phasebench is the fastest at {ours} of {len(found)} errors from {most:g} to {least:g}, "
        f"other packages at {peers}: {', '.join(best)}."
    )


def _table(question: Question, data: Data) -> Table | None:
    found = _of_scene(question, joined, data)
    if found is None:
        return None
    rows = found.sort_values("accuracy", ascending=False)
    shown = {"error up to": [f"{a:.0e}" for a in rows["accuracy"]]}
    for side, name in ((OURS, "ours"), (PEERS, "peer")):
        best = rows.reindex(columns=[f"{side} {x}" for x in COLUMNS]).set_axis(COLUMNS, axis=1)
        shown[name] = best["integrator"].fillna("none")
        shown[f"h or tol ({name})"] = best["h"].fillna(best["tol"]).map(number)
        shown[f"steps ({name})"] = ["" if pd.isna(n) else str(int(n)) for n in best["steps"]]
        shown[f"ms ({name})"] = (1e3 * best["seconds"]).map(number)
    shown["ratio"] = [
        "" if pd.isna(ratio) else f"{number(ratio, 2)} [{number(low, 2)}, {number(high, 2)}]"
        for ratio, low, high in rows[["ratio", "ratio low", "ratio high"]].itertuples(index=False)
    ]
    caption = (
        "The fastest of either side at each error, with its step or tolerance. Ratio: our time over the peer's, "
        f"with the interval in which a further sweep lies. Errors are taken against: {truth_of(found)}."
    )
    return Table(pd.DataFrame(shown | {"cheaper": rows["cheaper"]}), caption)


def integrators_to_draw(finals: pd.DataFrame, side: str, most: int) -> list[str]:
    """The integrators that are most often the fastest of their side, over accuracies."""
    part = finals[finals["side"] == side]
    best = part.loc[part.groupby("accuracy")["seconds"].idxmin(), "integrator"]
    return list(best.value_counts().index[:most])


@style.styled
def _draw(question: Question, data: Data, folder: Path) -> list[Picture] | None:
    finals, rungs = (_of_scene(question, name, data) for name in (FINALS, RUNGS))
    if finals is None or rungs is None:
        return None
    figure, (panels,) = style.panels(1, 2, 3.6, sharey=True)
    looks = iter(style.looks())
    for side, most in CURVES.items():
        for name in integrators_to_draw(finals, side, most):
            curve = rungs[(rungs["integrator"] == name) & (rungs["error"] > 0)]
            look = next(looks) | ({} if side == OURS else {"markerfacecolor": "white"})
            label = name if side == OURS else f"{name} (peer)"
            for axes, column in zip(panels, ("seconds", "steps"), strict=True):
                axes.loglog(curve[column], curve["error"].clip(lower=FLOOR), label=label, **look)
    front = finals.loc[finals.groupby("accuracy")["seconds"].idxmin()].sort_values("accuracy")
    panels[0].loglog(front["seconds"], front["accuracy"], color="black", linewidth=4, alpha=0.15, label="the front")
    panels[0].set(xlabel="warm integration (s)", ylabel=f"error ({question.quantity})")
    panels[1].set(xlabel="steps")
    for axes in panels:
        axes.grid(color="0.93", linewidth=0.5)
        axes.set_ylim(FLOOR, 10 * max(question.accuracies))
    style.legend_above(figure, panels[0], 3)
    caption = (
        f"Error of {question.id} over the seconds of a warm run without output, and over its steps: the integrators of "
        "each side that are its fastest at most errors. Filled marks: ours; white: peers; grey: the fastest of all."
    )
    return [Picture(style.save(figure, folder, f"trade-{question.id}.png"), question.about, caption)]


def study_of(place: float, question: Question) -> Study:
    """The page of a scene."""
    errors, here = len(question.accuracies), f"scene == '{question.id}'"
    return Study(
        id=f"trade-{question.id}",
        place=place,
        question=f"{question.problem}, {question.about}: which integrator is the fastest?",
        reads=(CHOICES, FINALS, TIMES, RUNGS, DROPPED),
        runs=(),
        answer=partial(_answer, question),
        setting=(
            f"Problem: {question.problem}, from its initial data to t = {question.t_end:g}.",
            f"Wanted: {question.quantity} ({question.about}), to an error of {question.accuracies[0]:g} down to "
            f"{question.accuracies[-1]:g}.",
            "How it is measured is said on [the page of the trade](trade.md).",
        ),
        claims={
            "wins": Claim(
                "This project's methods are the fastest at least as often as the peers",
                joined, won, at_least(HALF), rows=here, unit="errors at which one side wins", where=lost,
            ),
            "reference": Claim(
                "The reference is certain enough to judge every error",
                joined, lambda rows: Count(len(rows), errors), EVERY, rows=here, unit="errors",
                where=partial(unjudged, question),
            ),
            "compilation": Claim(
                "No integrator was dropped because it does not compile",
                DROPPED, lambda rows: rows["why"].str.startswith(UNCOMPILED), NONE, rows=f"{here} and why == why",
                unit="dropped integrators", where="{integrator}", names=3,
            ),
        },
        figure=partial(_draw, question),
        shown=partial(_table, question),
        whole=lambda data: None,
        command=f"pytest benchmarks -k {question.id}",
        listed=False,
        limits=(
            "Which integrators were dropped, at which step, and by which they were beaten: data/front_dropped.csv.",
        ),
    )  # fmt: skip


STUDIES = tuple(study_of(470 + k / 1000, question) for k, question in enumerate(QUESTIONS))
