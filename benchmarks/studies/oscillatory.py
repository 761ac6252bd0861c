r"""Resonances of the integrators for highly oscillatory systems: the Fermi-Pasta-Ulam problem over h omega.

For each method and each :math:`h\omega`: the greatest error of H and the greatest deviation of the oscillatory energy
I over a time span.  omega is that of the published problem and h varies; a curve therefore shows the growth with h as
well as the resonances near the integer multiples of pi.

After E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration (2006), XIII.2 (there h is fixed and omega
varies).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.shared import most, picture
from phasebench.benchmarks.page.study import Claim, Runs, Study
from phasebench.benchmarks.page.verdict import at_least
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.fpu import oscillatory_energies
from phasebench.benchmarks.store.cells import ProblemKey
from phasebench.integrators.driver import INVALID, OK, integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.record import Method
from phasebench.integrators.records.oscillatory import METHODS as FAST
from phasebench.integrators.registry import method as method_of

TABLE, RATIO = "oscillatory", "h omega / pi"
ENERGY, OSCILLATORY = ("energy error", "oscillatory energy error")
SPAN = 200.0
#: The grid of h omega / pi: a point far below the resonances, then 40 points per pi, to 4.5 pi.
RATIOS = [0.1 / math.pi, *(k / 40 for k in range(2, 181))]
#: Label -> method: those for systems with a fast linear part, and Stormer-Verlet.
METHODS = {m.label: m for m in (*FAST, method_of("stormer-verlet"))}
#: Energy error from which the energy counts as lost: half of the initial energy, 2.0012.
LOST = 1.0
#: Largest distance of h omega from an integer multiple of pi that counts as resonant, in multiples of pi.
NEAR = 0.1
#: Limits of the logarithmic error axis; larger errors are marks at the top.
LIMITS = (1e-6, 1e2)
#: Stormer-Verlet is stable on the linear part up to h omega = 2.
STABLE = 2.0


def errors(chosen: Method, ratios: Sequence[float], t_end: float = SPAN) -> list[dict]:
    """The greatest absolute errors of a method over all steps: a row for each h omega / pi.

    h is not adjusted to ``t_end``: the last step may end a little later.  Errors are missing where the status is not
    ok.
    """
    found = problem("fpu")
    energies, rows = {ENERGY: found.system.H, OSCILLATORY: sum(oscillatory_energies(found))}, []
    for ratio in ratios:
        h = ratio * math.pi / found.parameters["omega"]
        steps = math.ceil(t_end / h)
        row = {"method": chosen.label, RATIO: ratio, "h": h, "steps": steps}
        try:
            s = integrate(found, chosen, h=h, steps=steps)
            row |= {"status": s.status, "reason": s.reason}
            for name, expression in energies.items() if s.status == OK else ():
                value = found.system.observe(expression, s.q, s.p)
                row[name] = float(np.abs(value - value[0]).max())
        except InvalidInput as error:
            row |= {"status": INVALID, "reason": str(error)}
        rows.append(row)
    return rows


def measure(method: str) -> list[dict]:
    """The errors of a method, given by its label, at all h omega."""
    return errors(METHODS[method], RATIOS)


def lost(frame: pd.DataFrame) -> pd.Series:
    """True for a run that failed or has an energy error of `LOST` or more."""
    return (frame["status"] != OK) | ~(frame[ENERGY] < LOST)


@of(TABLE)
def summary(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each method: at how many step sizes it loses the energy, at which, and its errors."""
    rows = []
    for name, part in frame.groupby("method", sort=False):
        out = lost(part)
        kept, ok = part[~out], part[part["status"] == OK].sort_values(ENERGY, kind="stable", na_position="first")
        rows.append({
            "method": name,
            "step sizes": len(part),
            "energy lost": int(out.sum()),
            "first lost at hω/π": part.loc[out, RATIO].min(),
            "where it is lost": where_lost(part),
            "error of H at the smallest step": part.loc[part[RATIO].idxmin(), ENERGY],
            "median error of H": kept[ENERGY].median(),
            "greatest error of H": ok[ENERGY].max(),
            "at hω/π": ok[RATIO].iloc[-1] if len(ok) else math.nan,
            "median error of I": kept[OSCILLATORY].median(),
            "greatest error of I": ok[OSCILLATORY].max(),
        })  # fmt: skip
    return pd.DataFrame(rows)


def where_lost(part: pd.DataFrame) -> str:
    """Where a method loses the energy: above some h omega, or near multiples of pi, which are named, and elsewhere."""
    out = lost(part)
    ratios = part.loc[out, RATIO]
    if ratios.empty:
        return ""
    below = part.loc[part[RATIO] < ratios.min(), RATIO]
    if out[part[RATIO] >= ratios.min()].all():
        return f"above {number(below.max())} π" if len(below) else "at every step"
    resonant = [r for r in ratios if round(r) >= 1 and round(abs(r - round(r)), 9) <= NEAR]
    near = [f"near {join_list([f'{k} π' for k in sorted({round(r) for r in resonant})])}"] if resonant else []
    others = len(ratios) - len(resonant)
    return " and ".join(near + ([f"at {others} other step{'s' if others > 1 else ''}"] if others else []))


@of(TABLE, summary)
def _answer(frame: pd.DataFrame, found: pd.DataFrame) -> str:
    """Which methods keep the energy at every step size, and from which one others lose it."""
    whole, others = found[found["energy lost"] == 0], found[found["energy lost"] > 0]
    names = join_list(list(whole["method"]), 2) if len(whole) else "No method"
    text = f"{names} keep{'s' if len(whole) < 2 else ''} the energy of a stiff Fermi–Pasta–Ulam chain at every step"
    text += f" up to hω = {number(frame[RATIO].max())}π"
    if others.empty:
        return f"{text}."
    return f"{text}; {len(others)} of {len(found)} lose it, from hω = {number(others['first lost at hω/π'].min())}π."


@picture(
    TABLE, "oscillatory", "errors of H and I against hω/π",
    "Greatest errors of H (solid) and of the oscillatory energy I (dashed) against hω/π; triangles: no finite end, a "
    f"step refused, or an error of H above {number(LIMITS[1])}. Grey lines: hω is a multiple of π.",
)  # fmt: skip
def _draw(frame: pd.DataFrame) -> style.Figure:
    shared = {"sharex": True, "sharey": True}
    figure, by_method = style.grid(frame["method"].unique(), 3, 6.4, r"$h\omega/\pi$", "greatest error", **shared)
    for name, axes in by_method.items():
        part = frame[frame["method"] == name].sort_values(RATIO)
        axes.semilogy(part[RATIO], part[OSCILLATORY], linewidth=1.0, color=style.ORANGE, linestyle="--", zorder=2)
        axes.semilogy(part[RATIO], part[ENERGY], linewidth=1.0, color=style.BLUE, linestyle="-", zorder=3)
        out = part[(part["status"] != OK) | (part[ENERGY] > LIMITS[1])]
        axes.plot(out[RATIO], [LIMITS[1] / 2] * len(out), "v", color=style.VERMILION, markersize=3, zorder=4)
        for k in range(1, 1 + int(frame[RATIO].max())):
            axes.axvline(k, color="0.85", linewidth=0.6, zorder=0)
        axes.set(title=name, ylim=LIMITS)
        axes.grid(axis="y", color="0.93", linewidth=0.5)
    for text, y, colour in (("error of H", 0.17, style.BLUE), ("error of I", 0.06, style.ORANGE)):
        axes.text(0.96, y, text, color=colour, transform=axes.transAxes, ha="right")
    return figure


@of(summary)
def _table(found: pd.DataFrame) -> Table:
    caption = (
        f"Greatest errors over a run. Lost: no finite end, a step refused, or an error of H of {number(LOST)} or more; "
        f"near a multiple of π: within {NEAR} π of it. Medians are over the step sizes at which the energy is not lost."
    )
    return Table(found, caption)


@of(TABLE)
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    """The runs that lose the energy."""
    return frame[lost(frame)][["method", RATIO, "status", ENERGY, OSCILLATORY]]


STUDY = Study(
    id="oscillatory",
    place=260,
    question="Which integrators survive steps beyond the fast period, and where do they resonate?",
    answer=_answer,
    setting=(
        "H = Σ (p₀ᵢ² + p₁ᵢ²)/2 + (ω²/2) Σ q₁ᵢ² + slow part: Fermi–Pasta–Ulam with three stiff springs, ω = 50.",
        f"From the published initial state (H = 2.0012) to t = {number(SPAN)}; step sizes up to hω = 4.5 π.",
        "I = Σ (p₁ᵢ² + ω² q₁ᵢ²)/2, the energy of the stiff springs, is an adiabatic invariant: the exact flow changes "
        "it little.",
        "Trigonometric integrators, r-RESPA and IMEX, which treat the stiff part apart, beside Störmer–Verlet.",
    ),
    runs=(
        Runs(TABLE, measure, [{"method": label} for label in METHODS],
             needs=lambda method: (METHODS[method], ProblemKey("fpu"))),
    ),
    claims={
        "survivors": Claim(
            "Some methods keep the energy at every step size",
            summary, lambda found: int((found["energy lost"] == 0).sum()), at_least(1),
            unit=lambda found: f"of {len(found)} methods",
            where=most("`energy lost`", "{method}, lost {where it is lost}"),
        ),
    },
    checks={
        "stable": Claim("Below Störmer–Verlet's stability limit every method completes its run", TABLE,
                        "status == 'ok'", rows=f"`{RATIO}` * {math.pi} < {0.9 * STABLE}"),
    },
    figure=_draw,
    shown=_table,
    whole=_whole,
    limits=(
        f"The energy counts as lost from an error of {number(LOST)} on, half of the total; a loss counts as resonant "
        f"within {NEAR} π of a multiple of π.",
        "One ω and one initial state; narrow resonances between the step sizes that were tried are not seen.",
    ),
)  # fmt: skip
