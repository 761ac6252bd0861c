"""The pages on the talks' figures: a verdict depends on all curves and is tested from both sides."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.talks import page
from phasebench.benchmarks.page.verdict import FAIL, FINDING, PASS, Count


def of_rows(verdict, figure: str, *rows: dict):
    """A page's verdict on these fabricated curves of a figure."""
    return verdict({page.TABLE: pd.DataFrame(rows).assign(figure=figure)}.get)


@pytest.mark.parametrize(
    ("order", "holds"),
    [(1.0, True), (1 + 0.9 * page.NEAR, True), (1 - 0.9 * page.NEAR, True), (1 + 1.1 * page.NEAR, False)]
    + [(1 - 1.1 * page.NEAR, False), (0.0, False)],
)
def test_order_is_judged_from_both_sides(order, holds):
    rows = [{"panel": "Scheme I", "curve": curve, "order": x} for curve, x in (("1/3", order), ("-1", 1.0))]
    found = of_rows(page.slopes, "convergence-schemes-i-iii", *rows)
    assert found.outcome == (PASS if holds else FINDING)
    assert found.measured == Count(2 if holds else 1, 2)
    assert found.where == ("" if holds else f"1/3: {order:.2f}")


@pytest.mark.parametrize(
    ("others", "euler", "holds"),
    [((0.1, 0.2), (5.0, 6.0), True), ((0.1, 5.5), (5.0, 6.0), False), ((0.1, 0.2), (0.15, 6.0), False)]
    + [((0.1, 5.0), (5.0, 6.0), False), ((7.0, 8.0), (5.0, 6.0), False)],
)
def test_other_methods_stay_nearer_than_both_eulers(others, euler, holds):
    names = ("implicit midpoint", "symplectic Euler", "explicit Euler", "implicit Euler")
    rows = [{"panel": n, "energy_error": x} for n, x in zip(names, (*others, *euler), strict=True)]
    found = of_rows(page.level_curves, "lotka-volterra-methods", *rows)
    assert found.outcome == (PASS if holds else FINDING)
    assert found.measured == Count(sum(x < min(euler) for x in others), 2)
    assert found.where == names[others.index(max(others))]


@pytest.mark.parametrize(
    ("turns", "holds"), [((0.12, 0.12), True), ((0.12, 0.2), False), ((0.2, 0.12), False), ((0.12, 0.05), False)]
)
def test_every_curve_precesses_like_the_exact_flow(turns, holds):
    curves = zip(("exact flow", "AVF", "Scheme V"), (0.12, *turns), strict=True)
    rows = [{"curve": curve, "turn": turn} for curve, turn in curves]
    found = of_rows(page.turns, "perturbed-kepler-preserving-orbits", *rows)
    assert found.outcome == (PASS if holds else FINDING)
    assert found.measured == pytest.approx(max(100 * abs(turn / 0.12 - 1) for turn in turns), abs=1e-9)


def test_relative_error_of_a_precession():
    for factor, holds in ((1 + 0.99 * page.TURN, True), (1 + 1.01 * page.TURN, False), (1 - 1.01 * page.TURN, False)):
        rows = [{"curve": "exact flow", "turn": 0.12}, {"curve": "AVF", "turn": 0.12 * factor}]
        found = of_rows(page.turns, "perturbed-kepler-preserving-orbits", *rows)
        assert found.outcome == (PASS if holds else FINDING)


def test_scheme_without_a_root_is_left_out_of_the_energy():
    rows = [
        {"curve": "AVF", "energy_error": 1e-15, "fallbacks": 0},
        {"curve": "Scheme IV", "energy_error": 1e-6, "fallbacks": 2},
    ]
    kept, missed = (of_rows(v, "henon-heiles-preserving-energy", *rows) for v in (page.energies, page.roots))
    assert (kept.outcome, kept.measured, kept.where) == (PASS, 1e-15, "AVF")
    assert (missed.outcome, missed.measured, missed.where) == (FINDING, 2, "Scheme IV")


def test_explicit_euler_is_the_control_of_areas():
    rows = [{"panel": n, "area": x} for n in ("exact flow", "explicit Euler") for x in (1.0, 1.0)]
    assert of_rows(page.areas, "pendulum-area", *rows) is None
    assert of_rows(page.euler_area, "pendulum-area", *rows).outcome == FAIL
    assert of_rows(page.euler_area, "pendulum-area", *rows, rows[-1] | {"area": 2.0}).outcome == PASS


def test_both_schemes_must_preserve_both_invariants():
    rows = [{"curve": c, "panel": p, "largest": 1e-15} for c in page.BOTH for p in ("energy", "angular-momentum")]
    for k in range(4):
        bad = [row | {"largest": 1e-9} if j == k else row for j, row in enumerate(rows)]
        found = of_rows(page.momenta, "perturbed-kepler-preserving-invariants", *bad)
        assert (found.outcome, found.where) == (FAIL, page.BOTH[k // 2])
    assert of_rows(page.momenta, "perturbed-kepler-preserving-invariants", *rows).outcome == PASS
    assert of_rows(page.momenta, "perturbed-kepler-preserving-invariants", *rows[:2]) is None
