"""Molecular dynamics of packages: the scenes, the measures, and verdicts that follow the rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.molecules import argon, bench_molecules, page, water
from phasebench.benchmarks.experiments.molecules.argon import BEST, DEFAULTS
from phasebench.benchmarks.page.verdict import FINDING, PASS
from phasebench.benchmarks.store.cells import Unavailable
from support.needs import need


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(argon, "STEPS", 1000)
    monkeypatch.setattr(argon, "EVERY", 10)
    monkeypatch.setattr(water, "STEPS", 100)
    monkeypatch.setattr(water, "EVERY", 1)


@pytest.mark.parametrize("name", argon.ENGINES)
def test_packages_report_the_energy_of_the_same_orbit(short, name):
    need(name)
    (row,), (own,) = (argon.measure_rows(n, BEST)[argon.TABLE] for n in (name, ""))
    assert abs(row["mean"] / own["mean"] - 1) < 1e-7
    assert abs(row["spread"] / own["spread"] - 1) < 1e-3


@pytest.mark.parametrize("name", ["", "openmm", "ase"])
def test_a_rigid_water_keeps_its_distances_and_its_momentum(short, name):
    if name:
        need(name)
    (row,) = water.measure_rows(name, BEST)[water.TABLE]
    bound = 1e-7 if name == "openmm" else 1e-11  # it holds a water's distances in single precision
    assert max(row["distances"], row["angular momentum"], abs(row["energy drift"])) < bound


def test_a_package_that_is_not_installed_is_named(monkeypatch):
    for module in (argon, water):
        monkeypatch.setattr(module, "is_installed", lambda name: False)
        with pytest.raises(Unavailable, match="ase is not installed; pip install ase"):
            module.measure_rows("ase", BEST)


def test_errors_of_a_water_are_seen():
    x, v = water.start()
    rows = np.repeat(x[None], 40, axis=0), np.repeat(v[None], 40, axis=0)
    assert max(map(abs, water.errors(*rows).values())) < 1e-15
    rows[0][7] *= 1 + 1e-6
    assert abs(water.errors(*rows)["distances"] - 1e-6) < 1e-9
    rows[1][-4:] *= 1 + 1e-3
    assert abs(water.errors(*rows)["energy drift"] - 2e-3) < 1e-4
    assert water.errors(*rows)["angular momentum"] > 1e-4


def test_a_drift_is_told_from_noise():
    noise = np.random.default_rng(5).normal(size=10_000)
    still, moved = argon.summary(noise), argon.summary(noise + np.linspace(0, 1, 10_000))
    assert abs(still["drift"]) < 4 * still["uncertainty"]
    assert moved["drift"] > 8 * moved["uncertainty"]


def tables(**changes):
    """The function from names to made-up tables; changes are columns of the packages' rows."""
    heads = [(page.OURS, BEST), ("openmm", DEFAULTS), ("openmm", BEST)]
    atoms = pd.DataFrame(heads, columns=["package", "settings"]).assign(told="x", mean=-10.0, spread=1e-3, drift=0.01)
    atoms = atoms.assign(uncertainty=0.01)
    molecule = pd.DataFrame(heads, columns=["package", "settings"])
    molecule = molecule.assign(**{"distances": 1e-14, "energy spread": 1e-13, "angular momentum": 1e-13})
    for frame in (atoms, molecule):
        for name, value in changes.items():
            if name in frame:
                frame.loc[frame["package"] != page.OURS, name] = value
    return lambda name: {argon.TABLE: atoms, water.TABLE: molecule}.get(name)


@pytest.mark.parametrize(
    ("verdict", "bad"),
    [
        (page.spread, {"spread": 2e-3}),
        (page.drift, {"drift": 0.1}),
        (page.potential, {"mean": -9.9}),
        (page.distances, {"distances": 1e-8}),
        (page.kinetic, {"energy spread": 1e-3}),
    ],
)
def test_verdicts_follow_the_rows(verdict, bad):
    assert verdict(tables()).outcome == PASS
    assert verdict(tables(**bad)).outcome == FINDING
    assert verdict(lambda name: None) is None


def test_the_page_has_a_row_for_each_package_and_settings():
    assert len(page.table(tables()).frame) == 3
    assert page.answer(tables()).startswith("The energy does not drift in 2 of 2 runs")
    assert len(bench_molecules.cells()) == 12
