"""A page for every scene of the trade: the work-precision diagram, and the cheapest of either side at each accuracy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Page, Picture, Table, Verdict, of
from phasebench.benchmarks.problems.questions import QUESTIONS, Question

from . import figures
from .choice import changes, choices, counts
from .climb import UNCOMPILED
from .front import CHOICES, DROPPED, FINALS, RUNGS
from .settled import TIMES, of_choices

WHO = {OURS: "this project's methods", PEERS: "the peers"}


def _scene(question: Question, *names: str) -> Callable:
    """Make a function of these tables' rows of a scene one of ``data``; None where one has none."""

    def decorate(function):
        def of_rows(*given):
            parts = [t[t["scene"] == question.id] for t in given[: len(names)]]
            return None if parts[0].empty else function(*parts, *given[len(names) :])

        return of_choices(*names[1:])(of_rows) if names[0] == CHOICES else of(*names)(of_rows)

    return decorate


def _advice(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def advice(rows: pd.DataFrame) -> Verdict:
        """Who is the cheaper, and where that changes."""
        found = choices(rows)
        ours, peers, tied, none = counts(found)
        text = f"Of {len(found)} accuracies this project's methods are the cheaper at {ours}, the peers at {peers}"
        text += f", {tied} {'is a tie' if tied == 1 else 'are ties'}" if tied else ""
        text += f", {none} {'is' if none == 1 else 'are'} reached by none" if none else ""
        turns = [f"from {a:g} on {WHO[who]}" for a, _, who in changes(found)]
        first = next((w for w in found.sort_values("accuracy", ascending=False)["cheaper"] if w in WHO), None)
        if turns:
            text += f". The advice changes: {WHO[first]} first, {', '.join(turns)}"
        return Verdict(f"{text}.", ours >= peers, f"Ours {ours}, peers {peers}, ties {tied}.")

    return advice


def _reference(question: Question) -> Callable:
    @_scene(question, CHOICES)
    def reference(rows: pd.DataFrame) -> Verdict | None:
        """What the errors are against, and whether every accuracy was asked."""
        row, asked = rows.iloc[0], len(rows)
        text = f"What is true: {row['reference']}"
        if row["reference uncertainty"] > 0:
            text += f", uncertain by {number(row['reference uncertainty'], 2)}"
        missing = len(question.accuracies) - asked
        text += f"; {missing} accuracies below that are not asked" if missing else "; every accuracy can be told"
        return Verdict(f"{text}.", not missing, f"{asked} accuracies told.")

    return reference


def _eliminated(question: Question) -> Callable:
    @_scene(question, DROPPED)
    def eliminated(rows: pd.DataFrame) -> Verdict | None:
        """How many were dropped on the way; that one does not compile is a finding."""
        if "why" not in rows or rows["why"].isna().all():
            return None
        uncompiled = rows["why"].str.startswith(UNCOMPILED, na=False)
        beaten = (rows["why"].str.contains("times", na=False) & ~uncompiled).sum()
        others = len(rows) - beaten - uncompiled.sum()
        text = f"{beaten} were dropped on the way as too slow, {others} cannot do the problem or fail on it"
        if uncompiled.any():
            text += f", {uncompiled.sum()} do not compile ({rows.loc[uncompiled, 'integrator'].iloc[0]} first)"
        return Verdict(f"{text}.", not uncompiled.any(), f"{text}.")

    return eliminated


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
            "The cheapest of either side for an error up to so much; ratio: ours over the peer's, with the interval in "
            "which a further sweep lies."
        )
        return Table(shown, caption)

    return table


def _draw(question: Question) -> Callable:
    @_scene(question, FINALS, RUNGS)
    def draw(finals: pd.DataFrame, rungs: pd.DataFrame, folder) -> list[Picture]:
        return [figures.work_precision(question, finals, rungs, folder)]

    return draw


def page_of(question: Question) -> Page:
    """The page of a scene."""
    made = question.problem
    return Page(
        id=f"trade-{question.id}",
        question=f"{question.about[0].upper()}{question.about[1:]}: which integrator is the cheapest?",
        tables=(CHOICES, FINALS, TIMES, RUNGS, DROPPED),
        setting=(
            f"Problem: {made}, from its initial data to t = {question.t_end:g}.",
            f"Wanted: {question.quantity}.",
            "How it is measured is said on [the page of the trade](trade.md).",
        ),
        verdicts=(_advice(question), _reference(question), _eliminated(question)),
        figures=_draw(question),
        table=_table(question),
        limits=("Who was dropped, on which rung and by whom beaten: data/front_dropped.csv.",),
        command=f"pytest benchmarks/experiments/trade -k {question.id}",
        listed=False,
    )


PAGES = tuple(page_of(q) for q in QUESTIONS)
