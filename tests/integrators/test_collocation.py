"""Implicit Runge-Kutta methods, HBVM and cPG: tableaus, kernels against textbook formulas, conservation, round-off."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import comb, factorial
from unittest.mock import patch

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import exact_maps
from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.measure.metrics import slope
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.studies.extremes import round_off
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import dop853, quadrature, tableaus
from phasebench.integrators.coefficients.trees import DIGITS, order_residual, trees
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import gauss_lanes, path_lanes
from phasebench.integrators.families.stage_lanes import Lanes
from phasebench.integrators.records.collocation import METHODS, hbvm
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import energy_errors, rough_end

EPS = np.finfo(float).eps

BY_ID = {m.id: m for m in METHODS}
BOX, KEPLER = problem("henon-heiles:box"), problem("perturbed-kepler")


# -- coefficients -----------------------------------------------------------------------------------------------------

RULES = {quadrature.gauss_legendre: 1, quadrature.radau_right: 2, quadrature.gauss_lobatto: 3}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
@pytest.mark.parametrize("n", [3, 8])
def test_quadrature_rules_have_their_exact_degree(rule, n):
    with mpmath.workdps(DIGITS):
        nodes = rule(n, DIGITS)
        defect = [abs(mpmath.fsum(b * c**k for c, b in nodes) - mpmath.mpf(1) / (k + 1)) for k in range(2 * n + 1)]
    assert [c for c, _ in nodes] == sorted(c for c, _ in nodes)
    degree = 2 * n - RULES[rule]
    assert max(defect[: degree + 1]) < 1e-48
    assert defect[degree + 1] > 1e-12


def simplifying(A, b, c, orders):
    s, (p, q, r) = len(b), orders
    found = [mpmath.fsum(b[i] * c[i] ** (k - 1) for i in range(s)) - mpmath.mpf(1) / k for k in range(1, p + 1)]
    for i in range(s):
        for k in range(1, q + 1):
            found.append(mpmath.fsum(A[i, j] * c[j] ** (k - 1) for j in range(s)) - c[i] ** k / k)
        for k in range(1, r + 1):
            found.append(mpmath.fsum(b[j] * c[j] ** (k - 1) * A[j, i] for j in range(s)) - b[i] * (1 - c[i] ** k) / k)
    return max(map(abs, found))


#: (kind, s, whether A is that of p), (p, q, r) of B(p), C(q), D(r): Hairer & Wanner (1996), table IV.5.13.
CONDITIONS = [
    *((("gauss", s, False), (2 * s, s, s)) for s in range(1, 9)),
    *((("radau-iia", s, False), (2 * s - 1, s, s - 1)) for s in (2, 3)),
    *((("lobatto-iiia-iiib", s, False), (2 * s - 2, s, s - 2)) for s in (2, 3, 4)),
    *((("lobatto-iiia-iiib", s, True), (2 * s - 2, s - 2, s)) for s in (2, 3, 4)),
]


@pytest.mark.parametrize(("which", "orders"), CONDITIONS)
def test_simplifying_assumptions(which, orders):
    kind, s, second = which
    with mpmath.workdps(DIGITS):
        A, conjugate, b, c = tableaus.runge_kutta(kind, s)
        A = conjugate if second else A
        assert simplifying(A, b, c, orders) < 1e-45
        for k in range(3):
            beyond = [p + (i == k) for i, p in enumerate(orders)]
            assert simplifying(A, b, c, beyond) > 1e-12, "it satisfies more than it should"
        for M in (A, b, c):
            for i in range(s * s if M is A else s):
                place = divmod(i, s) if M is A else i
                kept, M[place] = M[place], M[place] + mpmath.mpf("1e-12")
                assert simplifying(A, b, c, orders) > 1e-16, f"coefficient {place} may be wrong"
                M[place] = kept


UNIT = mpmath.mpf(2) ** -52


def dop853_arrays():
    rows = np.array([[mpmath.mpf(0) + x for x in row] for row in dop853.tableau()], dtype=object)
    return rows[:-1], rows[-1]


def test_dop853_satisfies_the_order_conditions_up_to_8_only():
    assert sum(len(trees(n)) for n in range(1, 9)) == 200
    with mpmath.workdps(DIGITS):
        A, b = dop853_arrays()
        assert order_residual(A, b, range(1, 9)) < 1e-48
        assert order_residual(A, b, [9]) > 1e-8
        root = mpmath.sqrt(6)
        c = [A[i].sum() for i in range(12)]
        assert max(abs(c[3] - (6 - root) / 30), abs(c[4] - (6 + root) / 30), abs(c[8] - mpmath.mpf(127) / 195)) < 1e-48


def test_dop853_has_the_published_numbers():
    from scipy.integrate import DOP853

    A, b = (x.astype(float) for x in dop853_arrays())
    assert np.abs(A - DOP853.A[:12, :12]).max() <= 64 * EPS
    assert np.abs(b - DOP853.B[:12]).max() <= 8 * EPS


def test_control_any_wrong_coefficient_of_dop853_is_seen():
    with mpmath.workdps(25):
        A, b = dop853_arrays()
        for M, place in [(x, place) for x in (A, b) for place in zip(*np.nonzero(x), strict=True)]:
            kept, M[place] = M[place], M[place] * (1 + mpmath.mpf("1e-12"))
            assert any(order_residual(A, b, [n]) > 1e-18 for n in range(1, 9)), place
            M[place] = kept


# -- round-off --------------------------------------------------------------------------------------------------------


def doubles(id, system):
    """The coefficients that a method's kernel uses in double precision: (A for q, A for p, nodes c, weights of q)."""
    step = prepare(BY_ID[id], system).step
    if isinstance(step, Lanes):  # lane i of row j holds A_ij
        s = step.stages
        return step.A[:s, :s].T, step.A[:s, :s].T, step.nodes[0, :s], step.nodes[2, :s]
    return step.A_q, step.A_p, step.c[:, 0], step.weights[0]


def exactly_symplectic(id, system):
    A, B, c, w = doubles(id, system)
    if system.separable:
        exact = [[Fraction(a) - Fraction(b) for a, b in zip(*rows, strict=True)] for rows in zip(A, A.T, strict=True)]
        nodes = [Fraction(x) for x in c]
        return w.tolist() == [float(1 - x) for x in nodes] and all(
            exact[i][j] == x - y for i, x in enumerate(nodes) for j, y in enumerate(nodes)
        )
    return all(Fraction(a) + Fraction(b) == 1 for a, b in zip(A.ravel(), B.T.ravel(), strict=True))


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", ["gauss-1", "gauss-2", "gauss-3", "gauss-8", "lobatto-iiia-iiib-3", "radau-iia-3"])
def test_double_coefficients_are_symplectic_if_declared(id, name):
    assert exactly_symplectic(id, SYSTEMS[name]()[0]) == BY_ID[id].symplectic


def test_double_weights_of_symmetric_rules_add_up_to_1():
    for m in METHODS:
        if m.data[0] in tableaus.SYMMETRIC:
            kind, s, *_ = m.data
            B = tableaus.tableau(kind, s, s, False, 40, UNIT).B
            b, exact = [Fraction(float(B[i][i])) for i in range(s)], tableaus.runge_kutta(kind, s)[2]
            assert sum(b) == 1, m.id
            assert b == b[::-1], m.id
            assert max(abs(float(x - float(y))) for x, y in zip(b, exact, strict=True)) < 2e-16, m.id


def phase_error(id):
    h, n = 0.0887654321, 16384
    Q, P = round_off.run(id, {}, h, n, round_off.starts(40), 1)
    with mpmath.workdps(exact_maps.DIGITS):
        phase = exact_maps.errors(exact_maps.exact_matrix(id, {}, h), np.array([0, n]), Q, P)[1][:, -1]
    return abs(phase.mean()) / (phase.std() / 40**0.5)


def test_the_phase_error_has_no_bias(monkeypatch):
    laned = gauss_lanes.build_lanes

    def spoiled(*arguments):
        step = laned(*arguments)
        step.nodes[4] = 0.0  # no lane compensates the rounding of the weights
        return step

    tableaus.tableau.cache_clear()
    assert phase_error("gauss-4") < 4
    with monkeypatch.context() as patch:
        patch.setattr(gauss_lanes, "build_lanes", spoiled)
        tableaus.tableau.cache_clear()
        assert phase_error("gauss-4") > 20
    tableaus.tableau.cache_clear()


def test_the_energy_error_of_gauss_6_is_a_random_walk():
    """Brouwer's law. h is not a simple fraction: products of a double and h = 1/10 have a biased round-off."""
    random, errors = np.random.default_rng(0), []
    for _ in range(16):
        q, p = (np.array(x) * (1 + 0.02 * random.standard_normal(2)) for x in (BOX.q0, BOX.p0))
        s = integrate(BOX, BY_ID["gauss-6"], h=0.09, steps=50_000, save_every=500, q0=q, p0=p)
        E = BOX.system.observe(BOX.system.H, s.q, s.p)
        errors.append((E[1:] - E[0]) / E[0])
    errors = np.array(errors)
    growth = slope(np.log(np.arange(1, 101)), 0.5 * np.log((errors**2).mean(0)))
    assert 0.3 < growth.value < 0.7
    assert abs(errors[:, -1].mean()) < 4 * errors[:, -1].std() / 16**0.5
    assert np.abs(errors).max() < 2e-14


# -- the kernel -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
def test_methods_that_are_one(name):
    """HBVM with s nodes is Gauss's method, the Petrov-Galerkin method of degree 1 the averaged vector field method."""
    made, q, p = SYSTEMS[name]()
    for one, other in ((hbvm(2, 2), "gauss-2"), ("cpg-1", "avf")):
        ends = [rough_end(integrate(made, m, h=0.1, steps=50, q0=q, p0=p)) for m in (one, other)]
        assert np.abs(ends[0] - ends[1]).max() < 1e-13


def test_hbvm_converges_to_cpg():
    limit = rough_end(integrate(KEPLER, BY_ID["cpg-2"], h=0.1, steps=20))
    found = [integrate(KEPLER, hbvm(k, 2), h=0.1, steps=20) for k in (2, 3, 4, 6, 12)]
    distance = [np.abs(rough_end(s) - limit).max() for s in found]
    lost = [np.abs(energy_errors(s)).max() for s in found]
    assert all(b < 0.5 * a for a, b in pairwise(distance))
    assert all(b < 0.5 * a for a, b in pairwise(lost))
    assert max(distance[-1], lost[-1]) < 1e-14
    assert min(distance[0], lost[0]) > 1e-7


def planar(rest):
    """H = |p|^2/2 + rest with d = 2, a common d so that compiled kernels are shared."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H=f"p1**2/2 + p2**2/2 + {rest}")


def test_hbvm_conserves_polynomials_up_to_degree_4_only():
    """HBVM(k, s) conserves a polynomial H of degree 2k/s at most."""
    lost = {}
    for name, V in (("quartic", "q1**2/2 + q1**4 + q1**2*q2**2/3"), ("sextic", "q1**2/2 + q1**6 + q1**2*q2**2/3")):
        system = planar(V)
        s = integrate(system, BY_ID["hbvm-4-2"], h=0.5, steps=200, q0=[0.8, 0.4], p0=[0.3, 0.1])
        lost[name] = np.abs(energy_errors(s)).max()
    assert lost["quartic"] < 1e-14
    assert lost["sextic"] > 1e-13


# -- Newton's method --------------------------------------------------------------------------------------------------

OMEGA = 50


@pytest.mark.parametrize(("s", "h"), [(1, 0.2), (2, 0.8), (4, 0.8)])
def test_newton_converges_where_fixed_point_iteration_fails(s, h):
    """h omega = 10 and 40; a step is the diagonal Pade approximation of exp(i h omega), of modulus 1."""
    oscillator, state = planar(f"{OMEGA**2}*(q1**2 + q2**2)/2"), {"q0": [1.0, 0.5], "p0": [0.0, 0.0]}
    found = integrate(oscillator, BY_ID[f"gauss-{s}"], h=h, steps=20, **state)
    assert found.counts["newton"] == 20
    z = 1j * h * OMEGA
    step = np.polyval(exp_pade(s), z) / np.polyval(exp_pade(s), -z)
    expected = np.kron([(step**20).real, -OMEGA * (step**20).imag], state["q0"])
    assert np.abs(rough_end(found) - expected).max() < 1e-11 * OMEGA
    assert integrate(oscillator, BY_ID[f"gauss-{s}"], h=0.002, steps=20, **state).counts["newton"] == 0


def exp_pade(s):
    return [comb(s, k) * factorial(2 * s - k) / factorial(2 * s) for k in range(s, -1, -1)]


# -- starting values -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("id", "most"), [("radau-iia-3", 20), ("hbvm-4-2", 28)])
def test_extrapolated_starts_save_evaluations(id, most):
    """Wrongly extrapolated starts take 30 and 32 evaluations per step."""
    system, q, p = SYSTEMS["coupled"]()
    with patch.object(path_lanes, "serves", lambda *_: False):
        short, long = (integrate(system, id, h=h, steps=20, q0=q, p0=p).counts for h in (0.02, 0.1))
    assert short["gradient"] < most * 20
    assert short["newton"] == long["newton"] == 0
