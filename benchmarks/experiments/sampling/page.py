"""The report page on Hamiltonian Monte Carlo: expected acceptance at equal numbers of evaluations, stability limits."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, NONE, Count, Range, Verdict, at_most

from . import cost, limits
from .acceptance import BUDGETS, DRAWS, GRADIENTS, STAGES, TABLE, TIME, VERLET

if TYPE_CHECKING:
    from pathlib import Path

#: Budgets that both targets have.
COMMON = sorted(set.intersection(*map(set, BUDGETS.values())))
#: Smallest rejection that the figure shows.
FLOOR = 1e-4


def best(frame: pd.DataFrame, methods: Iterable[str]) -> pd.DataFrame:
    """Select, for each target and budget, the row of that one of ``methods`` which accepts most.

    ``frame`` is the table of acceptances, a row for each target, method and budget (number of evaluations); the result
    is indexed by (target, budget).
    """
    rows = frame[frame["method"].isin(methods)]
    return rows.loc[rows.groupby(["target", "budget"], sort=False)["acceptance"].idxmax()].set_index(
        ["target", "budget"]
    )


def _ahead(frame: pd.DataFrame, target: str) -> tuple[Count, str]:
    """Count the budgets at which the best splitting of several stages accepts more than Stormer-Verlet on a target.

    Accepting more means that the two 95 % intervals do not overlap.  Returns (count, text with the budgets at which it
    does not).  ``frame`` is the table of acceptances, a row for each target, method and budget (number of evaluations).
    """
    rows = frame[frame["target"] == target]
    several, verlet = best(rows, [m for m in STAGES if m != VERLET]), best(rows, [VERLET])
    both = several.join(verlet.add_suffix(" of Verlet"), how="inner")
    ahead = both["low"] > both["high of Verlet"]
    behind = [str(budget) for (_, budget), won in ahead.items() if not won]
    return Count(int(ahead.sum()), len(ahead)), f"{', '.join(behind)} evaluations" if behind else ""


@of(TABLE)
def gaussian(frame: pd.DataFrame) -> Verdict:
    """Judge whether a splitting of several stages accepts more than Stormer-Verlet on the Gaussian target.

    Both have the same number of evaluations.  ``frame`` is the table of acceptances, a row for each target, method and
    budget (number of evaluations).
    """
    measured, where = _ahead(frame, "Gaussian")
    return Verdict(
        "A splitting of several stages accepts more than Störmer–Verlet, Gaussian target",
        measured,
        EVERY,
        "numbers of evaluations",
        where=where,
    )


@of(TABLE)
def quartic(frame: pd.DataFrame) -> Verdict:
    """Judge whether a splitting of several stages accepts more than Stormer-Verlet on the quartic target.

    Both have the same number of evaluations.  ``frame`` is the table of acceptances, a row for each target, method and
    budget (number of evaluations).
    """
    measured, where = _ahead(frame, "quartic")
    return Verdict(
        "A splitting of several stages accepts more than Störmer–Verlet, quartic target",
        measured,
        EVERY,
        "numbers of evaluations",
        where=where,
    )


@of(TABLE)
def gradients(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether no force-gradient method accepts more than the best splitting at equal numbers of evaluations.

    ``frame`` is the table of acceptances, a row for each target, method and budget (number of evaluations).
    """
    with_gradient, without = best(frame, GRADIENTS), best(frame, STAGES)
    both = with_gradient.join(without.add_suffix(" without"), how="inner")
    ahead = both["low"] > both["high without"]
    first = both[ahead].index
    return Verdict(
        "No force gradient accepts more than every splitting at equal evaluations",
        Count(int(ahead.sum()), len(ahead)),
        NONE,
        "targets and numbers of evaluations",
        where=f"{first[0][0]}, {first[0][1]} evaluations" if len(first) else "",
    )


def _least(rows: pd.DataFrame) -> pd.DataFrame:
    """Select, for each target and method, the row of the least time per accepted proposal.

    ``rows`` is the table of times, a row for each target, method and number of evaluations; the result is indexed by
    (target, method).
    """
    chosen = rows.loc[rows.groupby(["target", "method"], sort=False)["ns an accepted proposal"].idxmin()]
    return chosen.set_index(["target", "method"])


@of(cost.TABLE)
def cheapest(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether a splitting of several stages takes less time per accepted proposal than Stormer-Verlet.

    ``rows`` is the table of times, a row for each target, method and number of evaluations; None if it lacks one side.
    """
    times = _least(rows)["ns an accepted proposal"].unstack()
    several = [m for m in STAGES if m != VERLET and m in times.columns]
    if VERLET not in times.columns or not several:
        return None
    ratio = times[several].min(axis=1) / times[VERLET]
    worst = ratio.idxmax()
    return Verdict(
        "A splitting of several stages takes less time an accepted proposal than Störmer–Verlet",
        Range(ratio.min(), ratio.max()),
        at_most(1.0),
        "times its time",
        where=f"{worst}, {times.loc[worst, several].idxmin()}",
    )


@of(limits.TABLE)
def printed(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether measured stability limits round to those that the methods' authors print.

    ``frame`` is the table of limits, a row for each method; None if no limit is printed.
    """
    known = frame[frame["printed"].notna() & (frame["printed"].astype(str) != "")]
    if known.empty:
        return None
    right = [limits.agrees(r["limit"], str(r["printed"])) for _, r in known.iterrows()]
    wrong = known[[not x for x in right]]
    return Verdict(
        "Stability limits round to those that the authors print",
        Count(sum(right), len(right)),
        EVERY,
        "limits",
        where=f"{wrong['method'].iloc[0]}, printed {wrong['printed'].iloc[0]}" if len(wrong) else "",
    )


@of(TABLE)
def answer(frame: pd.DataFrame) -> str | None:
    """Write the page's answer: the shares of proposals that the best method and Stormer-Verlet reject on each target.

    Both have the largest number of evaluations that is measured on all targets.  ``frame`` is the table of acceptances,
    a row for each target, method and budget (number of evaluations); None if Stormer-Verlet is missing.
    """
    budget, parts = COMMON[-1], []
    for target in BUDGETS:
        rows = frame[(frame["target"] == target) & (frame["budget"] == budget)].set_index("method")
        if VERLET not in rows.index:
            return None
        name = rows["acceptance"].idxmax()
        mine, verlet = (number(100 * (1 - rows.loc[m, "acceptance"]), 2) for m in (name, VERLET))
        parts.append(f"{name} rejects {mine} % of {target} proposals, Störmer–Verlet {verlet} %")
    return f"With {budget} evaluations a run {'; '.join(parts)}."


@of(TABLE)
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the share of rejected proposals over the evaluations: a panel for each target, a curve for each method.

    The figure is saved in ``folder``.  ``frame`` is the table of acceptances, a row for each target, method and budget
    (number of evaluations).
    """
    with style.settings():
        figure, (panels,) = style.panels(1, len(BUDGETS), 3.4, sharey=True)
        for axes, target in zip(panels, BUDGETS, strict=True):
            rows = frame[frame["target"] == target]
            for k, (method, part) in enumerate(rows.groupby("method", sort=False)):
                look = style.curve(k) | {"linestyle": ":" if method in GRADIENTS else "-"}
                rejected = (1 - part["acceptance"]).clip(lower=FLOOR)
                axes.loglog(part["budget"], rejected, label=method, **look)
            axes.set(title=f"{target} target", xlabel="evaluations in a run")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("share rejected")
        style.legend_above(figure, panels[0], 3)
    caption = "Share of proposals that are rejected over the evaluations of a run. Dotted lines: force gradients."
    return [Picture(style.save(figure, folder, "sampling.png"), "rejected proposals over the cost", caption)]


def table(data: Data) -> Table | None:
    """Make the page's table: acceptances, stability limit and least time per accepted proposal of each method.

    It has a row for each target and method.  ``data`` maps a table's name to the table.  None if acceptances or limits
    are missing; if only the times are missing, their columns are left out.
    """
    frame, stable, times = (data(name) for name in (TABLE, limits.TABLE, cost.TABLE))
    if frame is None or stable is None:
        return None
    shown = frame[frame["budget"].isin(COMMON)].pivot_table(
        index=["target", "method"], columns="budget", values="acceptance", sort=False
    )
    shown.columns = [f"accepted at {c}" for c in shown.columns]
    limit = stable.set_index("method")[["evaluations per step", "limit", "limit per evaluation"]]
    shown = shown.reset_index().join(limit, on="method")
    caption = (
        "Shares accepted with so many evaluations a run, and the stability limits of h ω, whole and per evaluation"
    )
    if times is not None:
        least = _least(times)[["ns an accepted proposal", "budget"]].rename(columns={"budget": "with evaluations"})
        shown, caption = (
            shown.join(least, on=["target", "method"]),
            f"{caption}; the least time an accepted proposal, and the evaluations of that run",
        )
    return Table(shown.head(ROWS), f"{caption}.", 4)


@of(TABLE)
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="sampling",
    question="Which explicit splitting accepts most in Hamiltonian Monte Carlo?",
    tables=(TABLE, cost.TABLE, limits.TABLE),
    setting=(
        "H = |p|²/2 + Σ v(2 i qᵢ), i = 1 … 8, with v = x²/2 (Gaussian) or v = x²/2 + x⁴/4 (quartic).",
        f"{DRAWS} independent draws (q, p) of the density exp(−H); a run over T = {TIME:g} from each.",
        "Accepted is the mean of min(1, exp(−ΔH)): the expected acceptance in the stationary state, without a chain.",
        "All methods have the same number of gradients in a run; a kick with a force gradient counts as two.",
        "Time: of a step in a long run of all draws on one thread, methods in turns, times the steps, divided by the "
        "acceptance. Stability limits: of the step's matrix on the harmonic oscillator.",
    ),
    verdicts=(gaussian, quartic, gradients, cheapest, printed),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        "More is said where the 95 % intervals do not overlap; methods share their draws, so that this is strict.",
        "A run that fails or leaves the finite numbers counts as rejected.",
        "Acceptance alone is no efficiency of sampling: how far a proposal moves is the same for all, as T is.",
        "The least time is among the numbers of evaluations in the figure; fewer might be cheaper still.",
        "Eight frequencies in a ratio of one to eight; other spectra may rank the methods otherwise.",
    ),
    command="pytest benchmarks/experiments/sampling",
)
