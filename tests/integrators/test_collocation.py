"""Implicit Runge-Kutta methods, HBVM and cPG: tableaus, kernels against textbook formulas, conservation, round-off."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import pairwise, product
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
from phasebench.integrators.coefficients.trees import DIGITS, order_residual, trees, vector
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import collocation, gauss_lanes, path_lanes, stage_lanes
from phasebench.integrators.families.stage_lanes import Lanes
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.records.collocation import METHODS, hbvm
from phasebench.integrators.stepping.kernel import COUNTS, prepare
from phasebench.integrators.values.lanes import put
from phasebench.integrators.values.vector import jit
from support.solutions import energy_errors, rough_end
from support.values import value

EPS = np.finfo(float).eps

BY_ID = {m.id: m for m in METHODS}
BOX, KEPLER = problem("henon-heiles:box"), problem("perturbed-kepler")


# -- coefficients -----------------------------------------------------------------------------------------------------

RULES = {quadrature.gauss_legendre: 1, quadrature.radau_right: 2, quadrature.gauss_lobatto: 3}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_quadrature_rules_have_their_exact_degree(rule, n):
    with mpmath.workdps(DIGITS):
        nodes = rule(n, DIGITS)
        defect = [abs(mpmath.fsum(b * c**k for c, b in nodes) - mpmath.mpf(1) / (k + 1)) for k in range(2 * n + 1)]
    assert [c for c, _ in nodes] == sorted(c for c, _ in nodes)
    degree = 2 * n - RULES[rule]
    assert max(defect[: degree + 1]) < 1e-48
    assert defect[degree + 1] > 1e-12


def test_legendre_polynomials_are_orthonormal():
    def P(i):
        return lambda c: quadrature.legendre(4, c)[i]

    with mpmath.workdps(DIGITS):
        for i in range(4):
            products = [mpmath.quad(lambda c, i=i, j=j: P(i)(c) * P(j)(c), [0, 1]) for j in range(4)]
            assert max(abs(x - (i == j)) for j, x in enumerate(products)) < 1e-45
            assert abs(mpmath.quad(P(i), [0, 0.3]) - quadrature.legendre_integrals(4, mpmath.mpf(0.3))[i]) < 1e-45


def simplifying(A, b, c, orders):
    """Largest residual of the simplifying assumptions B(p), C(q), D(r), with ``orders`` = (p, q, r)."""
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
    """The tableaus satisfy the assumptions B, C and D; control: one wrong coefficient violates them."""
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


@pytest.mark.parametrize(("kind", "s"), [("gauss", 2), ("gauss", 3), ("gauss", 5), ("lobatto-iiia-iiib", 3)])
def test_rounded_coefficients_are_exactly_symplectic(kind, s):
    """a^q_ij / b_j + a^p_ji / b_i = 1 exactly, for multiples of the unit within half a unit of the exact numbers."""
    made = tableaus.tableau(kind, s, s, False, DIGITS, UNIT)
    with mpmath.workdps(DIGITS):
        A, conjugate, b, _ = tableaus.runge_kutta(kind, s)
        for i in range(s):
            for j in range(s):
                assert made.A_q[i][j] + made.A_p[j][i] == 1
                assert made.A_q[i][j] / UNIT == mpmath.nint(made.A_q[i][j] / UNIT)
                gaps = made.A_q[i][j] - A[i, j] / b[j], made.A_p[i][j] - conjugate[i, j] / b[j]
                assert max(map(abs, gaps)) <= UNIT / 2
        assert made.weights == ((1,) * s,) * 2
        assert distance(made.B, np.diag(list(b))) <= UNIT / 2
        assert mpmath.fsum(made.B[i][i] for i in range(s)) == 1


@pytest.mark.parametrize("digits", [30, 60])
def test_coefficients_have_full_precision(digits):
    """Radau quadrature with three nodes integrates powers up to 4 to the digits in use."""
    with codegen.precision(digits):
        step = prepare(BY_ID["radau-iia-3"], SYSTEMS["coupled"]()[0], codegen.MULTIPRECISION).step
        for k in range(5):
            integral = sum(step.B[i, i] * c**k for i, (c,) in enumerate(step.c))
            assert abs((k + 1) * integral - 1) < 10.0 ** (2 - digits)


@pytest.mark.parametrize("s", [1, 2, 3, 4])
def test_rounded_nystrom_coefficients_are_exactly_symplectic(s):
    """a_ij - a_ji = c_i - c_j exactly, with weights 1 - c_j, in numbers near the exact coefficients."""
    made = tableaus.tableau("gauss", s, s, True, DIGITS, UNIT)
    for i in range(s):
        assert made.weights[0][i] == 1 - made.c[i]
        for j in range(s):
            assert made.A_q[i][j] - made.A_q[j][i] == made.c[i] - made.c[j]
    with mpmath.workdps(DIGITS):
        A, _, b, c = tableaus.runge_kutta("gauss", s)
        squared = A * A
        exact = [[squared[i, j] / b[j] for j in range(s)] for i in range(s)]
        assert distance(made.A_q, exact) <= 2 * UNIT
        assert 0 < distance([made.c], [c]) <= UNIT or s == 1
        lobatto = tableaus.tableau("lobatto-iiia-iiib", 3, 3, True, DIGITS, UNIT)
        assert distance([lobatto.weights[0]], [[1, HALF, 0]]) < 1e-45


HALF = mpmath.mpf(1) / 2


@pytest.mark.parametrize("nystrom", [False, True])
@pytest.mark.parametrize(("s", "k"), [(1, 1), (1, 4), (2, 3), (3, 6)])
def test_rounded_hbvm_rules_integrate_linear_functions(s, k, nystrom):
    """With rounded coefficients the weights still sum to 1, the rule is symmetric, and linear functions are exact."""
    made = tableaus.tableau("hbvm", s, k, nystrom, DIGITS, UNIT)
    b, c = [row[0] for row in made.B], made.c
    assert mpmath.fsum(b) == 1
    assert mpmath.fsum(x * y for x, y in zip(b, c, strict=True)) == HALF
    assert (b, [1 - x for x in c]) == (b[::-1], [*c][::-1])
    assert made.weights[1] == (1, *[0] * (s - 1))
    with mpmath.workdps(DIGITS):
        rule = quadrature.gauss_legendre(k, DIGITS)
        assert distance([c, b], [[x for x, _ in rule], [y for _, y in rule]]) <= UNIT
        if nystrom:
            first = [made.weights[0][0], *(row[0] for row in made.A_q)]
            wanted = [HALF, *(x**2 / 2 if s > 1 else x / 2 for x in c)]
            assert distance([first], [wanted]) <= 2 * UNIT
        else:
            assert [row[0] for row in made.A_q] == [*c]
            assert made.weights[0] == made.weights[1]


def distance(found, wanted):
    """Largest difference of two matrices given by rows."""
    pairs = [(x, y) for row, other in zip(found, wanted, strict=True) for x, y in zip(row, other, strict=True)]
    return max(abs(x - y) for x, y in pairs)


def dop853_arrays():
    """(A, b) of DOP853 as arrays of mpmath numbers."""
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
    """Whether the symplecticity conditions hold exactly for the rounded coefficients."""
    A, B, c, w = doubles(id, system)
    if system.separable:
        exact = [[Fraction(a) - Fraction(b) for a, b in zip(*rows, strict=True)] for rows in zip(A, A.T, strict=True)]
        nodes = [Fraction(x) for x in c]
        return w.tolist() == [float(1 - x) for x in nodes] and all(
            exact[i][j] == x - y for i, x in enumerate(nodes) for j, y in enumerate(nodes)
        )
    return all(Fraction(a) + Fraction(b) == 1 for a, b in zip(A.ravel(), B.T.ravel(), strict=True))


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", [m.id for m in METHODS if m.data[0] in ("gauss", "lobatto-iiia-iiib", "radau-iia")])
def test_double_coefficients_are_symplectic_if_declared(id, name):
    assert exactly_symplectic(id, SYSTEMS[name]()[0]) == BY_ID[id].symplectic


def mean_momentum_error(id):
    """(mean, standard error) of the error of angular momentum at the end of long runs from ten states."""
    random, errors = np.random.default_rng(0), []
    for _ in range(10):
        q, p = (np.array(x) * (1 + 0.02 * random.standard_normal(2)) for x in (KEPLER.q0, KEPLER.p0))
        s = integrate(KEPLER, id, h=0.019, steps=200_000, save_every=1000, q0=q, p0=p)
        L = KEPLER.system.observe(KEPLER.invariants["angular-momentum"], s.q, s.p)
        errors.append(L[-20:].mean() - L[0])
    return np.mean(errors), np.std(errors) / 10**0.5


def test_angular_momentum_does_not_drift(monkeypatch):
    """The mean error of long runs is not significant; control: with plainly rounded coefficients it is."""
    mean, doubt = mean_momentum_error(BY_ID["gauss-2"])
    assert abs(mean) < 4 * doubt
    with monkeypatch.context() as patch:
        patch.setattr(tableaus, "nystrom_rounded", lambda A, c, unit: (A, c))
        tableaus.tableau.cache_clear()
        plain, plain_doubt = mean_momentum_error(BY_ID["gauss-2"])
    tableaus.tableau.cache_clear()
    assert abs(plain) > 5 * plain_doubt
    assert abs(plain) > 5 * abs(mean)


#: Round and arbitrary step sizes, some near powers of two.
LENGTHS = (0.1, 0.0987654321, 0.1234567891, 0.5000000001, 0.9999999999, 7.0 / 3, -0.3)


@pytest.mark.parametrize("s", range(2, 9))
def test_weights_of_lanes_add_up_to_the_step(s):
    step = gauss_lanes.build_lanes(s, SYSTEMS["henon-heiles"]()[0], codegen.DOUBLE)
    for h in LENGTHS:
        table = np.ones((1, len(step.like)))
        write_weights(step, h, table)
        found = [Fraction(x) for x in table[0].tolist()]
        assert sum(found) == Fraction(h)
        assert found[:s] == found[s - 1 :: -1]
        assert not any(found[s:])
        plain = [h * float(b) for _, b in quadrature.gauss_legendre(s)]
        assert np.abs(np.array(found[:s], float) - plain).max() <= EPS * abs(h)


@jit
def write_weights(step, h, table):
    put(table, 0, stage_lanes.exact_weights(step, h), step.like)


@pytest.mark.parametrize("id", [m.id for m in METHODS if m.data[0] in tableaus.SYMMETRIC])
def test_double_weights_of_symmetric_rules_add_up_to_1(id):
    kind, s, *_ = BY_ID[id].data
    B = tableaus.tableau(kind, s, s, False, 40, UNIT).B
    b, exact = [Fraction(float(B[i][i])) for i in range(s)], tableaus.runge_kutta(kind, s)[2]
    assert sum(b) == 1
    assert b == b[::-1]
    assert max(abs(float(x - float(y))) for x, y in zip(b, exact, strict=True)) < 2e-16


def phase_error(id):
    """Mean phase error on the oscillator over many starts, in units of its standard error."""
    h, n = 0.0887654321, 16384
    Q, P = round_off.run(id, {}, h, n, round_off.starts(40), 1)
    with mpmath.workdps(exact_maps.DIGITS):
        phase = exact_maps.errors(exact_maps.exact_matrix(id, {}, h), np.array([0, n]), Q, P)[1][:, -1]
    return abs(phase.mean()) / (phase.std() / 40**0.5)


@pytest.mark.parametrize("lanes", [True, False])
def test_the_phase_error_has_no_bias(monkeypatch, lanes):
    """The mean phase error is not significant; control: with plainly rounded weights it is."""
    if not lanes:
        monkeypatch.setattr(gauss_lanes, "serves", lambda s, system: False)
    laned = gauss_lanes.build_lanes

    def spoiled(*arguments):
        step = laned(*arguments)
        step.nodes[4] = 0.0  # no lane compensates the rounding of the weights
        return step

    tableaus.tableau.cache_clear()
    assert phase_error("gauss-4") < 4
    with monkeypatch.context() as patch:
        if lanes:
            patch.setattr(gauss_lanes, "build_lanes", spoiled)
        else:
            patch.setattr(tableaus, "rounded_weights", lambda b, unit: b)
        tableaus.tableau.cache_clear()
        assert phase_error("gauss-4") > 20
    tableaus.tableau.cache_clear()


def test_the_energy_error_of_gauss_6_is_a_random_walk():
    """Brouwer's law. h is not a simple fraction: products of a double and h = 1/10 have a biased round-off."""
    random, errors = np.random.default_rng(0), []
    for _ in range(40):
        q, p = (np.array(x) * (1 + 0.02 * random.standard_normal(2)) for x in (BOX.q0, BOX.p0))
        s = integrate(BOX, BY_ID["gauss-6"], h=0.09, steps=100_000, save_every=1000, q0=q, p0=p)
        E = BOX.system.observe(BOX.system.H, s.q, s.p)
        errors.append((E[1:] - E[0]) / E[0])
    errors = np.array(errors)
    growth = slope(np.log(np.arange(1, 101)), 0.5 * np.log((errors**2).mean(0)))
    assert 0.3 < growth.value < 0.7
    assert abs(errors[:, -1].mean()) < 4 * errors[:, -1].std() / 40**0.5
    assert np.abs(errors).max() < 2e-14


# -- the kernel -------------------------------------------------------------------------------------------------------


#: Hessians K of H = (p, q) K (p, q)/2 in q1, q2, p1, p2; the unknowns are the kicks, or both increments.
HESSIANS = {
    "kicks": np.array([[2.0, 0.5, 0, 0], [0.5, 3.0, 0, 0], [0, 0, 1.0, 0.2], [0, 0, 0.2, 0.5]]),
    "increments": np.array([[2.0, 0.5, 0.3, 0], [0.5, 3.0, 0, -0.4], [0.3, 0, 1.0, 0.2], [0, -0.4, 0.2, 0.5]]),
}


@cache
def quadratic(name):
    """The system with quadratic H whose matrix of second derivatives has this name in `HESSIANS`."""
    q, p = ["q1", "q2"], ["p1", "p2"]
    terms = zip(HESSIANS[name].ravel() / 2, product(q + p, repeat=2), strict=True)
    return Hamiltonian(q=q, p=p, H=" + ".join(f"({k})*{a}*{b}" for k, (a, b) in terms if k))


def stages(id, name, h=0.5):
    """(stage equations of one step on a quadratic H, first row of their random increments); earlier rows hold 9."""
    prepared = collocation.prepare_stage_by_stage(BY_ID[id], quadratic(name), codegen.DOUBLE)
    step, s, at = prepared.step._replace(h=h, eps=EPS), prepared.stages, 3 * prepared.stages
    memory, q, p = np.full((at + 3 * s, prepared.width), 9.0), value(0.7, -0.2), value(0.4, 1.1)
    memory[at : at + s] = np.random.default_rng(s).normal(size=(s, prepared.width))
    v, counts = value(*h * HESSIANS[name][2:, 2:] @ p), np.zeros(1, COUNTS).view(np.recarray)[0]
    zero, like = value(0.0, 0.0), value(*[0.0] * prepared.width)
    return collocation.Equations(step, q, p, v, memory, zero, like, s, counts), at


def by_matrices(e, K, x):
    """The increments h B f that one sweep must return for increments x, from the tableau and the Hessian K."""
    step, h = e.step, e.step.h
    q, p = np.array(e.q), np.array(e.p)
    if step.field is None:
        return h * step.B.T @ -((q + h * (step.c * p + step.A_q @ x) @ K[2:, 2:]) @ K[:2, :2])
    slopes = np.hstack([q + step.A_q @ x[:, :2], p + step.A_p @ x[:, 2:]]) @ K
    return h * step.B.T @ np.hstack([slopes[:, 2:], -slopes[:, :2]])


@pytest.mark.parametrize("name", HESSIANS)
@pytest.mark.parametrize("id", ["gauss-3", "lobatto-iiia-iiib-3", "radau-iia-3", "hbvm-4-2", "hbvm-6-3"])
def test_a_sweep_evaluates_the_slopes_at_the_nodes(id, name):
    """A sweep writes h B f at the nodes, and returns the norms of the change and of the new increments."""
    (e, at), K = stages(id, name), HESSIANS[name]
    x = e.memory[at : at + e.stages].copy()
    told = collocation.sweep(e, at, at + e.stages)
    found = e.memory[at + e.stages : at + 2 * e.stages]
    assert found == pytest.approx(by_matrices(e, K, x), rel=1e-13, abs=1e-13)
    assert told == pytest.approx((np.abs(found - x).sum(), np.abs(found).sum()), rel=1e-13)
    assert np.array_equal(e.memory[at : at + e.stages], x)
    assert (e.memory[:at] == 9).all()


@pytest.mark.parametrize("name", HESSIANS)
@pytest.mark.parametrize("id", ["gauss-3", "lobatto-iiia-iiib-3", "radau-iia-3", "hbvm-4-2", "hbvm-6-3"])
def test_newtons_matrix_is_the_derivative(id, name):
    """The equations are linear, so differences over whole increments are exact."""
    (e, at), K = stages(id, name), HESSIANS[name]
    x = e.memory[at : at + e.stages].copy()
    matrix = np.zeros((x.size, x.size + 1))
    assert collocation.linearize(e, at, 1.0, matrix) == x.shape[1] + 2, "a sweep for each difference, and two"
    units = np.eye(x.size).reshape(-1, *x.shape)
    columns = [(unit - by_matrices(e, K, x + unit) + by_matrices(e, K, x)).ravel() for unit in units]
    assert matrix[:, :-1] == pytest.approx(np.transpose(columns), abs=1e-6)
    assert e.memory[at + e.stages : at + 2 * e.stages] == pytest.approx(by_matrices(e, K, x), rel=1e-13, abs=1e-13)
    assert np.array_equal(e.memory[at : at + e.stages], x)
    assert (e.memory[:at] == 9).all()


def textbook(system, kind, s, y, h):
    """One step k_i = f(y + h sum a_ij k_j) at 30 digits by fixed-point iteration."""
    d = system.d
    with codegen.precision(30):
        *tableau, b, _ = tableaus.runge_kutta(kind, s)
        matrices = [np.array([codegen.vector(row) for row in M.tolist()]) for M in tableau]
        y, weights = codegen.vector(y), codegen.vector(b)
        K = np.array([codegen.vector([0] * 2 * d) for _ in range(s)])
        field = system.vector_field(codegen.MULTIPRECISION)
        for _ in range(200):
            Z = [y + h * np.concatenate([matrices[0][i] @ K[:, :d], matrices[1][i] @ K[:, d:]]) for i in range(s)]
            new = np.array([field(0, z) for z in Z])
            change, K = np.abs(new - K).max(), new
            if change < 1e-27:
                return y + h * (weights @ K)
        raise AssertionError("the textbook's fixed point did not settle")


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", ["gauss-2", "gauss-5", "lobatto-iiia-iiib-3", "radau-iia-3"])
def test_a_step_equals_the_textbook_formula(id, name):
    """The stage equations are solved to round-off, in the Nystrom form and in the general one."""
    made, q, p = SYSTEMS[name]()
    y, h = vector([*q, *p]), 0.2
    expected = textbook(made, *BY_ID[id].data, y, h).astype(float)
    found = rough_end(integrate(made, BY_ID[id], h=h, steps=1, q0=q, p0=p))
    assert np.abs(found - expected).max() < 4 * EPS


@pytest.mark.parametrize("s", [1, 2, 3])
def test_hbvm_with_s_nodes_is_gauss(s):
    for name in ("henon-heiles", "coupled"):
        made, q, p = SYSTEMS[name]()
        ends = [rough_end(integrate(made, m, h=0.1, steps=50, q0=q, p0=p)) for m in (hbvm(s, s), BY_ID[f"gauss-{s}"])]
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


@pytest.mark.parametrize("name", ["perturbed-kepler", "coupled"])
def test_cpg_1_is_the_averaged_vector_field_method(name):
    made, q, p = SYSTEMS[name]()
    ends = [rough_end(integrate(made, m, h=0.1, steps=50, q0=q, p0=p)) for m in (BY_ID["cpg-1"], "avf")]
    assert np.abs(ends[0] - ends[1]).max() < 1e-14


def planar(rest):
    """H = |p|^2/2 + rest with d = 2, a common d so that compiled kernels are shared."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H=f"p1**2/2 + p2**2/2 + {rest}")


@pytest.mark.parametrize("id", [m.id for m in METHODS if m.id.startswith("hbvm")])
def test_hbvm_conserves_polynomials_up_to_degree_4_only(id):
    """HBVM(k, s) conserves a polynomial H of degree 2k/s at most, which is 4 for all of these methods."""
    lost = {}
    for name, V in (("quartic", "q1**2/2 + q1**4 + q1**2*q2**2/3"), ("sextic", "q1**2/2 + q1**6 + q1**2*q2**2/3")):
        system = planar(V)
        s = integrate(system, BY_ID[id], h=0.5, steps=200, q0=[0.8, 0.4], p0=[0.3, 0.1])
        lost[name] = np.abs(energy_errors(s)).max()
    assert lost["quartic"] < 1e-14
    assert lost["sextic"] > 1e-13


@pytest.mark.parametrize("id", [m.id for m in METHODS if m.id.startswith("cpg")])
@pytest.mark.parametrize("name", ["perturbed-kepler", "coupled"])
def test_cpg_conserves_every_energy(id, name):
    made, q, p = SYSTEMS[name]()
    s = integrate(made, BY_ID[id], h=0.1, steps=1000, q0=q, p0=p)
    assert s.counts["fallbacks"] == 0
    assert np.abs(energy_errors(s)).max() < 1e-14


def test_gauss_8_reaches_round_off_with_large_steps():
    wide, control = (integrate(BOX, BY_ID[id], h=0.6, t_end=300) for id in ("gauss-8", "gauss-3"))
    assert np.abs(rough_end(wide) - rough_end(integrate(BOX, BY_ID["gauss-8"], h=0.3, t_end=300))).max() < 1e-11
    assert np.abs(energy_errors(wide)).max() < 1e-15
    assert np.abs(energy_errors(control)).max() > 1e-10


# -- Newton's method --------------------------------------------------------------------------------------------------

OMEGA = 50


@pytest.mark.parametrize("s", [1, 2, 4])
@pytest.mark.parametrize("h", [0.2, 0.8])
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
    """Coefficients of the numerator of the diagonal Pade approximation of exp, highest power first."""
    return [comb(s, k) * factorial(2 * s - k) / factorial(2 * s) for k in range(s, -1, -1)]


NYSTROM, GENERAL = "q1**4", "q1**2*p1**2/10"


def stiff(rest: str) -> str:
    """The formula of an H with one fast coordinate, q1, and an additional term."""
    return f"p1**2/2 + p2**2/2 + {OMEGA**2}*q1**2/2 + q2**2/2 + q1*q2 + {rest}"


@pytest.mark.parametrize(
    ("id", "h", "rest"),
    [
        *((id, 0.1, rest) for id in ("gauss-3", "gauss-6", "cpg-2") for rest in (NYSTROM, GENERAL)),
        ("lobatto-iiia-iiib-3", 0.03, GENERAL),
    ],
)
def test_newton_steps_are_reversible(id, h, rest):
    """The exact solution of the stage equations is time-symmetric, in the Nystrom form and in the general one."""
    H = stiff(rest)
    forth, back = (Hamiltonian(q="q1 q2", p="p1 p2", H=f"{sign}({H})") for sign in ("", "-"))
    q, p = [0.9, 0.2], [3.0, -0.4]
    there = integrate(forth, BY_ID[id], h=h, steps=5, q0=q, p0=p)
    here = integrate(back, BY_ID[id], h=h, steps=5, q0=there.q[-1], p0=there.p[-1])
    assert min(there.counts["newton"], here.counts["newton"]) > 0
    if h < 0.1:
        assert there.counts["gradient"] < 250 * 5, "the Jacobian is wrong: Newton's method converges slowly"
    assert np.abs(rough_end(here) - [*q, *p]).max() < 1e-12
    assert np.abs(rough_end(there) - [*q, *p]).max() > 0.1


def test_newton_keeps_the_increments_of_earlier_steps():
    """The next start extrapolates them: their rows add up to the change of the momenta in a step."""
    prepared = prepare(BY_ID["lobatto-iiia-iiib-3"], Hamiltonian(q="q1 q2", p="p1 p2", H=stiff(GENERAL)))
    run = lay_out(prepared, 2, 0.03, [0.9, 0.2], [3.0, -0.4], codegen.DOUBLE)
    weights, added, newton = prepared.step.weights, [], []
    for _ in range(tableaus.LEVELS + 1):
        before = run.carry.state[1, :2].copy()
        assert run(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 1)), 1) == (1, 0)
        added.append(run.carry.state[1, :2] - before)
        newton.append(run.counts.newton)
    assert np.all(np.diff(newton) > 0)
    for step in range(1, tableaus.LEVELS + 1):
        first = step % tableaus.LEVELS * weights.shape[1]
        kept = weights[1] @ run.carry.memory[first : first + weights.shape[1], 2:4]
        np.testing.assert_allclose(kept, added[step], rtol=0, atol=1e-13)
        assert np.abs(kept).max() > 0.1


# -- starting values -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("id", "most"), [("radau-iia-3", 20), ("hbvm-4-2", 28)])
def test_extrapolated_starts_save_evaluations(id, most):
    """Wrongly extrapolated starts take 30 and 32 evaluations per step."""
    system, q, p = SYSTEMS["coupled"]()
    with patch.object(path_lanes, "serves", lambda *_: False):
        short, long = (integrate(system, id, h=h, steps=20, q0=q, p0=p).counts for h in (0.02, 0.1))
    assert short["gradient"] < most * 20
    assert short["newton"] == long["newton"] == 0


@pytest.mark.parametrize("kind", [("gauss", 1, 1), ("gauss", 4, 4), ("lobatto-iiia-iiib", 3, 3), ("hbvm", 2, 4)])
def test_the_start_extrapolates_a_polynomial(kind):
    _, _, B, _, c = tableaus.exact(*kind)
    s = kind[1]
    weights = tableaus.extrapolation(B, c)
    assert len(weights) == s * (5 if s == 1 else 2), "two steps are enough where there is more than one stage"
    B, c = (np.array(x, dtype=float) for x in (B.tolist(), c))
    for m in range(1, len(weights) // s + 1):
        degree = min(len(set(np.concatenate([c - n for n in range(m)]).round(12))), m * s, tableaus.DEGREE + 1) - 1
        E = np.array(weights[(m - 1) * s : m * s])
        for power, continued in ((degree, True), (degree + 1, False)):
            earlier = np.concatenate([B @ (c - n) ** power for n in range(1, m + 1)])
            assert (np.abs(E @ earlier - B @ c**power).max() < 1e-8) == continued


def test_only_differences_of_nodes_are_rounded():
    A, c = mpmath.matrix([[0, 0], ["0.3", 0]]), [mpmath.mpf(0), mpmath.mpf(1)]
    assert tableaus.nystrom_rounded(A, c, mpmath.mpf(2) ** -50) == (A, c)
    assert tableaus.nystrom_rounded(A, [mpmath.mpf(0), A[1, 0]], mpmath.mpf(2) ** -50)[0] != A, "the control"


@pytest.mark.processor
@pytest.mark.parametrize("s", [1, 2, 3, 4, 5, 8])
def test_newton_solves_steps_too_long_for_the_fixed_point(s):
    """Gauss's methods have no limit on the oscillator, however many lanes their stages take."""
    made = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
    for h in (10.0, 200.0):
        solution = integrate(made, f"gauss-{s}", h=h, steps=6, q0=[1.0], p0=[0.0])
        assert solution.status == "ok"
        assert solution.counts["newton"] == 6
        assert np.abs(solution.q**2 + solution.p**2 - 1).max() < 1e-11
