"""The report's page of each scene: its work-precision diagram, and the fastest integrators at each error.

A scene is a problem, end time and quantity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks.ladder.race import UNCOMPILED
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, NONE, Count, Verdict, at_least
from phasebench.benchmarks.problems.questions import QUESTIONS, Question

from . import figures
from .choice import HALF, choices, counts, winner
from .front import CHOICES, DROPPED, FINALS, RUNGS
from .settled import TIMES, of_choices

if TYPE_CHECKING:
    from pathlib import Path

#: Name of a reference in the tables -> its description.
TRUTHS = {
    truths.CERTIFIED: "certified states",
    truths.LONG_DOUBLE: "Taylor series in long double at two tolerances",
    truths.ENSEMBLE: "the mean over an ensemble of orbits",
    truths.NONE: "the initial value, which is exact",
}


def _scene(question: Question, *names: str) -> Callable:
    """Decorator: turn a function of one scene's rows in the tables ``names`` into a function of ``data``.

    ``data`` maps a table's name to the table.  The result is None if the scene has no rows in the first table.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        def of_rows(*given: Any) -> Any:
            parts = [t[t["scene"] == question.id] for t in given[: len(names)]]
            return None if parts[0].empty else function(*parts, *given[len(names) :])

        return of_choices(*names[1:])(of_rows) if names[0] == CHOICES else of(*names)(of_rows)

    return decorate


def _wins(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def wins(rows: pd.DataFrame) -> Verdict:
        """Judge whether this project's methods are the fastest in a scene at least as often as the peers."""
        found = choices(rows)
        ours, peers, _, _ = counts(found)
        lost = [f"{a:g}" for a in found.loc[found["cheaper"] == PEERS, "accuracy"]]
        return Verdict(
            "This project's methods are the fastest at least as often as the peers",
            Count(ours, ours + peers),
            at_least(HALF),
            "errors at which one side wins",
            where=f"errors up to {join_list(lost, 3)}" if lost else "",
        )

    return wins


def _reference(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def reference(rows: pd.DataFrame) -> Verdict:
        """Judge whether the reference's uncertainty is small enough for every accuracy of the scene."""
        return Verdict(
            "The reference is certain enough to judge every error",
            Count(len(rows), len(question.accuracies)),
            EVERY,
            "errors",
            where="" if len(rows) == len(question.accuracies) else _truth(rows),
        )

    return reference


def _truth(rows: pd.DataFrame) -> str:
    """Return a text: the kind of reference against which a scene's errors are taken, and its uncertainty."""
    row = rows.iloc[0]
    kind = TRUTHS.get(row["reference"], row["reference"])
    uncertainty = row["reference uncertainty"]
    return f"{kind}, uncertain by {number(uncertainty, 2)}" if uncertainty > 0 else kind


def _compilation(question: Question) -> Callable:
    @_scene(question, DROPPED)
    def compilation(rows: pd.DataFrame) -> Verdict | None:
        """Judge whether no integrator was dropped in a scene because it does not compile."""
        if "why" not in rows or rows["why"].isna().all():
            return None
        uncompiled = rows.loc[rows["why"].str.startswith(UNCOMPILED, na=False), "integrator"]
        return Verdict(
            "No integrator was dropped because it does not compile",
            Count(len(uncompiled), len(rows)),
            NONE,
            "dropped integrators",
            where=join_list(uncompiled, 3) if len(uncompiled) else "",
        )

    return compilation


def _answer(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def answer(rows: pd.DataFrame) -> str:
        """Return the page's answer, a sentence: how often ours and how often peers are the fastest in a scene.

        It also names the fastest integrators at the largest and at the smallest error that any reaches.
        """
        found = choices(rows)
        ours, peers, _, _ = counts(found)
        reached = [row for row in found.sort_values("accuracy").to_dict("records") if winner(row)]
        if not reached:
            return f"No integrator reaches an error of {found['accuracy'].max():g}."
        fine, coarse = reached[0], reached[-1]
        return (
            f"Ties aside, phasebench is the fastest at {ours} of {len(found)} errors from "
            f"{found['accuracy'].max():g} to {found['accuracy'].min():g}, other packages at {peers}: {winner(coarse)} "
            f"for {coarse['accuracy']:g}, {winner(fine)} for {fine['accuracy']:g}."
        )

    return answer


def _table(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def table(rows: pd.DataFrame) -> Table:
        found = choices(rows).sort_values("accuracy", ascending=False)
        shown = pd.DataFrame({"error up to": [f"{a:.0e}" for a in found["accuracy"]]})
        for side, name in ((OURS, "ours"), (PEERS, "peer")):
            part = found.reindex(columns=[f"{side} {x}" for x in ("integrator", "h", "tol", "steps", "seconds")])
            part.columns = ["integrator", "h", "tol", "steps", "seconds"]
            shown[name] = part["integrator"].fillna("none").to_numpy()
            shown[f"h or tol ({name})"] = [
                number(h) if pd.notna(h) else number(tol) for h, tol in zip(part["h"], part["tol"], strict=True)
            ]
            shown[f"steps ({name})"] = ["" if pd.isna(x) else str(int(x)) for x in part["steps"]]
            shown[f"ms ({name})"] = [number(1e3 * x) if np.isfinite(x) else "" for x in part["seconds"]]
        shown["ratio"] = [
            "" if pd.isna(r) else f"{number(r, 2)} [{number(low, 2)}, {number(high, 2)}]"
            for r, low, high in zip(found["ratio"], found["ratio low"], found["ratio high"], strict=True)
        ]
        shown["cheaper"] = found["cheaper"].to_numpy()
        caption = (
            "The fastest of either side at each error, with its step or tolerance. Ratio: our time over the peer's, "
            f"with the interval in which a further sweep lies. Errors are taken against: {_truth(rows)}."
        )
        return Table(shown, caption)

    return table


def _draw(question: Question) -> Callable:
    @_scene(question, FINALS, RUNGS)
    def draw(finals: pd.DataFrame, rungs: pd.DataFrame, folder: Path) -> list[Picture]:
        return [figures.work_precision(question, finals, rungs, folder)]

    return draw


def page_of(question: Question) -> Page:
    """Build the page of a scene (a problem, end time, quantity and accuracies)."""
    return Page(
        id=f"trade-{question.id}",
        question=f"{question.problem}, {question.about}: which integrator is the fastest?",
        tables=(CHOICES, FINALS, TIMES, RUNGS, DROPPED),
        setting=(
            f"Problem: {question.problem}, from its initial data to t = {question.t_end:g}.",
            f"Wanted: {question.quantity} ({question.about}), to an error of {question.accuracies[0]:g} down to "
            f"{question.accuracies[-1]:g}.",
            "How it is measured is said on [the page of the trade](trade.md).",
        ),
        verdicts=(_wins(question), _reference(question), _compilation(question)),
        answer=_answer(question),
        figures=_draw(question),
        table=_table(question),
        limits=(
            "Which integrators were dropped, at which step, and by which they were beaten: data/front_dropped.csv.",
        ),
        command=f"pytest benchmarks/experiments/trade -k {question.id}",
        listed=False,
    )


PAGES = tuple(page_of(q) for q in QUESTIONS)
