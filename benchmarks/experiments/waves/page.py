"""The report's page "waves": energy, mass and charge of semi-discretized wave equations, and the cost of a step.

The table ``pde`` has a row for each method on each equation with each step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict, at_most

from .waves import UNITS

if TYPE_CHECKING:
    from pathlib import Path

ROUND_OFF = "round-off"


def _ran(frame: pd.DataFrame) -> pd.DataFrame:
    ran = frame[frame["status"] == "ok"].copy()
    for column in ("energy is kept", "invariant is kept"):
        ran[column] = ran[column].astype(bool)
    return ran


def _count_preserving(ran: pd.DataFrame, what: str, declared: str) -> tuple[Count, str]:
    """Return (count of the runs that preserve ``what``, text with the methods that do not).

    ``ran`` has the completed runs; ``what`` is "energy" or "invariant".  Only runs count whose method is declared, in
    the column ``declared``, to preserve it to round-off.
    """
    says = ran[ran[declared] == ROUND_OFF]
    kept = says[f"{what} is kept"]
    return Count(int(kept.sum()), len(says)), "" if kept.all() else join_list(
        sorted(says.loc[~kept, "method"].unique()), 4
    )


def _energy(frame: pd.DataFrame) -> tuple[Count, str]:
    return _count_preserving(_ran(frame), "energy", "energy class")


def _charge(frame: pd.DataFrame) -> tuple[Count, str]:
    ran = _ran(frame)
    return _count_preserving(ran[ran["invariant"] == "charge"], "invariant", "quadratic class")


@of("pde")
def energy(frame: pd.DataFrame) -> Verdict:
    """Judge whether methods declared to preserve the energy do so on semi-discretized wave equations.

    Schemes IV and V choose a parameter lambda in each step so that H is kept; steps in which no lambda does so are left
    out.  ``frame`` has a row for each method on each equation with each step.
    """
    count, lost = _energy(frame)
    return Verdict("Methods declared to keep the energy do, to round-off", count, EVERY, "runs", lost, FAIL)


@of("pde")
def charge(frame: pd.DataFrame) -> Verdict:
    """Judge whether methods declared to preserve invariants q.D p keep the charge of the Klein-Gordon equation.

    ``frame`` has a row for each method on each wave equation with each step.
    """
    count, lost = _charge(frame)
    return Verdict("Methods declared to keep invariants q·Dp keep the charge", count, EVERY, "runs", lost, FAIL)


@of("pde")
def roots(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether Schemes IV and V find in every step a parameter lambda with which the energy is kept.

    ``frame`` has a row for each method on each wave equation with each step; None if no run completed.
    """
    ran = _ran(frame)
    if ran.empty:
        return None
    worst = ran.loc[ran["fallbacks"].idxmax()]
    return Verdict(
        "Every step of Schemes IV and V has a λ that keeps the energy",
        int(ran["fallbacks"].sum()),
        at_most(0),
        "steps without",
        where=f"{worst['method']} on {worst['problem']}, h = {number(worst['h'])}" if worst["fallbacks"] else "",
    )


@of("pde")
def answer(frame: pd.DataFrame) -> str | None:
    """Return the page's answer, a sentence: how many runs on wave equations preserve the energy, and how many the charge.

    ``frame`` has a row for each run; counted are the runs of methods that are declared to preserve the quantity.
    """
    (energies, _), (charges, _) = _energy(frame), _charge(frame)
    if not energies.of:
        return None
    text = "On discretized Schrödinger and Klein–Gordon waves, energy-preserving methods hold the energy"
    text += f" in {energies.n} of {energies.of} runs"
    missed = int(_ran(frame)["fallbacks"].sum())
    text += f", except on {missed} steps" if missed else ""
    return f"{text}; {charges.n} of {charges.of} runs declared to keep the charge do." if charges.of else f"{text}."


@of("pde")
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """Draw the energy error against the time of an integration, a panel for each wave equation; None without runs."""
    ran = _ran(frame)
    if ran.empty:
        return None
    problems, methods = (list(dict.fromkeys(ran[c])) for c in ("problem", "method"))
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.2, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            for k, method in enumerate(methods):
                part = ran[(ran["problem"] == name) & (ran["method"] == method)]
                axes.loglog(part["seconds"], part["energy error"].clip(lower=1e-17), label=method, **style.curve(k))
            axes.set(title=name, xlabel="warm integration (s)")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("energy error")
        style.legend_above(figure, panels[0], 4)
    caption = (
        "Largest energy error, on steps with a root, over the seconds of the integration; the marks of a curve are its "
        "step sizes."
    )
    return [Picture(style.save(figure, folder, "waves.png"), "energy error against time", caption)]


COLUMNS = {
    "problem": "problem",
    "method": "method",
    "h": "h",
    "energy error": "energy error",
    "invariant": "invariant",
    "invariant error": "its error",
    "evaluations per step": "evaluations a step",
    "fallbacks": "steps without a root",
    "seconds": "seconds",
    "status": "status",
}


@of("pde")
def table(frame: pd.DataFrame) -> Table:
    """Return the page's table: a row for each method on each wave equation, at its smallest step."""
    least = frame.loc[frame.groupby(["problem", "method"], sort=False)["h"].idxmin()]
    caption = "Every method on every problem, at its smallest step."
    return Table(least[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of("pde")
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[list(COLUMNS)].rename(columns=COLUMNS)


PAGE = Page(
    id="waves",
    question="Do energy, mass and charge of wave equations stay when many degrees of freedom are integrated?",
    tables=("pde",),
    setting=(
        "Nonlinear Schrödinger: i u_t + u_xx + 2|u|²u = 0 (plane wave, soliton), d = 64; Klein–Gordon, d = 128.",
        "Central differences in space leave a Hamiltonian system of d degrees of freedom, which is what is integrated.",
        "Schemes IV and V choose in every step the λ that keeps the energy: a root of an equation, which may have none.",
        "Charge (Klein–Gordon) is of the form q·Dp. Mass Σ|u|² (Schrödinger) is of the form q·q + p·p: Scheme I keeps it "
        "at λ = 1/2 alone.",
        "Errors are absolute, the largest over all steps; seconds are of the integration without compilation and output.",
    ),
    verdicts=(energy, charge, roots),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"An error counts as round-off up to {UNITS} times the unit round-off of the terms of H, or of the invariant.",
        "On steps without a root the energy is missed, and restored in the steps that follow: they are left out of the "
        "energy's error.",
        "What is kept in every cell of space-time is another question: see [local laws](multisymplectic.md).",
    ),
    command="pytest benchmarks/experiments/waves",
)
