"""EQUIP methods: the Runge-Kutta method for fixed alpha, a step, invariants, and steps without a root."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import tableaus
from phasebench.integrators.coefficients.trees import DIGITS, order_residual
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import equip as gauss_equip
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.records.collocation import METHODS
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import energy_errors, last

EPS = np.finfo(float).eps

BY_ID = {m.id: m for m in METHODS}
BOX = problem("henon-heiles:box")


def butcher(s, alpha):
    """(A(alpha), b) of the EQUIP method, arrays in the working precision: A(alpha) = P (X_s - alpha V) P^-1.

    P: Legendre polynomials at the s Gauss nodes; X_s: the Gauss method's matrix in this basis; V: one skew pair of
    entries.
    """
    A, _, b, c = tableaus.runge_kutta("gauss", s)
    P = mpmath.matrix([tableaus.legendre(s, x) for x in c])
    V = mpmath.zeros(s, s)
    V[s - 1, s - 2], V[s - 2, s - 1] = 1, -1
    A = P * (P**-1 * A * P - alpha * V) * P**-1
    return np.array(A.tolist(), dtype=object), np.array(list(b), dtype=object)


@pytest.mark.parametrize("s", [2, 3])
def test_a_fixed_alpha_is_symplectic_symmetric_of_order_2s_2(s):
    with mpmath.workdps(DIGITS):
        A, b = butcher(s, mpmath.mpf("0.03"))
        assert np.abs(b[:, None] * A + (b[:, None] * A).T - np.outer(b, b)).max() < 1e-45
        assert np.abs(A + A[::-1, ::-1] - b).max() < 1e-45
        assert order_residual(A, b, range(1, 2 * s - 1)) < 1e-45
        assert order_residual(A, b, [2 * s - 1]) > 1e-6
        assert order_residual(*butcher(s, 0), range(1, 2 * s + 1)) < 1e-45
        # The kernel has the same skew matrix.
        gauss, c = butcher(s, 0)[0], tableaus.runge_kutta("gauss", s)[3]
        S = np.array(gauss_equip.skew(s, c), dtype=object)
        assert np.abs(gauss - mpmath.mpf("0.03") * S * b - A).max() < 1e-45


#: A pendulum with a free particle; the step from this state has two roots.
TWO_ROOTS = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 - cos(q1)")
FROM = np.array([0.0663, 0.0, 1.6816, 0.0])


def test_the_nearer_of_two_roots_is_taken():
    """Both conserve the energy; the other root is at alpha = 0.017."""
    s = integrate(TWO_ROOTS, BY_ID["gauss-equip-3"], h=0.25, steps=1, q0=FROM[:2], p0=FROM[2:])
    assert -0.01 < s.parameter[0] < -0.008
    assert s.counts["fallbacks"] == 0
    assert abs(energy_errors(s)[1]) < 1e-15


def test_a_run_ends_at_an_unsolved_step():
    fall = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 - 1/q1")
    s = integrate(fall, BY_ID["gauss-equip-2"], h=0.5, steps=10, q0=[1.0, 0.1], p0=[0.5, 0.2])
    assert (s.status, s.counts["steps"], len(s.t)) == ("not-converged", 3, 4)
    assert np.isfinite(s.q).all()


# -- stages in lanes --------------------------------------------------------------------------------------------------


def laned() -> Hamiltonian:
    return Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/6 - cos(q1) - cos(q2) + sin(q1*q2)/10")


@pytest.mark.processor
def test_stages_in_lanes_reach_the_state_of_single_stages(monkeypatch):
    """Up to the round-off of the energy, which determines alpha, over fifty steps."""
    runs, state = [], {"q0": [0.7, 0.5], "p0": [0.2, -0.3]}
    for served in (True, False):
        monkeypatch.setattr(gauss_equip, "serves", lambda s, system, served=served: served)
        s = integrate(laned(), BY_ID["gauss-equip-3"], h=0.1, steps=50, **state)
        runs.append((last(s), s.counts))
    (lanes, n), (rows, m) = runs
    assert np.abs(lanes - rows).max() < 1e-12
    assert n["fallbacks"] == m["fallbacks"]
    assert max(n["gradient"], m["gradient"]) < 41.5 * 50, "attempts start from the last one (otherwise it is 43.5)"
    gauss = last(integrate(laned(), "gauss-3", h=0.1, steps=50, **state))
    assert np.abs(lanes - gauss).max() > 1e-10, "the control: without the parameter"


def test_the_tableau_of_every_alpha_is_exactly_symplectic():
    """Exactly, in double precision; the prepared tableau is unchanged, as other threads use it."""
    prepared = prepare(BY_ID["gauss-equip-3"], laned())
    kept = prepared.step.tableau.A.copy()
    layout = lay_out(prepared, 2, 0.3, np.array([0.7, 0.5]), np.array([0.2, -0.3]))
    parameter = np.zeros((1, 1))
    assert layout(np.zeros((1, 2)), np.zeros((1, 2)), parameter, 3) == (1, 0)
    assert abs(parameter[0, 0]) > 1e-6
    t = layout.step.tableau
    A, c = [[Fraction(x) for x in row] for row in t.A[:3, :3].T], [Fraction(x) for x in t.nodes[0, :3]]
    for i in range(3):
        for j in range(3):
            assert A[i][j] - A[j][i] == c[i] - c[j]
    assert t.nodes[2, :3].tolist() == [float(1 - x) for x in c]
    assert np.abs(t.A - kept).max() > 1e-7
    assert np.array_equal(prepared.step.tableau.A, kept)


# -- steps without a root ---------------------------------------------------------------------------------------------


def test_steps_without_a_root():
    """Such steps are Gauss steps and are counted; later steps restore the energy."""
    s = integrate(BOX, BY_ID["gauss-equip-2"], h=0.25, t_end=1000)
    lost = np.isnan(s.parameter)
    assert 0 < lost.sum() == s.counts["fallbacks"] < 0.05 * len(lost)
    assert gauss_equip.MISSED in s.reason
    error = np.abs(BOX.system.observe(BOX.system.H, s.q, s.p) - 0.02)[1:]
    assert error[~lost].max() < 1e-15
    assert 1e-10 < error[lost].max() < 1e-6
    n = np.flatnonzero(lost)[0]
    step = integrate(BOX, BY_ID["gauss-2"], h=0.25, steps=1, q0=s.q[n], p0=s.p[n])
    assert np.abs(step.q[-1] - s.q[n + 1]).max() < 4 * EPS
