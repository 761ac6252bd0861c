"""The talks, statement by statement: a page with those that do not plainly hold, and one for each section with all."""

from __future__ import annotations

from functools import partial

import pandas as pd

from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table, Verdict

from .judging import CONTRADICTED, HOLDS, KEPT_TEXT, MISSING, UNTESTABLE, VERDICTS, WHERE
from .statements import SECTIONS, Section

COLUMNS = ("talk", "where", "kind", "says", "verdict", "measured", "shown on")


def judged(section: Section, data: Data) -> pd.DataFrame:
    """A row for each statement of a section, with what the rows say of it."""
    rows = []
    for statement in section.statements:
        found = statement.judged(data)
        row = {"talk": section.talk, "where": statement.where, "kind": statement.kind, "says": statement.words}
        row |= {
            "verdict": found.verdict,
            "measured": found.measured,
            "shown on": f"[{statement.page}]({statement.page}.md)",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def everything(data: Data) -> pd.DataFrame:
    """The rows of all sections."""
    return pd.concat([judged(section, data) for section in SECTIONS], ignore_index=True)


def _measured(rows: pd.DataFrame) -> bool:
    return bool(rows["verdict"].isin([HOLDS, WHERE, CONTRADICTED]).any())


def _named(rows: pd.DataFrame, limit: int = 4) -> str:
    return listed([f"{r.where} ({r.says})" for r in rows.itertuples()], limit)


def counted(rows: pd.DataFrame) -> Verdict | None:
    """How many statements hold."""
    if not _measured(rows):
        return None
    number = {v: int((rows["verdict"] == v).sum()) for v in VERDICTS}
    text = f"{number[HOLDS]} of {len(rows)} statements hold; {WHERE} a condition is met: {number[WHERE]}"
    others = [v for v in (CONTRADICTED, UNTESTABLE, MISSING) if number[v] or v == CONTRADICTED]
    text += "".join(f", {v}: {number[v]}" for v in others)
    short = f"{number[HOLDS]} of {len(rows)} statements hold, contradicted: {number[CONTRADICTED]}."
    return Verdict(f"{text}.", number[MISSING] == 0, short)


def contradicted(rows: pd.DataFrame) -> Verdict | None:
    """Which statements are contradicted."""
    if not _measured(rows):
        return None
    wrong = rows[rows["verdict"] == CONTRADICTED]
    text = f"Contradicted: {_named(wrong)}." if len(wrong) else "No statement is contradicted."
    what = listed(list(dict.fromkeys(wrong["where"])), 4)
    return Verdict(text, wrong.empty, f"Contradicted: {what}." if len(wrong) else text)


def conditional(rows: pd.DataFrame) -> Verdict | None:
    """Which statements hold under a condition only."""
    if not _measured(rows):
        return None
    some = rows[rows["verdict"] == WHERE]
    text = f"Only under a condition: {_named(some, 10)}." if len(some) else "None needs a condition."
    return Verdict(text, some.empty, text)


def _of_section(verdict, section: Section):
    return lambda data: verdict(judged(section, data))


def _of_all(verdict):
    return lambda data: verdict(everything(data))


def _section_table(section: Section, data: Data) -> Table | None:
    rows = judged(section, data)
    if not _measured(rows):
        return None
    return Table(rows[list(COLUMNS[1:])], "Every statement in the talk's order, with what the suite measured of it.")


def exceptions(data: Data) -> Table | None:
    """The statements that do not plainly hold: those contradicted first."""
    rows = everything(data)
    if not _measured(rows):
        return None
    order = {CONTRADICTED: 0, MISSING: 1, WHERE: 2, UNTESTABLE: 3}
    part = rows[rows["verdict"] != HOLDS]
    part = part.assign(rank=part["verdict"].map(order)).sort_values("rank", kind="stable").head(ROWS)
    if part.empty:
        part = rows.head(ROWS)
    caption = "Every statement that does not plainly hold; the others are on the sections' pages."
    return Table(part[list(COLUMNS)], caption)


def _whole(data: Data) -> pd.DataFrame:
    return everything(data)[list(COLUMNS[:-1])]


LIMITS = (
    KEPT_TEXT,
    "The words are this suite's; a statement is judged in its plain sense, on the systems that the measurement names.",
    "Every check has a control for which the statement must fail, in data/talk_checks.csv.",
)
LINKS = ", ".join(f"[{s.id}](talks-{s.id}.md)" for s in SECTIONS)
PAGE = Page(
    id="talks",
    question="What do the two talks state, and does it hold?",
    tables=tuple(dict.fromkeys(name for s in SECTIONS for name in s.tables)),
    setting=(
        "“Symplectic Integration of Hamiltonian Systems”, an introduction, and “A general symplectic integrator for "
        "canonical Hamiltonian systems” (Y. Wang with Y. Bo and W. Cai).",
        "Every definition, theorem, remark, table, figure, formula, method and system has a row, in the talks' order.",
        f"All of them, section by section: {LINKS}.",
    ),
    verdicts=(_of_all(contradicted), _of_all(counted), _of_all(conditional)),
    limits=LIMITS,
    command="pytest benchmarks/experiments/talks",
    table=exceptions,
    whole=_whole,
)


def _page(section: Section) -> Page:
    return Page(
        id=f"talks-{section.id}",
        question=section.title,
        tables=section.tables,
        setting=(
            f"The talk on the {section.talk}; the rows are in its order.",
            "What does not plainly hold in either talk is on [the talks' page](talks.md).",
        ),
        verdicts=tuple(_of_section(v, section) for v in (contradicted, counted, conditional)),
        limits=LIMITS,
        command="pytest benchmarks/experiments/talks",
        table=partial(_section_table, section),
    )


PAGES = (PAGE, *map(_page, SECTIONS))
