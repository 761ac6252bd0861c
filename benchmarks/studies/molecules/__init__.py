"""Packages of molecular dynamics on argon atoms and on a rigid water, at default and at best settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pandas as pd

from phasebench.benchmarks.page.markdown import number
from phasebench.benchmarks.page.page import Table, of
from phasebench.benchmarks.page.study import Claim, Number, Runs, Study
from phasebench.benchmarks.page.verdict import EVERY, at_most
from phasebench.benchmarks.store.cells import Package, ProblemKey
from phasebench.integrators.registry import BY_ID

from . import argon, water
from .argon import BEST, DEFAULTS, OURS

#: A relative error over a long run that counts as round-off.
ROUND_OFF = 1e-12
#: Standard errors of a drift that count as none; a factor between the spreads of chaotic orbits that are alike.
SIGMAS, ALIKE = 3.0, 1.5


def keys(engines: Iterable[str]) -> list[dict[str, str]]:
    """This suite at its best, and each package with both settings."""
    pairs = [(OURS, BEST), *((name, settings) for name in engines for settings in (DEFAULTS, BEST))]
    return [{"package": name, "settings": settings} for name, settings in pairs]


def version(package: str) -> str | Package:
    """Stands for the version of a package; "" of this suite."""
    return "" if package == OURS else Package(package)


def beside_ours(column: str, settings: str) -> Callable[[pd.DataFrame], pd.Series | None]:
    """The packages' numbers over this suite's; None without either."""

    def ratio(rows: pd.DataFrame) -> pd.Series | None:
        own, found = rows[rows["package"] == OURS], packages(rows, settings)
        return None if own.empty or found.empty else found[column] / float(own[column].iloc[0])

    return ratio


def packages(rows: pd.DataFrame, settings: str) -> pd.DataFrame:
    """The rows of packages at some settings."""
    return rows[(rows["package"] != OURS) & (rows["settings"] == settings)]


def off(rows: pd.DataFrame) -> pd.Series | None:
    """The relative difference of the packages' mean energies from this suite's, at default settings."""
    ratio = beside_ours("mean", DEFAULTS)(rows)
    return None if ratio is None else (ratio - 1).abs()


def drifting(rows: pd.DataFrame) -> str:
    """The run with the largest drift."""
    size = rows["drift"].abs() / rows["uncertainty"]
    row = rows.loc[size.idxmax()]
    return f"{row['package']}, {row['settings']}: {number(size.max())} standard errors"


@of(argon.TABLE, water.TABLE)
def _table(atoms: pd.DataFrame, molecule: pd.DataFrame) -> Table:
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
    caption = (
        "Atoms: the energies that each package reports, in reduced units; spread: largest less smallest; drift and its "
        "standard error over the spread. Water: largest relative errors."
    )
    return Table(shown.astype(object).fillna(""), caption)


THEIRS = f"package != '{OURS}'"
POTENTIAL = Claim(
    "At its defaults a package has the whole Lennard-Jones potential",
    argon.TABLE, off, at_most(1e-4), unit="of the energy", where="{package}: {told}", span=True,
)  # fmt: skip
STUDY = Study(
    id="molecules",
    place=360,
    question="What do packages of molecular dynamics do to the energy of atoms, and to a rigid water?",
    answer="The energy does not drift in {drift.n} of {drift.of} runs; packages' defaults change it by up to {percent} "
    "%; rigid water's distances err by at most {largest} (relative).",
    setting=(
        f"Seven argon atoms, reduced units, h = {argon.H:g}, {argon.STEPS} steps, energies as reported every "
        f"{argon.EVERY} steps.",
        f"A rigid water that turns freely, h = {1000 * water.H:g} fs, {water.STEPS} steps.",
        "At its best: double precision, no cutoff, the smallest tolerance of constraints that converges.",
        "Said: OpenMM, “the drift in energy is almost entirely diffusive with negligible systematic drift” in mixed "
        "and double precision (User Guide, Testing and Validation); JAX-MD and ASE, that the energy is kept.",
        "Drift: the last tenth's mean energy less the first tenth's.",
    ),
    runs=(
        Runs(argon.TABLE, argon.measure, keys(argon.ENGINES),
             needs=lambda package, settings: (BY_ID[argon.METHOD], ProblemKey(argon.PROBLEM), version(package))),
        Runs(water.TABLE, water.measure, keys(water.ENGINES),
             needs=lambda package, settings: (BY_ID[water.METHOD], version(package))),
    ),
    claims={
        "spread": Claim(
            "At its best a package's energy spreads as leapfrog's",
            argon.TABLE, beside_ours("spread", BEST), at_most(ALIKE), unit="times leapfrog's", where="{package}",
            span=True,
        ),
        "drift": Claim(
            "The energy of atoms does not drift, at defaults and at the best",
            argon.TABLE, f"abs(drift) / uncertainty <= {SIGMAS}", EVERY, rows=THEIRS, unit="runs", where=drifting,
        ),
        "potential": POTENTIAL,
        "distances": Claim(
            "At its best a package holds a rigid water's distances to round-off",
            water.TABLE, "distances", at_most(ROUND_OFF), rows=f"{THEIRS} and settings == '{BEST}'",
            unit="of a distance", where="{package}", span=True,
        ),
        "kinetic": Claim(
            "A free rigid water keeps its kinetic energy and its angular momentum",
            water.TABLE, lambda rows: rows[["energy spread", "angular momentum"]].abs().max(axis=1), at_most(1e-9),
            rows=THEIRS, unit="relative", where="{package}, {settings}", span=True,
        ),
    },
    numbers={
        "percent": Number(argon.TABLE, lambda rows: None if off(rows) is None else 100 * off(rows)),
        "largest": Number(water.TABLE, "distances", rows=f"{THEIRS} and settings == '{BEST}'"),
    },
    checks={
        "rattle": Claim(
            "This suite's RATTLE keeps the water's distances, energy and angular momentum", water.TABLE,
            lambda rows: rows[["distances", "energy drift", "angular momentum"]].abs().max(axis=1),
            at_most(ROUND_OFF), rows=f"package == '{OURS}'",
        ),
    },
    shown=_table,
    whole=lambda data: None,
    limits=(
        "Nothing is timed: one loop is Python's, and seven atoms are far from what these packages are made for.",
        "JAX-MD has rigid bodies, but no constraints: it has no row of the water.",
        "OpenMM's graphics platforms have precisions of their own, and are not here.",
    ),
)  # fmt: skip
