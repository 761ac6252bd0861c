"""Are the stated uncertainties of the certified reference states true, and their horizons?

A horizon is the time up to which a run rounded to long double stays close to the exact orbit.  Between the stored times
the state and its uncertainty are those that the error of a user's run is measured with (`measure.truths`).
"""

from __future__ import annotations

from collections.abc import Callable
from zlib import crc32

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.quantities import END_STATE
from phasebench.benchmarks.page.markdown import join_list
from phasebench.benchmarks.page.page import ROWS, Table, of
from phasebench.benchmarks.page.shared import picture, total, worst
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study, over
from phasebench.benchmarks.page.verdict import EVERY, NONE, Between, at_least
from phasebench.benchmarks.problems import labels
from phasebench.benchmarks.problems import problem as problem_of
from phasebench.benchmarks.problems.base import Problem
from phasebench.reference.certificates import check, followed
from phasebench.reference.certificates.along import norm
from phasebench.reference.certificates.horizon import CENTRAL, DRAWS, FASTEST, LIMIT
from phasebench.reference.certificates.make import FACTOR, PRECISION
from phasebench.reference.certificates.others import SAFETY
from phasebench.reference.certificates.stored import TELLING
from phasebench.reference.solvers import taylor

STORED, ODD = "references", "references_odd"
LEAVES = "long double leaves"
#: Number of times between the stored ones; the earliest, as a share of the span; the seed.
TIMES, FIRST, SEED = 20, 0.01, 25
#: Bits and tolerance of the exact run; its largest number of degrees of freedom; bits of quadruple precision.
MANY, TOLERANCE, LARGEST, QUADRUPLE = 240, "1e-60", 9, 113


def stored_states(problem: str) -> dict[str, object]:
    """The stored reference states of an orbit, measured again."""
    return check.recheck(problem_of(problem)).row()


def times(made: Problem, count: int = TIMES) -> list[float]:
    """Random times between the stored ones of an orbit, ascending."""
    random = np.random.default_rng([SEED, crc32(made.label.encode())])
    return sorted(float(t) for t in made.start.times[-1] * random.uniform(FIRST, 1.0, count))


def errors(made: Problem, at: list[float]) -> list[dict[str, object]]:
    """Error and stated uncertainty of the state at each time, and the numbers from which that is estimated."""
    many = made.system.d <= LARGEST
    bits = taylor.Bits(MANY) if many else taylor.extended_types()[1]
    exact = taylor.states(made.system, bits, made.q0, made.p0, at, TOLERANCE if many else None)
    rows = []
    for t, state in zip(at, exact, strict=True):
        runs = followed.follow(made, [t])
        true = truths.of_runs(made, END_STATE, runs)
        size = float(np.abs(true.values).max())
        rows.append(
            {
                "problem": made.label,
                "t": t,
                "bits": MANY if many else QUADRUPLE,
                "size": size,
                "error": norm(true.values, state, bits),
                "uncertainty": true.uncertainty,
                "long double": norm(runs.one[-1], state, bits),
                "rounding": true.rounding,
                "two runs": float(np.abs(runs.one[-1] - runs.other[-1]).max()),
                "early": bool(true.rounding <= LIMIT * size),
                "source": true.source,
            }
        )
    return rows


def between(problem: str) -> list[dict[str, object]]:
    """The errors of an orbit's states at random times between the stored ones."""
    made = problem_of(problem)
    return errors(made, times(made))


def by_chance(rows: pd.DataFrame) -> Between:
    """Condition: 95 % of the rows, or up to three standard deviations of as many draws fewer."""
    return at_least(0.95 - 3 * np.sqrt(0.05 * 0.95 / len(rows)))


def those(rows: str) -> Callable[[pd.DataFrame], str]:
    """The names of the orbits that a query selects."""

    def named(frame: pd.DataFrame) -> str:
        found = list(frame.query(rows)["problem"])
        return join_list(found, 4) if found else ""

    return named


COLUMNS = ["problem", "t_end", "error", "uncertainty", "horizon", "earliest", "latest", LEAVES, "rate", "distance"]
COLUMNS += ["its uncertainty"]
NAMED = {LEAVES: "this machine", "distance": "Gauss 16"}


@picture(
    STORED, "references", "errors, uncertainties and horizons",
    "Left: the error of each reference's digits at its last time, and the uncertainty stated for them. Right: its "
    "horizon, with the interval in which 95 of 100 long double runs leave the limit.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    shown = frame.sort_values("uncertainty").reset_index(drop=True)
    y, t_end = np.arange(len(shown)), shown["t_end"]
    figure, ((left, right),) = style.panels(1, 2, 1.3 + 0.145 * len(shown))
    for k, (column, label) in enumerate((("error", "error of the digits"), ("uncertainty", "stated uncertainty"))):
        colour, _, marker = style.CURVES[k]
        left.semilogx(shown[column], y, marker, color=colour, label=label)
    left.set_xlabel("max norm over (q, p) at the last time")
    colour, _, marker = style.CURVES[2]
    right.hlines(y, shown["earliest"] / t_end, shown["latest"] / t_end, color=colour, linewidth=2, label="interval")
    right.plot(shown["horizon"] / t_end, y, marker, color=colour, label="horizon")
    right.plot(shown[LEAVES] / t_end, y, "x", color="0.2", label="long double on this machine")
    right.set_xlabel("horizon / t_end")
    left.set_yticks(y, shown["problem"])
    right.set_yticks(y, [""] * len(y))
    for axes in (left, right):
        axes.set_ylim(-0.7, len(shown) - 0.3)
        axes.grid(color="0.93", linewidth=0.5)
        axes.legend(loc="lower right" if axes is left else "lower left")
    return figure


@of(STORED)
def _table(frame: pd.DataFrame) -> Table:
    hard = frame["rate"].notna() | (frame["earliest"] < frame["t_end"])
    shown = pd.concat([frame[hard], frame[~hard].nlargest(10, "uncertainty")])
    caption = (
        "The orbits with exponential divergence (rate, in 1/t) or whose interval begins before the end, then the ten "
        "largest uncertainties; errors at t_end. Comparisons left out, because the other solver has not two digits: "
        f"{int(frame['no comparison'].sum())}."
    )
    return Table(shown[COLUMNS].rename(columns=NAMED).head(ROWS), caption)


STUDY = Study(
    id="references",
    place=380,
    question="Can the references that errors are measured against be trusted, and until when?",
    answer="{confirmed} reference orbits are confirmed, uncertain by at most {uncertain}; {short} of them can be "
    "followed in long double for a part of their time span only.",
    setting=(
        f"Stored digits: a Taylor run in 113 bits. Their uncertainty: {FACTOR:g} times their distance from a run in "
        f"{PRECISION.bits} bits and of another order, plus that run's own. Errors are max norms over (q, p).",
        f"The error is measured again by a third run, in {check.AGAIN.bits} bits at the tolerance "
        f"{check.AGAIN.tolerance}. A reference fails where it exceeds the stated uncertainty, or is {check.LOOSE:g} "
        "times smaller.",
        f"Between stored times: two long double runs and {followed.DRAWS} displaced ones. Uncertainty: "
        f"{truths.SAFETY:g} times the difference of the two, {truths.GROWN:g} times the growth of a rounding error, "
        f"and a double's rounding; judged in {MANY} bits, above d = {LARGEST} in quadruple precision.",
        "Horizon: the time until which a state that is rounded to long double at every step stays within "
        f"{LIMIT:g} of its size, in the median of {DRAWS} seeded draws of the rounding; `earliest` to `latest` holds "
        "95 of 100 runs, `this machine` is one. Later, no error of a trajectory is given.",
        "`Gauss 16` (8 stages, long double) shares no code with the Taylor runs: its largest distance from the orbit, "
        "beside its own uncertainty.",
    ),
    runs=(
        Runs(STORED, stored_states, over(problem=labels())),
        Runs(ODD, between, over(problem=labels())),
    ),
    claims={
        "confirmed": Claim(
            "Errors and horizons, measured again, are as each reference states them",
            STORED, "changed != changed and `digits hold to the end` == True", EVERY, unit="references",
            where="{problem}", names=4, fault=True,
        ),
        "between": Claim(
            "At random times between stored states, the uncertainty bounds the error",
            ODD, "error <= uncertainty", EVERY, unit="states",
            where=worst("error / uncertainty", "{problem}, t = {t:.3g}"), fault=True,
        ),
        "second": Claim(
            "No other solver disagrees beyond the uncertainties of both",
            STORED, total("disagree", "pairs"), NONE,
            unit="comparisons", where=those("disagree > 0"), fault=True,
        ),
        "compared": Claim(
            "Another solver is accurate enough to check every stored state",
            STORED, total("states - unchecked", "states"),
            EVERY, unit="states", where=those("unchecked > 0"), fault=True,
        ),
        "horizons": Claim(
            "A long double run on this machine leaves the limit within the predicted interval",
            STORED, f"earliest <= `{LEAVES}` <= latest", by_chance, rows=f"earliest < t_end or `{LEAVES}` < t_end",
            unit="orbits", where="{problem}", names=4, fault=True,
        ),
    },
    numbers={
        "uncertain": Number(STORED, "uncertainty", digits=2),
        "short": Number(STORED, "horizon < t_end", take=pd.Series.sum),
    },
    figure=_draw,
    shown=_table,
    whole=of(STORED)(lambda frame: frame[COLUMNS].rename(columns=NAMED)),
    limits=(
        "All Taylor runs are heyoka's, from the same formulae: a mistake there shows only in the distance of the Gauss "
        f"method, down to its own uncertainty ({SAFETY:g} times the difference of two step sizes, and grown "
        "round-off).",
        f"A solver whose own uncertainty is above {TELLING:g} of the state's size has not two digits: it is not "
        "compared.",
        "Some runs leave the interval by chance: 5 % are expected outside, and up to three standard deviations more "
        "are allowed.",
        f"The interval takes rounding as normally distributed: {CENTRAL[1]:.3g} to {CENTRAL[0]:.3g} medians hold 95 % "
        f"of it. Divergence counts as exponential where neighbours part faster than t^{FASTEST:g}.",
    ),
)  # fmt: skip
