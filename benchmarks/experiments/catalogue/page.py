"""The pages on methods, problems and coefficients: what there is, from their records and tables."""

from __future__ import annotations

from functools import cache

import pandas as pd

from phasebench.benchmarks.page.markdown import listed
from phasebench.benchmarks.page.page import ROWS, Page, Table, Verdict, of
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.base import Problem
from phasebench.integrators.registry import METHODS

from . import describe, mutation_page

KINDS = {
    "composition": "symmetric compositions of a symmetric base of order 2",
    "splitting": "splittings for any T(p) + V(q)",
    "nystrom": "splittings for a quadratic kinetic energy",
    "near-integrable": "splittings for A + ε B",
}
#: A longer formula is cut: its module has it.
LONGEST = 90
#: A residual of the order conditions up to this is a zero, at 70 digits.
ZERO = 1e-40


def sourced(data) -> Verdict:
    """Whether every method says where it is from."""
    without = [m.id for m in METHODS if not m.source or not m.cite]
    text = f"{len(METHODS)} methods of {len({m.family for m in METHODS})} families are registered"
    text += f"; without a source: {listed(without, 6)}." if without else ", every one with its source and citation."
    return Verdict(text, not without, text)


def _families(data) -> Table:
    lines = []
    for family in dict.fromkeys(m.family for m in METHODS):
        members = [m for m in METHODS if m.family == family]
        lines.append(
            {
                "family": family.replace("_", " "),
                "methods": len(members),
                "orders": listed([str(p) for p in sorted({m.order for m in members})], 12),
                "symplectic": f"{sum(m.symplectic for m in members)}",
                "symmetric": f"{sum(m.symmetric for m in members)}",
                "energy to round-off": f"{sum(m.energy == 'round-off' for m in members)}",
                "such as": listed([m.id for m in members], 3),
            }
        )
    caption = "The families, and how many of their methods are declared so; `phasebench list methods` names every one."
    return Table(pd.DataFrame(lines[:ROWS]), caption)


def _methods(data) -> pd.DataFrame:
    return pd.DataFrame(describe.methods())


METHODS_PAGE = Page(
    id="methods",
    question="Which methods are there, and what does each declare?",
    tables=(),
    setting=(
        "A method is a record: family, order, symmetric, symplectic, how it keeps the energy and invariants q·Dp.",
        "`round-off`: kept on every step; `bounded`: the error oscillates; `drift`: it grows.",
        "What it requires of a system stands with it: separable, quadratic kinetic energy, a Kepler part, ...",
        "Every declaration is tested: see the pages on orders, structure, the matrix and invariants.",
    ),
    verdicts=(sourced,),
    table=_families,
    whole=_methods,
    limits=("The parameterized schemes keep general quadratic invariants at λ = 1/2 only; those q·Dp at every λ.",),
    command="phasebench list methods",
)


@cache
def _made() -> tuple[Problem, ...]:
    """Every problem, made once."""
    return tuple(problem(name) for name in PROBLEMS)


def _formula(H) -> str:
    text = str(H)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … (see its module)"


def cited(data) -> Verdict:
    """Whether every problem says where it is from."""
    without = [p.id for p in _made() if not p.source]
    text = f"{len(_made())} problems with {sum(len(p.orbits) for p in _made())} orbits are registered"
    text += f"; without a source: {listed(without, 6)}." if without else ", every one with its source."
    return Verdict(text, not without, text)


def _problems(data) -> Table:
    lines = []
    for made in _made():
        lines.append(
            {
                "problem": made.id,
                "d": made.system.d,
                "separable": "yes" if made.system.traits["separable"] else "no",
                "orbits": listed([o.name for o in made.orbits], 4),
                "H (or invariant)": f"`{_formula(made.system.H)}`",
                "invariants": len(made.invariants),
            }
        )
    return Table(pd.DataFrame(lines[:ROWS]), "Every problem; `invariants` counts those besides the energy.")


def _orbits(data) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "problem": made.id,
                "orbit": o.name,
                "q0": ", ".join(map(repr, o.q[:4])) + (", …" if len(o.q) > 4 else ""),
                "p0": ", ".join(map(repr, o.p[:4])) + (", …" if len(o.p) > 4 else ""),
                "source": made.source,
            }
            for made in _made()
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
        "Orbits are named as `henon-heiles:chaotic`; the first is the default.",
    ),
    verdicts=(cited,),
    table=_problems,
    whole=_orbits,
    limits=("Initial data are the doubles nearest to the published digits: the doubles are the problem.",),
    command="phasebench list problems",
)


@of("coefficients")
def orders(coefficients: pd.DataFrame) -> Verdict:
    """Whether the tables have their order by the numbers alone."""
    agree = coefficients["order"].astype(str) == coefficients["declared order"].astype(str)
    wrong = list(coefficients[~agree]["table"])
    counts = f"{int(agree.sum())} of {len(coefficients)} tables have the declared order by their coefficients alone"
    text = f"{counts}, two-sided; the residuals are at most {float(coefficients['polished residual'].max()):.1e}"
    return Verdict(f"{text}{f'; not so {listed(wrong, 6)}' if wrong else ''}.", not wrong, f"{counts}.")


@of("coefficients")
def polished(coefficients: pd.DataFrame) -> Verdict:
    """Whether polishing leaves zeros."""
    before, after = (float(coefficients[f"{when} residual"].max()) for when in ("published", "polished"))
    text = f"Polishing brings the largest residual of the order conditions from {before:.1e} to {after:.1e}."
    return Verdict(text, after <= ZERO, text)


@of("repairs")
def repaired(repairs: pd.DataFrame) -> Verdict:
    """What was found damaged."""
    text = f"{len(repairs)} numbers in {repairs['table'].nunique()} published copies are damaged; the order conditions "
    text += "locate and restore them."
    return Verdict(text, True, text)


@of("coefficients")
def _least(coefficients: pd.DataFrame) -> Table:
    """Of each kind and order the table of the least error constant and the one of the least sum of sizes."""
    frame = coefficients.assign(constant=coefficients["error constant"].astype(str).str.split(",").str[0].astype(float))
    frame["what"] = frame["kind"].map(KINDS)
    best = frame.loc[frame.groupby(["kind", "declared order"], sort=False)["constant"].idxmin()]
    columns = {"what": "kind", "declared order": "order", "table": "table", "stages": "stages"}
    columns |= {
        "published residual": "published residual",
        "error constant": "error constant",
        "sum of sizes": "Σ sizes",
    }
    caption = "Of each kind and order the table with the least error constant (the 2-norm of the first residuals left)."
    return Table(best[list(columns)].rename(columns=columns).head(ROWS), caption)


@of("coefficients")
def _tables(coefficients: pd.DataFrame) -> pd.DataFrame:
    return coefficients


COEFFICIENTS_PAGE = Page(
    id="coefficients",
    question="Do the tables of coefficients have the order that they declare?",
    tables=("coefficients", "repairs"),
    setting=(
        "A step is a product of exponentials exp(a₁hA) exp(b₁hB) …; order p: the coefficients of all words in A and B "
        "up to degree p are those of exp(h(A + B)). Residual: the largest such difference, at 70 digits.",
        "Published digits first, then polished by Gauss–Newton steps to the nearest solution.",
        "For A + ε B the orders and constants are those of the terms in ε, ε², …",
    ),
    verdicts=(orders, polished, repaired),
    table=_least,
    whole=_tables,
    limits=(
        f"A residual up to {ZERO:g} is a zero.",
        "Error constants compare methods of one kind and order only; they say nothing of the cost of a stage.",
    ),
    command="pytest benchmarks/experiments/catalogue",
)

#: What may not be part of this project, and who may be it: a comparison that is reached through its public interface.
COPYLEFT, COMPARED = "GPL-", ("rebound",)


@of("dependencies")
def licences(dependencies: pd.DataFrame) -> Verdict:
    """Whether every distribution says its licence, and none but the comparison has one that binds this project."""
    said = dependencies["licence"].fillna("")
    strong = said.str.contains(COPYLEFT) & ~said.str.contains(f"L{COPYLEFT}")
    silent, bound = list(dependencies[said == ""]["package"]), list(dependencies[strong]["package"])
    other = [name for name in bound if name not in COMPARED]
    text = f"{len(dependencies)} distributions are needed, {int(dependencies['direct'].sum())} of them directly"
    text += f"; under the GPL: {listed(bound, 4)}" if bound else "; none is under the GPL"
    text += f", of which not a comparison alone: {listed(other, 4)}" if other else ""
    text += f"; without a stated licence: {listed(silent, 4)}." if silent else "; each states its licence."
    return Verdict(text, not (silent or other), text)


@of("dependencies")
def weight(dependencies: pd.DataFrame) -> Verdict:
    """How large an installation is."""
    heavy = dependencies.sort_values("MB", ascending=False).head(3)
    whole = float(dependencies["MB"].sum())
    part = listed([f"{r['package']} ({r['MB']:.0f} MB)" for _, r in heavy.iterrows()], 3)
    text = f"An installation takes {whole:.0f} MB; the largest are {part}."
    return Verdict(text, True, text)


@of("dependencies")
def _needed(dependencies: pd.DataFrame) -> Table:
    shown = dependencies.assign(direct=dependencies["direct"].map({True: "yes", False: "no"}))
    caption = "What phasebench needs itself, then the largest of what these need; the CSV has every one."
    return Table(shown[["package", "version", "licence", "direct", "MB"]].head(ROWS), caption)


@of("dependencies")
def _all_needed(dependencies: pd.DataFrame) -> pd.DataFrame:
    return dependencies


DEPENDENCIES_PAGE = Page(
    id="dependencies",
    question="What does an installation bring, and under which licences?",
    tables=("dependencies",),
    setting=(
        "Every distribution that `pip install` brings without an extra, by the metadata of what was installed here.",
        "MB: the files of a distribution, without bytecode.",
    ),
    verdicts=(licences, weight),
    table=_needed,
    whole=_all_needed,
    limits=(
        "A licence is what the distribution's own metadata say; other versions may say otherwise.",
        "Libraries that a wheel carries inside count as its own.",
    ),
    command="pytest benchmarks/experiments/catalogue",
)

PAGES = (METHODS_PAGE, PROBLEMS_PAGE, COEFFICIENTS_PAGE, DEPENDENCIES_PAGE, mutation_page.PAGE)
