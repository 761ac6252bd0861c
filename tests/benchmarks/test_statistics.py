"""Statistics of chaotic orbits: ensembles, exact averages, and the largest step that gives a statistic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.statistics import claims, measure, scenes

SCENES = scenes.SCENES
KNOWN = [id for id, s in SCENES.items() if s.known]


@pytest.mark.parametrize("id", KNOWN)
def test_starts_lie_on_the_surface_and_their_average_is_the_exact_one(id):
    scene = replace(SCENES[id], orbits=20_000)
    q, p = scenes.start(scene)
    assert np.abs(problem(scene.problem).system.energies(q, p) - scene.energy).max() < 1e-10
    if scene.kind == scenes.MEAN:
        values = scenes.quantity(scene)(q, p)
        assert abs(values.mean() - scenes.exact(scene)) < 4 * values.std() / np.sqrt(len(q))
    again = scenes.start(scene)[0]
    assert np.array_equal(again, q)


def test_exact_averages_of_a_harmonic_oscillator_are_known(monkeypatch):
    """At a small energy Henon-Heiles is an oscillator: <q2^2> = E / 2, and crossings are uniform in a disc.

    A cap beyond half of the radius is 1/3 - sqrt(3) / (4 pi) of the disc, but 1/4 of its width.
    """
    monkeypatch.setitem(scenes.BOXES, "henon-heiles", 2e-3)
    mean = replace(SCENES["henon-heiles-mean"], energy=1e-6, formula="q2**2")
    cap = replace(mean, kind=scenes.SECTION, plane="q1", formula=f"q2 - {np.sqrt(5e-7)}")
    for scene, value in ((mean, 5e-7), (cap, 1 / 3 - np.sqrt(3) / (4 * np.pi))):
        assert abs(scenes.exact(scene) / value - 1) < 2e-3


def test_atoms_have_the_energy_of_the_problem_and_no_momentum():
    q, p = scenes.start(SCENES["argon-mean"])
    made = problem("lennard-jones")
    assert np.abs((p**2).sum(axis=1) - (np.array(made.p0) ** 2).sum()).max() < 1e-12
    assert np.abs(p.reshape(len(p), -1, 2).sum(axis=1)).max() < 1e-12
    assert (q == made.q0).all()


@pytest.mark.parametrize("id", ["henon-heiles-mean", "henon-heiles-section", "double-pendulum-mean"])
def test_an_ensemble_keeps_its_average(monkeypatch, id):
    """By Gauss's method an ensemble keeps the exact average; by explicit Euler at the same step it does not."""
    scene = replace(SCENES[id], orbits=64, span=SCENES[id].span / 10)
    found = measure.sums(scene, "gauss-4", 8)
    mean, error = measure.statistic(found.total, found.number)
    assert abs(mean - scenes.exact(scene)) < 4 * error
    if id == "henon-heiles-mean":
        lost = measure.sums(scene, "explicit-euler", 8)
        off, spread = measure.statistic(lost.total, lost.number)
        assert not abs(off - scenes.exact(scene)) < 4 * spread


def test_a_share_of_crossings_counts_crossings_and_not_orbits():
    """An orbit that crosses more often counts more; the error is that of the ratio (Cochran 1977, section 6.4)."""
    rng = np.random.default_rng(5)
    number = rng.integers(1, 40, 400).astype(float)
    total = rng.binomial(number.astype(int), np.where(number > 20, 0.8, 0.3)).astype(float)
    value, error = measure.statistic(total, number)
    assert value == total.sum() / number.sum()
    assert abs(value - (total / number).mean()) > 5 * error  # the mean over orbits is another number
    drawn = rng.integers(0, 400, (2000, 400))
    spread = (total[drawn].sum(axis=1) / number[drawn].sum(axis=1)).std()
    assert abs(error / spread - 1) < 0.1


def test_exponents_of_chaotic_orbits_are_positive_and_those_of_an_oscillator_are_not():
    scene = replace(SCENES["henon-heiles-exponent"], orbits=16, span=200.0)
    chaotic = measure.sums(scene, "kahan-li-8", 2)
    regular = measure.sums(replace(scene, energy=0.01), "kahan-li-8", 2)
    assert np.median(chaotic.total) > 0.08 > 0.04 > regular.total.max()
    assert chaotic.ended == 0


def rows(**constants) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows of one scene, whose statistic is 1: method -> (constant, order), errors of constant / evaluations^order."""
    out = []
    for method, (size, order) in constants.items():
        for k in measure.LADDER:
            mean = 1 + size / k**order
            row = {"scene": "henon-heiles-mean", "method": method, "symplectic": method != "rk4", "k": k}
            row |= {"evaluations": 4.0 * k, "mean": mean, "standard error": 1e-3, "late": mean, "late error": 1e-3}
            out.append(row)
    exact = {"scene": "henon-heiles-mean", "exact": 1.0, "known": True}
    return pd.DataFrame(out), pd.DataFrame([exact | {"mean": 1.0005, "standard error": 1e-3}])


METHODS = {"stormer-verlet": (1.0, 2), "calvo-sanz-serna-4": (1.0, 4), "rk4": (100.0, 4)}


def test_the_largest_step_is_the_one_from_which_all_finer_ones_are_within_1_percent():
    table, exact = rows(**METHODS)
    found = claims.by_scene(table, exact).loc["henon-heiles-mean"]
    assert found[found < np.inf].to_dict() == {
        "stormer-verlet": 4.0 * 12,
        "calvo-sanz-serna-4": 4.0 * 4,
        "rk4": 4.0 * 12,
    }
    table.loc[(table["method"] == "rk4") & (table["k"] == 32), "mean"] = 1.5
    assert claims.by_scene(table, exact).loc["henon-heiles-mean", "rk4"] == 4.0 * 48
    table.loc[table["method"] == "rk4", "standard error"] = 0.1
    assert claims.by_scene(table, exact).loc["henon-heiles-mean", "rk4"] == np.inf
    assert claims.by_scene(table.assign(**{"standard error": 0.1}), exact).empty, "no method reaches it"


def test_methods_that_need_a_separable_system_are_left_out_where_it_is_none():
    assert not measure.able("double-pendulum-mean", "blanes-moan-srkn6b")
    assert measure.able("double-pendulum-mean", "rk4")
    assert measure.able("henon-heiles-mean", "blanes-moan-srkn6b")
