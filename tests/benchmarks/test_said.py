"""What only a hand-made case shows of the measures by which statements of others are judged."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.solar_system import PLANETS
from phasebench.benchmarks.studies.said import brouwer, energies, julia, minimum_norm, planets, timed
from phasebench.benchmarks.studies.said.minimum_norm import LEAPFROG, MINIMUM_NORM, MOMENTA, POSITIONS
from phasebench.integrators.driver import integrate
from phasebench.integrators.systems.hamiltonian import Hamiltonian

# -- printed numbers ---------------------------------------------------------------------------------------------------


def test_perihelia_turn_with_the_planes():
    """A rotation about the ecliptic's axis adds to every longitude, a scaling to none."""
    made = problem("solar-system")
    q, p = np.array([made.q0]), np.array([made.p0])
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.kron(np.eye(9), [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before, after = planets.longitudes(made, q, p), planets.longitudes(made, q @ turn.T, p @ turn.T)
    np.testing.assert_allclose((after - before - 0.3 + np.pi) % (2 * np.pi), np.pi, atol=1e-12)


def test_a_rate_is_in_seconds_of_arc_a_year():
    t = np.linspace(0, 1000 * planets.YEAR, 50)
    assert planets.rate(t, 1.0 + np.radians(5.0 / 3600) * t / planets.YEAR) == pytest.approx(5.0, rel=1e-9)


def rms_of_oscillator(id: str, h: float, steps: int) -> float:
    """The rms of Delta H on the harmonic oscillator: z'(M'M - 1)z / 2 for Gaussian z, from the step's matrix alone."""
    lam = 0.19318332750378357396
    substeps = [("A", 0.5), ("B", 1.0), ("A", 0.5)]
    if id == MINIMUM_NORM:
        substeps = [("A", lam), ("B", 0.5), ("A", 1 - 2 * lam), ("B", 0.5), ("A", lam)]
    step = np.eye(2)
    for letter, c in substeps:
        step = (np.array([[1, c * h], [0, 1]]) if letter == "A" else np.array([[1, 0], [-c * h, 1]])) @ step
    M = np.linalg.matrix_power(step, steps)
    S = M.T @ M - np.eye(2)
    return float(np.sqrt((2 * np.trace(S @ S) + np.trace(S) ** 2) / 4))


@pytest.mark.parametrize("id", [LEAPFROG, MINIMUM_NORM])
@pytest.mark.parametrize("first", [POSITIONS, MOMENTA])
def test_rms_on_the_oscillator_is_that_of_the_step_matrix(id, first):
    d, weights = minimum_norm.jumps("oscillator", id, first, 1.0, 8)
    assert np.sqrt(weights @ d**2) == pytest.approx(rms_of_oscillator(id, 1 / 8, 8), rel=1e-9)
    assert weights @ np.expm1(-d) == pytest.approx(0, abs=1e-12)


def test_the_rule_for_averages_has_the_moments():
    q, p, weights = minimum_norm.states("anharmonic")
    x = np.linspace(-8, 8, 20001)
    density = np.exp(-minimum_norm.potential("anharmonic", x))
    assert weights @ q**2 == pytest.approx((density @ x**2) / density.sum(), rel=1e-4)
    assert weights @ p**4 == pytest.approx(3.0, rel=1e-9)


def test_exponents_of_random_walks_and_of_lines():
    random = np.random.default_rng(1)
    a, low, high = brouwer.exponent(np.cumsum(random.normal(size=(64, 100)), axis=1))
    assert low < 0.5 < high
    assert abs(a - 0.5) < 0.12
    line, low, high = brouwer.exponent(np.outer(random.uniform(1, 2, 64), np.arange(1, 101)))
    assert line == pytest.approx(1.0)
    assert low == pytest.approx(high)


def test_short_runs_grow_by_round_off_and_by_truncation(monkeypatch):
    monkeypatch.setattr(brouwer, "STARTS", 4)
    ours, control = (np.abs(brouwer.errors(*run, orbits=100)).max() for run in (("gauss-8", None), brouwer.CONTROL))
    assert ours < 1e-14
    assert control > 1e-12


def test_heavier_giants_are_the_giants_of_the_solar_system():
    made = timed.heavier()
    assert made.bodies.names == ("sun", *timed.GIANTS)
    assert made.bodies.masses[1] == pytest.approx(timed.HEAVIER / PLANETS["jupiter"][0])


# -- guides ------------------------------------------------------------------------------------------------------------

N = np.arange(1, 1001)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.0])
def test_the_power_of_time_is_found_under_an_oscillation(power):
    assert abs(julia.power(1e-9 * N**power * (1 + 0.3 * np.sin(N))) - power) < 0.07
    assert julia.power(np.where(N == 50, 1.0, 1e-9)) == 0, "of the largest error so far"


def test_growth_of_a_symplectic_method_and_of_one_that_is_not(monkeypatch):
    monkeypatch.setattr(julia, "ORBITS", 100)
    for id, powers in {"calvo-sanz-serna-4": (0, 1), "rk4": (1, 2)}.items():
        row = julia.growth(id)
        assert (row["energy power"], row["position power"]) == pytest.approx(powers, abs=0.12)


def test_orders_with_both_kinetic_energies():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + q**4/4")
    for id, order in julia.STATED.items():
        assert [r["order"] for r in julia.orders(id)] == pytest.approx([order, 3], abs=0.1)
        s = integrate(system, id, h=julia.SPAN / 64, steps=64, q0=julia.START[:1], p0=julia.START[1:])
        assert np.abs(julia.end(id, 64, True) - [s.q[-1, 0], s.p[-1, 0]]).max() < 1e-13, "another composition"


def test_plain_and_compensated_sums_take_the_same_steps():
    made, ((q, p), _) = problem("henon-heiles"), energies.SCENES["henon-heiles"]
    states = energies.plain(made.system, q, p, 0.05, 200, 50)
    s = integrate(made, energies.COMPENSATED, h=0.05, steps=200, q0=q, p0=p, save_every=50)
    assert np.abs(states - np.hstack([s.q, s.p])).max() < 1e-12
    assert not np.array_equal(states[1:], np.hstack([s.q, s.p])[1:])


def test_errors_fall_with_evaluations():
    rows = julia.cost("pendulum:swinging", "calvo-sanz-serna-4")
    (n1, e1), (n2, e2) = ((r["evaluations"], r["error"]) for r in (rows[10], rows[14]))
    assert abs(np.log(e1 / e2) / np.log(n2 / n1) - 4) < 0.2
