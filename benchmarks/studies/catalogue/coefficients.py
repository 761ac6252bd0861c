"""Orders and error constants of compositions and splittings from their coefficients alone."""

from __future__ import annotations

import mpmath

from phasebench.benchmarks.page.page import ROWS, Data, Table
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import at_most
from phasebench.integrators import coefficients
from phasebench.integrators.coefficients import TABLES
from phasebench.integrators.coefficients.fractions import DIGITS
from phasebench.integrators.coefficients.order_conditions import (
    conditions,
    excess,
    leading_norms,
    next_degrees,
    residuals,
)
from phasebench.integrators.coefficients.polish import locate, starting_values
from phasebench.integrators.coefficients.table import Table as Coefficients

from .exactness import as_text, files, observed_order

ORDERS, REPAIRS, LOOSE = "coefficients", "repairs", "loose_digits"
BEFORE, AFTER, CONSTANT = "published residual", "polished residual", "error constant"
KINDS = {
    "composition": "symmetric compositions of a symmetric base of order 2",
    "splitting": "splittings for any T(p) + V(q)",
    "nystrom": "splittings for a quadratic kinetic energy",
    "near-integrable": "splittings for A + ε B",
}
#: Numbers as they stand in damaged copies of a table, {name: {index: text}}.  Of the first table a copy has two digits
#: exchanged in one number and three too many in another; of the second a digit is lost in several programs' tables.
DAMAGED: dict[str, dict[int, str]] = {
    "sofroniou-spaletta-10": {
        8: "0.36613344954622675319114812353150",
        13: "-0.39203335373010863990644808193642610",
    },
    "aba-864": {7: "0.0653961422823734184559721793911134363710"},
}
#: A residual of the order conditions up to this counts as 0, at 70 digits.
ZERO = 1e-40


def _digits(x: mpmath.mpf) -> str:
    return mpmath.nstr(x, 2, min_fixed=0, max_fixed=0)


def order(t: Coefficients) -> dict:
    """Orders, residuals and error constants of a table of coefficients."""
    steps = coefficients.steps(t.name)
    found = residuals(t.kind, steps, next_degrees(t.order))
    before = residuals(t.kind, t.steps(starting_values(t)), t.order)
    about = coefficients.describe(t.name)
    sizes = steps if t.gamma else [weight for _, weight in steps]
    stages = len(steps) if t.gamma else sum(letter == "B" for letter, _ in steps) - (t.first == "B" and t.symmetric)
    return {
        "kind": t.kind,
        "table": t.name,
        "stages": stages,
        "declared order": as_text(t.order),
        "order": as_text(observed_order(found, len(t.order))),
        "conditions": sum(len(found[key]) for key in conditions(found, t.order)),
        BEFORE: _digits(excess(before, t.order)),
        AFTER: _digits(excess(found, t.order)),
        "moved by": about["moved"],
        "sum of sizes": f"{float(mpmath.fsum(map(abs, sizes))):.3f}",
        CONSTANT: ", ".join(_digits(x) for x in leading_norms(found, t.order)),
        "source": t.source,
    }


def repairs(name: str) -> list[dict]:
    """The misprinted numbers of a copy of a table, and the right ones: a row for each."""
    t, damaged, rows = coefficients.table(name), DAMAGED[name], []
    numbers = starting_values(t, damaged)
    for _ in damaged:
        residual = excess(residuals(t.kind, t.steps(numbers), t.order), t.order)
        k, mended = locate(t, numbers)
        row = {"table": name, "number": f"{k + 1} of {len(numbers)}", "in a copy": damaged.get(k, t.published[k])}
        row |= {"from the order conditions": mpmath.nstr(mended, 36), "published": t.published[k]}
        rows.append(row | {"residual with it": _digits(residual)})
        numbers[k] = starting_values(t)[k]
    return rows


def measure() -> dict[str, list[dict]]:
    """Orders of all tables, repaired misprints, and tables printed with more digits than are right."""
    loose = [(t, max(len(x.partition(".")[2]) for x in t.published)) for t in TABLES if t.good is not None]
    with mpmath.workdps(DIGITS):
        return {
            ORDERS: [order(t) for t in TABLES],
            REPAIRS: [row for name in DAMAGED for row in repairs(name)],
            LOOSE: [{"table": t.name, "decimals printed": n, "decimals right": t.good} for t, n in loose],
        }


def _table(data: Data) -> Table | None:
    frame, repaired = data(ORDERS), data(REPAIRS)
    if frame is None or frame.empty:
        return None
    frame = frame.assign(what=frame["kind"].map(KINDS), least=frame[CONSTANT].astype(str).str.split(",").str[0])
    frame["least"] = frame["least"].astype(float)
    best = frame.loc[frame.groupby(["kind", "declared order"], sort=False)["least"].idxmin()]
    columns = {"what": "kind", "declared order": "order", "table": "table", "stages": "stages", BEFORE: BEFORE}
    columns |= {CONSTANT: CONSTANT, "sum of sizes": "Σ |coefficients|"}
    caption = (
        "For each kind and order the table with the least error constant (the 2-norm of the first residuals left)."
    )
    if repaired is not None and len(repaired):
        caption += (
            f" {len(repaired)} misprinted numbers in {repaired['table'].nunique()} published tables were found by the "
            "order conditions and corrected: data/repairs.csv."
        )
    return Table(best[list(columns)].rename(columns=columns).head(ROWS), caption)


def largest(column: str) -> Number:
    """The largest residual of a column."""
    return Number(ORDERS, lambda rows: rows[column].astype(float), digits=2)


STUDY = Study(
    id="coefficients",
    place=442,
    question="Do the tables of coefficients have the order that they declare?",
    answer="{orders.n} of {orders.of} tables of splitting and composition coefficients have exactly their declared "
    "order; polishing lowers the largest residual from {before} to {after}.",
    setting=(
        "A step is a product exp(a₁hA) exp(b₁hB) …; it has order p if the coefficients of all words in A and B up to "
        "degree p are those of exp(h(A + B)). Residual: the largest difference of these coefficients, with 70 digits.",
        "The published digits are taken first, then polished: Gauss–Newton steps lead to the nearest exact solution.",
        "For A + ε B, orders and constants are given for the terms in ε, ε², …",
    ),
    runs=(Runs(ORDERS, measure, [{}], lambda: files(), more=(REPAIRS, LOOSE)),),
    claims={
        "orders": Claim(
            "Every table satisfies the conditions of its declared order, and not of the next",
            ORDERS, "order == `declared order`", unit="tables", where="{table}", names=6, fault=True,
        ),
        "polished": Claim(
            "After polishing the largest residual of the order conditions vanishes",
            ORDERS, lambda rows: rows[AFTER].astype(float), at_most(ZERO), where="{table}", fault=True,
        ),
    },
    numbers={"before": largest(BEFORE), "after": largest(AFTER)},
    shown=_table,
    tables=(ORDERS, REPAIRS),
    limits=(
        f"A residual up to {ZERO:g} counts as zero.",
        "Error constants compare methods of the same kind and order only, and leave out what a stage costs.",
    ),
)  # fmt: skip
