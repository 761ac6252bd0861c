"""The report page on the energy-preserving Schemes IV and V: energy errors, and steps without a root lambda.

The root is the value of the schemes' parameter lambda with which a step conserves the energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict, at_most
from phasebench.integrators.families.schemes_iv_v import RADIUS

if TYPE_CHECKING:
    from pathlib import Path

#: An energy error up to this, on steps with a root, is round-off.
ROUND_OFF = 1e-13
PLAIN, ALTERNATING = ("scheme-iv", "scheme-v"), ("scheme-iv-v", "scheme-v-iv")
WITH, WITHOUT = "energy error, steps with a root", "energy error, steps without"


def _completed_runs(frame: pd.DataFrame, schemes: tuple[str, ...]) -> pd.DataFrame:
    return frame[frame["scheme"].isin(schemes) & (frame["status"] == "ok")]


def _where(row: pd.Series) -> str:
    return f"{row['scheme']} on {row['problem']}, h = {row['h']:g}"


@of("energy_preservation")
def energy_conservation(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether the energy error is round-off on every step that has a root lambda.

    A root is a value of the scheme's parameter lambda with which the step conserves the energy.  ``frame`` has a row
    for each scheme, problem and step size; None without a completed run.
    """
    ran = _completed_runs(frame, PLAIN)
    if ran.empty:
        return None
    worst = ran.loc[ran[WITH].idxmax()]
    return Verdict(
        "On steps with a root the energy error is of round-off",
        float(worst[WITH]),
        at_most(ROUND_OFF),
        where=_where(worst),
        otherwise=FAIL,
    )


@of("energy_preservation")
def root_existence(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether in every step of Schemes IV and V some value of their parameter lambda conserves the energy.

    ``frame`` has a row for each scheme, problem and step size; None without a completed run.
    """
    ran = _completed_runs(frame, PLAIN)
    if ran.empty:
        return None
    missed, steps = int(ran["without a root"].sum()), int(ran["steps"].sum())
    worst = ran.loc[ran["without a root"].idxmax()]
    return Verdict(
        "Every step of Schemes IV and V has a root",
        Count(steps - missed, steps),
        EVERY,
        "steps",
        where=f"{_where(worst)}: {int(worst['without a root'])} steps without" if missed else "",
    )


@of("energy_preservation")
def root_search(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether the schemes find every root lambda that an independent scan finds; None without a scan.

    A root is a value of the scheme's parameter lambda with which the step conserves the energy.  ``frame`` has a row
    for each scheme, problem and step size.
    """
    ran = _completed_runs(frame, PLAIN)
    if "scanned steps" not in ran or not ran["scanned steps"].sum():
        return None
    return Verdict(
        "The root finder misses no root that an independent scan finds",
        Count(int(ran["scan finds a root within the radius"].sum()), int(ran["scanned steps"].sum())),
        NONE,
        "steps without a root",
        otherwise=FAIL,
    )


@of("energy_preservation")
def alternating(frame: pd.DataFrame) -> Verdict | None:
    """Judge whether every step has a root lambda of Scheme IV or of Scheme V, in the variants that may use both.

    A root is a value of the scheme's parameter lambda with which the step conserves the energy.  ``frame`` has a row
    for each scheme, problem and step size; None if the variants were not run.
    """
    ran = _completed_runs(frame, ALTERNATING)
    if ran[ran["scheme"] == ALTERNATING[0]].empty:
        return None
    left, steps = int(ran["without a root"].sum()), int(ran["steps"].sum())
    return Verdict(
        "Every step has a root of Scheme IV or of Scheme V",
        Count(steps - left, steps),
        EVERY,
        "steps",
        where=_where(ran.loc[ran["without a root"].idxmax()]) if left else "",
    )


@of("energy_preservation")
def answer(frame: pd.DataFrame) -> str | None:
    """Write the page's answer: the largest energy error, and in how many steps no parameter lambda keeps the energy.

    ``frame`` has a row for each scheme, problem and step size; None without a completed run.
    """
    ran = _completed_runs(frame, PLAIN)
    if ran.empty:
        return None
    missed, steps = int(ran["without a root"].sum()), int(ran["steps"].sum())
    text = f"Schemes IV and V keep the energy to {number(ran[WITH].max(), 2)} up to t = 1000"
    if not missed:
        return f"{text}, on every one of {steps} steps."
    return (
        f"{text}, except on {missed} of {steps} steps without a suitable λ, where the error reaches "
        f"{number(ran[WITHOUT].max(), 2)}."
    )


@of("energy_preservation")
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the largest energy error over h, beside that of the implicit midpoint rule, a panel for each problem.

    ``frame`` has a row for each scheme, problem and step size; the figure is saved in ``folder``.
    """
    problems = list(dict.fromkeys(frame["problem"]))
    midpoint = "implicit midpoint's energy error"
    curves = [("scheme-iv", WITH, "Scheme IV, steps with a root"), ("scheme-v", WITH, "Scheme V, steps with a root")]
    curves += [("scheme-iv", WITHOUT, "Scheme IV, steps without"), ("scheme-iv", midpoint, "implicit midpoint")]
    with style.settings():
        figure, (panels,) = style.panels(1, len(problems), 3.0, sharey=True)
        for axes, name in zip(panels, problems, strict=True):
            for k, (scheme, column, label) in enumerate(curves):
                part = frame[(frame["problem"] == name) & (frame["scheme"] == scheme)].sort_values("h")
                axes.loglog(part["h"], part[column], label=label, **style.curve(k))
            axes.set(title=name, xlabel="$h$")
            axes.grid(color="0.93", linewidth=0.5)
        panels[0].set_ylabel("largest energy error")
        style.legend_above(figure, panels[0], 2)
    caption = "Largest energy error to t = 1000 over the step size, on steps with and without a root, beside that of the implicit midpoint rule."
    return [Picture(style.save(figure, folder, "energy_preservation.png"), "energy errors over the step", caption)]


COLUMNS = {
    "problem": "problem",
    "scheme": "scheme",
    "h": "h",
    "steps": "steps",
    "without a root": "without a root",
    WITH: "energy error with one",
    WITHOUT: "without",
    "one step later": "one step later",
    "least lambda": "least λ",
    "greatest lambda": "greatest λ",
}


@of("energy_preservation")
def table(frame: pd.DataFrame) -> Table:
    """Make the page's table: runs with steps in which no lambda keeps the energy, then the largest energy errors.

    ``frame`` has a row for each scheme, problem and step size.
    """
    order = frame.assign(none=frame["without a root"] == 0).sort_values(["none", WITH], ascending=[True, False])
    shown = order.head(18)[list(COLUMNS)].rename(columns=COLUMNS)
    caption = "Runs that have steps without a root, then those of the largest energy error. Energy errors: on steps with a root, on steps without, and one step after these, where a root restores H₀."
    return Table(shown, caption)


@of("energy_preservation")
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="energy_preservation",
    question="Do Schemes IV and V keep the energy on every step?",
    tables=("energy_preservation",),
    setting=(
        "In each step the parameter λ near 1/2 is a root of E(λ, h) = H(q₁(λ), p₁(λ)) − H₀.",
        "Hénon–Heiles (box, chaotic) and perturbed Kepler to t = 1000, h from 0.2 to 0.005.",
        "A step without a root is taken with λ = 1/2; since the target remains H₀, a later step restores the energy.",
        "scheme-iv-v takes such a step by Scheme V, and scheme-v-iv takes by Scheme IV a step that Scheme V cannot.",
        "The scan follows the stage equations in λ from 1/2 until they lose their solution, at most by 60; it shares no code "
        "with the root finder.",
    ),
    verdicts=(energy_conservation, root_existence, root_search, alternating),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"An energy error of at most {ROUND_OFF:g} counts as round-off. Roots are sought within |λ − 1/2| < {RADIUS:g}.",
        "A step without a root counts, though the energy is restored after it.",
        "These are three orbits: another one may more often pass where no root exists.",
    ),
    command="pytest benchmarks/experiments/energy_preservation",
)
