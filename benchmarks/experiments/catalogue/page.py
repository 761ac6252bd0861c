"""Report pages on methods, problems and coefficients, made from their records and tables."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict, at_most
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import METHODS

from . import acta_page, describe, transcribed_page

if TYPE_CHECKING:
    import sympy as sp

KINDS = {
    "composition": "symmetric compositions of a symmetric base of order 2",
    "splitting": "splittings for any T(p) + V(q)",
    "nystrom": "splittings for a quadratic kinetic energy",
    "near-integrable": "splittings for A + ε B",
}
#: Longer formulae are shortened.
LONGEST = 90
#: A residual of the order conditions up to this counts as 0, at 70 digits.
ZERO = 1e-40


def count_methods(data: Data) -> str:
    """Write the methods page's answer: how many methods there are, and how many declare each property."""
    return (
        f"{len(METHODS)} methods of {len({m.family for m in METHODS})} families: "
        f"{sum(m.symplectic for m in METHODS)} are declared symplectic, {sum(m.symmetric for m in METHODS)} symmetric, "
        f"{sum(m.energy == ROUND_OFF for m in METHODS)} to keep the energy to round-off."
    )


def _families(data: Data) -> Table:
    """Make a table with a row for each family of methods: how many there are, and how many declare each property."""
    lines = []
    for family in dict.fromkeys(m.family for m in METHODS):
        members = [m for m in METHODS if m.family == family]
        lines.append(
            {
                "family": family.replace("_", " "),
                "methods": len(members),
                "orders": join_list([str(p) for p in sorted({m.order for m in members})], 12),
                "symplectic": f"{sum(m.symplectic for m in members)}",
                "symmetric": f"{sum(m.symmetric for m in members)}",
                "energy to round-off": f"{sum(m.energy == ROUND_OFF for m in members)}",
                "such as": join_list([m.id for m in members], 3),
            }
        )
    caption = f"At most {ROWS} families, and how many of their methods declare each property; `phasebench list methods` names all."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


def _methods(data: Data) -> pd.DataFrame:
    return pd.DataFrame(describe.methods())


METHODS_PAGE = Page(
    id="methods",
    question="Which methods are there, and what does each declare?",
    tables=(),
    setting=(
        "A method declares its family, order, symmetry, symplecticity and what becomes of the energy and of invariants "
        "q·Dp: kept to `round-off` on every step, `bounded` (the error oscillates) or `drift` (it grows).",
        "It also declares what it requires of a system: separable, quadratic kinetic energy, a Kepler part, ...",
        "Every declaration is tested on the pages [orders](orders.md), [structure](structure.md), [matrix](matrix.md) and "
        "[invariants](invariants.md); every method has a source and a citation (`phasebench cite`).",
    ),
    verdicts=(),
    answer=count_methods,
    table=_families,
    whole=_methods,
    limits=("Schemes with a parameter λ keep invariants q·Dp at every λ, other quadratic ones at λ = 1/2 only.",),
    command="phasebench list methods",
)


@cache
def _problems() -> tuple[Problem, ...]:
    """Build every registered problem, once; the result is cached."""
    return tuple(problem(name) for name in PROBLEMS)


def _formula(H: sp.Expr) -> str:
    text = str(H)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … (see its module)"


def count_problems(data: Data) -> str:
    """Write the problems page's answer: how many problems and orbits there are, and of how many degrees of freedom."""
    sizes = [p.system.d for p in _problems()]
    return (
        f"{len(sizes)} problems with {sum(len(p.orbits) for p in _problems())} orbits, of {min(sizes)} to {max(sizes)} "
        f"degrees of freedom; {sum(bool(p.system.traits['separable']) for p in _problems())} have H = T(p) + V(q)."
    )


def _problem_table(data: Data) -> Table:
    """Make a table with a row for each benchmark problem: degrees of freedom, orbits, H, number of invariants."""
    lines = []
    for made in _problems():
        lines.append(
            {
                "problem": made.id,
                "d": made.system.d,
                "separable": "yes" if made.system.traits["separable"] else "no",
                "orbits": join_list([o.name for o in made.orbits], 4),
                "H (or invariant)": f"`{_formula(made.system.H)}`",
                "invariants": len(made.invariants),
            }
        )
    return Table(
        pd.DataFrame(lines[:ROWS]),
        f"At most {ROWS} problems; `phasebench list problems` names all. `invariants` counts those beside the energy.",
    )


def _orbits(data: Data) -> pd.DataFrame:
    """Make a table with a row for each orbit of each problem, with its initial values."""
    return pd.DataFrame(
        [
            {
                "problem": made.id,
                "orbit": o.name,
                "q0": ", ".join(map(repr, o.q[:4])) + (", …" if len(o.q) > 4 else ""),
                "p0": ", ".join(map(repr, o.p[:4])) + (", …" if len(o.p) > 4 else ""),
                "source": made.source,
            }
            for made in _problems()
            for o in made.orbits
        ]
    )


PROBLEMS_PAGE = Page(
    id="problems",
    question="Which problems are there, on which orbits?",
    tables=(),
    setting=(
        "A problem is a system with published initial data, its invariants and a citation.",
        "d is the number of degrees of freedom; separable means H = T(p) + V(q).",
        "An orbit is named `problem:orbit`, as `henon-heiles:chaotic`; a problem's first orbit is its default.",
    ),
    verdicts=(),
    answer=count_problems,
    table=_problem_table,
    whole=_orbits,
    limits=("Initial data are the doubles nearest to the published digits; references start from these doubles.",),
    command="phasebench list problems",
)


def _largest(coefficients: pd.DataFrame, when: str) -> float:
    """Return the largest residual of the order conditions over all coefficient tables.

    ``when`` says whose residual: "published" for the coefficients as printed, "polished" for those computed from them
    to many digits.  ``coefficients`` has a row for each table.
    """
    return float(coefficients[f"{when} residual"].max())


def _has_order(coefficients: pd.DataFrame) -> pd.Series:
    """True for each coefficient table whose residuals show exactly the order that it declares."""
    return coefficients["order"].astype(str) == coefficients["declared order"].astype(str)


@of("coefficients")
def orders(coefficients: pd.DataFrame) -> Verdict:
    """Judge whether the coefficient tables satisfy the conditions of the declared order, and not those of the next."""
    good = _has_order(coefficients)
    return Verdict(
        "Every table satisfies the conditions of its declared order, and not of the next",
        Count(int(good.sum()), len(good)),
        EVERY,
        "tables",
        where=join_list(list(coefficients[~good]["table"]), 6) if not good.all() else "",
        otherwise=FAIL,
    )


@of("coefficients")
def polished_residuals(coefficients: pd.DataFrame) -> Verdict:
    """Judge whether the residuals of the order conditions vanish after polishing the coefficients to many digits."""
    return Verdict(
        "After polishing the largest residual of the order conditions vanishes",
        _largest(coefficients, "polished"),
        at_most(ZERO),
        where=str(coefficients.loc[coefficients["polished residual"].idxmax(), "table"]),
        otherwise=FAIL,
    )


@of("coefficients")
def judge_tables(coefficients: pd.DataFrame) -> str:
    """Write the page's answer: how many coefficient tables have their declared order, and what polishing gains."""
    before, after = (_largest(coefficients, when) for when in ("published", "polished"))
    return (
        f"{int(_has_order(coefficients).sum())} of {len(coefficients)} tables of splitting and composition coefficients "
        f"have exactly their declared order; polishing lowers the largest residual from {before:.1e} to {after:.1e}."
    )


def _least(data: Data) -> Table | None:
    """Make a table with the coefficient table of smallest error constant for each kind of method and order."""
    coefficients, repairs = data("coefficients"), data("repairs")
    if coefficients is None or coefficients.empty:
        return None
    frame = coefficients.assign(constant=coefficients["error constant"].astype(str).str.split(",").str[0].astype(float))
    frame["what"] = frame["kind"].map(KINDS)
    best = frame.loc[frame.groupby(["kind", "declared order"], sort=False)["constant"].idxmin()]
    columns = {"what": "kind", "declared order": "order", "table": "table", "stages": "stages"}
    columns |= {
        "published residual": "published residual",
        "error constant": "error constant",
        "sum of sizes": "Σ |coefficients|",
    }
    caption = (
        "For each kind and order the table with the least error constant (the 2-norm of the first residuals left)."
    )
    if repairs is not None and len(repairs):
        caption += (
            f" {len(repairs)} misprinted numbers in {repairs['table'].nunique()} published tables were found by the order "
            "conditions and corrected: data/repairs.csv."
        )
    return Table(best[list(columns)].rename(columns=columns).head(ROWS), caption)


@of("coefficients")
def _tables(coefficients: pd.DataFrame) -> pd.DataFrame:
    return coefficients


COEFFICIENTS_PAGE = Page(
    id="coefficients",
    question="Do the tables of coefficients have the order that they declare?",
    tables=("coefficients", "repairs"),
    setting=(
        "A step is a product exp(a₁hA) exp(b₁hB) …; it has order p if the coefficients of all words in A and B up to "
        "degree p are those of exp(h(A + B)). Residual: the largest difference of these coefficients, with 70 digits.",
        "The published digits are taken first, then polished: Gauss–Newton steps lead to the nearest exact solution.",
        "For A + ε B, orders and constants are given for the terms in ε, ε², …",
    ),
    verdicts=(orders, polished_residuals),
    answer=judge_tables,
    table=_least,
    whole=_tables,
    limits=(
        f"A residual up to {ZERO:g} counts as zero.",
        "Error constants compare methods of the same kind and order only, and leave out what a stage costs.",
    ),
    command="pytest benchmarks/experiments/catalogue",
)

PAGES = (
    METHODS_PAGE,
    PROBLEMS_PAGE,
    COEFFICIENTS_PAGE,
    acta_page.PAGE,
    transcribed_page.PAGE,
)
