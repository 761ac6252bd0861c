"""The talks' figures: a verdict is of all curves, from both sides, and not of one of them."""

from __future__ import annotations

import pandas as pd
import pytest

from phasebench.benchmarks.experiments.talks import page


def told(verdict, figure: str, *rows: dict):
    return verdict({page.TABLE: pd.DataFrame(rows).assign(figure=figure)}.get)


@pytest.mark.parametrize(
    ("order", "holds"),
    [(1.0, True), (1 + 0.9 * page.NEAR, True), (1 - 0.9 * page.NEAR, True), (1 + 1.1 * page.NEAR, False)]
    + [(1 - 1.1 * page.NEAR, False), (0.0, False)],
)
def test_an_order_is_judged_from_above_and_from_below(order, holds):
    rows = [{"panel": "Scheme I", "curve": curve, "order": x} for curve, x in (("1/3", order), ("-1", 1.0))]
    found = told(page.slopes, "convergence-schemes-i-iii", *rows)
    assert found.holds is holds
    assert found.short == f"{2 if holds else 1} of 2 observed slopes are the scheme's order."
    assert (f"1/3 {order:.2f} for 1" in found.text) is not holds


@pytest.mark.parametrize(
    ("others", "euler", "holds"),
    [((0.1, 0.2), (5.0, 6.0), True), ((0.1, 5.5), (5.0, 6.0), False), ((0.1, 0.2), (0.15, 6.0), False)]
    + [((0.1, 5.0), (5.0, 6.0), False), ((7.0, 8.0), (5.0, 6.0), False)],
)
def test_every_other_method_stays_nearer_than_both_eulers(others, euler, holds):
    names = ("implicit midpoint", "symplectic Euler", "explicit Euler", "implicit Euler")
    rows = [{"panel": n, "energy_error": x} for n, x in zip(names, (*others, *euler), strict=True)]
    found = told(page.invariant_curves, "lotka-volterra-methods", *rows)
    assert found.holds is holds
    both = f"Least change of the invariant: {names[0]}; both Euler methods leave the level curves."
    assert (found.short == both) is holds


@pytest.mark.parametrize(
    ("turns", "holds"), [((0.12, 0.12), True), ((0.12, 0.2), False), ((0.2, 0.12), False), ((0.12, 0.05), False)]
)
def test_every_curve_turns_as_the_exact_flow(turns, holds):
    curves = zip(("exact flow", "AVF", "Scheme V"), (0.12, *turns), strict=True)
    rows = [{"curve": curve, "turn": turn} for curve, turn in curves]
    assert told(page.turns, "perturbed-kepler-preserving-orbits", *rows).holds is holds


def test_a_turn_is_judged_by_its_share():
    for factor, holds in ((1 + 0.99 * page.TURN, True), (1 + 1.01 * page.TURN, False), (1 - 1.01 * page.TURN, False)):
        rows = [{"curve": "exact flow", "turn": 0.12}, {"curve": "AVF", "turn": 0.12 * factor}]
        assert told(page.turns, "perturbed-kepler-preserving-orbits", *rows).holds is holds
