"""The report page on stability limits: measured ones compared with derived and printed ones."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.experiments.extremes import verdicts
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table, of


@of("extremes_published")
def table(known: pd.DataFrame) -> Table:
    """Make the page's table: measured beside known stability limits, disagreeing ones first, then finite ones."""
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
    caption = "Measured limits of h ω beside those that are known, derived as `by` says, or printed; none: stable at every step."
    return Table(pd.DataFrame(columns), caption)


def _limit(value: float) -> str:
    return "none" if np.isinf(value) else f"{value:.11g}"


@of("extremes_published")
def full_table(known: pd.DataFrame) -> pd.DataFrame:
    """Make the long table: every known stability limit of h omega with the measured one."""
    return known.drop(columns=["known"])


def answer(data: Data) -> str | None:
    """Write the page's answer: how many known stability limits are met, how many long runs confirm measured ones."""
    limits, runs = verdicts.known_limits(data), verdicts.long_runs(data)
    if limits is None or runs is None:
        return None
    text = (
        f"On the harmonic oscillator {limits.measured.n} of {limits.measured.of} known stability limits of hω are met"
    )
    return f"{text}, and {runs.measured.n} of {runs.measured.of} long runs beside measured limits end as predicted."


PAGE = Page(
    id="extremes-limits",
    question="Are the stability limits those that are known?",
    tables=("extremes_published", "extremes_scheme_i", "extremes_linear"),
    setting=(
        "H = (p² + ω² q²) / 2: a step is a matrix M(z), z = h ω, stable while |tr M| ≤ 2 and det M ≤ 1 (Jury's conditions).",
        "Measured: the columns of M are the compiled method's images of the unit vectors; ends are refined to ten digits.",
        "Derived: the trace and the determinant follow from the coefficients that the authors give, exactly or in 60 digits.",
        "Printed: others state the limit, where the table says.",
        "Long runs: beside each end, within later stable intervals and in gaps between them.",
    ),
    verdicts=(verdicts.known_limits, verdicts.closed_form, verdicts.long_runs),
    answer=answer,
    table=table,
    whole=full_table,
    limits=(
        "The derivations share no code and no coefficients with the methods, but their author.",
        "Printed limits were read in abstracts and in the documentation of software; books were not at hand.",
        "A limit on the oscillator is no limit on another problem: see [how far a method can be pushed](extremes.md).",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
