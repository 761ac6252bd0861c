"""The report's page "structure": defects of symplecticity, symmetry and volume of step maps, in multiprecision.

The table ``structure`` has a row for each method and property: the defect, and whether the method is declared to have
the property.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import NO_DEFECT as NOTHING
from phasebench.benchmarks.measure.multiprecision import DIGITS
from phasebench.benchmarks.measure.visible import HIGH, NEARLY, least_visible
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict, at_most

if TYPE_CHECKING:
    from pathlib import Path

#: Smaller defects are drawn at this value.
FLOOR = 1e-42
PROPERTIES = ("symplecticity", "symmetry", "volume")
#: Methods shown of each property, of those declared to have it and of the others.
SHOWN = 4


def _hides(structure: pd.DataFrame) -> pd.Series:
    """Return for each row (a method and a property) whether its defect does not show that the property fails.

    It is too small for that, or was not measured (NaN).
    """
    keys = zip(structure["method"], structure["property"], strict=True)
    return ~(structure["defect"] > [least_visible(*key) for key in keys])


def _as_declared(structure: pd.DataFrame) -> pd.Series:
    """Return for each row (a method and a property) whether its defect agrees with what the method is declared to have.

    The defect of a declared property must be at most `NOTHING`, that of another one large enough to be visible.
    """
    return (structure["defect"] <= NOTHING).where(structure["declared"], ~_hides(structure))


def _methods(structure: pd.DataFrame, name: str, declared: bool) -> pd.DataFrame:
    return structure[(structure["property"] == name) & (structure["declared"] == declared)]


def _largest(structure: pd.DataFrame, name: str) -> dict:
    """Return the arguments of a `Verdict` on whether all methods declared to have the property ``name`` have it.

    The largest of their defects must be at most `NOTHING`.
    """
    having = _methods(structure, name, True)
    worst = having.loc[having["defect"].idxmax()] if len(having) else {"defect": np.nan, "method": ""}
    measured = {"measured": float(worst["defect"]), "where": worst["method"]}
    return measured | {"expected": at_most(NOTHING), "otherwise": FAIL}


def _hidden(structure: pd.DataFrame, name: str) -> dict:
    """Return the arguments of a `Verdict` on whether methods not declared to have the property ``name`` lack it.

    Methods whose defect is too small to show that they lack it are counted; there must be none.
    """
    lacking = _methods(structure, name, False)
    hidden = list(lacking[_hides(lacking)]["method"])
    measured = {"measured": Count(len(hidden), len(lacking)), "where": join_list(hidden, 3) if hidden else ""}
    return measured | {"expected": NONE, "unit": "methods", "otherwise": FAIL}


@of("structure")
def symplectic(structure: pd.DataFrame) -> Verdict:
    """Judge whether the methods declared symplectic are symplectic, by the largest of their defects.

    ``structure`` has a row for each method and property, with the defect of the step map.
    """
    largest = _largest(structure, "symplecticity")
    return Verdict("The defect of symplecticity vanishes for methods declared symplectic", **largest)


@of("structure")
def others_not_symplectic(structure: pd.DataFrame) -> Verdict:
    """Judge whether every method not declared symplectic has a visible symplecticity defect in its step map.

    ``structure`` has a row for each method and property, with the defect of the step map.
    """
    return Verdict("No method is symplectic that is not declared so", **_hidden(structure, "symplecticity"))


@of("structure")
def symmetric(structure: pd.DataFrame) -> Verdict:
    """Judge whether the methods declared symmetric are symmetric, by the largest of their defects.

    ``structure`` has a row for each method and property, with the defect of the step map.
    """
    return Verdict("The defect of symmetry vanishes for methods declared symmetric", **_largest(structure, "symmetry"))


@of("structure")
def others_not_symmetric(structure: pd.DataFrame) -> Verdict:
    """Judge whether every method not declared symmetric has a visible symmetry defect in its step map.

    ``structure`` has a row for each method and property, with the defect of the step map.
    """
    return Verdict("No method is symmetric that is not declared so", **_hidden(structure, "symmetry"))


@of("structure")
def volume(structure: pd.DataFrame) -> Verdict:
    """Judge whether, on charged particles, step maps keep the volume if and only if they are declared to.

    The maps of methods that are not declared to are controls.  ``structure`` has a row for each method and property,
    with the defect of its step map.
    """
    rows = structure[structure["property"] == "volume"]
    wrong = rows[~_as_declared(rows)]
    measured = Count(len(rows) - len(wrong), len(rows)) if len(rows) else None
    where = join_list(list(wrong["method"]), 3) if len(wrong) else ""
    return Verdict(
        "Methods for charged particles keep volume where declared, and the controls do not",
        measured,
        EVERY,
        "methods",
        where,
        FAIL,
    )


@of("structure")
def answer(structure: pd.DataFrame) -> str:
    """Return the page's answer, a sentence: how many step maps are as declared, for each property.

    ``structure`` has a row for each method and property, with the defect of the step map.
    """
    right = structure[_as_declared(structure)]
    there = [name for name in PROPERTIES if (structure["property"] == name).any()]
    counts = [f"{(right['property'] == x).sum()} of {(structure['property'] == x).sum()} in {x}" for x in there]
    return f"In arithmetic of {DIGITS} digits step maps are as declared: {join_list(counts, len(counts))}."


@of("structure")
def draw(structure: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw every defect, sorted, in a panel for each property; save the figure in ``folder``.

    Methods declared to have the property have another colour than the others.  ``structure`` has a row for each method
    and property, with the defect of the step map.
    """
    there = [name for name in PROPERTIES if (structure["property"] == name).any()]
    with style.settings():
        figure, (panels,) = style.panels(1, len(there), 3.0, sharey=True)
        for axes, name in zip(panels, there, strict=True):
            part = structure[structure["property"] == name]
            first = 0
            for k, (declared, label) in enumerate(((True, "declared"), (False, "not declared"))):
                defect = np.sort(part[part["declared"] == declared]["defect"].clip(lower=FLOOR))
                look = {"color": style.CURVES[k][0], "marker": style.CURVES[k][2], "linestyle": "none"}
                axes.semilogy(first + np.arange(len(defect)), defect, label=label, **look)
                first += len(defect)
            axes.axhline(NOTHING, color=style.GREY, linewidth=0.9, linestyle="--")
            axes.set(title=name, xlabel="methods, by defect")
            axes.grid(axis="y", color="0.93", linewidth=0.5)
        panels[0].set_ylabel("defect of one step")
        style.legend_above(figure, panels[0], 2)
    caption = (
        f"Defects of the step maps in {DIGITS} digits, the largest over the systems; dashed: {NOTHING:g}, below which a defect "
        f"is of the stage solver and the differences; zeros are drawn at {FLOOR:g}. Methods of high "
        "order that lack a property may be below the line, too."
    )
    return [Picture(style.save(figure, folder, "structure.png"), "defects of the step maps", caption)]


@of("structure")
def table(structure: pd.DataFrame) -> Table:
    """Return the page's table: for each property, the methods with defects nearest to the limit `NOTHING`.

    They are the largest defects of methods declared to have the property, and the smallest of the others.
    ``structure`` has a row for each method and property.
    """
    columns = ["property", "method", "declared", "defect"]
    parts = []
    for name in PROPERTIES:
        part = structure[structure["property"] == name]
        parts += [part[part["declared"]].nlargest(SHOWN, "defect"), part[~part["declared"]].nsmallest(SHOWN, "defect")]
    shown = pd.concat(parts)[columns].head(ROWS)
    shown["declared"] = shown["declared"].map({True: "yes", False: "no"})
    caption = (
        f"The methods nearest to the limit of {NOTHING:g}: of each property the four largest defects of methods declared to "
        "have it, and the four smallest of the others."
    )
    return Table(shown, caption)


@of("structure")
def _full_table(structure: pd.DataFrame) -> pd.DataFrame:
    return structure.assign(declared=structure["declared"].map({True: "yes", False: "no"}))


PAGE = Page(
    id="structure",
    question="Are the step maps symplectic, symmetric and volume-preserving where they are declared to be?",
    tables=("structure",),
    setting=(
        "Symplecticity: the largest entry of MᵀJM − J, M the Jacobian of one step by differences. Of a charged particle, with p = v + A(x), J is the magnetic two-form dx ∧ dv + B: this is K-symplecticity.",
        "Symmetry: |Φ₋ₕ(Φₕ(y)) − y|, the distance from the start after a step and the same step backwards.",
        "Volume: |det M − 1|, of methods for charged particles and, as controls, of some others, on charged particles.",
        "Systems: pendulum, Hénon–Heiles, charged particles, and non-separable ones where the method can do them; the largest counts.",
        f"In arithmetic of {DIGITS} digits (MPFR through gmpy2), with the stages solved to them, so that round-off hides no defect.",
    ),
    verdicts=(symplectic, others_not_symplectic, symmetric, others_not_symmetric, volume),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"A defect of at most {NOTHING:g} counts as none: a smaller one on all systems would pass unseen.",
        f"Above order {HIGH} a method is seen to lack a property by half of the digits that it is measured in, a processed one to lack symmetry from {NEARLY:g} on.",
        "Schemes IV and V choose λ from the state, so that their maps are not symplectic; with λ held fixed they are.",
    ),
    command="pytest benchmarks/experiments/orders",
)
