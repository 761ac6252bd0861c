"""The report's pages of the talks' figures, one for each section of the talks, with verdicts.

``curves`` is the table of all measured curves: a row for each curve of a figure.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import pandas as pd

from phasebench.benchmarks.page.markdown import join_list, number
from phasebench.benchmarks.page.page import ROWS, Data, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, FAIL, NONE, Count, Verdict, at_least, at_most

from . import convergence, gallery, henon_heiles, lotka_volterra, measure, pendulum, perturbed_kepler
from .record import TABLE

if TYPE_CHECKING:
    from pathlib import Path

#: Largest change of an area, energy or momentum that counts as preserved.
KEPT = 1e-11
#: Largest difference of an observed order from the scheme's that counts as agreement.
NEAR = 0.15
#: Largest relative error of the apocentre's turn per revolution.
TURN = 0.05
EULERS = ("explicit Euler", "implicit Euler")
#: The schemes that preserve both energy and angular momentum.
BOTH = ("Scheme IV", "Scheme V")


def _of(curves: pd.DataFrame, *figures: str) -> pd.DataFrame:
    return curves[curves["figure"].isin(figures)]


def _area_changes(curves: pd.DataFrame) -> pd.Series:
    """Return the largest change of the area of a set under each map of the pendulum, by the map's name."""
    faces = _of(curves, "pendulum-area").dropna(subset=["area"])
    return faces.groupby("panel", sort=False)["area"].agg(lambda a: (a - a.iloc[0]).abs().max())


@of(TABLE)
def areas(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether symplectic maps preserve the area of a set in the pendulum's phase plane; None without rows."""
    change = _area_changes(curves).drop(["exact flow", EULERS[0]], errors="ignore")
    if change.empty:
        return None
    return Verdict(
        "Symplectic maps change the area by round-off only",
        float(change.max()),
        at_most(KEPT),
        where=change.idxmax(),
        otherwise=FAIL,
    )


@of(TABLE)
def euler_area(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether explicit Euler, the control, changes the area of a set in the pendulum's phase plane."""
    change = _area_changes(curves)
    if EULERS[0] not in change:
        return None
    return Verdict(
        "The explicit Euler method changes the area", float(change[EULERS[0]]), at_least(KEPT), otherwise=FAIL
    )


@of(TABLE)
def answer_areas(curves: pd.DataFrame) -> str | None:
    """Return a page's answer, a sentence: the change of the area of a set under each map of the pendulum."""
    parts = [f"{number(x, 2)} ({name})" for name, x in _area_changes(curves).items()]
    if not parts:
        return None
    return f"Over {pendulum.SNAPSHOTS} steps of π/4 on the pendulum a set's area changes by {join_list(parts)}."


def _invariant_changes(curves: pd.DataFrame) -> pd.Series:
    """Return the largest change of the Lotka-Volterra invariant under each method, by the method's name."""
    runs = _of(curves, "lotka-volterra-methods").dropna(subset=["energy_error"])
    return runs.groupby("panel", sort=False)["energy_error"].max()


@of(TABLE)
def level_curves(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether symplectic methods stay nearer to level curves of the Lotka-Volterra invariant than both Eulers do.

    The Euler methods are the explicit and the implicit one.
    """
    worst = _invariant_changes(curves)
    euler, others = worst[worst.index.isin(EULERS)], worst[~worst.index.isin(EULERS)]
    if euler.empty or others.empty:
        return None
    return Verdict(
        "Symplectic methods stay nearer to the level curve than both Euler methods",
        Count(int((others < euler.min()).sum()), len(others)),
        EVERY,
        "methods",
        where=others.idxmax(),
    )


@of(TABLE)
def answer_level_curves(curves: pd.DataFrame) -> str | None:
    """Return a page's answer, a sentence: the largest change of the Lotka-Volterra invariant under each method."""
    parts = [f"{number(x, 2)} ({name})" for name, x in _invariant_changes(curves).sort_values().items()]
    if not parts:
        return None
    return (
        f"Numerical orbits (h = {lotka_volterra.STEP:g}) leave the exact closed curves: the invariant changes by up "
        f"to {join_list(parts)}."
    )


def _well(curves: pd.DataFrame) -> pd.DataFrame:
    """Summarize the energy-preserving methods on Henon-Heiles, a row for each: ``energy_error`` and ``fallbacks``.

    The methods are AVF (averaged vector field) and Schemes IV and V, which choose a parameter lambda in each step.
    ``fallbacks`` counts the steps of a run in which no lambda was found that keeps the energy; both values are the
    largest over the orbits.
    """
    runs = _of(curves, "henon-heiles-preserving-energy")
    return runs.groupby("curve", sort=False)[["energy_error", "fallbacks"]].max()


@of(TABLE)
def energies(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether energy-preserving methods that solve their equation in every step keep the energy of Henon-Heiles.

    They are AVF (averaged vector field), and those of Schemes IV and V that find in every step a parameter lambda with
    which H is kept; None if there are none.
    """
    worst = _well(curves)
    kept = worst[worst["fallbacks"] == 0]["energy_error"]
    if kept.empty:
        return None
    return Verdict(
        "Schemes with a root in every step keep the energy to round-off",
        float(kept.max()),
        at_most(KEPT),
        where=kept.idxmax(),
        otherwise=FAIL,
    )


@of(TABLE)
def roots(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether Schemes IV and V find a lambda that preserves the energy of Henon-Heiles in every step."""
    missed = _well(curves)["fallbacks"]
    if missed.empty:
        return None
    return Verdict(
        "In every step some λ near 1/2 keeps the energy",
        int(missed.max()),
        at_most(0),
        "steps without",
        where=missed.idxmax() if missed.any() else "",
    )


@of(TABLE)
def escapes(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether the orbits of Scheme I (a symplectic method with a fixed lambda) stay in Henon-Heiles' well."""
    runs = _of(curves, "henon-heiles-scheme-i-energy")
    if runs.empty:
        return None
    gone = runs[(runs["status"] != "ok") | ~(runs["energy_error"] < henon_heiles.ESCAPED)]
    return Verdict(
        "No orbit of Scheme I leaves the potential well",
        Count(len(gone), len(runs)),
        NONE,
        "orbits",
        where=join_list([f"{r.panel}, {r.curve}" for r in gone.itertuples()], 4) if len(gone) else "",
    )


@of(TABLE)
def answer_well(curves: pd.DataFrame) -> str | None:
    """Return a page's answer, a sentence: the energy errors of energy-preserving methods on Henon-Heiles.

    They are AVF (averaged vector field) and Schemes IV and V, which choose a parameter lambda in each step.
    """
    worst = _well(curves)
    if worst.empty:
        return None
    errors = join_list([f"{number(x, 2)} ({name})" for name, x in worst["energy_error"].items()])
    return (
        f"On Hénon–Heiles (h = {henon_heiles.STEP:g}) the energy error is at most {errors}; steps without an "
        f"energy-preserving λ: {int(worst['fallbacks'].sum())}."
    )


def _both(curves: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each energy-preserving method on perturbed Kepler: its largest errors of two invariants.

    The columns are "energy" and "angular-momentum".
    """
    runs = _of(curves, "perturbed-kepler-preserving-invariants")
    return runs.pivot_table(index="curve", columns="panel", values="largest", sort=False)


@of(TABLE)
def momenta(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether Schemes IV and V keep the energy and the angular momentum of perturbed Kepler to round-off.

    These schemes choose a parameter lambda in each step so that H is kept.
    """
    largest = _both(curves).max(axis=1).reindex(BOTH)
    if largest.isna().any():
        return None
    return Verdict(
        "Schemes IV and V keep both energy and angular momentum to round-off",
        float(largest.max()),
        at_most(KEPT),
        where=largest.idxmax(),
        otherwise=FAIL,
    )


@of(TABLE)
def turns(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether under AVF and Schemes IV and V the apocentre of perturbed Kepler turns as under the exact flow."""
    runs = _of(curves, "perturbed-kepler-preserving-orbits").dropna(subset=["turn"])
    turn = runs.set_index("curve")["turn"]
    others = turn.drop("exact flow", errors="ignore")
    if others.empty or len(others) == len(turn):
        return None
    off = (others / turn["exact flow"] - 1).abs()
    return Verdict(
        "With energy-preserving methods the apocentre turns at the rate of the exact flow",
        100 * float(off.max()),
        at_most(100 * TURN),
        "% off",
        where=off.idxmax(),
    )


def answer_kepler(data: Data) -> str | None:
    """Return a page's answer, a sentence on perturbed Kepler: errors of energy, angular momentum and precession.

    ``data`` maps a table's name to the table.
    """
    kept, turned, parts = momenta(data), turns(data), []
    if kept:
        avf = _both(data(TABLE)).reindex(["AVF"])["angular-momentum"].iloc[0]
        parts.append(f"Schemes IV and V keep energy and angular momentum within {number(kept.measured, 2)}")
        if avf == avf:
            parts[0] += f", AVF the latter within {number(avf, 2)}"
    if turned:
        parts.append(f"the ellipse's turning is exact within {number(turned.measured, 2)} %")
    return f"On perturbed Kepler (h = {perturbed_kepler.STEP:g}) {'; '.join(parts)}." if parts else None


def _slopes(curves: pd.DataFrame) -> pd.DataFrame:
    """Select the curves of refinement differences with an observed order; add the method's order as ``expected``."""
    rows = _of(curves, "convergence-schemes-i-iii", "convergence-compositions").dropna(subset=["order"])
    orders = {title: order for title, (_, order) in (convergence.SCHEMES | convergence.COMPOSITIONS).items()}
    return rows.assign(expected=rows["panel"].map(orders).fillna(rows["curve"].map(orders)))


@of(TABLE)
def slopes(curves: pd.DataFrame) -> Verdict | None:
    """Judge whether the refinement differences |y_h - y_2h| fall with the orders of the schemes."""
    rows = _slopes(curves)
    if rows.empty:
        return None
    off = rows[(rows["order"] - rows["expected"]).abs() > NEAR]
    return Verdict(
        "Every refinement difference falls with the order of its scheme",
        Count(len(rows) - len(off), len(rows)),
        EVERY,
        f"slopes within {NEAR}",
        where="; ".join(f"{r.curve}: {r.order:.2f}" for r in off.head(4).itertuples()),
    )


def answer_slopes(data: Data) -> str | None:
    """Return a page's answer, a sentence: how many slopes of refinement differences equal the scheme's order."""
    found = slopes(data)
    if found is None:
        return None
    of = f"{found.measured.n} of {found.measured.of}"
    return f"{of} observed slopes of refinement differences are within {NEAR} of the scheme's order, on a chaotic Hénon–Heiles orbit."


#: Column of a measured number -> its name in the table.
VALUES = {
    "energy_error": "energy error",
    "largest": "largest error",
    "area": "area",
    "order": "order",
    "turn": "turn (rad)",
}


def _table(section: str, data: Data) -> Table | None:
    """Return the table of a section's page: a row for each run of its figures with an error, area, order or precession.

    None if nothing was measured.
    """
    curves = data(TABLE)
    if curves is None or curves.empty:
        return None
    rows = _of(curves, *(f.id for f in gallery.FIGURES if f.section == section))
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


def _figures(section: str, data: Data, folder: Path) -> list | None:
    curves = data(TABLE)
    return None if curves is None else gallery.pictures(curves, section, folder)


def _page(section: str, question: str, **parts: Any) -> Page:
    return Page(
        id=f"talk-{section}",
        question=question,
        tables=(TABLE,),
        command="pytest benchmarks/experiments/talks",
        figures=partial(_figures, section),
        table=partial(_table, section),
        **parts,
    )


KEEPS = f"Kept to round-off means a change of at most {KEPT:g} over the whole run."
LAMBDAS = ", ".join(map(str, measure.LAMBDAS))
PAGES = (
    _page(
        "symplectic-maps",
        "Do symplectic maps keep areas, and the others not?",
        setting=(
            "H = p²/2 − cos q; a set of points is carried by the flow and by maps of step h = π/4.",
            "With one degree of freedom a map is symplectic if it keeps areas; with more, if it keeps the sum ω(ξ, η) of "
            "the oriented areas of the projections onto the planes (pᵢ, qᵢ).",
        ),
        verdicts=(areas, euler_area),
        answer=answer_areas,
        limits=(KEEPS, "Areas are those of the trigonometric interpolant of the set's boundary."),
    ),
    _page(
        "lotka-volterra",
        "Do the numerical orbits of Lotka–Volterra close?",
        setting=(
            "u' = u (v − 2), v' = v (1 − u); every solution lies on a level curve of I = ln u − u + 2 ln v − v.",
            f"From the talk's initial values, h = {lotka_volterra.STEP:g}.",
        ),
        verdicts=(level_curves,),
        answer=answer_level_curves,
        limits=("Symplectic is meant in (ln u, ln v): in (u, v) the system is not canonical.",),
    ),
    _page(
        "henon-heiles",
        "What do Schemes I, IV, V and AVF make of a box orbit and a chaotic orbit?",
        setting=(
            "H = (p₁² + p₂²)/2 + (q₁² + q₂²)/2 + q₁² q₂ − q₂³/3; a box orbit and a chaotic one, h = "
            f"{henon_heiles.STEP:g}, to t = 1000.",
            f"Scheme I at λ = {LAMBDAS}; Schemes IV and V choose λ in each step such that H is kept, and take λ = 1/2 "
            "where there is no such λ. AVF: averaged vector field method.",
        ),
        verdicts=(energies, roots, escapes),
        answer=answer_well,
        limits=(KEEPS, "The chaotic orbit starts close to the escape energy: an energy error lets it leave the well."),
    ),
    _page(
        "perturbed-kepler",
        "Which schemes keep energy, angular momentum and the turning of the ellipse on perturbed Kepler?",
        setting=(
            f"H = |p|²/2 − 1/|q| − μ/(3|q|³), μ = 0.0075; h = {perturbed_kepler.STEP:g}, to t = 1000.",
            f"Schemes I and III at λ = {LAMBDAS}; AVF (averaged vector field), Schemes IV and V.",
            "Every scheme that is symplectic at fixed λ keeps L = q₁p₂ − q₂p₁, even where λ changes; AVF does not.",
        ),
        verdicts=(momenta, turns),
        answer=answer_kepler,
        limits=(
            KEEPS,
            f"The exact turn is that of {perturbed_kepler.EXACT} at half the step; rates within {100 * TURN:g} % count as "
            "the same.",
        ),
    ),
    _page(
        "convergence",
        "Do refinement differences fall with the orders of the schemes?",
        setting=(
            "Max |y_h − y_2h| over q and p at t = 1 on the chaotic Hénon–Heiles orbit, as in the talk's tables: not the "
            "error against the exact solution, but it falls with the same order.",
        ),
        verdicts=(slopes,),
        answer=answer_slopes,
        limits=(f"Slopes are fitted over the three smallest steps with differences above {measure.NOISE:g}.",),
    ),
)
