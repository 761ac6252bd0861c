"""How does round-off grow over long times, and why does it drift at some steps."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.experiments.extremes import brouwer
from phasebench.benchmarks.experiments.extremes import brouwer_every as every
from phasebench.benchmarks.experiments.extremes import round_off_verdicts as verdicts
from phasebench.benchmarks.page.page import ROWS, Page, Table


def table(data) -> Table | None:
    """Fractions and what is beside them, by hand, then of all methods the worst."""
    known = whole(data)
    if known is None:
        return None
    order = {brouwer.FRACTION: 0, brouwer.ASIDE_OF: 1, brouwer.HAND: 2}
    known = known[known["energy low"].notna()].assign(order=known["kind"].map(order).fillna(3))
    first = known[known["order"] < 3].sort_values(["order", "label", "h"])
    # The worst first: the farther its exponent is above the law's, then the larger it is.
    rest = known[known["order"] == 3].assign(above=lambda t: (t["energy low"] - verdicts.ENERGY).clip(lower=0))
    shown = pd.concat([first, rest.sort_values(["above", "in units"], ascending=False)]).head(ROWS)
    columns = {
        "run": shown["label"],
        "h": [verdicts.named_step(h) for h in shown["h"]],
        "steps": shown["steps"].astype(float),
        "energy ~ n^": [verdicts.exponent(row, "energy") for _, row in shown.iterrows()],
        "phase ~ n^": [verdicts.exponent(row, "phase") for _, row in shown.iterrows()],
        "of eps h n^(1/2)": shown["in units"],
        "mean a step": shown["bias per step"],
        "of its error": shown["bias in its errors"],
    }
    caption = (
        "Fractions of small denominators, what is beside them, by hand, then of all other ensembles the worst, the rest in "
        "the CSV. Exponents with 95 % intervals; the rms error of the energy at the end in units of eps h n^(1/2); the "
        "mean change of the energy a step, and in units of its standard error."
    )
    return Table(pd.DataFrame(columns), caption)


def whole(data) -> pd.DataFrame | None:
    """Every ensemble with every number, and the methods that have none with the reason."""
    known = [t for t in (data("extremes_growth"), data("extremes_growth_every")) if t is not None and len(t)]
    return pd.concat(known, ignore_index=True) if known else None


PAGE = Page(
    id="extremes-round-off",
    question="How does round-off grow over long times?",
    tables=("extremes_growth", "extremes_growth_every"),
    setting=(
        "H = (p² + q²) / 2: a symplectic step is a matrix M of trace 2 cos θ; w = M_pq q + (e^{iθ} - M_qq) p turns by θ and keeps |w|.",
        f"{brouwer.STARTS} seeded starts; |w|² and arg w in {brouwer.DIGITS} digits, M from the coefficients and the double h; what changes is round-off.",
        "Brouwer 1937: unbiased rounding lets the energy's error grow as n^(1/2), the phase's as n^(3/2) where the period depends on the energy.",
        "Fractions of small denominators: h = 0.01 and 0.1, λ = 1/3; a little beside them: h (1 + 2^-40), λ = 0.3333333333. "
        f"Every method: h = {every.H:g}, {every.DEAR} to {every.EXPLICIT} steps, fewer where one costs more; of what keeps H the error of H itself.",
        "By hand: Stormer-Verlet by plain sums; by exact products; by exact products with the state's lost part in velocity and force.",
    ),
    verdicts=(verdicts.brouwers_law, verdicts.every_method, verdicts.small_denominators),
    table=table,
    whole=whole,
    limits=(
        f"An exponent fails where its interval begins more than {verdicts.ABOVE:g} above the law's, a size above {verdicts.UNITS:g} eps h n^(1/2), a mean where "
        f"Student's law gives it a probability of less than {verdicts.CHANCE:.0%} over all ensembles of its table.",
        "A bias grows as n and overtakes a random walk after so many steps as make its mean as large as the walk; of a method that keeps H the mean is an offset.",
        "Coefficients that are rounded to doubles make another symplectic map: the phase has a part linear in n, which is no round-off of the run.",
        "The oscillator's force is exact in doubles; a force that rounds by itself may hide the residues of the state.",
        "The drift next to fractions is not mended: the force would have to be evaluated at more digits than a double has; another step costs nothing.",
        "Methods that are neither symplectic nor keep the energy drift by truncation, not by round-off: they have no ensemble here.",
        f"The runs of every method are short: an exponent is told over {every.ROWS} to 1, at h = {every.H:.3g}; where the map is not known exactly the phase is not told.",
    ),
    command="pytest benchmarks/experiments/extremes",
    listed=False,
)
