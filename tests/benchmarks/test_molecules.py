"""Molecular dynamics of packages: the scenes and the measures."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.store.cells import Unavailable
from phasebench.benchmarks.studies.molecules import argon, water
from phasebench.benchmarks.studies.molecules.argon import BEST, OURS
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
    row, own = (argon.measure(n, BEST) for n in (name, OURS))
    assert abs(row["mean"] / own["mean"] - 1) < 1e-7
    assert abs(row["spread"] / own["spread"] - 1) < 1e-3


@pytest.mark.parametrize("name", [OURS, "openmm", "ase"])
def test_a_rigid_water_keeps_its_distances_and_its_momentum(short, name):
    if name != OURS:
        need(name)
    row = water.measure(name, BEST)
    bound = 1e-7 if name == "openmm" else 1e-11  # it holds a water's distances in single precision
    assert max(row["distances"], row["angular momentum"], abs(row["energy drift"])) < bound


def test_a_package_that_is_not_installed_is_named(monkeypatch):
    for module in (argon, water):
        monkeypatch.setattr(module, "is_installed", lambda name: False)
        with pytest.raises(Unavailable, match="ase is not installed; pip install ase"):
            module.measure("ase", BEST)


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
