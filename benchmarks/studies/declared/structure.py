"""Defects of symplecticity, symmetry and volume of the step maps of every method, in multiprecision."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.judge.evidence import NO_DEFECT
from phasebench.benchmarks.measure import declared
from phasebench.benchmarks.measure.declared import HIGH, NEARLY, PROPERTIES, least_visible
from phasebench.benchmarks.measure.multiprecision import DIGITS, methods
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, NONE, at_most
from phasebench.benchmarks.store.cells import UNCOMPILED

TABLE = "structure"
#: Smaller defects are drawn at this value.
FLOOR = 1e-42
#: Methods shown of each property, of those declared to have it and of the others.
SHOWN = 4
#: The defect of a method that has a property is below this.
ROUND_OFF = 1e-26


def least(rows: pd.DataFrame) -> list[float]:
    """The least defect that shows that the method lacks the property, for each row."""
    return [least_visible(*key) for key in zip(rows["method"], rows["property"], strict=True)]


def hides(rows: pd.DataFrame) -> pd.Series:
    """True where a defect does not show that a method lacks a property."""
    return ~(rows["defect"] > least(rows))


def as_declared(rows: pd.DataFrame) -> pd.Series:
    """True where a defect agrees with what is declared."""
    return (rows["defect"] <= NO_DEFECT).where(rows["declared"], ~hides(rows))


def round_off(rows: pd.DataFrame) -> pd.Series:
    """True where a defect is of round-off, in the digits in which it was measured."""
    return rows["defect"] <= np.minimum(ROUND_OFF, least(rows))


@of(TABLE)
def _answer(rows: pd.DataFrame) -> str:
    right = as_declared(rows).groupby(rows["property"], sort=False).agg(["sum", "size"])
    counts = [f"{right['sum'][name]} of {right['size'][name]} in {name}" for name in PROPERTIES if name in right.index]
    return f"In arithmetic of {DIGITS} digits step maps are as declared: {join_list(counts, len(counts))}."


@picture(
    TABLE, "structure", "defects of the step maps",
    f"Defects of the step maps in {DIGITS} digits, the largest over the systems; dashed: {NO_DEFECT:g}, below which a "
    f"defect is of the stage solver and the differences; zeros are drawn at {FLOOR:g}. Methods of high order that lack "
    "a property may be below the line, too.",
)  # fmt: skip
def _draw(rows: pd.DataFrame) -> style.Figure:
    def defects(axes: style.Axes, part: pd.DataFrame) -> None:
        first = 0
        for k, (known, label) in enumerate(((True, "declared"), (False, "not declared"))):
            defect = np.sort(part[part["declared"] == known]["defect"].clip(lower=FLOOR))
            look = {"color": style.CURVES[k][0], "marker": style.CURVES[k][2], "linestyle": "none"}
            axes.semilogy(first + np.arange(len(defect)), defect, label=label, **look)
            first += len(defect)
        axes.axhline(NO_DEFECT, color=style.GREY, linewidth=0.9, linestyle="--")
        axes.grid(axis="y", color="0.93", linewidth=0.5)

    parts = [(name, part) for name in PROPERTIES if len(part := rows[rows["property"] == name])]
    text = "methods, by defect", "defect of one step"
    return style.row(parts, defects, 3.0, *text, legend=2, grid=False, sharey=True)


@of(TABLE)
def _whole(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(declared=rows["declared"].map({True: "yes", False: "no"}))


@of(TABLE)
def _table(rows: pd.DataFrame) -> Table:
    parts = []
    for name in PROPERTIES:
        part = rows[rows["property"] == name]
        parts += [part[part["declared"]].nlargest(SHOWN, "defect"), part[~part["declared"]].nsmallest(SHOWN, "defect")]
    shown = _whole({TABLE: pd.concat(parts)}.get)[["property", "method", "declared", "defect"]].head(ROWS)
    caption = (
        f"The methods nearest to the limit of {NO_DEFECT:g}: of each property the four largest defects of methods "
        "declared to have it, and the four smallest of the others."
    )
    return Table(shown, caption)


STUDY = Study(
    id="structure",
    place=130,
    question="Are the step maps symplectic, symmetric and volume-preserving where they are declared to be?",
    answer=_answer,
    setting=(
        "Symplecticity: the largest entry of MᵀJM − J, M the Jacobian of one step by differences. Of a charged "
        "particle, with p = v + A(x), J is the magnetic two-form dx ∧ dv + B: this is K-symplecticity.",
        "Symmetry: |Φ₋ₕ(Φₕ(y)) − y|, the distance from the start after a step and the same step backwards.",
        "Volume: |det M − 1|, of methods for charged particles and, as controls, of some others, on charged particles.",
        "Systems: pendulum, Hénon–Heiles, charged particles, and non-separable ones where the method can do them; the "
        "largest counts.",
        f"In arithmetic of {DIGITS} digits (MPFR through gmpy2), with the stages solved to them, so that round-off "
        "hides no defect.",
    ),
    runs=(
        Runs(
            TABLE, declared.structure, declared.STRUCTURE,
            needs=lambda method, property: [methods()[method]], where=UNCOMPILED,
        ),
    ),
    claims={
        "symplectic": Claim(
            "The defect of symplecticity vanishes for methods declared symplectic",
            TABLE, "defect", at_most(NO_DEFECT), rows="property == 'symplecticity' and declared", where="{method}",
            fault=True,
        ),
        "not symplectic": Claim(
            "No method is symplectic that is not declared so",
            TABLE, hides, NONE, rows="property == 'symplecticity' and not declared", unit="methods", where="{method}",
            names=3, fault=True,
        ),
        "symmetric": Claim(
            "The defect of symmetry vanishes for methods declared symmetric",
            TABLE, "defect", at_most(NO_DEFECT), rows="property == 'symmetry' and declared", where="{method}",
            fault=True,
        ),
        "not symmetric": Claim(
            "No method is symmetric that is not declared so",
            TABLE, hides, NONE, rows="property == 'symmetry' and not declared", unit="methods", where="{method}",
            names=3, fault=True,
        ),
        "volume": Claim(
            "Methods for charged particles keep volume where declared, and the controls do not",
            TABLE, as_declared, EVERY, rows="property == 'volume'", unit="methods", where="{method}", names=3,
            fault=True,
        ),
    },
    checks={
        "round-off": Claim(
            "Defects of what is declared are of round-off",
            TABLE, round_off, EVERY, rows="declared", where="{method}, {property}",
        ),
    },
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        f"A defect of at most {NO_DEFECT:g} counts as none: a smaller one on all systems would pass unseen.",
        f"Above order {HIGH} a method is seen to lack a property by half of the digits that it is measured in, a "
        f"processed one to lack symmetry from {NEARLY:g} on.",
        "Schemes IV and V choose λ from the state, so that their maps are not symplectic; with λ held fixed they are.",
    ),
)  # fmt: skip
