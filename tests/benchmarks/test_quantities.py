"""Observables of a solution: values against closed forms, true values with their stated uncertainty."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi
from types import SimpleNamespace

import numpy as np
import pytest
from sympy import isprime

from phasebench.benchmarks.measure import truths
from phasebench.benchmarks.measure.global_error import quantity_error
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import AVERAGE, quantities, quantity
from phasebench.benchmarks.measure.quantities import END_STATE, ENERGY, Truth, distance, error, scale, values
from phasebench.benchmarks.problems import PROBLEMS, labels, problem
from phasebench.benchmarks.problems.questions import QUESTIONS
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.certificates import followed
from phasebench.reference.solvers import taylor

EPS = 2.0**-52
OSCILLATOR = problem("harmonic-oscillator")
#: An observable of a chaotic orbit whose values are the times at which it is evaluated.
LOOKED = replace(ENERGY, values=lambda problem, t, q, p: t, rows=4, kept=False, statistical=True)


def runs(monkeypatch, one: float, other: float, *displaced: float) -> None:
    """Replace the reference by made-up runs that end in (q, 0): one, another, and some from displaced starts.

    The certified state is removed.
    """
    rows = [np.array([[q, 0.0]], dtype=np.longdouble) for q in (one, other, *(displaced or (one,)))]
    found = followed.FollowedOrbit(followed.TAYLOR, np.array([1.0]), rows[0], rows[1], rows[2:])
    monkeypatch.setattr(followed, "follow", lambda problem, times: found)
    monkeypatch.setattr(truths, "_certified_end", lambda problem, t_end: None)


def test_equal_references_leave_the_rounding_of_a_double(monkeypatch):
    runs(monkeypatch, 1e-3, 1e-3)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert list(found.values) == [1e-3, 0.0]
    assert np.spacing(1e-3) / 2 <= found.uncertainty <= 1e-3 * EPS
    angle = truths.truth(OSCILLATOR, quantity(OSCILLATOR, "phase"), 1.0)
    assert np.spacing(pi) / 2 <= angle.uncertainty <= pi * EPS, "an angle is of the size of a turn"


def test_uncertainty_includes_the_growth_of_roundings(monkeypatch):
    """The worst displaced run counts, scaled by the ratio of a rounding to its displacement."""
    runs(monkeypatch, 1.0, 1.0, 1.0 + 1e-5, 1.0 - 1e-4, 1.0)
    found = truths.truth(OSCILLATOR, END_STATE, 1.0)
    assert found.rounding == pytest.approx(1e-4 * 2.0**-12, rel=1e-9, abs=0)
    assert found.uncertainty == pytest.approx(16 * 1e-4 * 2.0**-12, rel=1e-6, abs=0)
    assert found.source == truths.LONG_DOUBLE


@pytest.mark.parametrize("y", [0.0, 1e-17, -1e-17, 0.5])
def test_certified_angle_near_its_jump(monkeypatch, y):
    made = problem("kepler")
    end = SimpleNamespace(q=np.array([-1.0, y]), p=np.array([0.3, 0.2]), uncertainty=1e-16)
    monkeypatch.setattr(truths, "_certified_end", lambda problem, t_end: end)
    found = truths.truth(made, quantity(made, "phase"), 1.0)
    assert found.source == truths.CERTIFIED
    assert found.values == pytest.approx([np.arctan2(y, -1.0)])
    assert np.spacing(pi) / 2 <= found.uncertainty < 1e-15


def test_a_mean_over_orbits_is_known_to_two_deviations(monkeypatch):
    told = iter(np.outer(np.arange(truths.NEIGHBOURS), [1.0, 3.0]))
    monkeypatch.setattr(truths, "values", lambda *_: next(told))
    found = truths._ensemble(OSCILLATOR, END_STATE, 1.0)
    n = truths.NEIGHBOURS
    assert found.values == pytest.approx([(n - 1) / 2, 3 * (n - 1) / 2])
    assert found.uncertainty == pytest.approx(6 * np.sqrt(n * (n + 1) / 12))


@pytest.mark.parametrize("lost", [[np.nan, np.nan], [1.0, np.inf]])
def test_nonfinite_reference_has_failed(monkeypatch, lost):
    flow = SimpleNamespace(time=0.5)
    monkeypatch.setattr(taylor, "integrator", lambda *of: flow)
    monkeypatch.setattr(taylor, "start", lambda *state: None)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, None))
    with pytest.raises(taylor.ReferenceFailed, match=r"t = 0\.5: the state is no longer finite"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)
    monkeypatch.setattr(taylor, "propagate", lambda flow, grid: (np.array([[1.0, 0.0], lost]), None, "too many steps"))
    with pytest.raises(taylor.ReferenceFailed, match="too many steps"):
        truths.truth(OSCILLATOR, LOOKED, 1.0)


def test_uncertainty_is_a_multiple_of_their_distance(monkeypatch):
    runs(monkeypatch, 1.0, 1.001)
    assert truths.truth(OSCILLATOR, END_STATE, 1.0).uncertainty == pytest.approx(3e-3)


# -- quantities --------------------------------------------------------------------------------------------------------


def rows(t, q, p, status="ok"):
    """A stand-in for a solution with these times and states."""
    return SimpleNamespace(t=np.array(t), q=np.array(q, float), p=np.array(p, float), status=status)


def test_questions_cover_problems_and_have_quantities():
    asked = {x.problem.partition(":")[0] for x in QUESTIONS}
    assert asked == set(PROBLEMS) - {"solar-system", "spinning-binary"}, "asked by the page of printed numbers; not yet"
    assert len({x.id for x in QUESTIONS}) == len(QUESTIONS) >= 20
    for x in QUESTIONS:
        assert x.problem in labels([x.problem])
        assert quantity(x.build_problem(), x.quantity).name == x.quantity
        assert list(x.accuracies) == sorted(x.accuracies, reverse=True)


def test_unknown_quantity_suggests_a_name():
    with pytest.raises(InvalidInput, match="perihelion"):
        quantity(problem("kepler"), "perihelium")
    assert "lyapunov" in quantities(problem("henon-heiles:chaotic"))
    assert "lyapunov" not in quantities(problem("henon-heiles:box"))


def test_state_and_energy_error_of_an_oscillator():
    made = problem("harmonic-oscillator")
    state, energy = (quantity(made, name) for name in ("end-state", "energy"))
    moved = rows([0.0, 1.0, pi], [[1.0], [-1.0], [-1.0]], [[0.0], [0.0], [0.25]])
    assert error(made, state, moved, Truth(np.array([-1.0, 0.0]), 0.0, "")) == 0.25
    assert error(made, energy, moved) == pytest.approx(0.25**2)  # the terms of H add up to H0 = 1/2
    moved.status = "diverged"
    assert error(made, energy, moved) == inf


def test_angles_are_compared_modulo_2_pi():
    made = problem("kepler")
    phase = quantity(made, "phase")
    assert distance(phase, np.array([pi - 1e-3]), np.array([-pi + 1e-3])) == pytest.approx(2e-3)
    assert distance(replace(phase, angle=False), np.array([3.0]), np.array([-3.0])) == 6.0


@pytest.mark.parametrize("anomaly", [0.0, 0.9, 2.5, 4.0])
def test_perihelion_of_a_rotated_ellipse(anomaly):
    """A point of the ellipse by its eccentric anomaly; the phase is the polar angle of the body."""
    made, angle, e = problem("kepler"), 0.7, 0.6
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    across, (c, s) = np.sqrt(1 - e * e), (np.cos(anomaly), np.sin(anomaly))
    q, p = turn @ [c - e, across * s], turn @ np.array([-s, across * c]) / (1 - e * c)
    turned = rows([0.0, 0.5, 1.0], [made.q0, [9.0, -2.0], q], [made.p0, [3.0, 4.0], p])
    assert values(made, quantity(made, "perihelion"), turned) == pytest.approx([angle])
    phase = np.arctan2(across * s, c - e) + angle
    assert distance(quantity(made, "phase"), values(made, quantity(made, "phase"), turned), np.array([phase])) < 1e-14


def test_averages_and_oscillatory_energies():
    """Time-weighted, in units of the terms of H; and a square of the state, relative to the first."""
    made = problem("kepler")  # e = 0.6 at the perihelion: p^2 / 2 = 2 and 1 / r = 2.5
    assert scale(made) == pytest.approx(2 + 2.5)
    moved = rows([0.0, 1.0, 4.0], [made.q0] * 3, [[2.0, 0.0], [2.0, 0.0], [0.0, 0.0]])
    assert values(made, AVERAGE, moved) == pytest.approx([(2 * 1 + 1 * 3) / 4 / scale(made)])
    made, k = problem("fpu"), np.arange(1, 22)
    moved = rows(k - 1, np.outer(k, made.q0), np.outer(k, made.p0))
    assert values(made, quantity(made, "adiabatic-invariant"), moved) == pytest.approx(k[1:] ** 2)


def test_section_ignores_motion_along_the_orbit():
    made = problem("henon-heiles:box")
    section, state = quantity(made, "section"), quantity(made, "end-state")
    early, late = (integrator("heyoka").run(made, t_end=t, save_every=0) for t in (10.0, 10.001))
    at = values(made, section, early)
    assert distance(section, at, values(made, section, late)) < 1e-13
    assert distance(state, values(made, state, early), values(made, state, late)) > 1e-5
    across = rows(early.t, early.q * [1, 1.001], early.p)
    assert distance(section, at, values(made, section, across)) > 1e-7


def test_rows_required_by_a_quantity():
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


def test_trajectory_is_compared_at_every_row():
    made = problem("pendulum:swinging")
    found = rows(range(21), np.zeros((21, 1)), np.zeros((21, 1)))
    found.p[7] = 0.5
    assert error(made, quantity(made, "trajectory"), found, Truth(np.zeros(40), 0.0, "a law")) == 0.5


@pytest.mark.parametrize(("doubt", "known"), [(1e-9, True), (0.5, False)])
def test_an_error_is_told_where_the_reference_resolves_it(monkeypatch, doubt, known):
    made = problem("harmonic-oscillator")
    wanted = quantity(made, "phase")
    true = Truth(truths.truth(made, wanted, 1.0).values, doubt, "made up")
    monkeypatch.setattr(truths, "truth", lambda *of: true)
    found = quantity_error(made, integrator("stormer-verlet"), wanted, 1.0, {"steps": 10})
    assert 1e-5 < found["error"] < 1e-3 if known else found["error"] is None
    assert found["uncertainty"] == doubt
