"""Implicit Runge-Kutta methods, HBVM, cPG, variational ones, EQUIP: tableaus, round-off, steps without a solution."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.coefficients import dop853, quadrature, tableaus
from phasebench.integrators.coefficients.trees import DIGITS, order_residual, trees
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import collocation, path_lanes
from phasebench.integrators.families import equip as gauss_equip
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.records.collocation import METHODS
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from support.solutions import energy_errors

EPS = np.finfo(float).eps

BY_ID = {m.id: m for m in METHODS}
BOX = problem("henon-heiles:box")


# -- coefficients -----------------------------------------------------------------------------------------------------


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


def test_dop853_has_the_published_numbers():
    from scipy.integrate import DOP853

    A, b = (x.astype(float) for x in dop853_arrays())
    assert np.abs(A - DOP853.A[:12, :12]).max() <= 64 * EPS
    assert np.abs(b - DOP853.B[:12]).max() <= 8 * EPS


# -- round-off --------------------------------------------------------------------------------------------------------


def exactly_symplectic(id, system):
    """Whether the doubles that a kernel uses are symplectic without round-off; test_lanes.py tests those in lanes."""
    step = prepare(BY_ID[id], system).step
    if not system.separable:
        pairs = zip(step.A_q.ravel(), step.A_p.T.ravel(), strict=True)
        return all(Fraction(a) + Fraction(b) == 1 for a, b in pairs)
    exact, nodes = ([[Fraction(x) for x in row] for row in rows] for rows in (step.A_q, step.c[:, :1]))
    skew = all(exact[i][j] - exact[j][i] == x - y for i, [x] in enumerate(nodes) for j, [y] in enumerate(nodes))
    return skew and step.weights[0].tolist() == [float(1 - x) for [x] in nodes]


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", ["gauss-1", "lobatto-iiia-iiib-3", "radau-iia-3"])
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


def exact_rules(id, system):
    """Yield the (nodes c, weights b) of each quadrature rule as the kernel has them, in exact fractions."""
    step = prepare(method(id), system).step
    first = 0
    while first < len(step.rows):
        k, last = step.nodes[first], first + step.rows[first]
        if isinstance(step, path_lanes.Path):
            s, n = len(step.terms), len(step.like)
            c, b = step.A[first * s : last * s : s].ravel(), step.B[first * n : last * n, 0]
            assert not b[k:].any()
        else:
            c, b = step.c[first:last, 0], step.B[first:last, 0]
        yield [Fraction(x) for x in c[:k]], [Fraction(x) for x in b[:k]]
        first = last


#: One by one and in lanes, in Nystrom and general form, with one rule and with nine.
PATHS = [
    *((id, "henon-heiles") for id in ("hbvm-2-1", "hbvm-4-2", "hbvm-6-3", "hbvm-8-4", "cpg-1", "cpg-2")),
    ("hbvm-8-4", "coupled"),
    ("cpg-2", "perturbed-kepler"),
]


@pytest.mark.parametrize(("id", "name"), PATHS)
def test_double_rules_integrate_linear_functions_exactly(id, name):
    """Rules rounded to doubles do; else every step would add the same round-off to energy and phase."""
    for c, b in exact_rules(id, SYSTEMS[name]()[0]):
        assert sum(b) == 1
        assert all(x + y == 1 for x, y in zip(c, reversed(c), strict=True))
        assert b == b[::-1]
        exact = quadrature.gauss_legendre(len(c))
        assert max(abs(float(x - y)) for x, (y, _) in zip(map(mpmath.mpf, map(float, c)), exact, strict=True)) < 1.2e-16
        assert max(abs(float(x - y)) for x, (_, y) in zip(map(mpmath.mpf, map(float, b)), exact, strict=True)) < 2e-16


# -- the kernel -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", ["cpg-2", "hbvm-8-4", "gauss-3", "gauss-equip-3"])
def test_an_unsolvable_step_ends_a_run(id):
    """A step whose first increments overflow ends the run with a status."""
    made = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 + q1**6 + q2**4")
    assert not isinstance(prepare(method(id), made).step, collocation.Collocation)
    s = integrate(made, id, h=10.0, steps=3, q0=[1e50, 0.5], p0=[0.2, -0.3])
    assert s.status in ("not-converged", "diverged")
    assert len(s.q) == 1


@pytest.mark.parametrize(("id", "omega", "h"), [("variational-midpoint", 50, 0.02), ("variational-gauss-2", 100, 0.01)])
def test_a_force_at_its_round_off_level_can_be_solved(id, omega, h):
    """Near an equilibrium at q = 1 kicks are known only to the round-off of an increment divided by h."""
    system = Hamiltonian(q="q1", p="p1", H=f"(p1**2 + {omega**2}*(q1 - 1)**2)/2")
    for away in (1e-13, 1e-12):
        s = integrate(system, id, h=h, steps=60, q0=[1 + away], p0=[0.0])
        assert s.status == "ok", s.reason
        assert np.abs(s.q - 1).max() < 2 * away


# -- EQUIP ------------------------------------------------------------------------------------------------------------


#: A pendulum with a free particle; the step from this state has two roots.
TWO_ROOTS = Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2/2 + p2**2/2 - cos(q1)")
FROM = np.array([0.0663, 0.0, 1.6816, 0.0])


def test_the_nearer_of_two_roots_is_taken():
    """Both conserve the energy; the other root is at alpha = 0.017."""
    s = integrate(TWO_ROOTS, BY_ID["gauss-equip-3"], h=0.25, steps=1, q0=FROM[:2], p0=FROM[2:])
    assert -0.01 < s.parameter[0] < -0.008
    assert s.counts["fallbacks"] == 0
    assert abs(energy_errors(s)[1]) < 1e-15


def test_the_tableau_of_every_alpha_is_exactly_symplectic():
    """Exactly, in double precision; the prepared tableau is unchanged, as other threads use it."""
    prepared = prepare(BY_ID["gauss-equip-3"], TWO_ROOTS)
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
