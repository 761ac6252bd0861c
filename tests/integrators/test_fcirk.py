"""Flow-composed implicit Runge-Kutta methods: the derivative of Kepler's flow, exactness, costs, no drift."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kepler_flow, kepler_tangent
from phasebench.integrators.stepping.kernel import array
from phasebench.integrators.systems.hamiltonian import Hamiltonian

MADE = problem("perturbed-kepler")


def record(stages: int):
    return method("fcirk", stages=stages)


# -- the derivative of Kepler's flow -----------------------------------------------------------------------------------


#: The speed of a parabola from the start below, where v^2 = 2 / r; the velocity is this times (0.1, 1, 0.05).
PARABOLIC = (2 / 1.05**0.5 / 1.0125) ** 0.5


@pytest.mark.parametrize(
    ("speed", "h"),
    [
        (1.1, -0.7),
        (0.9, 40.0),
        (PARABOLIC, 0.8),
        (1.9, -3.0),
    ],
)
def test_a_kick_is_transported_back_as_differences_say(speed, h):
    table = array(kepler_flow.constants(DOUBLE), DOUBLE)
    X, spans = np.zeros((4, 3)), np.zeros(3)
    X[0], X[1] = (1.0, 0.1, -0.2), (0.1 * 0.3, speed * 0.3, 0.05 * 0.3)
    mass, eps, kick, there = 0.3, 2.0**-52, np.array([0.02, -0.03, 0.01]), X.copy()
    kepler_tangent.move(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1)
    kepler_flow.advance(there, 0, 3, mass, 1.0, h, eps, table)
    assert np.abs(X[:2] - there[:2]).max() < 1e-12
    kepler_tangent.kick_back(X, 0, 3, mass, 1.0, h, eps, table, spans, 0, 1, kick, 2)
    ends, d = [], 1e-4
    for sign in (2, 1, -1, -2):
        Y = np.zeros((4, 3))
        Y[:2] = X[:2]
        Y[1] += sign * d * kick
        kepler_flow.advance(Y, 0, 3, mass, 1.0, -h, eps, table)
        ends.append(Y[:2].copy())
    expected = (8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * d)
    assert np.abs(X[2:4] - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(X[2:4]).max() > 1e-2


# -- runs --------------------------------------------------------------------------------------------------------------


def test_kepler_is_solved_exactly():
    made = problem("kepler", e=0.6)
    one, many = (integrate(made, "fcirk", h=30.0 / n, steps=n) for n in (7, 200))
    assert np.abs(one.q[-1] - many.q[-1]).max() < 1e-12
    assert one.counts["gradient"] <= 2 * 8 * 7


def error_and_cost(made, exact, id: str, h: float, T: float) -> tuple[float, int]:
    """(largest error of q at the time T, evaluations of the gradient) of a method with steps h."""
    s = integrate(made, id, h=h, t_end=T, save_every=0)
    return float(np.abs(s.q[-1] - exact.q[-1]).max()), s.counts["gradient"]


def test_an_eccentric_orbit_at_equal_steps_and_at_equal_costs():
    """What Kepler's flow takes from Gauss's method, at e = 0.6; Wisdom and Holman's splitting has as many gradients."""
    exact = integrate(MADE, "gauss-8", h=0.02, t_end=20.0, save_every=0)
    mine, costs = error_and_cost(MADE, exact, "fcirk", 0.2, 20.0)
    gauss, more = error_and_cost(MADE, exact, "gauss-8", 0.2, 20.0)
    split, as_many = error_and_cost(MADE, exact, "wisdom-holman", 0.2 / 40, 20.0)
    assert mine < 1e-10
    assert gauss > 5 * mine
    assert more > costs
    assert split > 1e4 * mine
    assert as_many > 0.9 * costs


def test_energy_and_angular_momentum_do_not_drift():
    s = integrate(MADE, record(3), h=0.1, steps=20_000, save_every=10)
    E, L = s.energy(), s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
    assert np.abs(L - L[0]).max() < 1e-13
    assert abs(np.polyfit(s.t, E, 1)[0]) * s.t[-1] < 0.2 * np.ptp(E)
    assert np.ptp(E) < 1e-6


def test_a_system_without_a_kepler_part_is_refused():
    with pytest.raises(InvalidInput, match="Kepler part"):
        integrate(Hamiltonian(q="q", p="p", H="p**2/2 + q**4"), "fcirk", h=0.1, steps=3, q0=[0.1], p0=[0.2])
