"""The report page on Hessian-free force-gradient methods: does their energy drift?

Such a method takes a second evaluation of the force where others need the Hessian of the potential.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Range, Verdict, at_least, at_most

from .hessian_free import CHAOTIC, CONTROL, EARLIER, ORBIT_STEPS, ORBITS, REGULAR, REGULAR_STEPS, STEPS, H

if TYPE_CHECKING:
    from pathlib import Path

#: Share of the 95 % intervals that should hold zero, of so few.
LEAST = 0.85
#: Largest change on a regular orbit, in units of the oscillation.
STILL = 1e-6
#: Largest spread of chaotic orbits, in units of the one with the Hessian.
SAME = 2.0
PARTNER = "with the Hessian"


def _free(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame[PARTNER].notna() & (frame[PARTNER].astype(str) != "")]


def _zero(rows: pd.DataFrame) -> tuple[Count, str]:
    """Count the rows whose interval of the energy's drift holds zero: (count, first method whose interval does not).

    The second value is "" if all intervals hold zero.
    """
    holds = (rows["low"] <= 0) & (rows["high"] >= 0)
    wrong = rows[~holds]
    return Count(int(holds.sum()), len(rows)), wrong["method"].iloc[0] if len(wrong) else ""


@of(CHAOTIC)
def drifts(frame: pd.DataFrame) -> Verdict:
    """Judge whether on chaotic orbits the mean energy of force-gradient methods without the Hessian does not drift.

    The energy does not drift if the interval of the drift holds zero.  ``frame`` is the table of chaotic runs, a row
    for each method.
    """
    measured, where = _zero(_free(frame))
    return Verdict(
        "On chaotic orbits the interval of a Hessian-free energy drift holds zero",
        measured,
        at_least(LEAST),
        "methods",
        where=where,
    )


@of(CHAOTIC)
def symplectic(frame: pd.DataFrame) -> Verdict:
    """Judge whether on chaotic orbits the mean energy of force-gradient methods with the Hessian does not drift.

    The steps of these methods are symplectic, since they use the Hessian of V.  The energy does not drift if the
    interval of the drift holds zero.  ``frame`` is the table of chaotic runs, a row for each method.
    """
    rows = frame.drop(_free(frame).index)
    measured, where = _zero(rows[rows["method"] != CONTROL])
    return Verdict(
        "On chaotic orbits the drift's interval holds zero with the Hessian, too",
        measured,
        at_least(LEAST),
        "methods",
        where=where,
    )


@of(CHAOTIC)
def control(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy drift of RK4, the control, is seen on chaotic orbits: its interval excludes zero.

    ``frame`` is the table of chaotic runs, a row for each method; None if RK4 has none.
    """
    rows = frame[frame["method"] == CONTROL]
    if rows.empty:
        return None
    seen = (rows["low"] > 0) | (rows["high"] < 0)
    return Verdict(
        "The drift of a Runge–Kutta method is seen: its interval excludes zero",
        Count(int(seen.sum()), len(rows)),
        EVERY,
        "methods",
        where=CONTROL,
        otherwise=FAIL,
    )


def ratios(frame: pd.DataFrame) -> pd.Series:
    """Return for each Hessian-free method its spread over that of the method of the same structure with the Hessian.

    A spread is the standard deviation, over chaotic orbits, of the energy's change in a run.  ``frame`` is the table of
    chaotic runs, a row for each method; the result is indexed by method.
    """
    spread, free = frame.set_index("method")["spread"], _free(frame).set_index("method")
    return (free["spread"] / free[PARTNER].map(spread)).dropna()


@of(CHAOTIC)
def spreads(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether energies of chaotic orbits spread at most `SAME` times as far without the Hessian as with it.

    ``frame`` is the table of chaotic runs, a row for each method; None if no method can be compared.
    """
    found = ratios(frame)
    if found.empty:
        return None
    return Verdict(
        "Energies of chaotic orbits spread no further without the Hessian",
        Range(found.min(), found.max()),
        at_most(SAME),
        "times the spread with it",
        where=found.idxmax(),
    )


@of(REGULAR)
def regular(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy of a regular orbit does not drift with force-gradient methods without the Hessian.

    The drift over a run must be at most `STILL` times the energy's oscillation.  ``frame`` is the table of regular
    runs, a row for each method and problem; None if it has none of these methods.
    """
    rows = _free(frame)
    if rows.empty:
        return None
    moved = rows["change"] / rows["oscillation"]
    worst = rows.loc[moved.idxmax()]
    return Verdict(
        "On regular orbits the Hessian-free energy does not drift",
        float(moved.max()),
        at_most(STILL),
        "of its oscillation",
        where=case(worst),
    )


@of(CHAOTIC)
def answer(frame: pd.DataFrame) -> str | None:
    """Write the page's answer, a sentence: how many Hessian-free methods drift, and how far their energies spread.

    ``frame`` is the table of chaotic runs, a row for each method; None if no method can be compared.
    """
    rows, found = _free(frame), ratios(frame)
    if found.empty:
        return None
    drifting = int(((rows["low"] > 0) | (rows["high"] < 0)).sum())
    text = f"{drifting} of {len(rows)} Hessian-free methods show a linear energy drift; on chaotic orbits energies"
    return f"{text} spread up to {number(found.max(), 2)} times as far as with the Hessian ({found.idxmax()})."


@of(CHAOTIC)
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the mean change of the energy by each Hessian-free method and by its partner with the Hessian.

    The changes, with their intervals, are in units of the partner's spread; the figure is saved in ``folder``.
    ``frame`` is the table of chaotic runs, a row for each method.
    """
    rows = _free(frame)
    rows = rows[rows[PARTNER].isin(frame["method"])]
    spread = frame.set_index("method")["spread"]
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.0)
        for k, label in enumerate(("without the Hessian", PARTNER)):
            at = rows if k == 0 else frame.set_index("method").loc[rows[PARTNER]].reset_index()
            unit = rows[PARTNER].map(spread).to_numpy()
            scale = at["change"].abs().to_numpy() / at["drift"].abs().to_numpy() / unit
            middle = at["drift"].to_numpy() * scale
            half = (at["high"] - at["low"]).to_numpy() / 2 * scale
            place = [i + 0.15 * (2 * k - 1) for i in range(len(rows))]
            axes.errorbar(middle, place, xerr=half, fmt="o", color=(style.ORANGE, style.BLUE)[k], label=label)
        axes.axvline(0, color="0.7", linewidth=0.8)
        axes.set_yticks(range(len(rows)), rows["method"])
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xlabel("mean change of the energy over the run / spread with the Hessian")
        style.legend_above(figure, axes, 2)
    caption = (
        f"Mean change of the energy of {ORBITS} chaotic orbits over a run, in units of the spread with the Hessian, "
        "with 95 % intervals; the axis is linear between −1 and 1."
    )
    return [Picture(style.save(figure, folder, "hessian_free.png"), "changes of the energy", caption)]


@of(CHAOTIC)
def table(frame: pd.DataFrame) -> Table:
    """Make the page's table, a row for each method on chaotic orbits: the energy's drift, spread and oscillation.

    ``frame`` is the table of chaotic runs, a row for each method.
    """
    columns = ["method", PARTNER, "drift", "low", "high", "spread", "oscillation"]
    return Table(
        frame[columns].head(ROWS),
        "Chaotic orbits, H = 1: drift per unit of time, its 95 % interval; spread over a run; largest |H − H₀|.",
    )


@of(REGULAR)
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="hessian_free",
    question="Does the energy of Hessian-free force gradients drift?",
    tables=(CHAOTIC, REGULAR),
    setting=(
        "A Hessian-free kick takes a second force at q − (2 c h²/b) M⁻¹∇V, b and c its weights: symmetric, "
        "volume-preserving, not symplectic.",
        "Chaotic: H = |p|²/2 + x²y²/2 + (x⁴ + y⁴)/40 = 1, "
        f"{ORBITS} random starts, h = {H:g}, {STEPS} steps; last tenth less first tenth.",
        f"Regular: {', '.join(ORBIT_STEPS)}, {REGULAR_STEPS} steps; the slope of the energy without its oscillation.",
        "Each is compared with a method of the same drifts and kicks that has the Hessian and is symplectic.",
        "Of chaotic orbits the mean change is the drift; the standard deviation between orbits is the spread.",
    ),
    verdicts=(drifts, symplectic, control, spreads, regular),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "The partner with the Hessian has the same structure, but for most methods slightly other numbers.",
        f"Of seven 95 % intervals one may miss zero by chance: {LEAST:.0%} are asked for.",
        f"A regular energy drifts if it changes by more than {STILL:g} of its oscillation; up to {SAME:g} times the "
        "partner's spread counts as no further.",
        f"{CONTROL}, the control, makes one step in {EARLIER}: after all of them it has lost most of its energy.",
        "One system, one step size: a longer run or step may show a drift that these intervals hide.",
    ),
    command="pytest benchmarks/experiments/sampling",
)
