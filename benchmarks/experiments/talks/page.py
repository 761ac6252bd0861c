"""The figures of the two talks, a page for each section, with what their rows say."""

from __future__ import annotations

from functools import partial

import pandas as pd

from phasebench.benchmarks.page.markdown import listed, number
from phasebench.benchmarks.page.page import ROWS, Page, Table, Verdict, of

from . import convergence, gallery, measure, perturbed_kepler
from .record import TABLE

#: An area, energy or momentum that changes by at most this is kept.
KEPT = 1e-11
#: An observed order within this of the scheme's is that order.
NEAR = 0.15
#: The turn of the apocentre in a revolution is the exact flow's within this share.
TURN = 0.05


def _of(curves: pd.DataFrame, *figures: str) -> pd.DataFrame:
    return curves[curves["figure"].isin(figures)]


@of(TABLE)
def areas(curves: pd.DataFrame) -> Verdict | None:
    """Who keeps the area of the pendulum's set."""
    faces = _of(curves, "pendulum-area").dropna(subset=["area"])
    if faces.empty:
        return None
    groups = faces.groupby("panel", sort=False)["area"]
    change = groups.apply(lambda a: (a - a.iloc[0]).abs().max())
    text = f"Largest change of the area: {', '.join(f'{name} {number(x, 2)}' for name, x in change.items())}."
    symplectic = [name for name in change.index if name not in ("exact flow", "explicit Euler")]
    holds = bool((change[symplectic] <= KEPT).all() and change.get("explicit Euler", 1.0) > KEPT)
    return Verdict(text, holds, "Symplectic maps keep the area, explicit Euler does not." if holds else text)


@of(TABLE)
def invariant_curves(curves: pd.DataFrame) -> Verdict | None:
    """Whose Lotka-Volterra orbits stay on their level curve."""
    runs = _of(curves, "lotka-volterra-methods").dropna(subset=["energy_error"])
    if runs.empty:
        return None
    worst = runs.groupby("panel", sort=False)["energy_error"].max()
    least = worst.idxmin()
    text = f"Largest change of I: {', '.join(f'{name} {number(x, 2)}' for name, x in worst.items())}."
    euler = worst[[n for n in worst.index if n in ("explicit Euler", "implicit Euler")]]
    others = worst.drop(euler.index)
    holds = bool(len(euler) and len(others) and others.max() < euler.min())
    return Verdict(text, holds, f"Least change of the invariant: {least}; both Euler methods leave the level curves."
                   if holds else text)  # fmt: skip


@of(TABLE)
def energies(curves: pd.DataFrame) -> Verdict | None:
    """Who keeps the energy of Henon-Heiles."""
    runs = _of(curves, "henon-heiles-preserving-energy")
    if runs.empty:
        return None
    worst = runs.groupby("curve", sort=False)[["energy_error", "fallbacks"]].max()
    parts = [f"{name} {number(r['energy_error'], 2)}" for name, r in worst.iterrows()]
    kept = worst[(worst["energy_error"] <= KEPT) | (worst["fallbacks"] > 0)]
    missed = [f"{name} ({int(r['fallbacks'])})" for name, r in worst.iterrows() if r["fallbacks"]]
    text = f"Largest |H − H₀|: {', '.join(parts)}"
    text += f"; steps without a root: {listed(missed)}." if missed else "; no step is without a root."
    return Verdict(text, len(kept) == len(worst) and not missed, text)


@of(TABLE)
def escapes(curves: pd.DataFrame) -> Verdict | None:
    """Which orbits of Scheme I leave the well."""
    runs = _of(curves, "henon-heiles-scheme-i-energy")
    if runs.empty:
        return None
    gone = runs[(runs["status"] != "ok") | ~(runs["energy_error"] < 1.0)]
    names = [f"{r.panel}, {r.curve}" for r in gone.itertuples()]
    text = f"Orbits of Scheme I that leave the well: {listed(names, 6)}."
    return Verdict(text, gone.empty, text)


@of(TABLE)
def momenta(curves: pd.DataFrame) -> Verdict | None:
    """Who keeps the energy and the angular momentum of perturbed Kepler."""
    runs = _of(curves, "perturbed-kepler-preserving-invariants")
    if runs.empty:
        return None
    wide = runs.pivot_table(index="curve", columns="panel", values="largest", sort=False)
    parts = [f"{name} {number(r['energy'], 2)} and {number(r['angular-momentum'], 2)}" for name, r in wide.iterrows()]
    both = wide[(wide <= KEPT).all(axis=1)].index
    wanted = {"Scheme IV", "Scheme V"} <= set(both)
    text = f"Largest errors of H and of L: {'; '.join(parts)}."
    return Verdict(text, wanted, f"Both H and L are kept by {listed(list(both))}.")


@of(TABLE)
def turns(curves: pd.DataFrame) -> Verdict | None:
    """Whose apocentre turns as the exact flow's."""
    runs = _of(curves, "perturbed-kepler-preserving-orbits").dropna(subset=["turn"])
    exact = runs[runs["curve"] == "exact flow"]["turn"]
    if exact.empty:
        return None
    apart = {r.curve: abs(r.turn / exact.iloc[0] - 1) for r in runs.itertuples() if r.curve != "exact flow"}
    parts = [f"{name} by {100 * x:.2g} %" for name, x in apart.items()]
    text = f"The apocentre turns by {number(exact.iloc[0], 4)} rad a revolution; off from that: {', '.join(parts)}."
    return Verdict(text, bool(max(apart.values(), default=0) <= TURN), text)


@of(TABLE)
def slopes(curves: pd.DataFrame) -> Verdict | None:
    """Whether the observed orders are the schemes'."""
    rows = _of(curves, "convergence-schemes-i-iii", "convergence-compositions").dropna(subset=["order"])
    if rows.empty:
        return None
    orders = {t: p for t, (_, p) in convergence.SCHEMES.items()} | {
        t: p for t, (_, p) in convergence.COMPOSITIONS.items()
    }
    expected = [
        orders.get(r.panel, orders.get(r.curve)) if isinstance(r.panel, str) else orders[r.curve]
        for r in rows.itertuples()
    ]
    off = [
        f"{r.curve} {r.order:.2f} for {p}"
        for r, p in zip(rows.itertuples(), expected, strict=True)
        if abs(r.order - p) > NEAR
    ]
    counts = f"{len(rows) - len(off)} of {len(rows)} observed slopes are the scheme's order"
    text = f"{counts} within {NEAR}{f'; not so {listed(off, 4)}' if off else ''}."
    return Verdict(text, not off, f"{counts}.")


#: The measured numbers of a row, as the table calls them.
VALUES = {
    "energy_error": "energy error",
    "largest": "largest error",
    "area": "area",
    "order": "order",
    "turn": "turn (rad)",
}


def _table(section: str, data) -> Table | None:
    """The rows of a section's figures that have a number, those of its first quantity first."""
    curves = data(TABLE)
    if curves is None or curves.empty:
        return None
    rows = _of(curves, *(f.id for f in gallery.FIGURES if f.section == section))
    values = [c for c in VALUES if c in rows and rows[c].notna().any()]
    if not values:
        return None
    rows = rows.dropna(subset=values, how="all").sort_values(values[0], key=pd.isna, kind="stable")
    if "area" in values:  # of areas the last: a table of equal numbers tells nothing
        rows = rows[rows["area"].isna() | ~rows.duplicated(["figure", "panel"], keep="last")]
    columns = ["panel", "curve", "h", "t_end", *values, "fallbacks", "status"]
    shown = rows.reindex(columns=columns).drop_duplicates().dropna(axis=1, how="all").head(ROWS)
    return Table(
        shown.rename(columns=VALUES | {"fallbacks": "steps without a root"}), "The runs that the figures show."
    )


def _figures(section: str, data, folder) -> list | None:
    curves = data(TABLE)
    return None if curves is None else gallery.pictures(curves, section, folder)


def _page(section: str, question: str, setting: tuple[str, ...], verdicts: tuple, limits: tuple[str, ...]) -> Page:
    return Page(
        id=f"talk-{section}",
        question=question,
        tables=(TABLE,),
        setting=setting,
        verdicts=verdicts,
        limits=limits,
        command="pytest benchmarks/experiments/talks",
        figures=partial(_figures, section),
        table=partial(_table, section),
    )


KEEPS = f"Kept means a change of at most {KEPT:g} over the whole run."
PAGES = (
    _page(
        "symplectic-maps",
        "Do symplectic maps keep areas, and the others not?",
        (
            "H = p²/2 − cos q; a set of points is carried by the flow and by maps of step h = π/4.",
            "In one degree of freedom a map is symplectic if it keeps areas; in more, the sum ω(ξ, η) of the oriented "
            "areas of the projections onto the planes (pᵢ, qᵢ).",
        ),
        (areas,),
        (KEEPS, "Areas are those of the trigonometric interpolant of the set's boundary."),
    ),
    _page(
        "lotka-volterra",
        "Do the numerical orbits of Lotka–Volterra close?",
        (
            "u' = u (v − 2), v' = v (1 − u); every solution lies on a level curve of I = ln u − u + 2 ln v − v.",
            "From the talk's starting points, h = 0.12.",
        ),
        (invariant_curves,),
        ("Symplectic in (ln u, ln v) is meant: in (u, v) the system is not canonical.",),
    ),
    _page(
        "henon-heiles",
        "What do Schemes I, IV and V and AVF make of a box and of a chaotic orbit?",
        (
            "H = (p₁² + p₂²)/2 + (q₁² + q₂²)/2 + q₁² q₂ − q₂³/3; box and chaotic orbit, h = 0.02, to t = 1000.",
            f"Scheme I at λ = {', '.join(map(str, measure.LAMBDAS))}; Schemes IV and V choose λ in each step to keep H.",
        ),
        (energies, escapes),
        (KEEPS, "The chaotic orbit starts near the escape energy: an energy error lets it leave the well."),
    ),
    _page(
        "perturbed-kepler",
        "Who keeps energy, angular momentum and the ellipse's turning on perturbed Kepler?",
        (
            "H = |p|²/2 − 1/|q| − μ/(3|q|³), μ = 0.0075; h = 0.01, to t = 1000.",
            f"Schemes I and III at λ = {', '.join(map(str, measure.LAMBDAS))}; AVF, Schemes IV and V.",
            "Every scheme that is symplectic at a frozen λ keeps L = q₁p₂ − q₂p₁, also where λ changes; AVF does not.",
        ),
        (momenta, turns),
        (
            KEEPS,
            f"The exact turn is that of {perturbed_kepler.EXACT} at half the step; the same means within {100 * TURN:g} %.",
        ),
    ),
    _page(
        "convergence",
        "Do refinement differences fall with the schemes' orders?",
        (
            "Max |y_h − y_2h| over q and p at t = 1 on the chaotic Hénon–Heiles orbit: the quantity of the talk's tables.",
            "It is no error against the exact solution, but falls with the same order.",
        ),
        (slopes,),
        (f"Slopes are fitted over the three smallest steps with differences above {measure.NOISE:g}.",),
    ),
)
