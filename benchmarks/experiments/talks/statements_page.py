"""The report's pages on the two talks' statements: one for each section, and one of the statements that fail."""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial
from typing import Any

import pandas as pd

from phasebench.benchmarks.page.page import ROWS, Data, Page, Table
from phasebench.benchmarks.page.verdict import NONE, Count, Verdict

from .judging import CONTRADICTED, HOLDS, KEPT_TEXT, MISSING, UNTESTABLE, WHERE
from .statements import SECTIONS, Section

COLUMNS = ("talk", "where", "kind", "says", "verdict", "measured", "shown on")


def judgement_table(section: Section, data: Data) -> pd.DataFrame:
    """Judge the statements of a section: a row for each, with its verdict and the measured numbers.

    ``data`` maps a table's name to the measured table or None.
    """
    rows = []
    for statement in section.statements:
        found = statement.judgement(data)
        row = {"talk": section.talk, "where": statement.where, "kind": statement.kind, "says": statement.words}
        row |= {
            "verdict": found.verdict,
            "measured": found.measured,
            "shown on": f"[{statement.page}]({statement.page}.md)",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def everything(data: Data) -> pd.DataFrame:
    """Judge the statements of all sections of both talks: a row for each, with its verdict and the measured numbers."""
    return pd.concat([judgement_table(section, data) for section in SECTIONS], ignore_index=True)


def of_measured(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a function of judged statements (rows): it returns None if none of the statements was measured."""

    @functools.wraps(function)
    def of_rows(rows: pd.DataFrame, *more: Any) -> Any:
        return function(rows, *more) if rows["verdict"].isin([HOLDS, WHERE, CONTRADICTED]).any() else None

    return of_rows


def _places(rows: pd.DataFrame) -> str:
    """Return a text with the places in the talk of the first three statements in ``rows``, and the number of others."""
    names = list(dict.fromkeys(rows["where"]))
    return "; ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


@of_measured
def contradictions(rows: pd.DataFrame) -> Verdict:
    """Judge whether no statement of the talks is contradicted; ``rows`` has a row for each judged statement."""
    some = rows[rows["verdict"] == CONTRADICTED]
    return Verdict("No statement is contradicted", Count(len(some), len(rows)), NONE, "statements", _places(some))


@of_measured
def conditional(rows: pd.DataFrame) -> Verdict:
    """Judge whether no statement of the talks holds only under a condition that the talk does not state.

    ``rows`` has a row for each judged statement.
    """
    some = rows[rows["verdict"] == WHERE]
    return Verdict("No statement needs a condition", Count(len(some), len(rows)), NONE, "statements", _places(some))


@of_measured
def complete(rows: pd.DataFrame) -> Verdict:
    """Judge whether every testable statement of the talks was measured; ``rows`` has a row for each statement."""
    some = rows[rows["verdict"] == MISSING]
    return Verdict("No statement is left unmeasured", Count(len(some), len(rows)), NONE, "statements", _places(some))


@of_measured
def answer(rows: pd.DataFrame, statements_of: str) -> str:
    """Return a page's answer, a sentence: how many of the judged statements hold, and which are contradicted.

    ``statements_of`` is a phrase that names the statements, such as "statements of two talks".
    """
    number, wrong = rows["verdict"].value_counts(), rows[rows["verdict"] == CONTRADICTED]
    return (
        f"Of {len(rows)} {statements_of}, {number.get(HOLDS, 0)} hold, {number.get(WHERE, 0)} only under a condition; "
        f"contradicted: {f'{len(wrong)} ({_places(wrong)})' if len(wrong) else 'none'}."
    )


def _verdicts(rows_of: Callable[[Data], pd.DataFrame]) -> tuple:
    """Return a page's three verdicts as functions of ``data``: on contradictions, conditions and missing rows.

    ``rows_of`` maps ``data`` (table name -> table) to rows of judged statements.
    """
    return tuple(lambda data, judge=judge: judge(rows_of(data)) for judge in (contradictions, conditional, complete))


@of_measured
def _all_rows(rows: pd.DataFrame) -> Table:
    return Table(rows[list(COLUMNS[1:])], "Every statement in the order of the talk, with what was measured.")


@of_measured
def _exceptions(rows: pd.DataFrame) -> Table:
    order = {CONTRADICTED: 0, MISSING: 1, WHERE: 2, UNTESTABLE: 3}
    part = rows[rows["verdict"] != HOLDS]
    part = part.assign(rank=part["verdict"].map(order)).sort_values("rank", kind="stable").head(ROWS)
    if part.empty:
        part = rows.head(ROWS)
    caption = "Every statement that does not hold as it stands; the others are on the pages of the sections."
    return Table(part[list(COLUMNS)], caption)


def exceptions(data: Data) -> Table | None:
    """Return the table of the talks' statements that do not hold as stated, contradicted ones first.

    None if nothing was measured.
    """
    return _exceptions(everything(data))


def _full_table(data: Data) -> pd.DataFrame:
    return everything(data)[list(COLUMNS[:-1])]


LIMITS = (
    KEPT_TEXT,
    "The statements are paraphrased here and judged in their plain sense, on the systems that the measurement names.",
    "Checks in double precision have limits of their own; each has a control for which the statement must fail, in "
    "data/talk_checks.csv.",
)
LINKS = ", ".join(f"[{s.id}](talks-{s.id}.md)" for s in SECTIONS)
PAGE = Page(
    id="talks",
    question="Do the statements of the two talks hold?",
    tables=tuple(dict.fromkeys(name for s in SECTIONS for name in s.tables)),
    setting=(
        "The talks: “Symplectic Integration of Hamiltonian Systems”, an introduction, and “A general symplectic "
        "integrator for canonical Hamiltonian systems” (Y. Wang with Y. Bo and W. Cai).",
        "Every definition, theorem, remark, table, figure, formula, method and system of theirs is a statement.",
        f"All statements, section by section: {LINKS}.",
    ),
    verdicts=_verdicts(everything),
    answer=lambda data: answer(everything(data), "statements of two talks on symplectic integration"),
    limits=LIMITS,
    command="pytest benchmarks/experiments/talks",
    table=exceptions,
    whole=_full_table,
)


def _page(section: Section) -> Page:
    rows_of = partial(judgement_table, section)
    return Page(
        id=f"talks-{section.id}",
        question=section.question,
        tables=section.tables,
        setting=(
            f"Definitions, theorems, remarks, tables, figures, formulas, methods and systems of the {section.talk}.",
            "What does not hold as it stands, in both talks: [talks](talks.md).",
        ),
        verdicts=_verdicts(rows_of),
        answer=lambda data: answer(rows_of(data), section.statements_of),
        limits=LIMITS,
        command="pytest benchmarks/experiments/talks",
        table=lambda data: _all_rows(rows_of(data)),
    )


PAGES = (PAGE, *map(_page, SECTIONS))
