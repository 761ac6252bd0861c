"""The report's page "multisymplectic": which local conservation laws box schemes for wave equations keep.

A law is kept if its residual is round-off in every mesh cell.  Of a law that a scheme does not keep, the order is
measured with which the residual falls, in time or in space.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, Count, Exactly, Verdict

from .laws import ENERGY, FOLLOWS, MOMENTUM, TWO_FORM
from .spacetime import CELLS, IN_SPACE, IN_TIME, TABLE

if TYPE_CHECKING:
    from pathlib import Path

#: A residual of at most this many units of round-off counts as round-off.
UNITS = 10.0
#: Largest difference of a measured order from the expected one that counts as agreement.
NEAR = 0.1
#: The order in space of every scheme.
IN_SPACE_ORDER = 2
#: Largest error of a total (energy, mass, charge) that counts as preserved.
KEPT = 1e-12


def ran(frame: pd.DataFrame) -> pd.DataFrame:
    """Select the completed runs of box schemes; add columns "(law) is kept" for the laws of two-form and energy.

    A column says whether the law's residual is at most `UNITS` units of round-off.
    """
    part = frame[frame["status"] == "ok"].copy()
    for name in (TWO_FORM, FOLLOWS, ENERGY):
        part[f"{name} is kept"] = part[name] <= UNITS * part[f"{name}, round-off"]
    return part


def order(part: pd.DataFrame, law: str, falls: str) -> float:
    """Return the order of a law's residuals in the step or in the mesh width; NaN if they are round-off.

    ``part`` has the runs of one scheme on one equation; ``falls`` is `IN_TIME` or `IN_SPACE`.
    """
    part = part[(part["falls"] == falls) & (part[law] > UNITS * part[f"{law}, round-off"])]
    x = part["h"] if falls == IN_TIME else 1 / part["N"]
    return metrics.order(x, part[law]).value


def orders(frame: pd.DataFrame) -> pd.DataFrame:
    """Summarize the runs, a row for each equation and box scheme: its orders, and which laws and totals are preserved.

    Orders are the declared one and those measured of the residuals of the energy and momentum laws.
    """
    rows = []
    for (equation, id), part in ran(frame).groupby(["equation", "id"], sort=False):
        first, ladder = part.iloc[0], part[part["falls"] == IN_TIME]
        units = part[TWO_FORM] / part[f"{TWO_FORM}, round-off"]
        rows.append(
            {"equation": equation, "id": id, "scheme": first["scheme"], "declared": bool(first["multisymplectic"])}
            | {"two-form kept": bool(part[f"{TWO_FORM} is kept"].all()), "units": units.max(), "least": units.min()}
            | {"relative": (part[TWO_FORM] / part[f"{TWO_FORM}, largest term"]).max()}
            | {"follows kept": bool(part[f"{FOLLOWS} is kept"].all()), "keeps": first["keeps"], "order": first["order"]}
            | {"cell energy kept": bool(ladder[f"{ENERGY} is kept"].all())}
            | {"energy order": order(part, ENERGY, IN_TIME), "momentum order": order(part, MOMENTUM, IN_SPACE)}
            | {"total energy error": part["total energy error"].max(), "missed": part["steps without a root"].sum()}
            | {"quadratic invariant error": part["quadratic invariant error"].max()}
        )
    return pd.DataFrame(rows)


def _of_cases(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator: turn a function of the rows of `orders` into a function of ``data``, which maps a name to a table.

    The rows, one for each equation and box scheme, are made from the measured table; the result is None without them.
    """

    @of(TABLE)
    @functools.wraps(function)
    def of_frame(frame: pd.DataFrame) -> Any:
        rows = orders(frame)
        return None if rows.empty else function(rows)

    return of_frame


def _all(rows: pd.DataFrame, holds: pd.Series) -> tuple[Count, Exactly, str, str]:
    """Return arguments of a `Verdict` on whether a property holds in all rows, each an equation and a box scheme.

    They are (count of the rows where ``holds``, the expectation "every", the unit, text with the rows where it fails).
    """
    names = [f"{r.scheme} ({r.equation})" for r in rows[~holds].itertuples()]
    return Count(int(holds.sum()), len(rows)), EVERY, "cases", join_list(names, 4) if names else ""


@_of_cases
def two_form(rows: pd.DataFrame) -> Verdict:
    """Judge whether the multisymplectic law holds for the box schemes that are declared multisymplectic.

    ``rows`` has a row for each equation and scheme.
    """
    rows = rows[rows["declared"]]
    kept = _all(rows, rows["two-form kept"])
    return Verdict("Multisymplectic schemes keep the two-form's law in every cell, to round-off", *kept, FAIL)


@_of_cases
def controls(rows: pd.DataFrame) -> Verdict:
    """Judge whether each box scheme not declared multisymplectic breaks the multisymplectic law in each of its runs.

    ``rows`` has a row for each equation and box scheme.
    """
    rows = rows[~rows["declared"]]
    broken = _all(rows, rows["least"] > UNITS)
    return Verdict("Control schemes break the two-form's law by more than round-off", *broken, FAIL)


@_of_cases
def energy(rows: pd.DataFrame) -> Verdict:
    """Judge whether the box schemes built to preserve the energy, in every mesh cell or in total, do so.

    ``rows`` has a row for each equation and box scheme.
    """
    rows = rows[rows["keeps"].isin(["cell", "total"])]
    kept = rows["cell energy kept"].where(rows["keeps"] == "cell", rows["total energy error"] <= KEPT).astype(bool)
    return Verdict("Schemes built to keep the energy, of every cell or in total, keep it", *_all(rows, kept), FAIL)


@_of_cases
def energy_order(rows: pd.DataFrame) -> Verdict:
    """Judge whether the residual of the energy law falls with the order in time of each multisymplectic scheme.

    The measured order may be neither lower nor higher.  ``rows`` has a row for each equation and box scheme.
    """
    rows = rows[rows["declared"]]
    near = _all(rows, (rows["energy order"] - rows["order"]).abs() < NEAR)
    return Verdict("The residual of the energy law falls with the scheme's order in time", *near)


@_of_cases
def momentum(rows: pd.DataFrame) -> Verdict:
    """Judge whether the residual of the momentum law falls with the second power of the mesh width.

    ``rows`` has a row for each equation and box scheme; only multisymplectic schemes are judged.
    """
    rows = rows[rows["declared"]]
    near = _all(rows, (rows["momentum order"] - IN_SPACE_ORDER).abs() < NEAR)
    return Verdict("The residual of the momentum law falls as Δx²", *near)


@_of_cases
def answer(rows: pd.DataFrame) -> str | None:
    """Return the page's answer, a sentence: residuals of the multisymplectic law in units of round-off.

    The sentence has the largest residual of multisymplectic schemes, and the least of the others.  ``rows`` has a row
    for each equation and box scheme.
    """
    kept, others = rows[rows["declared"]], rows[~rows["declared"]]
    if kept.empty:
        return None
    text = "In every cell of space-time box schemes keep the multisymplectic law of Schrödinger and Klein–Gordon"
    text += f" equations to {number(kept['units'].max(), 2)} units of round-off"
    return f"{text}; controls miss it by {number(others['least'].min(), 2)} and more." if len(others) else f"{text}."


@of(TABLE)
def draw(frame: pd.DataFrame, folder: Path) -> list[Picture] | None:
    """Draw the residuals of the multisymplectic law and of the energy law over the step h; save it in ``folder``.

    ``frame`` has the runs of all box schemes; None if none completed.
    """
    rows = ran(frame)
    rows = rows[rows["falls"] == IN_TIME]
    if rows.empty:
        return None
    names, schemes = (list(dict.fromkeys(rows[c])) for c in ("equation", "scheme"))
    with style.settings():
        figure, grid = style.panels(2, len(names), 5.0, sharex="col", sharey="row")
        for column, name in enumerate(names):
            for k, scheme in enumerate(schemes):
                part = rows[(rows["equation"] == name) & (rows["scheme"] == scheme)]
                relative = part[TWO_FORM] / part[f"{TWO_FORM}, largest term"]
                for axes, values in zip(grid[:, column], (relative, part[ENERGY]), strict=True):
                    axes.loglog(part["h"], np.maximum(values, 1e-17), label=scheme, **style.curve(k))
                    axes.grid(color="0.93", linewidth=0.5)
            grid[0, column].set_title(name)
            grid[1, column].set_xlabel("$h$")
        grid[0, 0].set_ylabel("two-form, relative")
        grid[1, 0].set_ylabel("energy law")
        style.legend_above(figure, grid[0, 0], 4)
    caption = f"Largest residuals over all cells of space-time, {CELLS[0]} cells in space: of the multisymplectic law"
    caption += " (above, relative to its largest term) and of the energy law (below)."
    return [Picture(style.save(figure, folder, "multisymplectic.png"), "residuals of local laws", caption)]


COLUMNS = {
    "equation": "equation",
    "scheme": "scheme",
    "units": "two-form (units of round-off)",
    "relative": "relative to its terms",
    "energy order": "order of the energy residual in h",
    "momentum order": "of the momentum residual in Δx",
    "total energy error": "total energy error",
    "quadratic invariant error": "mass or charge error",
    "missed": "steps without a root",
}


@_of_cases
def table(rows: pd.DataFrame) -> Table:
    """Return the page's table: residuals, orders and errors of totals, a row for each equation and box scheme."""
    caption = "The largest values over all runs of a case; an order is empty where the residual is round-off."
    total = rows[rows["keeps"] == "total"]
    if len(total):
        law = "holds" if total["follows kept"].all() else "fails"
        caption += f" The two-form's law is that at fixed α; with EQUIP's α following the state it {law}."
    return Table(rows[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of(TABLE)
def _full_table(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="multisymplectic",
    question="Do box schemes keep the local conservation laws in every cell of space-time?",
    tables=(TABLE,),
    setting=(
        "K z_t + L z_x = ∇S(z), period 2π: i ψ_t + ψ_xx + 2|ψ|²ψ = 0, and φ_tt = φ_xx − φ − |φ|²φ, complex.",
        "Laws: two-form (uᵀKv)_t + (uᵀLv)_x = 0 of two linearized solutions u, v; energy (S − zᵀLz_x/2)_t + "
        "(zᵀLz_t/2)_x = 0; momentum (zᵀKz_x/2)_t + (S − zᵀKz_t/2)_x = 0.",
        "Preissmann's box: the midpoint rule in space and time. Gauss and EQUIP box: two Gauss nodes in time; EQUIP's "
        "parameter α keeps the total energy. Euler box: symplectic Euler in both.",
        "Controls: AVF in time (keeps the energy of every cell), Radau IIA, and a midpoint rule with 0.501 for 1/2.",
    ),
    verdicts=(two_form, controls, energy, energy_order, momentum),
    answer=answer,
    figures=draw,
    table=table,
    whole=_full_table,
    limits=(
        f"A residual up to {UNITS:g} units counts as round-off; a unit is eps times the square of the largest slope on "
        "the mesh (the last digit of its highest mode), for energy and momentum also divided by h.",
        f"A measured order must be within {NEAR} of the expected one; a total counts as kept up to {KEPT:g}. The "
        "number of cells is odd, without which the box scheme on a period may have no solution.",
        "On a fixed mesh these are methods in time for Hamiltonian systems: for the Euler box see the page on "
        "[waves](waves.md).",
    ),
    command="pytest benchmarks/experiments/waves",
)
