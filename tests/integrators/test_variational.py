"""Galerkin variational integrators: stationarity of the discrete action, and those that are collocation methods."""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import variational
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from support.kinds import arrays_and_tuples_apart
from support.solutions import end

IDS = [m.id for m in METHODS if m.family == "variational"]
H, STEPS = 0.1, 40
ROUND_OFF = 1e-13


@cache
def end_of(id):
    system, q, p = SYSTEMS["henon-heiles"]()
    return end(integrate(system, id, h=H, steps=STEPS, q0=q, p0=p))


def test_with_minimal_quadrature_it_is_a_known_method():
    # Marsden & West 2001, 2.6.6; Ober-Bloebaum & Saake 2015
    for id, other in {
        "variational-midpoint": "implicit-midpoint",
        "variational-trapezoidal": "stormer-verlet",
        "variational-gauss-2": "gauss-2",
        "variational-gauss-3": "gauss-3",
        "variational-lobatto-3": "lobatto-iiia-iiib-3",
        "variational-lobatto-4": "lobatto-iiia-iiib-4",
    }.items():
        assert np.abs(end_of(id) - end_of(other)).max() < ROUND_OFF, id
        assert np.abs(end_of(id) - end_of("variational-2-3")).max() > 1e-10, "more nodes make a new method"


def test_coefficients_satisfy_symplecticity_conditions():
    for id in IDS:
        degree, quadrature, nodes = method(id).data
        points = variational.QUADRATURES[quadrature](nodes, 60)
        *rows, last, _ = variational.coefficients(degree, points)
        with mpmath.workdps(60):
            for i, (c, _) in enumerate(points):
                assert abs(last[i] - (1 - c)) < 1e-55
                assert abs(rows[i][nodes] - c) < 1e-55
                for j in range(i):
                    assert abs(rows[i][j] - rows[j][i] - (c - points[j][0])) < 1e-55


# -- the solver, long runs, arrays ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id", "numerator"), [("variational-midpoint", (1, 1 / 2)), ("variational-gauss-2", (1, 1 / 2, 1 / 12))]
)
def test_newton_takes_over_for_stiff_forces(id, numerator):
    """For y' = Ky Gauss methods are diagonal Pade approximations of exp; here h omega = 20."""
    w = 200.0
    system = Hamiltonian(q="q1 q2", p="p1 p2", H="(p1**2 + p2**2 + 40000*q1**2 + q2**2)/2")
    s = integrate(system, id, h=H, steps=3, q0=[0.01, 0.5], p0=[1.0, 0.3])
    assert s.status == "ok", s.reason
    assert s.counts["newton"] == 3
    for i, omega in enumerate((w, 1.0)):
        z = H * np.array([[0, 1], [-(omega**2), 0]])
        above, below = (sum(a * np.linalg.matrix_power(f * z, k) for k, a in enumerate(numerator)) for f in (1, -1))
        y = np.linalg.matrix_power(np.linalg.solve(below, above), 3) @ [(0.01, 0.5)[i], (1.0, 0.3)[i]]
        assert abs(s.q[-1, i] - y[0]) < 1e-12
        assert abs(s.p[-1, i] - y[1]) < 1e-10


@pytest.mark.parametrize(("id", "omega", "h"), [("variational-midpoint", 50, 0.02), ("variational-gauss-2", 100, 0.01)])
def test_a_force_at_its_round_off_level_can_be_solved(id, omega, h):
    """Near an equilibrium at q = 1 kicks are known only to the round-off of an increment divided by h."""
    system = Hamiltonian(q="q1", p="p1", H=f"(p1**2 + {omega**2}*(q1 - 1)**2)/2")
    for away in (1e-13, 1e-12):
        s = integrate(system, id, h=h, steps=60, q0=[1 + away], p0=[0.0])
        assert s.status == "ok", s.reason
        assert np.abs(s.q - 1).max() < 2 * away


def test_an_unsolvable_step_ends_with_a_status():
    """Q = q + h d p + h^2 a exp(Q) has no solution for large h."""
    repelled = Hamiltonian(q="q1 q2", p="p1 p2", H="(p1**2 + p2**2)/2 - exp(q1) - exp(q2)")
    ends = [integrate(repelled, "variational-gauss-2", h=h, steps=5, q0=[1.0] * 2, p0=[1.0] * 2) for h in (5.0, 0.01)]
    assert ends[0].status in ("not-converged", "diverged")
    assert ends[1].status == "ok", "the control"


@pytest.mark.parametrize("id", ["variational-gauss-2", "variational-2-3"])
def test_angular_momentum_has_no_trend(id):
    """Rounded products b_j (1 - c_j), in place of 1 - c_j times b_j F_j, give 5e-15 for Gauss 2."""
    made = problem("perturbed-kepler")
    s = integrate(made, id, h=0.02, steps=200_000, save_every=100)
    L = made.system.observe(made.invariants["angular-momentum"], s.q, s.p)
    assert np.abs(L - L[0]).max() < 3e-15


def test_arrays_and_tuples_agree():
    assert arrays_and_tuples_apart("variational-lobatto-3") < 1e-12
