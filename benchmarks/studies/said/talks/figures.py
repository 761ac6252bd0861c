"""The pages of the talks' figures, one for each subject: every figure measured and drawn again, with verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from phasebench.benchmarks import style
from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Picture, Table, of
from phasebench.benchmarks.page.study import Claim, Study
from phasebench.benchmarks.page.verdict import NONE, at_least, at_most

from . import convergence, henon_heiles, linear_map, lotka_volterra, measure, pendulum, perturbed_kepler
from .measure import CURVES, Figure

#: Largest change of an area, energy or momentum that counts as preserved; difference of an observed order from the
#: scheme's; relative error of the apocentre's turn per revolution.
KEPT, NEAR, TURN = 1e-11, 0.15, 0.05
EULERS = ("explicit Euler", "implicit Euler")
#: Section -> its figures.
FIGURES: dict[str, tuple[Figure, ...]] = {
    "symplectic-maps": (*pendulum.FIGURES, *linear_map.FIGURES),
    "lotka-volterra": lotka_volterra.FIGURES,
    "henon-heiles": henon_heiles.FIGURES,
    "perturbed-kepler": perturbed_kepler.FIGURES,
    "convergence": convergence.FIGURES,
}
MEASURED = {f.id: f for figures in FIGURES.values() for f in figures if f.measure}


def curves(figure: str) -> list[dict]:
    """The rows of a figure, one for each curve."""
    return MEASURED[figure].measure()


# -- judging -----------------------------------------------------------------------------------------------------------

AREA = "figure == 'pendulum-area' and area == area"
INVARIANT = "figure == 'lotka-volterra-methods' and energy_error == energy_error"
WELL = "figure == 'henon-heiles-preserving-energy'"
BOTH = "figure == 'perturbed-kepler-preserving-invariants'"
TURNS = "figure == 'perturbed-kepler-preserving-orbits' and turn == turn"
SLOPES = "figure in ['convergence-schemes-i-iii', 'convergence-compositions'] and order == order"


def area_changes(rows: pd.DataFrame) -> pd.Series:
    """The largest change of the area of a set under each map."""
    return rows.groupby("panel", sort=False)["area"].agg(lambda a: (a - a.iloc[0]).abs().max())


def invariant_changes(rows: pd.DataFrame) -> pd.Series:
    """The largest change of the Lotka-Volterra invariant under each method."""
    return rows.groupby("panel", sort=False)["energy_error"].max()


def others(rows: pd.DataFrame) -> pd.Series:
    """The changes of the invariant under methods that are not Euler's."""
    worst = invariant_changes(rows)
    return worst[~worst.index.isin(EULERS)]


def nearer(rows: pd.DataFrame) -> pd.Series:
    """True for each method that stays nearer to the level curve than both Euler methods."""
    worst = invariant_changes(rows)
    euler = worst[worst.index.isin(EULERS)]
    return others(rows) < euler.min() if len(euler) else pd.Series(dtype=bool)


def well(rows: pd.DataFrame) -> pd.DataFrame:
    """The largest energy error and number of steps without a root of each method on Henon-Heiles."""
    return rows.groupby("curve", sort=False)[["energy_error", "fallbacks"]].max()


def kept(rows: pd.DataFrame) -> pd.Series:
    """The energy errors of methods that solve their equation in every step."""
    worst = well(rows)
    return worst[worst["fallbacks"] == 0]["energy_error"]


def laws(rows: pd.DataFrame) -> pd.DataFrame:
    """The largest errors of energy and angular momentum of each method on perturbed Kepler."""
    return rows.pivot_table(index="curve", columns="panel", values="largest", sort=False)


def both(rows: pd.DataFrame) -> pd.Series:
    """The larger error of Schemes IV and V, if both are known."""
    found = laws(rows).max(axis=1).reindex(["Scheme IV", "Scheme V"])
    return pd.Series(dtype=float) if found.isna().any() else found


def off_turn(rows: pd.DataFrame) -> pd.Series:
    """How far the apocentre's turn is from that of the exact flow, in percent, by method."""
    turn = rows.set_index("curve")["turn"]
    exact = turn.get("exact flow")
    return pd.Series(dtype=float) if exact is None else 100 * (turn.drop("exact flow") / exact - 1).abs()


def agreeing(rows: pd.DataFrame) -> pd.Series:
    """True for each slope near the order of its scheme."""
    orders = {title: order for title, (_, order) in (convergence.SCHEMES | convergence.COMPOSITIONS).items()}
    expected = rows["panel"].map(orders).fillna(rows["curve"].map(orders))
    return ~((rows["order"] - expected).abs() > NEAR)


def farther(rows: pd.DataFrame) -> str:
    """The first slopes that are not near the order."""
    return "; ".join(f"{r.curve}: {r.order:.2f}" for r in rows[~agreeing(rows)].head(4).itertuples())


def _told(errors: pd.Series) -> str:
    return join_list([f"{number(x, 2)} ({name})" for name, x in errors.items()])


@of(CURVES)
def answer_areas(curves: pd.DataFrame) -> str | None:
    """The change of the area of a set under each map of the pendulum."""
    found = area_changes(curves.query(AREA))
    if found.empty:
        return None
    return f"Over {pendulum.SNAPSHOTS} steps of π/4 on the pendulum a set's area changes by {_told(found)}."


@of(CURVES)
def answer_level_curves(curves: pd.DataFrame) -> str | None:
    """The largest change of the Lotka-Volterra invariant under each method."""
    found = invariant_changes(curves.query(INVARIANT)).sort_values()
    if found.empty:
        return None
    return (
        f"Numerical orbits (h = {lotka_volterra.STEP:g}) leave the exact closed curves: the invariant changes by up "
        f"to {_told(found)}."
    )


@of(CURVES)
def answer_well(curves: pd.DataFrame) -> str | None:
    """The energy errors of energy-preserving methods on Henon-Heiles."""
    worst = well(curves.query(WELL))
    if worst.empty:
        return None
    return (
        f"On Hénon–Heiles (h = {henon_heiles.STEP:g}) the energy error is at most {_told(worst['energy_error'])}; "
        f"steps without an energy-preserving λ: {int(worst['fallbacks'].sum())}."
    )


@of(CURVES)
def answer_kepler(curves: pd.DataFrame) -> str | None:
    """Errors of energy, angular momentum and precession on perturbed Kepler."""
    errors, turned, parts = both(curves.query(BOTH)), off_turn(curves.query(TURNS)), []
    if len(errors):
        avf = laws(curves.query(BOTH)).reindex(["AVF"])["angular-momentum"].iloc[0]
        parts.append(f"Schemes IV and V keep energy and angular momentum within {number(errors.max(), 2)}")
        parts[0] += f", AVF the latter within {number(avf, 2)}" if avf == avf else ""
    if len(turned):
        parts.append(f"the ellipse's turning is exact within {number(turned.max(), 2)} %")
    return f"On perturbed Kepler (h = {perturbed_kepler.STEP:g}) {'; '.join(parts)}." if parts else None


# -- what is shown -----------------------------------------------------------------------------------------------------

#: Column of a measured number -> its name in the table.
VALUES = {
    "energy_error": "energy error",
    "largest": "largest error",
    "area": "area",
    "order": "order",
    "turn": "turn (rad)",
}


def table(section: str, data: Data) -> Table | None:
    """A row for each run of a section's figures with an error, area, order or precession."""
    curves = data(CURVES)
    if curves is None or curves.empty:
        return None
    rows = curves[curves["figure"].isin([f.id for f in FIGURES[section]])]
    values = [c for c in VALUES if c in rows and rows[c].notna().any()]
    if not values:
        return None
    rows = rows.dropna(subset=values, how="all").sort_values(values[0], key=pd.isna, kind="stable")
    if "area" in values:  # only the last of the almost equal areas
        rows = rows[rows["area"].isna() | ~rows.duplicated(["figure", "panel"], keep="last")]
    columns = ["panel", "curve", "h", "t_end", *values, "fallbacks", "status"]
    whole = rows.reindex(columns=columns).drop_duplicates().dropna(axis=1, how="all")
    shown = whole.head(ROWS).rename(columns=VALUES | {"fallbacks": "steps without a root"})
    cut = f"The first {ROWS} of the {len(whole)} runs" if len(whole) > ROWS else "The runs"
    return Table(shown, f"{cut} that the figures show.")


def pictures(section: str, data: Data, folder: Path) -> list[Picture] | None:
    """The figures of a section; one whose curves were not measured is left out."""
    curves, drawn = data(CURVES), []
    if curves is None:
        return None
    for figure in FIGURES[section]:
        rows = curves[curves["figure"] == figure.id]
        if len(rows) or figure.measure is None:
            drawing, caption = figure.draw(rows)
            drawn.append(Picture(style.save(drawing, folder, f"{figure.id}.png"), figure.title, caption))
    return drawn


def _study(section: str, question: str, answer: Callable, setting: Sequence[str], **parts: Any) -> Study:
    return Study(
        id=f"talk-{section}",
        place=460 + [*FIGURES].index(section) / 10,
        question=question,
        answer=answer,
        setting=setting,
        runs=(),
        reads=(CURVES,),
        command="pytest benchmarks -k talks",
        figure=partial(pictures, section),
        shown=partial(table, section),
        whole=lambda data: None,
        **parts,
    )


KEEPS = f"Kept to round-off means a change of at most {KEPT:g} over the whole run."
LAMBDAS = ", ".join(map(str, measure.LAMBDAS))
CHANGED = Claim(
    "Symplectic maps change the area by round-off only",
    CURVES,
    area_changes,
    at_most(KEPT),
    rows=f"{AREA} and panel not in ['exact flow', 'explicit Euler']",
    fault=True,
)
STUDIES = (
    _study(
        "symplectic-maps",
        "Do symplectic maps keep areas, and the others not?",
        answer_areas,
        (
            "H = p²/2 − cos q; a set of points is carried by the flow and by maps of step h = π/4.",
            "With one degree of freedom a map is symplectic if it keeps areas; with more, if it keeps the sum ω(ξ, η) "
            "of the oriented areas of the projections onto the planes (pᵢ, qᵢ).",
        ),
        claims={
            "areas": CHANGED,
            "euler": Claim(
                "The explicit Euler method changes the area", CURVES, lambda rows: area_changes(rows).max(),
                at_least(KEPT), rows=f"{AREA} and panel == 'explicit Euler'", fault=True,
            ),
        },
        limits=(KEEPS, "Areas are those of the trigonometric interpolant of the set's boundary."),
    ),
    _study(
        "lotka-volterra",
        "Do the numerical orbits of Lotka–Volterra close?",
        answer_level_curves,
        (
            "u' = u (v − 2), v' = v (1 − u); every solution lies on a level curve of I = ln u − u + 2 ln v − v.",
            f"From the talk's initial values, h = {lotka_volterra.STEP:g}.",
        ),
        claims={
            "nearer": Claim(
                "Symplectic methods stay nearer to the level curve than both Euler methods", CURVES, nearer,
                rows=INVARIANT, unit="methods", where=lambda rows: others(rows).idxmax(),
            ),
        },
        limits=("Symplectic is meant in (ln u, ln v): in (u, v) the system is not canonical.",),
    ),
    _study(
        "henon-heiles",
        "What do Schemes I, IV, V and AVF make of a box orbit and a chaotic orbit?",
        answer_well,
        (
            "H = (p₁² + p₂²)/2 + (q₁² + q₂²)/2 + q₁² q₂ − q₂³/3; a box orbit and a chaotic one, h = "
            f"{henon_heiles.STEP:g}, to t = 1000.",
            f"Scheme I at λ = {LAMBDAS}; Schemes IV and V choose λ in each step such that H is kept, and take λ = 1/2 "
            "where there is no such λ. AVF: averaged vector field method.",
        ),
        claims={
            "kept": Claim(
                "Schemes with a root in every step keep the energy to round-off", CURVES, kept, at_most(KEPT),
                rows=WELL, fault=True,
            ),
            "roots": Claim(
                "In every step some λ near 1/2 keeps the energy", CURVES, lambda rows: well(rows)["fallbacks"],
                at_most(0), rows=WELL, unit="steps without",
            ),
            "escapes": Claim(
                "No orbit of Scheme I leaves the potential well", CURVES,
                lambda rows: (rows["status"] != "ok") | ~(rows["energy_error"] < henon_heiles.ESCAPED), NONE,
                rows="figure == 'henon-heiles-scheme-i-energy'", unit="orbits", where="{panel}, {curve}", names=4,
            ),
        },
        limits=(KEEPS, "The chaotic orbit starts close to the escape energy: an energy error lets it leave the well."),
    ),
    _study(
        "perturbed-kepler",
        "Which schemes keep energy, angular momentum and the turning of the ellipse on perturbed Kepler?",
        answer_kepler,
        (
            f"H = |p|²/2 − 1/|q| − μ/(3|q|³), μ = 0.0075; h = {perturbed_kepler.STEP:g}, to t = 1000.",
            f"Schemes I and III at λ = {LAMBDAS}; AVF (averaged vector field), Schemes IV and V.",
            "Every scheme that is symplectic at fixed λ keeps L = q₁p₂ − q₂p₁, even where λ changes; AVF does not.",
        ),
        claims={
            "both": Claim(
                "Schemes IV and V keep both energy and angular momentum to round-off", CURVES, both, at_most(KEPT),
                rows=BOTH, fault=True,
            ),
            "turns": Claim(
                "With energy-preserving methods the apocentre turns at the rate of the exact flow", CURVES, off_turn,
                at_most(100 * TURN), rows=TURNS, unit="% off",
            ),
        },
        limits=(
            KEEPS,
            f"The exact turn is that of {perturbed_kepler.EXACT} at half the step; rates within {100 * TURN:g} % count "
            "as the same.",
        ),
    ),
    _study(
        "convergence",
        "Do refinement differences fall with the orders of the schemes?",
        f"{{slopes.n}} of {{slopes.of}} observed slopes of refinement differences are within {NEAR} of the scheme's "
        "order, on a chaotic Hénon–Heiles orbit.",
        (
            "Max |y_h − y_2h| over q and p at t = 1 on the chaotic Hénon–Heiles orbit, as in the talk's tables: not "
            "the error against the exact solution, but it falls with the same order.",
        ),
        claims={
            "slopes": Claim(
                "Every refinement difference falls with the order of its scheme", CURVES, agreeing, rows=SLOPES,
                unit=f"slopes within {NEAR}", where=farther,
            ),
        },
        limits=(f"Slopes are fitted over the three smallest steps with differences above {measure.NOISE:g}.",),
    ),
)  # fmt: skip
