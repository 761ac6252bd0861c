"""Measures of the studies of extremes where the answer is known: theory in two ways, known orbits, hand-made maps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.extremes import encounters, multistep, springs
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE
from phasebench.integrators.driver import integrate

# -- close encounters --------------------------------------------------------------------------------------------------


def test_apocentre_is_computed_from_the_rounded_state():
    half, far = encounters.apocentre(0.4, 2.0)  # a = 1, e = 0.6
    assert (half, far) == (pytest.approx(np.pi, rel=1e-15), pytest.approx(1.6, rel=1e-15))
    rows = {r["e"]: r for r in encounters.kepler("wisdom-holman")}
    assert all(rows[e]["held"] for e in encounters.ECCENTRICITIES[:3])
    assert not encounters.kepler("symplectic-euler-p")[-1]["held"]


def test_encounter_is_judged_at_its_certified_state():
    assert encounters.distance([1.5, 101.0], [1.0, 100.0]) == 0.5
    rows = encounters.meet("zoom-whirl", "rk4")
    assert rows[-1]["error"] < rows[0]["error"]
    assert rows[-1]["steps"] == rows[-1]["asked"]
    (held,) = encounters.cheapest(pd.DataFrame(rows).assign(scene="zoom-whirl", method="rk4"))["held"]
    assert held == (rows[-1]["error"] <= encounters.HELD)


def test_cheapest_run_that_holds_or_the_most_accurate():
    rows = [("a", 4096, 1e-7), ("a", 1024, 2.0), ("a", 512, 1e-7), ("b", 700, 1.0), ("b", 100, 2.0)]
    found = encounters.cheapest(pd.DataFrame(rows, columns=["method", "steps", "error"]).assign(scene="s"))
    assert found.set_index("method")["steps"].to_dict() == {"a": 512, "b": 700}


# -- stiff springs -----------------------------------------------------------------------------------------------------


def test_distance_from_the_resonance_lines():
    found = springs.lines(2, 2.0)
    assert {(1, 0, 1), (0, 1, 1), (1, 1, 1), (2, 0, 1), (0, 2, 1)} <= {*found}
    assert springs.lines(2, 1.0) == [(0, 2, 1), (1, 1, 1), (2, 0, 1)]
    assert springs.lines(2, 0.9) == []
    x, y = np.array([0.5, 1.0, 0.3]), np.array([1.5, 0.2, 0.3])
    assert springs.distance(x, y, 2) == pytest.approx([0, 0, 0.7])
    assert springs.distance(x, y, 4)[2] == pytest.approx(0.2)
    assert springs.distance(np.array([0.1, 0.1]), np.array([0.3, 1.95]), 2)[1] == pytest.approx(0.05 / 2**0.5)


@pytest.mark.parametrize(("a", "b"), [(1, 0), (0, 1), (1, 1), (1, -1)])
def test_ridge_in_any_of_four_directions_is_found(a, b):
    """High everywhere except on both sides of the centre along one line: a row, a column or a diagonal."""
    drift = np.full((13, 13), 100.0)
    for k, low in ((1, 50.0), (2, 1.0)):
        drift[6 + k * a, 6 + k * b] = drift[6 - k * a, 6 - k * b] = low
    assert np.argwhere(springs.crests(drift)).tolist() == [[6, 6]]
    for place, high in (((6 - 2 * a, 6 - 2 * b), 100.0), ((6 - a, 6 - b), 101.0), ((6 + a, 6 + b), 101.0)):
        other = drift.copy()
        other[place] = high
        assert not springs.crests(other)[6, 6], "the controls: as high on one side"


def test_a_step_and_a_border_are_no_crests():
    step, border = np.ones((9, 9)), np.ones((9, 9))
    step[4:] = border[0] = 100.0
    assert not springs.crests(step).any()
    assert not springs.crests(border).any()


def test_crests_of_a_map_are_counted_with_the_highest():
    """1e-3 on the line x + y = 2 or five nodes beside it, 1e-6 elsewhere."""
    for aside in (0, 5):
        rows = [
            {"method": "a", "node 1": i, "node 2": j, "h omega 2": j / 10, "nodes": 36}
            | {"drift": 1e-3 if i + j == 72 - aside else 1e-6}
            for i in range(4, 70)
            for j in range(i, 70)
        ]
        found = springs.summary(pd.DataFrame(rows)).iloc[0]
        assert found["crests"] > 15
        assert (found["crests on lines"] == found["crests"]) == (aside == 0)
        assert (found["at"] == "(0.5, 6.7)") == (aside == 0)


def test_single_spring_preserves_the_energy_of_its_step():
    turns = springs.Turns("stormer-verlet", [0.5, 1.5, 2.5])
    assert len(turns.z) == 2
    assert turns.angles == pytest.approx(2 * np.arcsin([0.25, 0.75]))
    orbit = np.array([np.linalg.matrix_power(turns.matrices[1], n) @ [1.0, 0.3] for n in range(50)]).T
    assert np.ptp(turns.energy(1, *orbit)) < 1e-13
    assert np.ptp((orbit**2).sum(axis=0)) > 0.1
    exact = springs.Turns("deuflhard", [np.pi, 4.0])
    assert exact.angles == pytest.approx([np.pi, 4.0])
    assert exact.energy(1, 1.0, 2.0) == pytest.approx(2.5)
    assert exact.energy(0, 1.0, 2.0) == pytest.approx(2.5)


def test_grid_is_at_multiples_of_the_angle():
    z = springs.grid("stormer-verlet", 36)[:-2]
    assert np.allclose(z, 2 * np.sin(np.pi * np.arange(springs.LEAST, 36) / 72)[: len(z)], atol=1e-4)
    assert len(z) > 36 - springs.LEAST - 5


@pytest.mark.parametrize("id", ["stormer-verlet", "deuflhard"])
def test_springs_equal_the_registered_problem(id):
    q0, p0 = [*springs.SOFT_Q, 1 / 40, 1 / 40], [*springs.SOFT_P, 1.0, 1.0]
    known = integrate(problem("fpu", omega=40.0, m=2), id, h=springs.H, steps=30, q0=q0, p0=p0)
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


# -- multistep methods -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "N"), [(8, 10.0), (8, 59.5), (8, 60.0), (10, 40.0), (12, 33.5), (14, 132.0)])
def test_both_theories_agree_on_the_circle(order, N):
    """The closed form, and the eigenvalues of the product of all steps."""
    table = QUINLAN_TREMAINE[order]
    one, other = multistep.circular_rate(table, N), multistep.floquet_rate(table, N, 0.0)
    assert one > 0.01
    # the closed form has the radius of the recursion's own circle, the product the exact one
    assert one == pytest.approx(other, rel=0.35 if N < 60 else 0.01)


def test_a_resonance_of_two_parasitic_roots_is_found():
    """Roots of order 8 at 72 and 60 degrees: twice the orbit's angle is their difference with 60 steps an orbit."""
    assert multistep.circular_rate(QUINLAN_TREMAINE[8], 60.0) > 0.05
    assert abs(multistep.circular_rate(QUINLAN_TREMAINE[8], 62.0)) < 1e-6
    assert abs(multistep.floquet_rate(QUINLAN_TREMAINE[8], 62.0, 0.0)) < 1e-3
    assert multistep.floquet_rate(QUINLAN_TREMAINE[8], 90.0, 0.2) > 0.01


def test_points_are_on_keplers_orbit():
    t = np.linspace(0, 2 * np.pi, 9)
    q = multistep.orbit(0.2, t)
    assert np.abs(q[[0, -1]] - [0.8, 0]).max() < 1e-14
    assert np.abs(q[4] - [-1.2, 0]).max() < 1e-14
    E = np.arccos(np.clip(q[1, 0] + 0.2, -1, 1))
    assert pytest.approx(t[1], abs=1e-13) == E - 0.2 * np.sin(E)


def test_runs_are_lost_where_theory_says_so(monkeypatch):
    monkeypatch.setattr(multistep, "ORBITS", 600)
    monkeypatch.setattr(multistep, "steps_asked", lambda table: np.array([60.0, 62.0]))
    rows = pd.DataFrame(multistep.steps("quinlan-tremaine-8", 0.0)).assign(method="quinlan-tremaine-8")
    assert list(multistep.lost(rows)) == list(multistep.unstable(rows)) == [True, False]
    assert multistep.foretold(rows).all()
    assert multistep.spans(pd.Series([59.5, 60.0, 60.5, 90.0])) == "59.5 to 60.5, 90"


def test_the_control_drifts(monkeypatch):
    monkeypatch.setattr(multistep, "SHORT", 100)
    monkeypatch.setattr(multistep, "WINDOWS", 60)
    assert multistep.long(multistep.CONTROL, multistep.OFF)["high"] < -1e-11, "its interval excludes 0"
