"""The report page on methods for rigid bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case, declared_orders, growth
from phasebench.benchmarks.page.verdict import FAIL, Between, Verdict, at_least, at_most

from .measure import ATTITUDE, ENERGY, FREE, LONG, LONG_H, SPAN, SYMMETRY, TOP

#: What is kept to round-off is kept to this, and an ordinary method is further off than `LEFT`.
KEPT, LEFT = 1e-13, 1e-9
#: An order is what is declared if it is as near as this.
NEAR = 0.15
#: The spread of a bounded energy over all steps is at most this many times that over the first tenth of them.
BOUNDED = 2.0


@of(ATTITUDE)
def kept(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether methods for rigid bodies keep the rotation matrix orthogonal, and a free body's momentum in space.

    ``rows`` is the table of attitudes; None if it has no such method.
    """
    own = rows[rows["bodies"].astype(bool)]
    if own.empty:
        return None
    off = own[["orthogonality", "momentum"]].max(axis=1)
    worst = own.loc[off.idxmax()]
    return Verdict(
        "Methods for rigid bodies keep rotations orthogonal, and a free body's momentum in space",
        float(off.max()),
        at_most(KEPT),
        where=case(worst),
        otherwise=FAIL,
    )


@of(ATTITUDE)
def left(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the rotation matrix does not stay orthogonal with the fourth-order Runge-Kutta method, the control.

    The method integrates the quaternion, and is judged at its longest step.  ``rows`` is the table of attitudes; None
    if it has none of this method.
    """
    explicit = rows[(rows["method"] == "rk4") & (rows["h"] == rows["h"].max())]
    if explicit.empty:
        return None
    nearest = explicit.loc[explicit["orthogonality"].idxmin()]
    return Verdict(
        "The fourth-order Runge-Kutta method on the quaternion leaves the rotations",
        float(nearest["orthogonality"]),
        at_least(LEFT),
        where=str(nearest["problem"]),
        otherwise=FAIL,
    )


@of(ATTITUDE)
def orders(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether attitudes converge with the declared orders of the methods for rigid bodies.

    ``rows`` is the table of attitudes.
    """
    return declared_orders(rows[rows["bodies"].astype(bool)], "Attitudes converge with the declared order", NEAR)


@of(SYMMETRY)
def gain(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether splitting off a symmetric top gains accuracy as the inverse of the body's asymmetry delta.

    The body has the moments (1, 1 + delta, 2).  The gain is the error of the splitting into turns about the principal
    axes over that of the splitting off a symmetric top.  ``rows`` has a row for each delta; None for fewer than three.
    """
    if len(rows) < 3:
        return None
    slope = -np.polyfit(np.log(rows["delta"]), np.log(rows["axes"] / rows["top"]), 1)[0]
    return Verdict(
        "The gain of splitting off a symmetric top is inverse to the body's asymmetry",
        float(slope),
        Between(0.9, 1.1),
        "as the power",
        where=f"moments 1, 1 + delta, 2, delta = {number(rows['delta'].min())} to {number(rows['delta'].max())}",
    )


@of(ENERGY)
def bounded(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether every method keeps a chaotic top's energy bounded, even if it is not symplectic.

    The only method that is not symplectic is the Lie midpoint rule.  ``rows`` is the table of long runs, a row for each
    method.
    """
    times = growth(rows)
    worst = rows.loc[times.idxmax()]
    return Verdict(
        "Symplectic or not, every method keeps a chaotic top's energy bounded",
        float(times.max()),
        at_most(BOUNDED),
        "times the spread over the first tenth",
        where=f"{worst['method']}, {worst['steps']:.0f} steps",
    )


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how well rotations are kept, and how a chaotic top's energy spreads.

    ``data`` maps a table's name to the table; None if one is missing.
    """
    found, rows = kept(data), pd.DataFrame(data(ENERGY))
    if found is None or rows.empty:
        return None
    times = growth(rows)
    own = rows["symplectic"].astype(bool)
    return (
        f"Rotations are kept to {number(found.measured)}; on a chaotic top the energy's spread grows at most "
        f"{number(times[own].max())} times with symplectic methods, {number(times[~own].max())} times with the Lie "
        "midpoint."
    )


@of(ATTITUDE, SYMMETRY)
def draw(rows: pd.DataFrame, near: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the attitude's error against the step (left), and two splittings' errors against a body's asymmetry (right).

    ``rows`` is the table of attitudes, ``near`` that of nearly symmetric bodies; the figure is saved in ``folder``.
    """
    with style.settings():
        figure, ((left_axes, right_axes),) = style.panels(1, 2, 3.4)
        shown = rows[(rows["problem"] == TOP) & rows["bodies"].astype(bool)]
        for k, (method, part) in enumerate(shown.groupby("method", sort=False)):
            left_axes.loglog(part["h"], part["degrees"], label=method, **style.curve(k))
        left_axes.set(xlabel="step h", ylabel="attitude error in degrees", title=TOP)
        for k, (column, label) in enumerate((("axes", "rigid-dlm"), ("top", "rigid-reich"))):
            right_axes.loglog(near["delta"], near[column], label=label, **style.curve(k))
        right_axes.set(xlabel="asymmetry delta", ylabel="attitude error in degrees", title="moments 1, 1 + delta, 2")
        for axes in (left_axes, right_axes):
            axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, left_axes, 4)
    caption = (
        f"Left: the angle between the attitude at t = {SPAN:g} and the certified one. Right: both splittings of order 2 at one "
        "step, on free bodies that are nearly symmetric."
    )
    return [Picture(style.save(figure, folder, "rigid.png"), "attitude errors", caption)]


@of(ATTITUDE)
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table, a row for each method on each problem at h = 0.05: attitude errors, and what is kept."""
    one = rows[np.isclose(rows["h"], 0.05)]
    columns = ["problem", "method", "degrees", "uncertainty", "orthogonality", "momentum", "energy", "evaluations"]
    caption = (
        "At h = 0.05: the attitude's error in degrees with the reference's uncertainty, the largest change of |q|² (orthogonality: "
        "RᵀR changes with it), of a free body's momentum in space and of the energy, and evaluations of the torque a step."
    )
    return Table(one[columns], caption)


@of(ATTITUDE)
def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return rows


PAGE = Page(
    id="rigid",
    question="What do methods for rigid bodies keep, and does a chaotic top's energy stay bounded?",
    tables=(ATTITUDE, SYMMETRY, ENERGY),
    setting=(
        "A body about a fixed point, its attitude a quaternion q with momenta p: H = sum of L_k²/2I_k + V, canonical in eight "
        "variables.",
        f"A free body that turns over again and again ({FREE}) and a heavy top ({TOP}), with certified states.",
        "Ordinary methods run on the same eight equations.",
        f"Long runs: {LONG} steps of h = {LONG_H} on the heavy top with I2 = 1.3 and its centre of mass off the axis.",
    ),
    verdicts=(kept, left, orders, gain, bounded),
    answer=answer,
    figures=draw,
    table=table,
    whole=_all,
    limits=(
        "A step of `rigid-dlm` or `rigid-reich` costs one torque and a few sines; that of `moser-veselov` and `lie-midpoint` "
        "solves an equation of three unknowns besides. Times are in the trade.",
        "That the steps are those of rotation matrices, and that all but the Lie midpoint are symplectic, is measured in 30 "
        "digits by the tests.",
        "That the energy of a chaotic top stays bounded is seen over this many steps, not beyond.",
    ),
    command="pytest benchmarks/experiments/rigid",
)
