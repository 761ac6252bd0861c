"""The report page on packages of molecular dynamics: what they do to the energy of atoms and to a rigid water."""

from __future__ import annotations

from typing import Any

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Data, Page, Table, of
from phasebench.benchmarks.page.verdict import EVERY, Count, Range, Verdict, at_most

from . import argon, water
from .argon import BEST, DEFAULTS

OURS = "phasebench"
#: A relative error over a long run that counts as round-off.
ROUND_OFF = 1e-12
#: Standard errors of a drift that count as none; a factor between the spreads of chaotic orbits that are alike.
SIGMAS, ALIKE = 3.0, 1.5


def _packages(rows: pd.DataFrame, settings: str | None = None) -> pd.DataFrame:
    """Select the rows of packages (not those of this suite), at the given settings; at all settings if None."""
    found = rows[rows["package"] != OURS]
    return found if settings is None else found[found["settings"] == settings]


def _own(rows: pd.DataFrame, column: str) -> float:
    return float(rows[rows["package"] == OURS][column].iloc[0])


def _name(row: Any) -> str:
    return f"{row['package']}, {row['settings']}"


@of(argon.TABLE)
def spread(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the argon atoms' energy, as packages report it, spreads little more than with our leapfrog.

    Packages run at their best settings.  ``rows`` is the table of the atoms; None without such rows.
    """
    best = _packages(rows, BEST)
    if best.empty or OURS not in set(rows["package"]):
        return None
    ratio = best["spread"] / _own(rows, "spread")
    return Verdict(
        "At its best a package's energy spreads as leapfrog's",
        Range(ratio.min(), ratio.max()),
        at_most(ALIKE),
        "times leapfrog's",
        where=str(best.loc[ratio.idxmax(), "package"]),
    )


@of(argon.TABLE)
def drift(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether the argon atoms' energy, as packages report it, has no drift, at default and at best settings.

    ``rows`` is the table of the atoms; None without rows of packages.
    """
    found = _packages(rows)
    if found.empty:
        return None
    off = found["drift"].abs() / found["uncertainty"]
    return Verdict(
        "The energy of atoms does not drift, at defaults and at the best",
        Count(int((off <= SIGMAS).sum()), len(found)),
        EVERY,
        "runs",
        where=f"{_name(found.loc[off.idxmax()])}: {number(off.max())} standard errors",
    )


@of(argon.TABLE)
def potential(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether packages at default settings compute the whole Lennard-Jones potential, without a cutoff's effect.

    The mean energies are compared with this suite's.  ``rows`` is the table of the atoms; None without such rows.
    """
    found = _packages(rows, DEFAULTS)
    if found.empty or OURS not in set(rows["package"]):
        return None
    off = (found["mean"] / _own(rows, "mean") - 1).abs()
    worst = found.loc[off.idxmax()]
    return Verdict(
        "At its defaults a package has the whole Lennard-Jones potential",
        Range(off.min(), off.max()),
        at_most(1e-4),
        "of the energy",
        where=f"{worst['package']}: {worst['told']}",
    )


@of(water.TABLE)
def distances(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether packages at their best settings hold the distances in a rigid water to round-off.

    ``rows`` is the table of the water; None without such rows.
    """
    found = _packages(rows, BEST)
    if found.empty:
        return None
    worst = found.loc[found["distances"].idxmax()]
    return Verdict(
        "At its best a package holds a rigid water's distances to round-off",
        Range(found["distances"].min(), found["distances"].max()),
        at_most(ROUND_OFF),
        "of a distance",
        where=str(worst["package"]),
    )


@of(water.TABLE)
def kinetic(rows: pd.DataFrame) -> Verdict | None:
    """Judge whether packages keep a free rigid water's kinetic energy and angular momentum, at all settings.

    ``rows`` is the table of the water; None without rows of packages.
    """
    found = _packages(rows)
    if found.empty:
        return None
    off = found[["energy spread", "angular momentum"]].abs().max(axis=1)
    return Verdict(
        "A free rigid water keeps its kinetic energy and its angular momentum",
        Range(off.min(), off.max()),
        at_most(1e-9),
        "relative",
        where=_name(found.loc[off.idxmax()]),
    )


VERDICTS = (spread, drift, potential, distances, kinetic)


def answer(data: Data) -> str | None:
    """Write the page's answer, a sentence: how many runs drift, what defaults do to the energy, how rigid the water is.

    None if one of the tables is missing.
    """
    drifts, whole, held = drift(data), potential(data), distances(data)
    if drifts is None or whole is None or held is None:
        return None
    return (
        f"The energy does not drift in {drifts.measured.n} of {drifts.measured.of} runs; packages' defaults change it by up to "
        f"{number(100 * whole.measured.high)} %; rigid water's distances err by at most {number(held.measured.high)} (relative)."
    )


@of(argon.TABLE, water.TABLE)
def table(atoms: pd.DataFrame, molecule: pd.DataFrame) -> Table:
    """Make the page's table, of the argon atoms and of the water: a row for each package and setting."""
    both = atoms.merge(molecule, on=["package", "settings"], how="outer", sort=False)
    columns = {
        "package": "package",
        "settings": "settings",
        "told": "what it is",
        "mean": "mean energy",
        "spread": "spread",
        "drift": "drift over spread",
        "uncertainty": "± of the drift",
        "distances": "water: distances",
        "energy spread": "kinetic energy",
        "angular momentum": "angular momentum",
    }
    shown = both[list(columns)].rename(columns=columns)
    for name in list(columns.values())[3:]:
        shown[name] = ["" if x != x else number(x) for x in shown[name]]
    return Table(
        shown.fillna(""),
        "Atoms: the energies that each package reports, in reduced units; spread: largest less smallest; drift and its standard error over the spread. Water: largest relative errors.",
    )


PAGE = Page(
    id="molecules",
    question="What do packages of molecular dynamics do to the energy of atoms, and to a rigid water?",
    tables=(argon.TABLE, water.TABLE),
    setting=(
        f"Seven argon atoms, reduced units, h = {argon.H:g}, {argon.STEPS} steps, energies as reported every {argon.EVERY} steps.",
        f"A rigid water that turns freely, h = {1000 * water.H:g} fs, {water.STEPS} steps.",
        "At its best: double precision, no cutoff, the smallest tolerance of constraints that converges.",
        "Said: OpenMM, “the drift in energy is almost entirely diffusive with negligible systematic drift” in mixed and "
        "double precision (User Guide, Testing and Validation); JAX-MD and ASE, that the energy is kept.",
        "Drift: the last tenth's mean energy less the first tenth's.",
    ),
    verdicts=VERDICTS,
    answer=answer,
    table=table,
    limits=(
        "Nothing is timed: one loop is Python's, and seven atoms are far from what these packages are made for.",
        "JAX-MD has rigid bodies, but no constraints: it has no row of the water.",
        "OpenMM's graphics platforms have precisions of their own, and are not here.",
    ),
    command="pytest benchmarks/experiments/molecules",
)
