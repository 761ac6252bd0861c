"""What the pages say of round-off over long times: functions of the tables of ensembles."""

from __future__ import annotations

import pandas as pd
from scipy import stats

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_controls as controls
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import Verdict, of

#: Brouwer's exponents, how far above them an interval may begin, and the energy error that is round-off's in its units.
ENERGY, PHASE, ABOVE, UNITS = 0.5, 1.5, 0.05, 10.0
#: One bias in so many tables of ensembles is named by chance: its probability over all ensembles of a table.
CHANCE = 0.05
MEAN = "bias in its errors"


def named_step(h: float) -> str:
    """A step in digits; one a little beside a fraction as that fraction with its factor."""
    beside = [x for x in (brouwer.DECIMAL, brouwer.TENTH) if h == x * brouwer.ASIDE]
    return f"{beside[0]:g} (1 + 2^-40)" if beside else f"{h:.10g}"


def exponent(row, name: str) -> str:
    """An exponent of a row with its interval; empty where there is none."""
    value, low, high = (row.get(f"{name} {part}") for part in ("exponent", "low", "high"))
    return "" if value is None or pd.isna(value) else f"{value:.2f} [{low:.2f}, {high:.2f}]"


def critical(rows: pd.DataFrame) -> float:
    """The mean, in its standard errors, that one of these unbiased ensembles exceeds with probability `CHANCE`."""
    each = 1 - (1 - CHANCE) ** (1 / len(rows))
    return float(stats.t.ppf(1 - each / 2, rows["starts"].min() - 1))


def biased(rows: pd.DataFrame) -> pd.DataFrame:
    """The ensembles whose mean energy error is farther from 0 than chance explains, the farthest first."""
    told = rows[rows[MEAN].notna()] if MEAN in rows else rows.iloc[:0]
    if told.empty:
        return told
    return told[told[MEAN].abs() > critical(told)].sort_values(MEAN, key=abs, ascending=False)


def _bias(rows: pd.DataFrame, tested: pd.DataFrame) -> str:
    """A sentence on the ensembles that are biased, of all that were tested."""
    told = tested[tested[MEAN].notna()] if MEAN in tested else tested.iloc[:0]
    if told.empty:
        return ""
    if rows.empty:
        return f" No mean is beyond the {critical(told):.1f} standard errors that chance explains."
    names = listed([f"{_where(r)}, {r[MEAN]:.1f} ({_overtakes(r)})" for _, r in rows.iterrows()], 6)
    return (
        f" A mean beyond the {critical(told):.1f} standard errors that chance explains, so a bias, "
        f"{'has' if len(rows) == 1 else 'have'} {len(rows)} of {len(told)}: {names}."
    )


def overtaken(row) -> float:
    """The steps after which a bias is as large as the random walk: n times the starts over the square of its mean."""
    return row["steps"] * row["starts"] / row[MEAN] ** 2


def _overtakes(row) -> str:
    if row.get("by") == every.ENERGY:
        return "an offset, H is kept"
    return f"overtakes the walk after {number(overtaken(row), 2)} steps"


def _where(row) -> str:
    return f"{row['label']} at h = {named_step(row['h'])}"


def _size(row) -> str:
    return f"{number(row['in units'])} ({_where(row)}, {number(float(row['steps']))} steps)"


def _above(rows: pd.DataFrame, name: str, law: float) -> pd.DataFrame:
    """The ensembles whose whole interval of an exponent is above the law's."""
    return rows[rows[f"{name} low"] > law]


def _but(rows: pd.DataFrame, name: str) -> str:
    """In brackets the ensembles above a law with their exponents."""
    said = [f"{_where(r)}, n^{exponent(r, name)}" for _, r in rows.iterrows()]
    return f" (above it: {listed(said, 6)})" if said else ""


@of("extremes_growth")
def brouwers_law(table: pd.DataFrame) -> Verdict | None:
    """Whether round-off grows as Brouwer's law has it at every step, and plain sums do not stay as small."""
    fitted = table[table["energy exponent"].notna()]
    ours, control = fitted[fitted["kind"] != brouwer.HAND], fitted[fitted["label"] == brouwer.CONTROL]
    if ours.empty or control.empty:
        return None
    fast, late = _above(ours, "energy", ENERGY), _above(ours, "phase", PHASE)
    wrong = bool(faster(ours).any() or (ours["phase low"] > PHASE + ABOVE).any())
    long = table[table["energy exponent"].isna()]
    sizes = ours[ours["in units"].notna()]
    caught = bool((control["in units"] > UNITS).all())
    counts = f"{len(ours) - len(fast)} of {len(ours)} ensembles"
    text = (
        f"Brouwer's law: the energy's round-off grows no faster than n^{ENERGY:g} in {counts}{_but(fast, 'energy')}, "
        f"the phase's than n^{PHASE:g} in {len(ours) - len(late)}{_but(late, 'phase')}. Largest errors of the energy "
        f"over eps h n^(1/2): {_largest(sizes, long)}"
        f"plain sums, the control, {_size(control.loc[control['in units'].idxmax()])}"
    )
    text += "." if caught else ": not told apart."
    # Next to a fraction the drift is a bias already.
    plain = ours[ours["kind"] != brouwer.FRACTION]
    bias = biased(plain)
    large = pd.concat([sizes, long])["in units"] > UNITS
    holds = not wrong and not large.any() and caught and bias.empty
    return Verdict(text + _bias(bias, plain), holds, f"Round-off grows by Brouwer's law in {counts}.")


def _largest(sizes: pd.DataFrame, long: pd.DataFrame) -> str:
    """The largest error of each kind of ensemble, each with its own step and number of steps."""
    near = sizes["kind"] == brouwer.FRACTION
    kinds = (("", sizes[~near]), ("next to fractions ", sizes[near]), ("of the long run ", long))
    return "".join(f"{head}{_size(rows.loc[rows['in units'].idxmax()])}, " for head, rows in kinds if len(rows))


@of("extremes_growth_every")
def every_method(table: pd.DataFrame) -> Verdict | None:
    """Of how many of our methods round-off grows no faster than Brouwer's law has it, and which have no ensemble."""
    reasons = table["reason"].astype(object).fillna("")
    run, left = table[reasons == ""], table[reasons != ""]
    if run.empty:
        return None
    fitted = run[run["energy exponent"].notna()]
    fast, late = _above(fitted, "energy", ENERGY), _above(fitted, "phase", PHASE)
    wrong = bool(faster(fitted).any() or (fitted["phase low"] > PHASE + ABOVE).any())
    large, bias = run[run["in units"] > UNITS], biased(run)
    told, worst = int(run["phase exponent"].notna().sum()), run.loc[run["in units"].idxmax()]
    said = f"{len(run) - len(fast)} of {len(run)} methods at h = {run['h'].iloc[0]:.3g}"
    whose = f"Every symplectic or energy-preserving method, {int(run['starts'].min())} starts"
    phase = f"the phase's than n^{PHASE:g} in {told - len(late)} of {told}{_but(late, 'phase')}"
    text = (
        f"{whose}: the energy's round-off grows no faster than n^{ENERGY:g} in {said}{_but(fast, 'energy')}, {phase}; "
        f"in units of eps h n^(1/2) the energy's is at most {_size(worst)}"
    )
    if len(left):
        text += f"; {len(left)} have none here: {listed(list(left['label']), 4)}"
    holds = not wrong and large.empty and bias.empty
    short = f"Round-off grows by the law in {said}; {len(bias)} are biased."
    return Verdict(f"{text}.{_bias(bias, run)}", holds, short)


def faster(rows: pd.DataFrame) -> pd.Series:
    """Whether the energy's exponent is above the law's for certain, by more than `ABOVE`."""
    return rows["energy low"] > ENERGY + ABOVE


def _named(row) -> str:
    return f"{_where(row)}, n^{row['energy exponent']:.2f}"


@of("extremes_growth")
def small_denominators(table: pd.DataFrame) -> Verdict | None:
    """Whether the drift next to fractions of small denominators is there, and is what it is said to be.

    It must go where the fraction is left by a little, stay where products alone are exact, and go where velocity and
    force see the whole state.
    """
    parts = {kind: table[table["kind"] == kind] for kind in (brouwer.FRACTION, brouwer.ASIDE_OF)}
    parts |= {label: table[table["label"] == label] for label in (controls.HALF, controls.WHOLE)}
    if any(rows.empty for rows in parts.values()):
        return None
    drifting = {kind: rows[faster(rows)] for kind, rows in parts.items()}
    fractions, beside = drifting[brouwer.FRACTION], drifting[brouwer.ASIDE_OF]
    asked, near = parts[brouwer.FRACTION], parts[brouwer.ASIDE_OF]
    product, whole = (drifting[label] for label in (controls.HALF, controls.WHOLE))
    explained = beside.empty and whole.empty and not product.empty
    text = f"Next to a fraction of a small denominator the energy drifts in {len(fractions)} of {len(asked)} ensembles"
    if len(fractions):
        text += f" ({listed([_named(row) for _, row in fractions.iterrows()], 4)})"
    text += (
        f", a little beside it in {len(beside)} of {len(near)}; with exact products Stormer-Verlet "
        f"{'still drifts' if len(product) else 'does not drift'}, and where velocity and force see the lost part of "
        f"the state too it {'still does' if len(whole) else 'does not'}: "
    )
    text += "the bias is of the rounded state's few residues" if explained else "the drift is not explained"
    said = f"Steps such as {brouwer.DECIMAL:g} drift by the state's rounding{'' if explained else ', or so it seems'}."
    return Verdict(f"{text}.{_bias(biased(near), near)}", fractions.empty, said)
