"""Box schemes in space-time: which local laws they keep in every cell, and how fast other residuals fall."""

from __future__ import annotations

import numpy as np
import pandas as pd

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.page import style
from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Picture, Table, Verdict, of

from .laws import ENERGY, FOLLOWS, MOMENTUM, TWO_FORM
from .spacetime import CELLS, IN_SPACE, IN_TIME, TABLE

#: A residual up to so many units of round-off is round-off.
UNITS = 10.0
#: A measured order within this of the wanted one is that order.
NEAR = 0.1
#: Space is divided to second order by every scheme.
IN_SPACE_ORDER = 2
#: Totals (energy, mass, charge) are kept up to this.
KEPT = 1e-12


def ran(frame: pd.DataFrame) -> pd.DataFrame:
    """The runs that came to an end, each with whether its two-form is kept, with the parameter held and not."""
    part = frame[frame["status"] == "ok"].copy()
    for name in (TWO_FORM, FOLLOWS, ENERGY):
        part[f"{name} is kept"] = part[name] <= UNITS * part[f"{name}, round-off"]
    return part


def order(part: pd.DataFrame, law: str, falls: str) -> float:
    """The order with which the residuals of a law fall in time or in space, NaN where they are round-off."""
    part = part[(part["falls"] == falls) & (part[law] > UNITS * part[f"{law}, round-off"])]
    x = part["h"] if falls == IN_TIME else 1 / part["N"]
    return metrics.order(x, part[law]).value


def orders(frame: pd.DataFrame) -> pd.DataFrame:
    """A row for each equation and scheme: its declared order, the measured ones, what is kept and what is not."""
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


def _names(rows: pd.DataFrame) -> str:
    return listed([f"{r.scheme} ({r.equation})" for r in rows.itertuples()], 4)


@of(TABLE)
def two_form(frame: pd.DataFrame) -> Verdict | None:
    """Whether the multisymplectic law holds for those that declare it, and not for the others."""
    rows = orders(frame)
    if rows.empty:
        return None
    declared, others = rows[rows["declared"]], rows[~rows["declared"]]
    wrong = pd.concat([declared[~declared["two-form kept"]], others[others["least"] <= UNITS]])
    good = int(declared["two-form kept"].sum())
    text = f"The two-form's law holds in every cell in {good} of {len(declared)} pairs of a scheme and an equation that"
    text += f" declare it, to {number(declared['units'].max(), 2)} units of round-off"
    text += f"; the controls miss it by {number(others['least'].min(), 2)} units and more" if len(others) else ""
    text += f"; not as declared: {_names(wrong)}." if len(wrong) else "."
    return Verdict(text, wrong.empty, f"{good} of {len(declared)} keep the multisymplectic law in every cell.")


@of(TABLE)
def energy(frame: pd.DataFrame) -> Verdict | None:
    """Who keeps the energy, in cells or in total, and with which order the others' residuals fall."""
    rows = orders(frame)
    if rows.empty:
        return None
    cell, total = rows[rows["keeps"] == "cell"], rows[rows["keeps"] == "total"]
    bad = pd.concat([cell[~cell["cell energy kept"]], total[total["total energy error"] > KEPT]])
    falling = rows[rows["declared"]]
    slow = falling[~((falling["energy order"] - falling["order"]).abs() < NEAR)]
    loose = total[total["follows kept"]]
    text = (
        f"Energy in every cell: kept by {listed(sorted(set(cell.loc[cell['cell energy kept'], 'scheme'])))}; else its"
    )
    text += f" residual falls with the method's order in {len(falling) - len(slow)} of {len(falling)} pairs"
    text += f" (not {_names(slow)})" if len(slow) else ""
    if len(total):
        text += f". EQUIP keeps the total to {number(total['total energy error'].max(), 2)}, with"
        text += f" {int(total['missed'].sum())} steps without a root; with α following the state it is"
        text += " multisymplectic too" if len(loose) == len(total) else " not multisymplectic"
    wrong = pd.concat([bad, slow])
    said = "The energy law is kept or falls as declared"
    return Verdict(f"{text}.", wrong.empty, f"{said}{f', not by {_names(wrong)}' if len(wrong) else ''}.")


@of(TABLE)
def momentum(frame: pd.DataFrame) -> Verdict | None:
    """Whether the residual of the momentum law falls with the order in space."""
    rows = orders(frame)
    if rows.empty:
        return None
    rows = rows[rows["declared"]]
    off = rows[~((rows["momentum order"] - IN_SPACE_ORDER).abs() < NEAR)]
    text = f"The momentum law's residual falls with Δx² in {len(rows) - len(off)} of {len(rows)} pairs"
    text += f", not {_names(off)}." if len(off) else "."
    return Verdict(text, off.empty, text)


@of(TABLE)
def draw(frame: pd.DataFrame, folder) -> list[Picture] | None:
    """Residuals of the two-form and of the energy law over the step."""
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
                look = style.curve(k) if k < len(style.CURVES) else {"color": style.GREY, "marker": "*"}
                relative = part[TWO_FORM] / part[f"{TWO_FORM}, largest term"]
                for axes, values in zip(grid[:, column], (relative, part[ENERGY]), strict=True):
                    axes.loglog(part["h"], np.maximum(values, 1e-17), label=scheme, **look)
                    axes.grid(color="0.93", linewidth=0.5)
            grid[0, column].set_title(name)
            grid[1, column].set_xlabel("$h$")
            style.plain_ticks(grid[1, column].xaxis)
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
    "energy order": "order of the energy law in h",
    "momentum order": "of the momentum law in Δx",
    "total energy error": "total energy error",
    "quadratic invariant error": "mass or charge error",
    "missed": "no root",
}


@of(TABLE)
def table(frame: pd.DataFrame) -> Table | None:
    """A row for each equation and scheme."""
    rows = orders(frame)
    if rows.empty:
        return None
    caption = "Largest over all steps and divisions; an order is empty where the residual is round-off."
    return Table(rows[list(COLUMNS)].rename(columns=COLUMNS).head(ROWS), caption)


@of(TABLE)
def _whole(frame: pd.DataFrame) -> pd.DataFrame:
    return frame


PAGE = Page(
    id="multisymplectic",
    question="Do box schemes keep the local conservation laws in every cell of space-time?",
    tables=(TABLE,),
    setting=(
        "K z_t + L z_x = ∇S(z), period 2π: i ψ_t + ψ_xx + 2|ψ|²ψ = 0, and φ_tt = φ_xx − φ − |φ|²φ, complex.",
        "Laws: two-form (uᵀKv)_t + (uᵀLv)_x = 0 of two linearized solutions; energy (S − zᵀLz_x/2)_t + (zᵀLz_t/2)_x "
        "= 0; momentum (zᵀKz_x/2)_t + (S − zᵀKz_t/2)_x = 0.",
        "Preissmann's box: the midpoint rule in space and time. Gauss and EQUIP box: two Gauss nodes in time; EQUIP's "
        "α keeps the total energy. Euler box: symplectic Euler in both.",
        "Controls: AVF in time (keeps the energy of every cell), Radau IIA, and a midpoint rule with 0.501 for 1/2.",
    ),
    verdicts=(two_form, energy, momentum),
    figures=draw,
    table=table,
    whole=_whole,
    limits=(
        f"Round-off is up to {UNITS:g} units: eps times the squared largest slope of the mesh (the last digit of its "
        "highest mode), over h for energy and momentum.",
        f"Orders are two-sided within {NEAR}; totals are kept up to {KEPT:g}; the number of cells is odd, on which the "
        "box scheme's solvability on a period rests.",
        "On a fixed mesh these are the methods in time on canonical systems: the Euler box's is that of the page on "
        "[waves](waves.md).",
    ),
    command="pytest benchmarks/experiments/waves",
)
