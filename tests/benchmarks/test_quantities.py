"""What is wanted of a solution: values against closed forms, references against more exact ones, angles by turns."""

from dataclasses import replace
from math import inf, pi
from types import SimpleNamespace

import numpy as np
import pytest
from sympy import isprime

from phasebench.benchmarks.measure import lyapunov, truths
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import AVERAGE
from phasebench.benchmarks.measure.quantities import Truth, distance, error, quantities, quantity, scale, values
from phasebench.benchmarks.problems import PROBLEMS, labels, problem
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.integrators import Hamiltonian
from phasebench.integrators.errors import InvalidInput


def rows(t, q, p, status="ok"):
    """Rows as a solution has them."""
    return SimpleNamespace(t=np.array(t), q=np.array(q, float), p=np.array(p, float), status=status)


def test_every_problem_has_a_question_and_every_question_a_quantity():
    asked = {x.problem.partition(":")[0] for x in QUESTIONS}
    assert asked == set(PROBLEMS)
    assert len({x.id for x in QUESTIONS}) == len(QUESTIONS) >= 20
    for x in QUESTIONS:
        assert x.problem in labels([x.problem])
        assert quantity(x.made(), x.quantity).name == x.quantity
        assert list(x.accuracies) == sorted(x.accuracies, reverse=True)


def test_an_unknown_quantity_is_named_with_those_there_are():
    with pytest.raises(InvalidInput, match="perihelion"):
        quantity(problem("kepler"), "perihelium")
    assert "lyapunov" in quantities(problem("henon-heiles:chaotic"))
    assert "lyapunov" not in quantities(problem("henon-heiles:box"))


def test_the_state_and_the_energy_of_an_oscillator_moved_by_hand():
    made = problem("harmonic-oscillator")
    state, energy = (quantity(made, name) for name in ("end-state", "energy"))
    moved = rows([0.0, 1.0, pi], [[1.0], [-1.0], [-1.0]], [[0.0], [0.0], [0.25]])
    assert error(made, state, moved, Truth(np.array([-1.0, 0.0]), 0.0, "")) == 0.25
    assert error(made, energy, moved) == pytest.approx(0.25**2)  # H0 = 1/2 is the sum of the sizes of its terms
    assert error(made, energy, replace_status(moved)) == inf


def replace_status(solution):
    """The same rows of a run that diverged."""
    return SimpleNamespace(**vars(solution) | {"status": "diverged"})


def test_angles_are_compared_modulo_a_turn():
    made = problem("kepler")
    phase = quantity(made, "phase")
    assert distance(phase, np.array([pi - 1e-3]), np.array([-pi + 1e-3])) == pytest.approx(2e-3)
    assert distance(replace(phase, angle=False), np.array([3.0]), np.array([-3.0])) == 6.0


@pytest.mark.parametrize("anomaly", [0.0, 0.9, 2.5, 4.0])
def test_the_perihelion_of_a_turned_ellipse_is_where_it_was_turned_to(anomaly):
    """A point of the ellipse of eccentricity e by its eccentric anomaly; the phase is where the body itself is."""
    made, angle, e = problem("kepler"), 0.7, 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    across, (c, s) = np.sqrt(1 - e * e), (np.cos(anomaly), np.sin(anomaly))
    q, p = turn @ [c - e, across * s], turn @ np.array([-s, across * c]) / (1 - e * c)
    turned = rows([0.0, 0.5, 1.0], [made.q0, [9.0, -2.0], q], [made.p0, [3.0, 4.0], p])
    assert values(made, quantity(made, "perihelion"), turned) == pytest.approx([angle])
    phase = np.arctan2(across * s, c - e) + angle
    assert distance(quantity(made, "phase"), values(made, quantity(made, "phase"), turned), np.array([phase])) < 1e-14


def test_the_phase_of_an_oscillator_is_its_time():
    made = problem("harmonic-oscillator")
    omega = float(made.system.frequencies[0])
    t = np.array([0.0, 0.4, 1.3])
    q, p = 2 * np.cos(omega * t), -2 * omega * np.sin(omega * t)
    assert values(made, quantity(made, "phase"), rows(t, q[:, None], p[:, None])) == pytest.approx([1.3 * omega])


def test_the_average_is_weighted_by_the_times_and_in_units_of_the_terms():
    made = problem("kepler")  # e = 0.6 from its perihelion: p^2 / 2 = 2 and 1 / r = 2.5
    assert scale(made) == pytest.approx(np.dot(made.p0, made.p0) / 2 + 1 / np.hypot(*made.q0))
    moved = rows([0.0, 1.0, 4.0], [made.q0] * 3, [[2.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    assert values(made, AVERAGE, moved) == pytest.approx([(2 * 1 + 1 * 3) / 4 / scale(made)])


def test_the_oscillatory_energy_is_in_units_of_the_first():
    made = problem("fpu")
    found = values(
        made,
        quantity(made, "adiabatic-invariant"),
        rows(
            np.arange(21),
            [np.multiply(made.q0, 1 + k) for k in range(21)],
            [np.multiply(made.p0, 1 + k) for k in range(21)],
        ),
    )
    assert found == pytest.approx((1 + np.arange(1, 21)) ** 2), "it is a square of the state"


def test_the_section_sees_what_is_across_the_orbit_and_not_what_is_along_it():
    made = problem("henon-heiles:box")
    section, state = quantity(made, "section"), quantity(made, "end-state")
    early, late = (integrator("heyoka").run(made, t_end=t, save_every=0) for t in (10.0, 10.001))
    at = values(made, section, early)
    assert distance(section, at, values(made, section, late)) < 1e-13
    assert distance(state, values(made, state, early), values(made, state, late)) > 1e-5
    across = rows(early.t, early.q * [[1, 1], [1, 1.001]][1], early.p)
    assert distance(section, at, values(made, section, across)) > 1e-7


@pytest.mark.parametrize(("label", "t"), [("kepler", 200 * pi), ("henon-heiles:box", 1000.0), ("duffing", 200.0)])
def test_the_uncertainty_of_a_long_double_reference_bounds_its_error(label, t, monkeypatch):
    """Against the certified state, of some thirty digits."""
    made = problem(label)
    t = t if label != "kepler" else made.start.times[-1]
    state = quantity(made, "end-state")
    certified = truths.truth(made, state, t)
    monkeypatch.setattr(truths, "_certified", lambda problem, t_end: None)
    found = truths.truth(made, state, t)
    assert (certified.source, found.source) == (truths.CERTIFIED, truths.LONG_DOUBLE)
    apart = distance(state, certified.values, found.values)
    assert apart <= found.uncertainty + certified.uncertainty < 1e-11


def test_the_exponent_of_a_linear_saddle_is_its_rate_and_an_oscillators_is_none():
    t = np.linspace(0.0, 200.0, 401)
    saddle = Hamiltonian(q="q", p="p", H="p**2/2 - 9*q**2/8")
    still = np.zeros((401, 1))
    assert lyapunov.exponent(saddle, t, still, still) == pytest.approx(1.5, abs=1e-2)
    oscillator = problem("harmonic-oscillator").system
    assert abs(lyapunov.exponent(oscillator, t, np.cos(t)[:, None], -np.sin(t)[:, None])) < 1e-2


def test_an_average_and_an_exponent_lie_among_those_of_nearby_orbits():
    made, t = problem("henon-heiles:chaotic"), 1000.0
    for name, least in (("average", 1e-4), ("lyapunov", 1e-3)):
        wanted = quantity(made, name)
        true = truths.truth(made, wanted, t)
        run = integrator("pefrl").run(made, t_end=t, **wanted.grid(steps=wanted.steps(20_000)))
        assert least < true.uncertainty
        assert error(made, wanted, run, true) < 2 * true.uncertainty


def test_rows_that_a_quantity_needs_are_asked_for_and_missed():
    made = problem("pendulum:swinging")
    trajectory = quantity(made, "trajectory")
    assert [trajectory.steps(wanted) for wanted in (0.2, 29, 33)] == [20, 20, 40]
    assert trajectory.grid(tol=1e-8) == {"tol": 1e-8, "steps": 20, "save_every": 1}
    assert quantity(made, "end-state").grid(tol=1e-8) == {"tol": 1e-8, "save_every": 0}
    assert isprime(quantity(made, "energy").rows), "no period is looked at in few phases"
    assert trajectory.grid(steps=40) == {"steps": 40, "save_every": 2}
    bare = integrator("stormer-verlet").run(made, t_end=1.0, steps=40, save_every=0)
    with pytest.raises(ValueError, match="equidistant"):
        values(made, trajectory, bare)
    true = truths.truth(made, trajectory, 1.0)
    whole = integrator("stormer-verlet").run(made, t_end=1.0, **trajectory.grid(steps=40))
    every = integrator("stormer-verlet").run(made, t_end=1.0, steps=40, save_every=1)
    assert 0 < error(made, trajectory, whole, true) == error(made, trajectory, every, true) < 1e-3
