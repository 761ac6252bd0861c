"""The pages of the two talks: their statements (`talks.toml`), each with its verdict, and what is measured for them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks.judge.evidence import GATE, NO_DEFECT
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE, Judgement, worst
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import Data, Table
from phasebench.benchmarks.page.said import EXPECTED, named
from phasebench.benchmarks.page.study import Claim, Runs, Study, evaluate, over, rows_of
from phasebench.benchmarks.page.verdict import EVERY, NONE, measured_text
from phasebench.benchmarks.problems import PROBLEMS
from phasebench.benchmarks.store.arrays import unpack
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.registry import METHODS, method

from . import figures
from .checks import PROBES
from .curves import FIGURES

CHECKS, CURVES = "talk_checks", "talk_curves"
KINDS, PAGES = tomllib.loads(Path(__file__).parent.with_suffix(".toml").read_text(encoding="utf-8")).values()
COLUMNS = ["talk", "where", "kind", "says", "verdict", "measured", "shown on"]
#: Values that [lam=*] stands for.
VALUES = ("-1", "1/3", "3/2")
NOTHING = Judgement(MISSING, "")


def probe(check: str) -> dict:
    """The number that tests a statement, and its control, with their descriptions."""
    one = PROBES[check]
    value, control = one.measure()
    return {"value": float(value), "control": float(control), "what": one.what, "against": one.against}


def curves(figure: str) -> list[dict]:
    """The rows of a figure, one for each curve."""
    return FIGURES[figure]()


def _change(rows: pd.DataFrame, column: str) -> pd.Series:
    """By how much a column varies in each panel."""
    return rows.groupby("panel", sort=False)[column].agg(np.ptp)


def _omega(rows: pd.DataFrame) -> pd.Series:
    """By how much the sum of the oriented areas of a parallelogram (q, p) varies."""
    both = [(unpack(r.x), unpack(r.y)) for r in rows.itertuples()]
    areas = pd.Series([xi[2:] @ eta[:2] - xi[:2] @ eta[2:] for xi, eta in both])
    return _change(pd.DataFrame({"panel": "", "area": areas}), "area")


FUNCTIONS = {"change": _change, "omega": _omega}


def judge(data: Data, parts: Sequence[Mapping[str, Any]]) -> Judgement:
    """The worst verdict of the parts of a statement, and all their numbers."""
    found = [part for one in parts for part in _judged(data, one)]
    verdict = worst(f.verdict for f in found)
    return NOTHING if verdict == MISSING else Judgement(verdict, "; ".join(f.measured for f in found))


def _judged(data: Data, part: Mapping[str, Any]) -> list[Judgement]:
    """The judgements of a part, of a check with that of its control."""
    if "untestable" in part:
        return [Judgement(UNTESTABLE, part["untestable"])]
    if "condition" in part:
        return [_condition(part["condition"], judge(data, part["judged"]), judge(data, part["otherwise"]))]
    if "check" in part:
        control = {"control": part["check"], "at_least": part.get("control", part["at_most"])}
        return [_measured(data, part), _measured(data, control)]
    return [_measured(data, part)]


def _condition(text: str, inside: Judgement, outside: Judgement) -> Judgement:
    """A statement holds only under a condition if it is contradicted otherwise."""
    if MISSING in (inside.verdict, outside.verdict):
        return NOTHING
    where = (inside.verdict, outside.verdict) == (HOLDS, CONTRADICTED)
    told = f"{inside.measured}; else: {outside.measured}"
    return Judgement(WHERE, f"{text}: {told}") if where else Judgement(inside.verdict, told)


def _measured(data: Data, part: Mapping[str, Any]) -> Judgement:
    """The judgement of a part by the rows of its kind's table: all are measured, and within the bound."""
    kind, chosen = next(iter(part.items()))
    entry = KINDS[kind] | part
    chosen = [x.replace("*", v) for x in ([chosen] if isinstance(chosen, str) else chosen) for v in VALUES]
    rows = rows_of(data, entry["table"], lambda every: every[entry["by"]].isin(chosen))
    rows = rows_of({"": rows}.get, "", entry.get("rows", ""))
    if rows is None or {*chosen} - {*rows[entry["by"]]} or len(rows) != entry.get("entries", len(rows)):
        return NOTHING
    value = evaluate(rows, named(entry["value"], FUNCTIONS))
    bounds = [bound for bound in EXPECTED if bound in part] or [bound for bound in EXPECTED if bound in entry]
    expected = EXPECTED[bounds[0]](entry[bounds[0]]) if bounds else EVERY
    if value.isna().any():
        return NOTHING
    verdict = Claim("", lambda data: rows, lambda rows: value, expected)(data)
    side = {"at_most": "up to ", "at_least": "at least "}.get(bounds[0], "") if bounds and len(rows) > 1 else ""
    numbers = " to ".join(dict.fromkeys(measured_text(verdict.measured).split(" to ")))
    text = f"{entry['what'].format_map(rows.iloc[0])}: {side}{numbers}"
    return Judgement(HOLDS if expected.met(verdict.measured) else CONTRADICTED, text)


def statements(page: str, data: Data) -> pd.DataFrame | None:
    """A row for each statement of a page, with its verdict and the measured numbers; None if none was measured."""
    rows = []
    for talk, where, kind, says, shown, *parts in PAGES[page]["said"]:
        found = judge(data, parts)
        link = "" if shown == page else f"[{shown}]({shown}.md)"
        row = [talk, where, kind, says, found.verdict, found.measured, link]
        rows += [row] * len(where.split(";"))
    frame = pd.DataFrame(rows, columns=COLUMNS)
    kinds = {"contradicted": CONTRADICTED, "conditional": WHERE, "missing": MISSING}
    frame = frame.assign(**{name: frame["verdict"] == verdict for name, verdict in kinds.items()})
    return frame if frame["verdict"].isin([HOLDS, WHERE, CONTRADICTED]).any() else None


def answer(table: Callable[[Data], pd.DataFrame | None], subject: str, data: Data) -> str | None:
    """How many of the statements hold, and which are contradicted."""
    rows = table(data)
    if rows is None:
        return None
    number, wrong = rows["verdict"].value_counts(), rows[rows["contradicted"]]
    return (
        f"Of {len(rows)} statements of two talks about {subject}, {number.get(HOLDS, 0)} hold, {number.get(WHERE, 0)} "
        f"only under a condition; contradicted: {join_list(wrong['where'].unique())}."
    )


def _shown(table: Callable[[Data], pd.DataFrame | None], data: Data) -> Table | None:
    rows = table(data)
    caption = "Every statement with its verdict and what was measured; one row for places in a talk that say the same."
    return None if rows is None else Table(rows[COLUMNS].drop_duplicates(), caption)


#: Page -> further claims, on its figures.
CLAIMS = {
    "talks-schemes": {
        "slopes": Claim(
            "Every refinement difference falls with the order of its scheme",
            CURVES,
            lambda rows: ((rows["order"] - figures.orders(rows)).abs() <= 0.15).set_axis(rows["curve"]),
            rows="figure in ['convergence-schemes-i-iii', 'convergence-compositions'] and order == order",
            unit="slopes within 0.15",
            names=2,
        ),
    },
    "talks-preserving": {
        "turns": Claim(
            "With energy-preserving methods the apocentre turns at the rate of the exact flow",
            CURVES,
            lambda rows: 100 * (rows["turn"] / rows["turn"].iloc[-1] - 1).abs().set_axis(rows["curve"]),
            EXPECTED["at_most"](5.0),
            rows="figure == 'perturbed-kepler-preserving-orbits'",
            unit="% off",
        ),
    },
}
LIMITS = (
    f"A step map has a property up to a defect of {NO_DEFECT:g} (40 digits); an order is two-sided within {GATE}; "
    "energy and invariants are kept up to 1e-11; a printed entry is reproduced within 0.6 of its last digit.",
    "The statements are paraphrased here and judged in their plain sense, on the systems that the measurement names.",
    "Checks in double precision have limits of their own; each has a control for which the statement must fail, in "
    "data/talk_checks.csv.",
)
TALKS = (
    "The talks: “Symplectic Integration of Hamiltonian Systems”, an introduction (intro), and “A general symplectic "
    "integrator for canonical Hamiltonian systems” (Y. Wang with Y. Bo and W. Cai; general).",
    "Every definition, theorem, remark, table, figure, formula, method and system of theirs is a statement.",
)


def _study(page: str, place: float, runs: Sequence[Runs]) -> Study:
    table, subject = partial(statements, page), PAGES[page]["subject"]
    others = ", ".join(f"[{PAGES[other]['subject']}]({other}.md)" for other in PAGES if other != page)
    more = {"unit": "statements", "where": "{where}", "names": 3}
    claims = {
        "contradicted": Claim("No statement is contradicted", table, "contradicted", NONE, **more),
        "conditional": Claim("No statement needs a condition", table, "conditional", NONE, **more),
        "missing": Claim("No statement is left unmeasured", table, "missing", NONE, **more),
    }
    sure = "kind not in ['remark', 'table']"
    return Study(
        id=page,
        place=place,
        question=f"Do the statements of two talks about {subject} hold?",
        answer=partial(answer, table, subject),
        setting=(*TALKS, f"Other pages: {others}."),
        runs=runs,
        reads=[table for table in PAGES[page]["tables"] if table not in [r.table for r in runs]],
        claims=claims | CLAIMS.get(page, {}),
        checks={"sure": Claim("No theorem or method is contradicted", table, "contradicted", NONE, sure, whole=True)},
        figure=partial(figures.pictures, PAGES[page]["figures"]),
        shown=partial(_shown, table),
        whole=lambda data: None,
        command="pytest benchmarks -k talks",
        limits=LIMITS,
    )


RUNS = (
    Runs(CHECKS, probe, over(check=tuple(PROBES)),
         needs=lambda check: (*map(method, PROBES[check].methods), *map(ProblemKey, PROBES[check].problems))),
    # A figure's functions alone know which methods and problems they run.
    Runs(CURVES, curves, over(figure=tuple(FIGURES)), needs=lambda figure: (*METHODS, *map(ProblemKey, PROBLEMS))),
)  # fmt: skip
STUDIES = [_study(page, 450 + k / 10, () if k else RUNS) for k, page in enumerate(PAGES)]
