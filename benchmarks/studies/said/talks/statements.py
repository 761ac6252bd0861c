"""The pages of the talks' statements: one for each section of `talks.toml`, and one of those that fail."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd

from phasebench.benchmarks.judge.evidence import GATE, NO_DEFECT
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE
from phasebench.benchmarks.page.page import ROWS, Data, Table
from phasebench.benchmarks.page.study import Claim, Runs, Study, over
from phasebench.benchmarks.page.verdict import NONE
from phasebench.benchmarks.problems import PROBLEMS
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import METHODS, method

from . import checks_flows, checks_schemes, figures
from .judges import REPRODUCED, ROUND_OFF, judge
from .measure import CHECKS, CURVES

PROBES = {probe.id: probe for probe in (*checks_flows.CHECKS, *checks_schemes.CHECKS)}
SECTIONS = tomllib.loads(Path(__file__).parent.with_suffix(".toml").read_text(encoding="utf-8"))
COLUMNS = ["talk", "where", "kind", "says", "verdict", "measured", "shown on"]


def probe(check: str) -> dict:
    """The number that tests a statement, and its control, with their descriptions."""
    one = PROBES[check]
    value, control = one.measure()
    return {"value": float(value), "control": float(control), "what": one.what, "against": one.against}


def _needs(check: str) -> tuple:
    return (*map(method, PROBES[check].methods), *map(ProblemKey, PROBES[check].problems))


# -- judging -----------------------------------------------------------------------------------------------------------


def judged(sections: tuple[str, ...], data: Data) -> pd.DataFrame | None:
    """A row for each statement of sections, with its verdict and the measured numbers; None if none was measured."""
    rows = []
    for section in sections:
        for where, kind, says, page, *judges in SECTIONS[section]["said"]:
            found = judge(data, judges)
            row = [SECTIONS[section]["talk"], where, kind, says, found.verdict, found.measured, f"[{page}]({page}.md)"]
            rows.append(row)
    frame = pd.DataFrame(rows, columns=COLUMNS)
    kinds = {"contradicted": CONTRADICTED, "conditional": WHERE, "missing": MISSING}
    frame = frame.assign(**{name: frame["verdict"] == verdict for name, verdict in kinds.items()})
    return frame if frame["verdict"].isin([HOLDS, WHERE, CONTRADICTED]).any() else None


def places(rows: pd.DataFrame) -> str:
    """The places in the talk of the first three statements, and the number of others."""
    names = list(dict.fromkeys(rows["where"]))
    return "; ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _claims(table: Callable[[Data], pd.DataFrame | None]) -> dict[str, Claim]:
    found = {
        "contradicted": Claim("No statement is contradicted", table, "contradicted", NONE),
        "conditional": Claim("No statement needs a condition", table, "conditional", NONE),
        "missing": Claim("No statement is left unmeasured", table, "missing", NONE),
    }
    return {
        kind: replace(claim, unit="statements", where=lambda rows, kind=kind: places(rows[rows[kind]]))
        for kind, claim in found.items()
    }


def answer(table: Callable[[Data], pd.DataFrame | None], statements_of: str, data: Data) -> str | None:
    """How many of the judged statements hold, and which are contradicted."""
    rows = table(data)
    if rows is None:
        return None
    number, wrong = rows["verdict"].value_counts(), rows[rows["contradicted"]]
    return (
        f"Of {len(rows)} {statements_of}, {number.get(HOLDS, 0)} hold, {number.get(WHERE, 0)} only under a condition; "
        f"contradicted: {f'{len(wrong)} ({places(wrong)})' if len(wrong) else 'none'}."
    )


def exceptions(data: Data) -> Table | None:
    """The statements that do not hold as stated, contradicted ones first."""
    rows = ALL(data)
    if rows is None:
        return None
    order = {CONTRADICTED: 0, MISSING: 1, WHERE: 2, UNTESTABLE: 3}
    part = rows[rows["verdict"] != HOLDS]
    part = part.assign(rank=part["verdict"].map(order)).sort_values("rank", kind="stable")
    caption = "Every statement that does not hold as it stands; the others are on the pages of the sections."
    return Table((rows if part.empty else part)[COLUMNS].head(ROWS), caption)


def _every(table: Callable[[Data], pd.DataFrame | None], data: Data) -> Table | None:
    rows = table(data)
    caption = "Every statement in the order of the talk, with what was measured."
    return None if rows is None else Table(rows[COLUMNS[1:]], caption)


# -- the studies -------------------------------------------------------------------------------------------------------

ALL = partial(judged, tuple(SECTIONS))
LIMITS = (
    f"A step map has a property up to a defect of {NO_DEFECT:g} (40 digits); an order is two-sided within {GATE}; "
    f"energy and invariants are kept up to {ROUND_OFF:g}; a printed entry is reproduced within {REPRODUCED} of its "
    "last digit.",
    "The statements are paraphrased here and judged in their plain sense, on the systems that the measurement names.",
    "Checks in double precision have limits of their own; each has a control for which the statement must fail, in "
    "data/talk_checks.csv.",
)
LINKS = ", ".join(f"[{id}](talks-{id}.md)" for id in SECTIONS)
STUDY = Study(
    id="talks",
    place=450,
    question="Do the statements of the two talks hold?",
    answer=partial(answer, ALL, "statements of two talks on symplectic integration"),
    setting=(
        "The talks: “Symplectic Integration of Hamiltonian Systems”, an introduction, and “A general symplectic "
        "integrator for canonical Hamiltonian systems” (Y. Wang with Y. Bo and W. Cai).",
        "Every definition, theorem, remark, table, figure, formula, method and system of theirs is a statement.",
        f"All statements, section by section: {LINKS}.",
    ),
    runs=(
        Runs(CHECKS, probe, over(check=tuple(PROBES)), needs=_needs),
        # A figure's functions alone know which methods and problems they run.
        Runs(CURVES, figures.curves, over(figure=tuple(figures.MEASURED)),
             needs=lambda figure: (*METHODS, *map(ProblemKey, PROBLEMS))),
    ),
    reads=[t for t in dict.fromkeys(t for s in SECTIONS.values() for t in s["tables"]) if t not in (CHECKS, CURVES)],
    claims=_claims(ALL),
    shown=exceptions,
    whole=lambda data: None if (rows := ALL(data)) is None else rows[COLUMNS[:-1]],
    limits=LIMITS,
)  # fmt: skip


def _section(place: int, id: str) -> Study:
    section, table = SECTIONS[id], partial(judged, (id,))
    statements_of = f"statements of the {section['talk']} about {section['subject']}"
    return Study(
        id=f"talks-{id}",
        place=450.1 + place / 10,
        question=f"Do the {statements_of} hold?",
        answer=partial(answer, table, statements_of),
        setting=(
            f"Definitions, theorems, remarks, tables, figures, formulas, methods and systems of the {section['talk']}.",
            "What does not hold as it stands, in both talks: [talks](talks.md).",
        ),
        runs=(),
        reads=section["tables"],
        claims=_claims(table),
        shown=partial(_every, table),
        whole=lambda data: None,
        command="pytest benchmarks -k talks",
        limits=LIMITS,
    )


STUDIES = (STUDY, *(_section(k, id) for k, id in enumerate(SECTIONS)))
