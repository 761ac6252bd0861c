"""The report page on options that change how a step is computed: quadrature nodes, stage solvers, sums, precision."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table
from phasebench.benchmarks.page.verdict import Range, measured_text

from . import arithmetic, figures, findings, nodes, solvers, verdicts
from .page import line, table_or_none, times

TABLES = (nodes.TABLE, solvers.TABLE, arithmetic.ERRORS, arithmetic.COSTS)


def _nodes(table: pd.DataFrame) -> list[dict]:
    return [
        line(
            "nodes of AVF",
            f"{r['scene']}, h = {number(r['h'])}",
            f"{r['nodes']}",
            f"energy error {number(r['energy error'], 2)}, with one {number(r['with one'], 2)}",
            f"{times(r['cost'])} as long as one",
        )
        for _, r in findings.quadratures(table).iterrows()
    ]


def _solvers(table: pd.DataFrame) -> list[dict]:
    return [
        line(
            f"solver of {solvers.METHOD}",
            f"{r['scene']}, h = {number(r['h'])}",
            f"{r['solver']}, from {r['start']}",
            f"{number(r['fewest'])} evaluations a step: fixed point {_evaluations(r['fixed'])}, simplified Newton "
            f"{_evaluations(r['simplified'])}",
            f"its own takes {times(r['engine'])} as many{_looser(r)}",
        )
        for _, r in findings.solving(table).iterrows()
    ]


def _evaluations(each: float) -> str:
    return number(each) if each == each else "does not converge"


def _looser(row: pd.Series) -> str:
    if not row["saved"]:
        return ""
    return f"; a tolerance of {row['loosest']:.0e} saves {100 * row['saved']:.0f} %"


def _sums(table: pd.DataFrame, costs: pd.DataFrame | None) -> list[dict]:
    ratios = {} if costs is None else dict(zip(costs["scene"], costs["ratio"], strict=True))
    return [
        line(
            "sums",
            r["scene"],
            "compensated",
            f"round-off {number(r['compensated'], 2)}, plain {times(r['gain'])} that",
            f"{times(ratios[r['scene']])} as long as plain C" if r["scene"] in ratios else "",
        )
        for _, r in findings.sums(table).iterrows()
    ]


def _span(values: pd.Series) -> str:
    return measured_text(Range(values.min(), values.max()))


def answer(data: Data) -> str | None:
    """Write the page's answer: what compensated sums and quadrature nodes gain, and what solving stage equations costs.

    ``data`` maps a table's name to the table; None if none was measured.
    """
    rules, stages, ends = (table_or_none(data, name) for name in TABLES[:3])
    parts = []
    if ends is not None and len(found := findings.sums(ends)):
        parts.append(f"compensated sums leave {_span(found['gain'])} times less round-off")
    if rules is not None and len(found := findings.quadratures(rules)):
        parts.append(f"{_span(found['nodes'])} nodes keep AVF's energy to {findings.FLOOR:g}")
    if stages is not None and len(found := findings.solving(stages)):
        parts.append(f"{solvers.METHOD}'s solver takes {_span(found['engine'])} times the best other's evaluations")
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if parts else None


def table(data: Data) -> Table | None:
    """Make the page's table: the gain and the cost of each option's best setting, a line for each scene (orbit).

    ``data`` maps a table's name to the table; None if none was measured.
    """
    rules, stages, ends, costs = (table_or_none(data, name) for name in TABLES)
    rows = [] if rules is None else _nodes(rules)
    rows += [] if stages is None else _solvers(stages)
    rows += [] if ends is None else _sums(ends, costs)
    caption = (
        f"Nodes: the fewest whose relative energy error is at most {findings.FLOOR:g}. Solver: the one of the fewest "
        "evaluations among the loops, what the method's own takes over it, and the loosest tolerance that leaves the "
        "error as it is. Sums: round-off after the most steps."
    )
    return Table(pd.DataFrame(rows[:ROWS]), caption) if rows else None


PAGE = Page(
    id="options-numerics",
    question="What do quadrature nodes, stage solvers, compensated sums and precision give, and cost?",
    tables=TABLES,
    setting=(
        "AVF, the mean of the gradient over a step, by Gauss–Legendre rules of a fixed number of nodes, and by its own "
        "rule, which adds nodes until two results agree.",
        f"{solvers.METHOD}, a Gauss method of {solvers.STAGES} stages, by its own solver (fixed point from the last "
        "five steps, Newton where that does not contract), and by a plain loop of either from three starts, to several "
        "tolerances.",
        f"Störmer–Verlet from {arithmetic.STARTS} starts by plain sums in single and double precision, and by "
        "compensated sums; round-off is the distance from the same steps in long double.",
    ),
    verdicts=(
        verdicts.quadrature,
        verdicts.quadrature_cost,
        verdicts.solving,
        verdicts.compensation,
        verdicts.single,
    ),
    answer=answer,
    figures=figures.draw_numerics,
    table=table,
    limits=(
        "Times are this machine's, medians of rounds taken in turns; those of a quadrature include storing every step.",
        "How many nodes are enough is not known before: AVF's own rule pays for finding out.",
        "The loop solves the equations as they stand, the method's own solver those of q'' = g(q) where H is "
        "separable, which contract twice as fast.",
        "A Jacobian counts as many evaluations as there are variables, the linear algebra as none.",
        "The time of compensated sums is over that of a bare C loop of plain sums, which does nothing else. Single "
        "precision is run in NumPy, without a time.",
    ),
    command="pytest benchmarks/experiments/options",
)
