"""EQUIP methods: the Runge-Kutta method for fixed alpha, a step, invariants, and steps without a root."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import tableaus
from phasebench.integrators.coefficients.trees import DIGITS, order_residual
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import equip as gauss_equip
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.records.collocation import METHODS
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import energy_errors, last

EPS = np.finfo(float).eps

BY_ID = {m.id: m for m in METHODS}
IDS = ["gauss-equip-2", "gauss-equip-3", "gauss-equip-4"]
BOX, KEPLER = problem("henon-heiles:box"), problem("perturbed-kepler")


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


def textbook_end(system, y, h, s, alpha):
    """The state after a step h from y of the EQUIP method of s stages with this alpha, by fixed-point iteration."""
    field = system.vector_field()
    A, b = (x.astype(float) for x in butcher(s, mpmath.mpf(float(alpha))))
    K = np.zeros((s, len(y)))
    for _ in range(60):
        K = np.array([field(0, y + h * (row @ K)) for row in A])
    return y + h * (b @ K)


@pytest.mark.parametrize("s", [2, 3, 4])
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


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", IDS[:2])
def test_a_step_is_the_formula_with_its_alpha(id, name):
    system, q, p = SYSTEMS[name]()
    h = 0.3
    solution = integrate(system, BY_ID[id], h=h, steps=1, q0=q, p0=p)
    alpha = float(solution.parameter[0])
    assert abs(energy_errors(solution)[1]) < 4 * EPS
    ends = []
    with precision(30):
        field = system.vector_field(MULTIPRECISION)
        for a in (mpmath.mpf(alpha), 0):
            A, b = butcher(*BY_ID[id].data, a)
            A, b = np.array([vector(row) for row in A]), vector(b)
            y, K = vector([*q, *p]), np.array([vector([0] * 2 * len(q)) for _ in b])
            for _ in range(120):
                K = np.array([field(0, y + h * (row @ K)) for row in A])
            ends.append((y + h * (b @ K)).astype(float))
    found = last(solution)
    assert np.abs(found - ends[0]).max() < 4 * EPS
    assert np.abs(found - ends[1]).max() > 1e3 * EPS, "the parameter made no difference: Gauss's step was tested"


#: Conserves N = (|q|^2 + |p|^2) / 2 besides H; no invariant is of the form q . D p.
ROTATION = Hamiltonian(
    q="q1 q2",
    p="p1 p2",
    H="(q1**2 + p1**2 + q2**2 + p2**2)/2 + (q1*q2 + p1*p2)**2/2 + (q1**2 + p1**2)**2/5",
    invariants=["(q1**2 + p1**2 + q2**2 + p2**2)/2"],
)


def errors(id):
    """(a run's solution, its largest energy error, the largest error of the system's other invariant).

    The energy error is that after steps whose parameter alpha could be found: other steps do not keep the energy.
    """
    s = integrate(ROTATION, BY_ID.get(id, id), h=0.25, steps=400, q0=[0.8, 0.1], p0=[-0.2, 0.6])
    N = ROTATION.observe(ROTATION.invariants[0], s.q, s.p)
    rooted = slice(1, None) if not id.startswith("gauss-equip") else np.flatnonzero(~np.isnan(s.parameter)) + 1
    return s, np.abs(energy_errors(s))[rooted].max(), np.abs(N - N[0]).max()


@pytest.mark.parametrize("id", IDS)
def test_energy_and_a_quadratic_invariant_are_conserved(id):
    s, energy, number = errors(id)
    assert s.counts["fallbacks"] == np.isnan(s.parameter).sum() < 0.05 * len(s.t)
    assert np.nanmax(np.abs(s.parameter)) > 1e-6
    assert max(energy, number) < 1e-14


def test_controls_gauss_cpg_and_rk4_do_not_conserve_both():
    (gauss, cpg, rk4) = (errors(id)[1:] for id in ("gauss-2", "cpg-2", "rk4"))
    assert gauss[0] > 1e-7 > 1e-14 > gauss[1]
    assert cpg[1] > 1e-7 > 1e-14 > cpg[0]
    assert min(rk4) > 1e-7


@pytest.mark.parametrize("id", IDS)
def test_perturbed_kepler_conserves_energy_and_momentum(id):
    s = integrate(KEPLER, BY_ID[id], h=0.1, t_end=200)
    L = KEPLER.system.observe(KEPLER.invariants["angular-momentum"], s.q, s.p)
    good = np.concatenate([[True], ~np.isnan(s.parameter)])
    assert good.mean() > 0.5, "most steps have a root"
    assert np.abs(energy_errors(s))[good].max() < 1e-14
    assert np.abs(L - L[0]).max() < 1e-14


#: A pendulum with a free particle; the step from this state has two roots.
TWO_ROOTS = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 - cos(q1)")
FROM = np.array([0.0663, 0.0, 1.6816, 0.0])


def test_control_the_energy_error_has_a_root_on_each_side():
    """Computed with the textbook formula for a step of length 1/4."""

    def energy(alpha):
        """Energy error of the step with parameter alpha."""
        states = np.array([FROM, textbook_end(TWO_ROOTS, FROM, 0.25, 3, alpha)])
        return np.diff(TWO_ROOTS.observe(TWO_ROOTS.H, states[:, :2], states[:, 2:]))[0]

    assert energy(-0.01) > 0 > energy(-0.008)
    assert energy(0.015) < 0 < energy(0.019)


def test_the_nearer_of_two_roots_is_taken():
    """Both conserve the energy; the other root is at alpha = 0.017."""
    s = integrate(TWO_ROOTS, BY_ID["gauss-equip-3"], h=0.25, steps=1, q0=FROM[:2], p0=FROM[2:])
    assert -0.01 < s.parameter[0] < -0.008
    assert s.counts["fallbacks"] == 0
    assert abs(energy_errors(s)[1]) < 1e-15


def test_a_run_ends_at_an_unsolved_step():
    """The first component falls into a singularity, the second is free."""
    fall = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 - 1/q1")
    s = integrate(fall, BY_ID["gauss-equip-2"], h=0.5, steps=10, q0=[1.0, 0.1], p0=[0.5, 0.2])
    assert (s.status, s.counts["steps"], len(s.t)) == ("not-converged", 3, 4)
    assert np.isfinite(s.q).all()


# -- stages in lanes --------------------------------------------------------------------------------------------------

LANED = {
    "kicks": "p1**2/2 + p2**2/6 - cos(q1) - cos(q2) + sin(q1*q2)/10",
    "both": "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)",
}


def of(name) -> Hamiltonian:
    """The system whose H has this name in `LANED`."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H=LANED[name])


@pytest.mark.processor
@pytest.mark.parametrize("name", LANED)
def test_stages_in_lanes_reach_the_state_of_single_stages(monkeypatch, name):
    """Up to the round-off of the energy, which determines alpha, over fifty steps."""
    runs, state = [], {"q0": [0.7, 0.5], "p0": [0.2, -0.3]}
    for served in (True, False):
        monkeypatch.setattr(gauss_equip, "serves", lambda s, system, served=served: served)
        s = integrate(of(name), BY_ID["gauss-equip-3"], h=0.1, steps=50, **state)
        runs.append((last(s), s.counts))
    (lanes, n), (rows, m) = runs
    assert np.abs(lanes - rows).max() < 1e-12
    assert n["fallbacks"] == m["fallbacks"]
    assert abs(n["gradient"] - m["gradient"]) <= 0.1 * m["gradient"]
    gauss = last(integrate(of(name), "gauss-3", h=0.1, steps=50, **state))
    assert np.abs(lanes - gauss).max() > 1e-10, "the control: without the parameter"


@pytest.mark.parametrize("name", LANED)
def test_the_tableau_of_every_alpha_is_exactly_symplectic(name):
    """Exactly, in double precision; the prepared tableau is unchanged, as other threads use it."""
    prepared = prepare(BY_ID["gauss-equip-3"], of(name))
    kept = prepared.step.tableau.A.copy()
    layout = lay_out(prepared, 2, 0.3, np.array([0.7, 0.5]), np.array([0.2, -0.3]))
    parameter = np.zeros((1, 1))
    assert layout(np.zeros((1, 2)), np.zeros((1, 2)), parameter, 3) == (1, 0)
    assert abs(parameter[0, 0]) > 1e-6
    t = layout.step.tableau
    A, c = [[Fraction(x) for x in row] for row in t.A[:3, :3].T], [Fraction(x) for x in t.nodes[0, :3]]
    for i in range(3):
        for j in range(3):
            assert A[i][j] - A[j][i] == c[i] - c[j] if name == "kicks" else A[i][j] + A[j][i] == 1
    assert t.nodes[2, :3].tolist() == ([float(1 - x) for x in c] if name == "kicks" else [0, 0, 0])
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


def test_control_such_a_step_has_no_root_nearby():
    """By the textbook formula the energy error has no sign change for alpha between -1/4 and 1/4 either."""
    s = integrate(BOX, BY_ID["gauss-equip-2"], h=0.25, t_end=1000)
    n = np.flatnonzero(np.isnan(s.parameter))[0]

    def energy(y, alpha):
        """Energy error after the step from y with parameter alpha."""
        new = textbook_end(BOX.system, y, 0.25, 2, alpha)
        return BOX.system.observe(BOX.system.H, new[None, :2], new[None, 2:])[0] - H0

    H0 = BOX.system.observe(BOX.system.H, s.q[:1], s.p[:1])[0]
    signs = {
        k: {energy(np.concatenate([s.q[k], s.p[k]]), a) > 0 for a in np.linspace(-0.25, 0.25, 101)} for k in (n, n - 5)
    }
    assert len(signs[n]) == 1
    assert len(signs[n - 5]) == 2
