"""What judges a statement of a talk from measured rows, by the name that `talks.toml` gives it.

A judge is a function of data and of the entries of the file; it returns a `Judgement`, `NOTHING` without its rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from phasebench.benchmarks.judge.evidence import GATE, NO_DEFECT
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, MISSING, UNTESTABLE, WHERE, Judgement, worst
from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data
from phasebench.benchmarks.store.arrays import unpack

from . import linear_map
from .measure import CHECKS, CURVES

#: An error in doubles of at most this is round-off; units of its last digit within which a printed entry is reproduced.
ROUND_OFF, REPRODUCED = 1e-11, 0.6
#: The schemes that choose λ anew in each step, and values that [lam=*] stands for.
TUNED, VALUES = ["scheme-iv", "scheme-v"], ("-1", "1/3", "3/2")
NOTHING = Judgement(MISSING, "")


def judgement(holds: bool, text: str) -> Judgement:
    """The statement holds or is contradicted, with the measured numbers."""
    return Judgement(HOLDS if holds else CONTRADICTED, text)


def select(data: Data, table: str, **values: Any) -> pd.DataFrame | None:
    """The rows with these values, or one of several; None without rows, or if one of the methods has none."""
    frame = data(table)
    if frame is None or not {*values} <= {*frame}:
        return None
    for column, value in values.items():
        frame = frame[frame[column].isin(value if isinstance(value, list) else [value])]
    methods = values.get("method", [])
    lacking = {*(methods if isinstance(methods, list) else [methods])} - {*frame.get("method", [])}
    return None if frame.empty or lacking else frame


def _labels(of: Sequence[str]) -> list[str]:
    return [label for x in of for label in ([x.replace("*", v) for v in VALUES] if "*" in x else [x])]


def _count(rows: pd.DataFrame, word: str) -> str:
    return f"{len(rows)} {word}{'s' if len(rows) != 1 else ''}"


def untestable(data: Data, untestable: str) -> Judgement:
    """No number decides, for the reason given."""
    return Judgement(UNTESTABLE, untestable)


def check(data: Data, check: str, at_most: float, control: float | None = None) -> Judgement:
    """The number of a check is at most a bound, and that of a case that must fail is above it, or above ``control``."""
    rows = select(data, CHECKS, check=check)
    if rows is None or rows["value"].isna().any():
        return NOTHING
    r = rows.iloc[0]
    text = f"{r['what']}: {number(r['value'], 2)}; {r['against']}: {number(r['control'], 2)}"
    return judgement(abs(r["value"]) <= at_most and abs(r["control"]) > (at_most if control is None else control), text)


def prey(data: Data, prey: bool) -> Judgement:
    """In Lotka-Volterra the growth rate of u falls if v grows, and that of v rises if u grows."""
    rows = select(data, CHECKS, check="species")
    if rows is None:
        return NOTHING
    r = rows.iloc[0]
    return judgement(r["value"] < 0 < r["control"], f"{r['what']}: {r['value']:+g}; {r['against']}: {r['control']:+g}")


def order(data: Data, order: int, of: Sequence[str], **where: str) -> Judgement:
    """Methods have the order, not more or less, on all systems of the multiprecision table, or on a ``problem``."""
    rows = select(data, "multiprecision", method=_labels(of), **where)
    if rows is None:
        return NOTHING
    orders = rows["order"]
    span = list(dict.fromkeys(f"{x:.3f}" for x in (orders.min(), orders.max())))
    text = f"order {' to '.join(span)} ({_count(rows, 'measurement')})"
    return judgement(bool(((orders - order).abs() < GATE).all()), text)


def has(data: Data, has: str, of: Sequence[str]) -> Judgement:
    """Methods have a property, "symplecticity" or "symmetry"."""
    rows = select(data, "structure", method=_labels(of), property=has)
    if rows is None:
        return NOTHING
    largest = rows["defect"].max()
    return judgement(largest <= NO_DEFECT, f"defect of {has} up to {number(largest, 2)} ({_count(rows, 'map')})")


def lacks(data: Data, lacks: str, of: Sequence[str]) -> Judgement:
    """Methods lack a property."""
    rows = select(data, "structure", method=_labels(of), property=lacks)
    if rows is None:
        return NOTHING
    least = rows["defect"].min()
    text = f"defect of {lacks} of {', '.join(of)} at least {number(least, 2)} ({_count(rows, 'map')})"
    return judgement(least > NO_DEFECT, text)


def keeps_energy(data: Data, keeps_energy: list[str]) -> Judgement:
    """Methods keep the energy of Henon-Heiles."""
    rows = select(data, "matrix", method=keeps_energy, problem="henon-heiles")
    if rows is None or rows["energy"].isna().any():
        return NOTHING
    largest = rows["energy"].max()
    text = f"energy error on henon-heiles up to {number(largest, 2)} ({_count(rows, 'method')})"
    return judgement(largest <= ROUND_OFF, text)


def system(data: Data, system: str) -> Judgement:
    """On a problem the implicit midpoint rule is symplectic or, if that is not measured, has a small energy error."""
    rows, middle = (select(data, "matrix", problem=system, **m) for m in ({}, {"method": "implicit-midpoint"}))
    if middle is None:
        return NOTHING
    r = middle.iloc[0]
    text = f"{int(rows['energy'].notna().sum())} methods run; midpoint: energy error {number(r['energy'], 2)}"
    if r["symplecticity"] == r["symplecticity"]:
        return judgement(r["symplecticity"] <= NO_DEFECT, f"{text}, defect {number(r['symplecticity'], 2)}")
    return judgement(r["energy"] < 1e-3, text)


def printed(data: Data, printed: str, entries: int) -> Judgement:
    """The printed errors of a scheme are reproduced, so many entries."""
    rows = select(data, "printed", scheme=printed)
    if rows is None:
        return NOTHING
    good, orders = int((rows["units"] <= REPRODUCED).sum()), rows["order"].dropna()
    text = f"{good} of {len(rows)} entries within {REPRODUCED:g} of the last digit"
    text += f"; measured order {orders.iloc[-1]:.2f}" if len(orders) else ""
    return judgement(good == len(rows) == entries, text)


def curves(
    data: Data,
    curves: str,
    column: str,
    at_most: float = np.inf,
    above: float | None = None,
    panel: str = "",
    of: Sequence[str] = (),
) -> Judgement:
    """A column of a figure's curves is at most a bound, or above one; ``of`` and ``panel`` select curves."""
    rows = select(data, CURVES, figure=curves, **({"curve": of} if of else {}))
    if rows is None or column not in rows:
        return NOTHING
    rows = rows[rows["panel"].astype(str).str.endswith(panel) & rows[column].notna()]
    if rows.empty:
        return NOTHING
    value = rows[column].max() if above is None else rows[column].min()
    names = {
        "energy_error": "change of I" if curves.startswith("lotka") else "energy error",
        "largest": f"error of {panel or 'invariants'}",
    }
    whose = f"{panel or ', '.join(of)}: " if column == "energy_error" and (panel or of) else ""
    text = f"{whose}{names.get(column, column)} {'up to' if above is None else 'at least'} {number(value, 2)}"
    return judgement(value <= at_most if above is None else value > above, text)


def completed(data: Data, completed: str, runs: int) -> Judgement:
    """A figure has so many runs or more, all completed."""
    rows = select(data, CURVES, figure=completed)
    if rows is None:
        return NOTHING
    good = int((rows["status"] == "ok").sum())
    return judgement(good == len(rows) >= runs, f"{good} of {len(rows)} orbits to t = {number(rows['t_end'].max())}")


def areas(data: Data, areas: list[str], lost: list[str]) -> Judgement:
    """Maps keep the area of a set in the pendulum's phase plane to round-off, those in ``lost`` do not."""
    rows = select(data, CURVES, figure="pendulum-area")
    if rows is None or not {*areas, *lost} <= {*rows["panel"]}:
        return NOTHING
    change = rows.dropna(subset=["area"]).groupby("panel")["area"].agg(lambda a: (a - a.iloc[0]).abs().max())
    kept, control = change[areas].max(), change[lost].min()
    text = f"change of area up to {kept:.1e}; {lost[0]} {control:.1e}"
    return judgement(bool(kept <= ROUND_OFF < control), text)


def disc(data: Data, disc: bool) -> Judgement:
    """The exact flow of Lotka-Volterra keeps the measure du dv / (u v) of a disc."""
    rows = select(data, CURVES, figure="lotka-volterra-flow")
    if rows is None:
        return NOTHING
    change, area = (rows["measure"] - rows["measure"].iloc[0]).abs().max(), rows["area"].max() - rows["area"].min()
    text = f"∫ du dv/(uv) of a carried disc changes by {change:.1e}, its area by {area:.2f}"
    return judgement(bool(change <= ROUND_OFF), text)


def parallelogram(data: Data, parallelogram: bool) -> Judgement:
    """A midpoint step keeps omega(xi, eta) on coupled oscillators, and an explicit Euler step does not."""
    rows = select(data, CURVES, figure="linear-symplectic-map")
    if rows is None or len(rows) < 3:
        return NOTHING
    first, middle, euler = (linear_map.areas(unpack(r.x), unpack(r.y)).sum() for r in rows.itertuples())
    text = f"change of ω: midpoint {abs(middle - first):.1e}, explicit Euler {abs(euler - first):.2f}"
    return judgement(bool(abs(middle - first) <= ROUND_OFF < abs(euler - first)), text)


def middling(data: Data, middling: bool) -> Judgement:
    """The median of the lambda that Schemes IV and V choose in a step is near 1/2."""
    rows = select(data, CURVES, figure="perturbed-kepler-parameter", panel="lambda")
    if rows is None:
        return NOTHING
    apart = (rows["median"] - 0.5).abs().max()
    text = f"|median of λ − 1/2| up to {number(apart, 2)}, range {number(rows['low'].min(), 2)} to "
    return judgement(apart < 0.1, f"{text}{number(rows['high'].max(), 2)}")


def roots(data: Data, roots: list[str], condition: str = "λ near 1/2 exists") -> Judgement:
    """Every step of schemes that solve for lambda has a root, and the energy is kept; else only under a condition."""
    rows = select(data, "energy_preservation", scheme=roots, status="ok")
    waves = select(data, "pde", method=roots, status="ok")
    if rows is None or waves is None:
        return NOTHING
    missed, steps = int(rows["without a root"].sum()), int(rows["steps"].sum())
    lost, others = int(waves["fallbacks"].sum()), int((waves["t_end"] / waves["h"]).round().sum())
    error = max(rows["energy error, steps with a root"].max(), waves["energy error"].max())
    text = f"no root on {missed} of {steps} steps, on {lost} of {others} of waves"
    text += f"; energy error {number(error, 2)} on the others"
    if not error <= ROUND_OFF:
        return Judgement(CONTRADICTED, text)
    return Judgement(WHERE, f"{condition}: {text}") if missed + lost else Judgement(HOLDS, text)


def nls_mass(data: Data, nls_mass: bool) -> Judgement:
    """Schemes IV and V keep the mass of the nonlinear Schroedinger equation."""
    rows = select(data, "pde", method=TUNED, invariant="mass")
    if rows is None:
        return NOTHING
    largest = rows["invariant error"].max()
    return judgement(largest <= ROUND_OFF, f"NLS mass changes by up to {number(largest, 2)}")


def charge(data: Data, charge: bool) -> Judgement:
    """Schemes IV and V keep angular momentum and charge, invariants of the form q.D p."""
    rows = select(data, "pde", method=TUNED, invariant="charge")
    turns = select(data, "energy_preservation", scheme=TUNED, problem="perturbed-kepler")
    if rows is None or turns is None:
        return NOTHING
    largest = max(rows["invariant error"].max(), turns["angular momentum error"].max())
    return judgement(largest <= ROUND_OFF, f"q·Dp forms change by up to {number(largest, 2)}")


def box(data: Data, box: str, at_most: float) -> Judgement:
    """A column of the EQUIP box scheme is small; "two-form", a residual, in units of round-off."""
    rows = select(data, "multisymplectic", id="equip-box")
    if rows is None or box not in rows:
        return NOTHING
    value = (rows[box] / rows[f"{box}, round-off"] if box == "two-form" else rows[box]).max()
    unit = " units of round-off" if box == "two-form" else ""
    return judgement(value <= at_most, f"{box} {'residual' if unit else 'at most'} {number(value, 2)}{unit}")


def condition(data: Data, condition: str, judged: list[dict], otherwise: list[dict]) -> Judgement:
    """A statement holds only under a condition if it is contradicted ``otherwise``."""
    a, b = judge(data, judged), judge(data, otherwise)
    if MISSING in (a.verdict, b.verdict):
        return NOTHING
    text = f"{a.measured}; else: {b.measured}"
    if a.verdict == HOLDS and b.verdict == CONTRADICTED:
        return Judgement(WHERE, f"{condition}: {text}")
    return Judgement(a.verdict, text)


JUDGES: Mapping[str, Callable[..., Judgement]] = {
    f.__name__: f
    for f in (
        *(untestable, check, prey, order, has, lacks, keeps_energy, system, printed, curves, completed, areas, disc),
        *(parallelogram, middling, roots, nls_mass, charge, box, condition),
    )
}


def judge(data: Data, entries: Sequence[Mapping[str, Any]]) -> Judgement:
    """The worst verdict of several judges, each named by the first name of an entry, and all their numbers."""
    found = [JUDGES[next(iter(entry))](data, **entry) for entry in entries]
    verdict = worst(f.verdict for f in found)
    return NOTHING if verdict == MISSING else Judgement(verdict, "; ".join(f.measured for f in found))
