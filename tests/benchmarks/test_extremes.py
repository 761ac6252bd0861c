"""Measures of the studies of extremes where the answer is known: theory in two ways, known orbits, hand-made maps."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pandas as pd
import pytest
from scipy import stats

from phasebench.benchmarks.measure import exact_maps, oscillator
from phasebench.benchmarks.measure.exact_maps import DIGITS, exact_matrix
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.extremes import (
    encounters,
    limits,
    maps,
    multistep,
    push,
    round_off,
    springs,
)
from phasebench.integrators.coefficients.multistep import QUINLAN_TREMAINE
from phasebench.integrators.driver import OK, integrate
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import BY_ID
from support import known_maps

# -- stability ---------------------------------------------------------------------------------------------------------


def test_limit_at_a_triple_root_is_confirmed_where_growth_shows():
    """Of chin-4a tr M + 2 = (12 - z^2)^3 / 432; Stormer-Verlet's trace leaves -2 with a slope, at once."""
    chosen = integrator("chin-4a")
    M = oscillator.matrix(chosen, 3.0)
    assert np.trace(M) + 2 == pytest.approx(3**3 / 432, rel=1e-12)
    found = oscillator.find(chosen)
    assert found.limit == pytest.approx(math.sqrt(12), rel=2e-6)
    assert not limits.grows(chosen, found.limit * (1 + limits.BESIDE))
    assert limits.beyond(chosen, found) == [found.limit * (1 + 100 * limits.BESIDE)]
    assert limits.confirm(chosen, found) == (2, 2)
    verlet = integrator("stormer-verlet")
    found = oscillator.find(verlet)
    assert limits.beyond(verlet, found) == [found.limit * (1 + limits.BESIDE)]
    following = dataclasses.replace(found, intervals=(*found.intervals, (found.limit * (1 + limits.BESIDE), None)))
    assert limits.beyond(verlet, following) == []


def test_stability_functions():
    """R of the classical method is the truncated exponential series; that of Gauss is a Pade approximation."""
    rows = {r["method"]: r for r in maps.stability_functions(True)}
    assert np.allclose([float(c) for c in rows["rk4"]["above"].split()], [1 / 24, 1 / 6, 1 / 2, 1, 1])
    assert np.allclose([float(c) for c in rows["gauss-2"]["below"].split()], [1 / 12, -1 / 2, 1])


def test_resonances_are_where_theory_predicts():
    """Stormer-Verlet is stable to 2; the impulse method resonates at h (1 + ratio) = 2 pi, a filtered one does not."""
    coupled, start = maps.coupled(maps.RATIOS[0] * 2), {"q0": (1, 0), "p0": (0, 0)}
    run = {id: prepare(coupled, BY_ID[id], **start) for id in ("stormer-verlet", "deuflhard", "hairer-lubich")}
    assert maps.radius(run["stormer-verlet"], 0.9) < 1 + 1e-9
    assert maps.radius(run["stormer-verlet"], 1.1) > 1.1
    at = 2 * math.pi / 3
    assert maps.radius(run["deuflhard"], at) > 1.01 > maps.radius(run["hairer-lubich"], at)


# -- largest steps -----------------------------------------------------------------------------------------------------


def test_largest_step_is_bisected():
    for edge_at in (0.013, 3.0):
        h, fails = push.largest(lambda h, edge=edge_at: OK if h <= edge else "lost", 0.1)
        assert h <= edge_at < h * 2 ** (1.01 / push.PARTS)
        assert fails == "lost"
    assert push.largest(lambda h: "lost", 0.1) == (0.0, "lost")
    assert push.largest(lambda h: OK, 0.1) == (math.inf, "")


def test_status_of_runs_on_known_orbits():
    """At an h near the period of the box orbit the energy error is small, but the clock is wrong."""
    pendulum, near, box = (
        push.CASES[name] for name in ("pendulum", "pendulum, 1e-12 below the separatrix", "Henon-Heiles, box")
    )
    assert push.judge_run(pendulum, "stormer-verlet", 0.1, 1000) == OK
    assert push.judge_run(pendulum, "stormer-verlet", 2.2, 1000) == push.LOST
    assert push.judge_run(near, "stormer-verlet", 0.3, 1000) == push.WRONG
    assert push.course(pendulum).size == pytest.approx(-math.cos(2), rel=1e-3)
    by_energy = dataclasses.replace(box, ranged=False, timed=False)
    assert push.judge_run(box, "blanes-moan-s6", 0.5, 300) == OK
    assert push.judge_run(by_energy, "blanes-moan-s6", 5.4, 300) == OK
    assert push.judge_run(box, "blanes-moan-s6", 5.4, 300) == push.CLOCK


def test_orbit_out_of_range_or_out_of_phase():
    case = push.CASES["pendulum"]
    known, t = push.course(case), np.linspace(0, 200, 2001)
    swing = (known.high + known.low) / 2 + (known.high - known.low) / 2 * np.sin(np.pi * known.rate * t)[:, None]
    assert push.strays(case, swing, 200.0, True) == OK
    assert push.strays(case, swing * 2.5, 200.0, True) == push.WRONG
    assert push.strays(case, swing, 500.0, True) == push.CLOCK
    assert push.strays(case, swing, 500.0, False) == OK
    assert push.crossings(np.array([1.0, -1.0, -1.0, 1.0]), 0.0) == 2


# -- round-off ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def distances(of_each):
    """A function: method -> distance of its step matrix on the oscillator from the exact one, measured uncompiled."""
    return of_each(known_maps)


@pytest.mark.parametrize("id", known_maps.KNOWN)
def test_methods_equal_to_a_known_one_on_the_oscillator(distances, id):
    assert distances(id) <= 4e-16


EXACT = ("stormer-verlet", "blanes-moan-srkn6b", "gauss-2", "lobatto-iiia-iiib-3", "deuflhard")


@pytest.mark.parametrize(("id", "values"), [*((id, {}) for id in EXACT), ("scheme-i", {"lam": "1/3"})])
def test_exact_matrix_is_the_methods_matrix(id, values):
    with mpmath.workdps(DIGITS):
        M = np.array(exact_matrix(id, values, 0.3).tolist(), float)
    assert np.allclose(M, oscillator.matrix(integrator(id, parameters=values), 0.3), rtol=0, atol=4e-16)


def test_integer_errors_equal_multiprecision_errors():
    rng, n = np.random.default_rng(1), np.array([0, 3, 7])
    Q, P = rng.uniform(-1, 1, (2, 4, 3))
    with mpmath.workdps(DIGITS):
        M = exact_matrix("stormer-verlet", {}, 0.1)
        energy, phase = exact_maps.errors(M, n, Q, P)
        turn = mpmath.mpc((M[0, 0] + M[1, 1]) / 2, mpmath.sqrt(1 - ((M[0, 0] + M[1, 1]) / 2) ** 2))
        for i in range(4):
            w = [M[1, 0] * q + (turn - M[0, 0]) * p for q, p in zip(Q[i], P[i], strict=True)]
            for k in range(3):
                assert energy[i, k] == pytest.approx(float(abs(w[k]) ** 2 / abs(w[0]) ** 2 - 1), rel=1e-14, abs=1e-30)
                late = mpmath.arg(w[k] / w[0] * mpmath.expj(-mpmath.arg(turn) * int(n[k])))
                assert phase[i, k] == pytest.approx(float(late), rel=1e-14, abs=1e-30)


def test_elements_and_phase_error_of_a_kepler_orbit():
    """a = 1, e = 0.6, E = 1: M = 1 - 0.6 sin 1; a mean anomaly late by 1e-9 is a phase error of 1e-9."""

    def at(E):
        x, y, r = math.cos(E) - 0.6, 0.8 * math.sin(E), 1 - 0.6 * math.cos(E)
        return (x, y), (-math.sin(E) / r, 0.8 * math.cos(E) / r)

    with mpmath.workdps(DIGITS):
        a, M = map(float, round_off.elements(*at(1.0)))
        assert (a, M) == (pytest.approx(1, rel=1e-14), pytest.approx(1 - 0.6 * math.sin(1), rel=1e-14))
        Q, P = zip(at(0.0), at(1.0), strict=True)
        energy, phase = round_off.kepler_errors([0, 1], Q, P, M - 1e-9)
    assert abs(energy[1]) < 1e-14
    assert phase[1] == pytest.approx(1e-9, rel=1e-5)


def test_state_error_by_kind_of_summation():
    """After 4e6 steps of 0.01 on the oscillator plain sums have lost most digits."""
    steps = 4_000_000
    with mpmath.workdps(DIGITS):
        exact = exact_matrix("stormer-verlet", {}, 0.01) ** steps * mpmath.matrix([0.7, 0.4])
        far = {kind: [x[-1] for x in round_off.by_hand(kind, 0.01, steps, 10, 0.7, 0.4)] for kind in round_off.BY_HAND}
        error = {kind: float(mpmath.norm(mpmath.matrix(y) - exact)) for kind, y in far.items()}
    assert error[round_off.WHOLE] < 2e-15
    assert error[round_off.HALF] > 1e-14
    assert error[round_off.PLAIN] > 1e-13


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_interval_of_the_growth_exponent_covers(exponent):
    """In 16 of 20 draws the interval contains the exponent: 1/2 of random walks, 1 of lines with random slopes."""
    generator, n = np.random.default_rng(0), 10 * 2 ** np.arange(10)
    covered = 0
    for _ in range(20):
        if exponent == 1.0:
            e = generator.standard_normal((100, 1)) * n
        else:
            e = np.cumsum(generator.standard_normal((100, n[-1])), axis=1)[:, n - 1]
        value, low, high = round_off.power(n, e)
        assert low - 1e-12 <= value <= high + 1e-12, "lines are fitted to round-off"
        covered += low - 1e-9 <= exponent <= high + 1e-9
    assert covered >= 16


def test_threshold_of_a_bias_grows_with_the_ensembles():
    rows = pd.DataFrame({"starts": [100] * 144})
    assert round_off.critical(rows.head(1)) == pytest.approx(1.984, abs=1e-3)  # Student's t, 99 degrees of freedom
    for k in (18, 144):
        beyond = 2 * stats.t.sf(round_off.critical(rows.head(k)), 99)
        assert (1 - beyond) ** k == pytest.approx(0.95, abs=1e-9)
    assert round_off.critical(rows.assign(starts=10)) > 5


# -- close encounters --------------------------------------------------------------------------------------------------


def test_apocentre_is_computed_from_the_rounded_state():
    half, far = encounters.apocentre(0.4, 2.0)  # a = 1, e = 0.6
    assert (half, far) == (pytest.approx(np.pi, rel=1e-15), pytest.approx(1.6, rel=1e-15))
    rows = {r["e"]: r for r in encounters.kepler("wisdom-holman")}
    assert all(rows[e]["held"] for e in encounters.ECCENTRICITIES[:3])
    assert not encounters.kepler("symplectic-euler-p")[-1]["held"]


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


@pytest.mark.parametrize(("a", "b"), [(1, 0), (1, 1), (1, -1)])
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


def test_springs_equal_the_registered_problem():
    q0, p0 = [*springs.SOFT_Q, 1 / 40, 1 / 40], [*springs.SOFT_P, 1.0, 1.0]
    known = integrate(problem("fpu", omega=40.0, m=2), "deuflhard", h=springs.H, steps=30, q0=q0, p0=p0)
    Q, P = springs.Springs("deuflhard")(np.array([40.0, 40.0]), 30)
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


def test_stability_limit_of_a_multistep_method_is_that_of_its_roots():
    """On one side of it all roots of rho + (h omega)^2 sigma are on the circle, on the other one is outside."""
    limit, table = oscillator.find(integrator("quinlan-tremaine-8")).limit, QUINLAN_TREMAINE[8]
    rho, sigma = (np.array(x, dtype=float)[::-1] for x in (table.rho, table.sigma))
    inside, outside = (np.abs(np.roots(rho + (limit * x) ** 2 * sigma)).max() - 1 for x in (1 - 1e-6, 1 + 1e-6))
    assert inside < 1e-9 < 1e-5 < outside


@pytest.mark.parametrize(("order", "N"), [(8, 10.0), (8, 60.0), (14, 132.0)])
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
