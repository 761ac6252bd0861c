"""The report page on round-off: how energy and phase errors grow over long times, and why they drift at some steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts
from phasebench.benchmarks.page.page import ROWS, Page, Table

if TYPE_CHECKING:
    from phasebench.benchmarks.page.page import Data


def table(data: Data) -> Table | None:
    """Make the page's table, a row for each ensemble of runs: growth, size and bias of the energy's round-off.

    First are those with h or lambda at simple fractions, then those slightly off them, the controls, and the worst of
    the others.
    """
    known = full_table(data)
    if known is None:
        return None
    order = {brouwer.FRACTION: 0, brouwer.ASIDE_OF: 1, brouwer.HAND: 2}
    known = known[known["energy low"].notna()].assign(order=known["kind"].map(order).fillna(3))
    first = known[known["order"] < 3].sort_values(["order", "label", "h"])
    # Worst first: by how far the exponent is above the law's, then by the size of the error.
    rest = known[known["order"] == 3].assign(above=lambda t: (t["energy low"] - verdicts.ENERGY).clip(lower=0))
    shown = pd.concat([first, rest.sort_values(["above", "in units"], ascending=False)]).head(ROWS)
    columns = {
        "run": shown["label"],
        "h": [verdicts.named_step(h) for h in shown["h"]],
        "steps": shown["steps"].astype(float),
        "energy ~ n^": [verdicts.exponent(row, "energy") for _, row in shown.iterrows()],
        "phase ~ n^": [verdicts.exponent(row, "phase") for _, row in shown.iterrows()],
        "error / eps h n^(1/2)": shown["in units"],
        "mean a step": shown["bias per step"],
        "in standard errors": shown["bias in its errors"],
    }
    caption = (
        "Fractions of small denominators, steps beside them, controls by hand, then of all other ensembles the worst. "
        "Powers of n with 95 % intervals; the rms error of the energy at the end in units of eps h n^(1/2); the mean "
        "change of the energy a step, and in units of its standard error."
    )
    return Table(pd.DataFrame(columns), caption)


def full_table(data: Data) -> pd.DataFrame | None:
    """Make the long table: the growth of round-off in every ensemble, or the reason why a method has none."""
    known = [t for t in (data("extremes_growth"), data("extremes_growth_every")) if t is not None and len(t)]
    return pd.concat(known, ignore_index=True) if known else None


PAGE = Page(
    id="extremes-round-off",
    question="How does round-off grow over long times?",
    tables=("extremes_growth", "extremes_growth_every"),
    setting=(
        "H = (p² + q²) / 2: a symplectic step is a matrix M of trace 2 cos θ; w = M_pq q + (e^{iθ} - M_qq) p turns by θ and keeps |w|.",
        f"An ensemble: {brouwer.STARTS} seeded starts; |w|² and arg w in {brouwer.DIGITS} digits, M from the coefficients and the double h, so that what changes is round-off.",
        "Brouwer 1937: unbiased rounding lets the energy's error grow as n^(1/2), the phase's as n^(3/2) where the period depends on the energy.",
        "Chosen methods, also at fractions of small denominators (h = 0.01 and 0.1, λ = 1/3) and beside them (h (1 + 2^-40), λ = 0.3333333333). "
        f"Every method: h = {every.H:g}, {every.DEAR} to {every.EXPLICIT} steps, fewer for dear ones; for methods that keep H, the error of H.",
        "Controls by hand: Störmer–Verlet by plain sums; with exact products; with exact products and the state's lost digits seen by velocity and force.",
    ),
    verdicts=(verdicts.energy, verdicts.phase, verdicts.size, verdicts.bias, verdicts.controls),
    answer=verdicts.answer,
    table=table,
    whole=full_table,
    limits=(
        f"A power fails where its 95 % interval begins more than {verdicts.ABOVE:g} above the law's; a mean where Student's law gives it a probability of less than {verdicts.CHANCE:.0%} over all ensembles of its table.",
        "The drift at fractions of small denominators is a bias: the state's rounded-off digits take few values there, whose mean is not 0. The controls show it; another step avoids it.",
        "A bias grows as n and leads over a random walk after as many steps as make its mean as large; for a method that keeps H the mean is an offset.",
        "Coefficients that are rounded to doubles make another symplectic map: the phase has a part linear in n, which is no round-off of the run.",
        "The oscillator's force is exact in doubles; a force that rounds by itself may hide the drift.",
        "Methods that are neither symplectic nor keep the energy drift by truncation, not by round-off: they have no ensemble here.",
        f"The runs of every method are short: a power is fitted over a factor {every.ROWS} in n, at h = {every.H:.3g}; the phase is not judged where the step map is not known exactly.",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
