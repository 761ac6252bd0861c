"""Verdicts on round-off over long times: how fast energy and phase errors grow, their size, and their bias."""

from __future__ import annotations

import pandas as pd
from scipy import stats

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_controls as by_hand
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Data, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Exactly, Verdict, at_most

#: Brouwer's exponents, how far above them an interval may begin, and the largest energy error in units eps h n^(1/2).
ENERGY, PHASE, ABOVE, UNITS = 0.5, 1.5, 0.05, 10.0
#: Probability that an unbiased table of ensembles shows a bias by chance.
CHANCE = 0.05
MEAN = "bias in its errors"


def named_step(h: float) -> str:
    """Format a step; one slightly off a simple fraction as that fraction times (1 + 2^-40)."""
    beside = [x for x in (brouwer.DECIMAL, brouwer.TENTH) if h == x * brouwer.ASIDE]
    return f"{beside[0]:g} (1 + 2^-40)" if beside else f"{h:.10g}"


def exponent(row: pd.Series, name: str) -> str:
    """Format the exponent of growth of the error ``name`` ("energy" or "phase") in a row, with its interval.

    Empty where there is none.
    """
    value, low, high = (row.get(f"{name} {part}") for part in ("exponent", "low", "high"))
    return "" if value is None or pd.isna(value) else f"{value:.2f} [{low:.2f}, {high:.2f}]"


def critical(rows: pd.DataFrame) -> float:
    """Compute the largest |mean error|, in standard errors, that chance explains in a table of ensembles of runs.

    If none of the ensembles has a bias, the probability that at least one of them exceeds it is `CHANCE`.
    """
    each = 1 - (1 - CHANCE) ** (1 / len(rows))
    return float(stats.t.ppf(1 - each / 2, rows["starts"].min() - 1))


def _rows_with_mean(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the ensembles that have a mean energy error."""
    return rows[rows[MEAN].notna()] if MEAN in rows else rows.iloc[:0]


def biased_ensembles(rows: pd.DataFrame) -> pd.DataFrame:
    """Select the ensembles whose mean energy error is farther from 0 than chance explains, the farthest first."""
    tested = _rows_with_mean(rows)
    if tested.empty:
        return tested
    return tested[tested[MEAN].abs() > critical(tested)].sort_values(MEAN, key=abs, ascending=False)


def overtaken(row: pd.Series) -> float:
    """Compute after how many steps a bias, growing as n, is as large as the random walk, growing as n^(1/2)."""
    return row["steps"] * row["starts"] / row[MEAN] ** 2


def _where(row: pd.Series) -> str:
    return f"{row['label']} at h = {named_step(row['h'])}"


def _biased_where(row: pd.Series) -> str:
    of_h = row.get("by") == every.ENERGY  # H is kept: its mean error is an offset that does not grow
    return f"{_where(row)} ({'an offset' if of_h else f'leads after {number(overtaken(row), 2)} steps'})"


def _tables(data: Data) -> list[pd.DataFrame]:
    """Return the tables of ensembles of runs, without empty ones and without the hand-written controls.

    One table is of a few methods at chosen steps, the other of every method whose growth could be measured.
    """
    chosen, all_ = data("extremes_growth"), data("extremes_growth_every")
    tables = [] if chosen is None or chosen.empty else [chosen[chosen["kind"] != brouwer.HAND]]
    tables += [] if all_ is None or all_.empty else [all_[all_["reason"].astype(object).fillna("") == ""]]
    return [table for table in tables if len(table)]


def ensembles(data: Data, column: str) -> pd.DataFrame:
    """Select the ensembles of all tables that have a value in the column ``column``."""
    tables = [table[table[column].notna()] for table in _tables(data) if column in table]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _growth(data: Data, name: str, law: float) -> tuple[Count, Exactly, str, str]:
    """Make the arguments of a verdict that errors grow no faster than n^``law``, n the number of steps.

    They are how many ensembles of runs do not surely grow faster, that all should, a unit, and which do grow faster.
    ``name``, the error, is "energy" or "phase".
    """
    rows = ensembles(data, f"{name} exponent")
    fast = rows[rows[f"{name} low"] > law + ABOVE]
    names = [f"{_where(row)}: n^{row[f'{name} exponent']:.2f}" for _, row in fast.iterrows()]
    return Count(len(rows) - len(fast), len(rows)), EVERY, "ensembles", join_list(names, 3) if names else ""


def energy(data: Data) -> Verdict | None:
    """Judge whether the energy error by round-off grows no faster than n^(1/2), Brouwer's law, at every step size."""
    if ensembles(data, "energy exponent").empty:
        return None
    return Verdict(
        "The energy's round-off grows no faster than n^(1/2), Brouwer's law", *_growth(data, "energy", ENERGY)
    )


def phase(data: Data) -> Verdict | None:
    """Judge whether the phase error by round-off grows no faster than n^(3/2) in the number n of steps."""
    if ensembles(data, "phase exponent").empty:
        return None
    return Verdict("The phase's round-off grows no faster than n^(3/2)", *_growth(data, "phase", PHASE))


def size(data: Data) -> Verdict | None:
    """Judge whether the energy's round-off is as small as compensated sums allow: `UNITS` times eps h n^(1/2)."""
    rows = ensembles(data, "in units")
    if rows.empty:
        return None
    worst = rows.loc[rows["in units"].idxmax()]
    where = f"{_where(worst)}, {number(float(worst['steps']))} steps"
    return Verdict(
        "The energy's round-off is no larger than compensated sums allow",
        float(worst["in units"]),
        at_most(UNITS),
        "eps h n^(1/2)",
        where,
    )


def bias(data: Data) -> Verdict | None:
    """Judge whether no ensemble's mean energy error is larger than chance explains.

    Ensembles chosen for a lambda or step at a simple fraction, such as 1/3 or 1/100, are left out: their round-off
    repeats itself.
    """
    tables = [t[t["kind"] != brouwer.FRACTION] if "kind" in t else t for t in _tables(data)]
    tested = sum(len(_rows_with_mean(t)) for t in tables)
    if not tested:
        return None
    found = [row for t in tables for _, row in biased_ensembles(t).iterrows()]
    names = [_biased_where(row) for row in sorted(found, key=lambda row: -abs(row[MEAN]))]
    return Verdict(
        "Away from simple fractions, round-off has no bias",
        Count(len(found), tested),
        NONE,
        "ensembles",
        join_list(names, 2) if names else "",
    )


def faster(rows: pd.DataFrame) -> pd.Series:
    """True for each ensemble whose energy error surely grows faster than n^(1/2), by `ABOVE` in the exponent."""
    return rows["energy low"] > ENERGY + ABOVE


@of("extremes_growth")
def controls(table: pd.DataFrame) -> Verdict | None:
    """Judge whether the controls confirm the explanation of the drift at simple fractions, and plain sums lose more.

    The drift must vanish slightly off the fraction, persist with exact products alone, and vanish if velocity and force
    see the whole state.  None if one of the four controls was not measured.
    """
    beside = table[table["kind"] == brouwer.ASIDE_OF]
    plain, half, whole = (
        table[(table["label"] == label) & table["energy exponent"].notna()]
        for label in (brouwer.CONTROL, by_hand.HALF, by_hand.WHOLE)
    )
    if any(rows.empty for rows in (beside, plain, half, whole)):
        return None
    right = {
        "plain sums": bool((plain["in units"] > UNITS).all()),
        "beside a fraction": not faster(beside).any(),
        by_hand.HALF: bool(faster(half).any()),
        by_hand.WHOLE: not faster(whole).any(),
    }
    wrong = [name for name, holds in right.items() if not holds]
    return Verdict(
        "Controls drift, or do not, as the rounding of the state explains",
        Count(4 - len(wrong), 4),
        EVERY,
        "controls",
        join_list(wrong) if wrong else "",
        FAIL,
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how many ensembles follow Brouwer's law in the energy, and at which steps it drifts."""
    rows = ensembles(data, "energy exponent")
    if rows.empty:
        return None
    fast = rows[faster(rows)]
    text = f"In {len(rows) - len(fast)} of {len(rows)} ensembles the energy's round-off grows no faster than n^(1/2)"
    text += " after n steps, Brouwer's law"
    near = fast[fast["kind"] == brouwer.FRACTION] if "kind" in fast else fast.iloc[:0]
    if near.empty:
        return f"{text}."
    step = named_step(near.loc[near["energy exponent"].idxmax(), "h"])
    return f"{text}; it drifts next to fractions such as h = {step}."
