"""Schemes IV and V: energy on every step, and the steps without a root."""

from __future__ import annotations

import pandas as pd

from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Page, Picture, Table, Verdict, of
from phasebench.integrators.families.schemes_iv_v import RADIUS

#: An energy error up to this, on steps with a root, is round-off.
ROUND_OFF = 1e-13
#: Steps up to this are small: there the schemes are meant to be used, and there the steps without a root are told apart.
SMALL = 0.05
PLAIN = ("scheme-iv", "scheme-v")
WITH, WITHOUT = "energy error, steps with a root", "energy error, steps without"


def _plain(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["scheme"].isin(PLAIN) & (frame["status"] == "ok")]


@of("energy_preservation")
def kept(frame: pd.DataFrame) -> Verdict | None:
    """Whether the energy is kept on every step, over all step sizes."""
    ran = _plain(frame)
    if ran.empty:
        return None
    worst, missed = ran.loc[ran[WITH].idxmax()], int(ran["without a root"].sum())
    text = (
        f"To t = 1000 with h from {ran['h'].min():g} to {ran['h'].max():g}: on steps with a root the energy error is at "
        f"most {number(worst[WITH])} ({_where(worst)}); {_without(ran)}"
    )
    small = ran[ran["h"] <= SMALL]
    text += f"; with h ≤ {SMALL} {_without(small)}" if missed and len(small) < len(ran) and len(small) else ""
    short = f"On steps with a root the energy error is at most {number(worst[WITH])}; {_without(ran)}."
    return Verdict(f"{text}.", bool(worst[WITH] <= ROUND_OFF) and missed == 0, short)


def _where(row) -> str:
    return f"{row['scheme']} on {row['problem']}, h = {row['h']:g}"


def _without(ran: pd.DataFrame) -> str:
    """How many steps have no root, and the largest error on these with its run."""
    missed, steps = int(ran["without a root"].sum()), int(ran["steps"].sum())
    if not missed:
        return f"none of {steps} steps is without a root"
    worst = ran.loc[ran[WITHOUT].idxmax()]
    return f"{missed} of {steps} steps have none, with an error up to {number(worst[WITHOUT])} ({_where(worst)})"


@of("energy_preservation")
def searched(frame: pd.DataFrame) -> Verdict | None:
    """Whether the finder misses a root that is there."""
    plain = _plain(frame)
    if "scanned steps" not in plain or not plain["scanned steps"].sum():
        return None
    missed = int(plain["scan finds a root within the radius"].sum())
    scanned = int(plain["scanned steps"].sum())
    return Verdict(
        f"All {scanned} steps that the root finder leaves were scanned by other means: {missed} have a root within "
        f"|λ − 1/2| < {RADIUS:g}.",
        missed == 0,
        f"The finder misses a root on {missed} of {scanned} steps.",
    )


@of("energy_preservation")
def alternating(frame: pd.DataFrame) -> Verdict | None:
    """Whether taking a step without a root by the other scheme closes the gap."""
    ran = frame[frame["status"] == "ok"]
    counts = {s: int(ran[ran["scheme"] == s]["without a root"].sum()) for s in (*PLAIN, "scheme-iv-v", "scheme-v-iv")}
    if ran[ran["scheme"] == "scheme-iv-v"].empty:
        return None
    text = (
        f"Taking such a step by the other scheme leaves {counts['scheme-iv-v']} steps of scheme-iv-v without a root "
        f"(scheme-iv: {counts['scheme-iv']}) and {counts['scheme-v-iv']} of scheme-v-iv (scheme-v: {counts['scheme-v']})."
    )
    left = counts["scheme-iv-v"] + counts["scheme-v-iv"]
    return Verdict(text, left == 0, f"{left} steps have a root in neither scheme.")


@of("energy_preservation")
def draw(frame: pd.DataFrame, folder) -> list[Picture]:
    """Energy errors over h, beside implicit midpoint."""
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
    caption = "Largest energy error to t = 1000 over the step size, on steps with and without a root."
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
    """The runs with steps without a root, then the largest errors."""
    order = frame.assign(none=frame["without a root"] == 0).sort_values(["none", WITH], ascending=[True, False])
    shown = order.head(18)[list(COLUMNS)].rename(columns=COLUMNS)
    caption = "Runs that have steps without a root, then those of the largest energy error. A later step wins H₀ back."
    return Table(shown, caption)


@of("energy_preservation")
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="energy_preservation",
    question="Do Schemes IV and V keep the energy on every step?",
    tables=("energy_preservation",),
    setting=(
        "In each step the parameter λ near 1/2 is a root of E(λ, h) = H(q₁(λ), p₁(λ)) − H₀.",
        "Hénon–Heiles (box, chaotic) and perturbed Kepler to t = 1000, h from 0.2 to 0.005.",
        "A step without a root is taken with λ = 1/2, and the target stays H₀: a later step wins the energy back.",
        "scheme-iv-v takes such a step by Scheme V, scheme-v-iv by Scheme IV.",
        "The scan follows the stage equations in λ from 1/2 to the fold or to 60; it shares no code with the finder.",
    ),
    verdicts=(kept, searched, alternating),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Round-off is an energy error up to {ROUND_OFF:g}; roots are sought within |λ − 1/2| < {RADIUS:g}; a step without one does not keep the energy, whatever the next ones do.",
        "The orbits are three: a different one may pass more often where no root exists.",
    ),
    command="pytest benchmarks/experiments/energy_preservation",
)
