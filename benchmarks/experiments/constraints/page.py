"""The report page on methods for systems with constraints: manifold, energy drift, tolerance of the iteration."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Page, Picture, Table, of
from phasebench.benchmarks.page.shared import case
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Verdict, at_least, at_most

from .measure import CARTESIAN, DRIFT, LONG, MANIFOLD, SPHERE, STEPS, TOLERANCE

#: Constraints that are kept are kept to this; a method that leaves the manifold is further off than that.
KEPT, LEFT = 1e-14, 1e-9
#: A drift of the energy up to this in a unit of time is round-off.
NO_DRIFT = 1e-15
#: The double pendulum ends within this of the state that is certified in angles.
SAME = 1e-13
#: A usual tolerance of molecular dynamics: GROMACS's shake-tol (OpenMM's default is 1e-5).
USUAL = 1e-4


@of(MANIFOLD)
def kept(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether methods for constraints keep the constraints and their time derivatives to round-off.

    The time derivatives (hidden constraints) do not count for SHAKE, whose momenta do not satisfy them.
    ``rows`` is the table of errors, a row for each method and problem; None if it has no method for constraints.
    """
    bound = rows[rows["bound"].astype(bool)]
    if bound.empty:
        return None
    hidden = bound["hidden constraint"].where(bound["method"] != "shake", 0.0)
    off = pd.concat([bound["constraint"], hidden], axis=1).max(axis=1)
    worst = bound.loc[off.idxmax()]
    return Verdict(
        "Methods for constraints keep constraints and hidden constraints to round-off",
        float(off.max()),
        at_most(KEPT),
        where=case(worst),
        otherwise=FAIL,
    )


@of(MANIFOLD)
def left(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether RK4 on the index-reduced equations, the control, leaves the manifold; None if not measured.

    ``rows`` is the table of errors, a row for each method and problem.
    """
    explicit = rows[rows["method"] == "rk4"]
    if explicit.empty:
        return None
    nearest = explicit.loc[explicit["constraint"].idxmin()]
    return Verdict(
        "The fourth-order Runge-Kutta method on the index-reduced equations leaves the manifold",
        float(nearest["constraint"]),
        at_least(LEFT),
        where=str(nearest["problem"]),
        otherwise=FAIL,
    )


@of(MANIFOLD)
def same(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the double pendulum in Cartesian coordinates ends in its certified state; None if not measured.

    A certified state is a stored reference with a bound of its error.  ``rows`` is the table of errors, a row for each
    method and problem.
    """
    found = rows[(rows["problem"] == CARTESIAN) & (rows["method"] == "lobatto-iiia-iiib-constrained-6")]
    if found.empty:
        return None
    return Verdict(
        "The double pendulum in Cartesian coordinates ends in its certified state",
        float(found["error"].max()),
        at_most(SAME),
        where="lobatto-iiia-iiib-constrained-6",
        otherwise=FAIL,
    )


@of(DRIFT)
def drift(rows: pd.DataFrame) -> Verdict:
    """Judge whether RATTLE's energy is free of drift over long runs: its interval contains 0 or is all round-off.

    ``rows`` is the table of long runs, a row for each problem.
    """
    still = (rows["low"] <= 0) & (rows["high"] >= 0) | (rows[["low", "high"]].abs().max(axis=1) <= NO_DRIFT)
    told = (f"{r['problem']}: {number(r['low'])} to {number(r['high'])} per unit of time" for _, r in rows.iterrows())
    return Verdict(
        "The energy of RATTLE does not drift over a million steps",
        Count(int(still.sum()), len(rows)),
        EVERY,
        "long runs",
        where="; ".join(told),
        otherwise=FAIL,
    )


@of(TOLERANCE)
def loose(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether RATTLE's energy is free of drift at a tolerance that is usual in molecular dynamics.

    ``rows`` has a row for each tolerance; None if the usual one was not measured.
    """
    usual = rows[rows["tolerance"] == USUAL]
    if usual.empty:
        return None
    return Verdict(
        "RATTLE iterated to a usual tolerance keeps the energy as the converged one does",
        float(abs(usual.iloc[0]["slope"])),
        at_most(NO_DRIFT),
        "per unit of time",
        where=f"tolerance {number(USUAL)}",
    )


def answer(data: Data) -> str | None:
    """Write the page's answer: how well manifold and energy are kept, and how H drifts with a loose tolerance."""
    found = [verdict(data) for verdict in (kept, drift, loose)]
    if None in found:
        return None
    manifold, energy, tolerance = (v.measured for v in found)
    return (
        f"Methods for constraints stay on the manifold to {number(manifold)}; RATTLE's energy does not drift in {energy.n} of "
        f"{energy.of} long runs; iterated to {number(USUAL)}, it drifts by {number(tolerance)} per unit time."
    )


@of(DRIFT, TOLERANCE)
def draw(converged: pd.DataFrame, rows: pd.DataFrame, folder: Path) -> list[Picture]:
    """Draw the energy's drift with a RATTLE iterated to a tolerance, against the tolerance.

    ``rows`` has a row for each tolerance.  ``converged`` is the table of long runs of `rattle`, solved to round-off,
    whose drift is drawn for comparison.  The figure is saved in ``folder``.
    """
    with style.settings():
        figure, ((axes,),) = style.panels(1, 1, 3.4)
        axes.loglog(rows["tolerance"], rows["slope"].abs(), label="plain RATTLE, iterated", **style.curve(0))
        for slope in converged.loc[converged["problem"] == SPHERE, "slope"][:1]:
            axes.axhline(abs(slope), color="0.4", linestyle="--", label="rattle")
        axes.set(xlabel="tolerance of the constraints", ylabel="|drift of H| per unit of time")
        axes.grid(color="0.93", linewidth=0.5)
        style.legend_above(figure, axes, 2)
    caption = (
        f"Drift of the energy over {STEPS} steps of h = {LONG[SPHERE]} on the spherical pendulum, against the tolerance to which the "
        "constraint is iterated. Dashed: `rattle`, whose multipliers are solved to round-off."
    )
    return [
        Picture(style.save(figure, folder, "constraints.png"), "drift of the energy against the tolerance", caption)
    ]


@of(MANIFOLD)
def table(rows: pd.DataFrame) -> Table:
    """Make the page's table: errors in constraints, energy and end state of each method on each problem.

    ``rows`` is the table of errors, a row for each method and problem.
    """
    columns = ["problem", "method", "constraint", "hidden constraint", "energy", "error", "uncertainty", "evaluations"]
    caption = (
        "Largest change of a constraint, of a hidden one and of the energy, the error of the end state with the reference's "
        "uncertainty, and evaluations of the forces a step."
    )
    return Table(rows[columns], caption)


@of(MANIFOLD)
def _all(rows: pd.DataFrame) -> pd.DataFrame:
    return rows


PAGE = Page(
    id="constraints",
    question="Do methods for constraints stay on the manifold, and keep the energy?",
    tables=(MANIFOLD, DRIFT, TOLERANCE),
    setting=(
        "q' = H_p, p' = -H_q - Gᵀλ with g(q) = 0: the motion is on the manifold where g and its rate G H_p, the hidden "
        "constraint, vanish.",
        f"A spherical pendulum ({SPHERE}) and a double pendulum in Cartesian coordinates ({CARTESIAN}).",
        "Ordinary methods run on the index-reduced equations, with λ as a function of (q, p) from the twice differentiated "
        "constraint.",
        f"Long runs: {STEPS} steps of h = {LONG[SPHERE]} on the spherical pendulum; the drift is the slope of H with its interval.",
        f"A molecule: n-butane of four atoms, fixed bonds and angles, torsion of Ryckaert and Bellemans, steps of h = {LONG['butane']}, "
        "4 fs.",
    ),
    verdicts=(kept, left, same, drift, loose),
    answer=answer,
    figures=draw,
    table=table,
    whole=_all,
    limits=(
        "The tolerance is of one constraint; GROMACS's `shake-tol` is 1e-4 and OpenMM's default 1e-5, relative to a length. "
        "Their other constraint solvers (LINCS, SETTLE) are not measured here.",
        "The certified state of the double pendulum in Cartesian coordinates agrees with that in angles: a test compares them.",
        "That the methods are symplectic on the manifold is measured without round-off, with controls, by the tests.",
    ),
    command="pytest benchmarks/experiments/constraints",
)
