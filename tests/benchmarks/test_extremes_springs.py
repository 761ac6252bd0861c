"""Step-size resonances of two stiff springs: resonance lines, ridges, the energy that a step preserves, the runs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.experiments.extremes import springs, springs_page
from phasebench.benchmarks.page.verdict import FINDING, PASS, Range
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate

NODES = 36


def test_distance_from_the_resonance_lines():
    found = springs_page.lines(2, 2.0)
    assert {(1, 0, 1), (0, 1, 1), (1, 1, 1), (2, 0, 1), (0, 2, 1)} <= {*found}
    assert springs_page.lines(2, 1.0) == [(0, 2, 1), (1, 1, 1), (2, 0, 1)]
    assert springs_page.lines(2, 0.9) == []
    x, y = np.array([0.5, 1.0, 0.3]), np.array([1.5, 0.2, 0.3])
    assert springs_page.distance(x, y, 2) == pytest.approx([0, 0, 0.7])
    assert springs_page.distance(x, y, 4)[2] == pytest.approx(0.2)
    assert springs_page.distance(np.array([0.1, 0.1]), np.array([0.3, 1.95]), 2)[1] == pytest.approx(0.05 / 2**0.5)


def test_ridge_stands_out_on_both_sides():
    flat = np.ones((9, 9))
    assert not springs_page.crests(flat).any()
    ridge = flat.copy()
    ridge[4] = 2 * springs_page.HIGH
    found = springs_page.crests(ridge)
    assert found[4].all()
    assert found.sum() == 9
    step = flat.copy()
    step[4:] = 100.0
    assert not springs_page.crests(step).any()
    at_the_edge = flat.copy()
    at_the_edge[0] = 100.0
    assert not springs_page.crests(at_the_edge).any()


@pytest.mark.parametrize(("a", "b"), [(1, 0), (0, 1), (1, 1), (1, -1)])
def test_ridge_in_any_of_four_directions_is_found(a, b):
    """High everywhere except on both sides of the centre along one line: a row, a column or a diagonal."""
    drift = np.full((13, 13), 100.0)
    for k, low in ((1, 50.0), (2, 1.0)):
        drift[6 + k * a, 6 + k * b] = drift[6 - k * a, 6 - k * b] = low
    assert np.argwhere(springs_page.crests(drift)).tolist() == [[6, 6]]
    for place, high in (((6 - 2 * a, 6 - 2 * b), 100.0), ((6 - a, 6 - b), 101.0), ((6 + a, 6 + b), 101.0)):
        other = drift.copy()
        other[place] = high
        assert not springs_page.crests(other)[6, 6], "the controls: as high on one side"


def table(method: str, high) -> pd.DataFrame:
    """A fabricated map of energy drifts over pairs of steps: 1e-3 at nodes where ``high(x, y)``, 1e-6 elsewhere."""
    rows = [
        {"method": method, "node 1": i, "node 2": j, "h omega 2": j / 10, "nodes": NODES}
        | {"drift": 1e-3 if high(i, j) else 1e-6}
        for i in range(4, 70)
        for j in range(i, 70)
    ]
    return pd.DataFrame(rows)


def judge(verdict, *tables):
    """A page's verdict on these maps of energy drifts together."""
    return verdict(lambda name: pd.concat(tables))


def test_ridges_must_lie_on_lines_beyond_chance():
    on, none = table("a", lambda i, j: i + j == 2 * NODES), table("c", lambda i, j: False)
    aside = table("b", lambda i, j: i + j == 2 * NODES - 5)
    for verdict in (springs_page.on_lines, springs_page.above_chance):
        assert judge(verdict, on, none).outcome == PASS
        bad = judge(verdict, on, aside)
        assert (bad.outcome, bad.where) == (FINDING, "b")
        assert judge(verdict, none) is None
    assert judge(springs_page.on_lines, on, none).measured == Range(1.0, 1.0)


def test_ridges_partly_on_lines():
    mixed = table("d", lambda i, j: i + j == 2 * NODES or (i + j == 2 * NODES - 5 and i < 12))
    assert judge(springs_page.on_lines, mixed).outcome == FINDING
    assert judge(springs_page.above_chance, mixed).outcome == PASS


def test_ridges_of_a_method_are_counted_with_the_highest():
    found = springs_page.summary_table(table("a", lambda i, j: i + j == 2 * NODES)).iloc[0]
    assert found["crests"] == found["crests on lines"] > 15
    assert found["at"] == "(0.5, 6.7)"


def test_single_spring_preserves_the_energy_of_its_step():
    turns = springs.Turns("stormer-verlet", [0.5, 1.5, 2.5])
    assert len(turns.z) == 2
    assert turns.angles == pytest.approx(2 * np.arcsin([0.25, 0.75]))
    orbit = np.array([np.linalg.matrix_power(turns.matrices[1], n) @ [1.0, 0.3] for n in range(50)]).T
    kept = turns.energy(1, *orbit)
    assert np.ptp(kept) < 1e-13
    assert np.ptp((orbit**2).sum(axis=0)) > 0.1
    exact = springs.Turns("deuflhard", [np.pi, 4.0])
    assert exact.angles == pytest.approx([np.pi, 4.0])
    assert exact.energy(1, 1.0, 2.0) == pytest.approx(2.5)
    assert exact.energy(0, 1.0, 2.0) == pytest.approx(2.5)


def test_grid_is_at_multiples_of_the_angle():
    z = springs.grid("stormer-verlet", NODES)[:-2]
    assert np.allclose(z, 2 * np.sin(np.pi * np.arange(springs.LEAST, NODES) / NODES / 2)[: len(z)], atol=1e-4)
    assert len(z) > NODES - springs.LEAST - 5


@pytest.mark.parametrize("id", ["stormer-verlet", "deuflhard"])
def test_springs_equal_the_registered_problem(id):
    made = problem("fpu", omega=40.0, m=2)
    q0, p0 = [*springs.SOFT_Q, 1 / 40, 1 / 40], [*springs.SOFT_P, 1.0, 1.0]
    known = integrate(made, id, h=springs.H, steps=30, q0=q0, p0=p0)
    Q, P = springs.Springs(id)(np.array([40.0, 40.0]), 30)
    assert np.allclose(Q, known.q.T, rtol=0, atol=1e-13)
    assert np.allclose(P, known.p.T, rtol=0, atol=1e-12)


def test_impulse_method_drifts_at_a_resonance():
    run, z = springs.Springs("deuflhard"), np.array([2.0, 2 * np.pi - 2.0])
    drifts = []
    for at in (z, z + 0.3):
        turns = springs.Turns("deuflhard", at)
        Q, P = run(at / springs.H, 1500)
        fast = sum(turns.energy(k, at[k] / springs.H * Q[2 + k], P[2 + k]) for k in (0, 1))
        drifts.append(springs.drift(Q, P, fast))
    assert drifts[0] > 100 * drifts[1]
    assert springs.drift(Q * np.nan, P, fast) == np.inf
