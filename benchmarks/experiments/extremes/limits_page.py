"""Are the stability limits those that are known: the measured ones beside those derived or printed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import verdicts
from phasebench.benchmarks.page.page import ROWS, Page, Table, of


@of("extremes_published")
def table(known: pd.DataFrame) -> Table:
    """The limits, those that are met by no digits first, then finite ones."""
    order = known.assign(endless=np.isinf(known["known limit"])).sort_values(["agrees", "endless"], kind="stable")
    shown = order.head(ROWS).astype(dict.fromkeys(("parameters", "derived", "printed"), object))
    label = shown["method"] + shown["parameters"].fillna("").map(lambda p: f" ({p})" if p else "")
    columns = {
        "method": label,
        "measured": shown["measured"].map(_limit),
        "known": shown["known limit"].map(_limit),
        "it is": shown["evidence"],
        "by": shown["derived"].fillna(""),
        "printed by": shown["printed"].fillna(""),
    }
    caption = "Stability limits of h ω beside those that are known; what is stable at every step has none."
    return Table(pd.DataFrame(columns), caption)


def _limit(value) -> str:
    return "none" if np.isinf(value) else f"{value:.11g}"


@of("extremes_published")
def whole(known: pd.DataFrame) -> pd.DataFrame:
    """Every limit."""
    return known.drop(columns=["known"])


PAGE = Page(
    id="extremes-limits",
    question="Are the stability limits those that are known?",
    tables=("extremes_published", "extremes_scheme_i", "extremes_linear"),
    setting=(
        "H = (p² + ω² q²) / 2: a step is a matrix M(z), z = h ω, stable while |tr M| ≤ 2 and det M ≤ 1 (Jury's conditions).",
        "Measured: the columns of M are what the compiled method makes of the unit vectors; ends are refined to ten digits.",
        "Derived: the trace and the determinant follow from the coefficients that the authors give, exactly or in 60 digits.",
        "Printed: somebody else states the limit, and it was looked up where the table says.",
    ),
    verdicts=(verdicts.limits,),
    table=table,
    whole=whole,
    limits=(
        "The derivations share no code and no coefficients with the methods; who wrote them is the same.",
        "What is printed was read in abstracts and in documentation of software; pages of books were not at hand.",
        "A limit on the oscillator is no limit on another problem: see [how far a method can be pushed](extremes.md).",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
