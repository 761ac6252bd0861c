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
ROUND_OFF, VISIBLE = 1e-13, 1e-10


@cache
def end_of(id):
    """End state (q, p) of a run of a method on Henon-Heiles; fail if its status is not "ok"."""
    system, q, p = SYSTEMS["henon-heiles"]()
    return end(integrate(system, id, h=H, steps=STEPS, q0=q, p0=p))


# -- the discrete action ----------------------------------------------------------------------------------------------


#: M^-1 of a kinetic energy with coupled momenta.
INVERSE_MASS = ((2, 0.5), (0.5, 1))


@cache
def heavy():
    """A system with d = 2 whose kinetic energy, p1^2 + p1 p2 / 2 + p2^2, has a full mass matrix."""
    return Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2/2 + p2**2/2 + q1**4/4 + q1*q2**2 + cos(q2)")


def rule(quadrature, nodes):
    """[(node, weight)] of Gauss or Lobatto quadrature on [0, 1], in the working precision."""
    base = np.polynomial.legendre.Legendre.basis(nodes if quadrature == "gauss" else nodes - 1)
    roots = list(base.roots()) if quadrature == "gauss" else [-1.0, *base.deriv().roots(), 1.0]
    t = [mpmath.mpf(x) for x in roots]
    polynomial = (lambda x: mpmath.legendre(nodes, x)) if quadrature == "gauss" else (
        lambda x: (1 - x * x) * mpmath.diff(lambda y: mpmath.legendre(nodes - 1, y), x)
    )  # fmt: skip
    t = [x if abs(x) == 1 else mpmath.findroot(polynomial, x) for x in t]
    A = mpmath.matrix([[x**k for x in t] for k in range(nodes)])
    moments = mpmath.matrix([mpmath.mpf(1 - (-1) ** (k + 1)) / (k + 1) for k in range(nodes)])
    return [((1 + x) / 2, w / 2) for x, w in zip(t, mpmath.lu_solve(A, moments), strict=True)]


def action(points, h, quadrature):
    """Discrete action of the polynomial through ``points`` [(q1, q2), ...] at equidistant times."""
    s = len(points) - 1
    mass = mpmath.matrix(INVERSE_MASS) ** -1
    V = lambda q1, q2: q1**4 / 4 + q1 * q2**2 + mpmath.cos(q2)  # noqa: E731
    total = mpmath.mpf(0)
    for c, b in quadrature:
        Q, velocity = [mpmath.mpf(0)] * 2, [mpmath.mpf(0)] * 2
        for k, point in enumerate(points):
            others = [j for j in range(s + 1) if j != k]
            value = mpmath.fprod((s * c - j) / (k - j) for j in others)
            slope = mpmath.fsum(
                mpmath.mpf(s) / (k - i) * mpmath.fprod((s * c - j) / (k - j) for j in others if j != i) for i in others
            )
            for m in range(2):
                Q[m] += value * point[m]
                velocity[m] += slope * point[m] / h
        v = mpmath.matrix(velocity)
        total += h * b * ((v.T * mass * v)[0] / 2 - V(*Q))
    return total


def residual(id, spoil=0):
    """Residual of the discrete Euler-Lagrange equations p0 = -dL_d/dq0, p1 = dL_d/dq1 for one step.

    L_d is the discrete Lagrangian of the q at both ends, stationary in the inner control points; ``spoil`` changes the
    first weight (control).
    """
    degree, quadrature, nodes = method(id).data
    system, q0, p0 = heavy(), (0.3, -0.5), (0.4, 0.7)
    s = integrate(system, id, h=H, steps=1, q0=q0, p0=p0)
    with mpmath.workdps(30):
        h, weights = mpmath.mpf(H), rule(quadrature, nodes)
        weights[0] = (weights[0][0], weights[0][1] * (1 + spoil))
        first, last = [mpmath.mpf(x) for x in q0], [mpmath.mpf(x) for x in s.q[-1]]
        size = 2 * (degree - 1)

        def slope(flat, i):
            """Derivative of the discrete Lagrangian by the i-th coordinate of all control points."""

            def along(x):
                moved = [*flat[:i], x, *flat[i + 1 :]]
                return action(list(zip(moved[::2], moved[1::2], strict=True)), h, weights)

            e = mpmath.mpf(10) ** -7
            return (8 * (along(flat[i] + e) - along(flat[i] - e)) - along(flat[i] + 2 * e) + along(flat[i] - 2 * e)) / (
                12 * e
            )

        inner = [a + (b - a) * k / degree for k in range(1, degree) for a, b in zip(first, last, strict=True)]
        if size:
            J = mpmath.matrix(size, size)
            for sweep in range(3):  # Newton's method with the matrix of the first sweep
                flat = [*first, *inner, *last]
                g = mpmath.matrix([slope(flat, 2 + i) for i in range(size)])
                if sweep == 0:
                    e = mpmath.mpf(10) ** -5
                    for j in range(size):
                        bent = list(flat)
                        bent[2 + j] += e
                        for i in range(size):
                            J[i, j] = (slope(bent, 2 + i) - g[i]) / e
                inner = list(mpmath.matrix(inner) - mpmath.lu_solve(J, g))
        flat = [*first, *inner, *last]
        rest = [p0[i] + slope(flat, i) for i in range(2)] + [
            s.p[-1][i] - slope(flat, len(flat) - 2 + i) for i in (0, 1)
        ]
        return max(abs(float(x)) for x in rest)


@pytest.mark.parametrize("id", IDS)
def test_a_step_makes_the_discrete_action_stationary(id):
    # Derivatives of L_d divide the round-off of q1 by h.
    assert residual(id) < 2e-14


def test_control_a_changed_action_is_not_stationary():
    assert residual("variational-2-3", spoil=1e-8) > 1e-10


# -- variational methods that are collocation methods -----------------------------------------------------------------


def collocation(nodes):
    """(A, b) of the collocation method with these nodes, in doubles."""
    c = np.array(nodes)
    powers = np.vander(c, increasing=True)
    k = np.arange(1, len(c) + 1)
    A = np.linalg.solve(powers.T, (c[:, None] ** k / k).T).T
    return A, np.linalg.solve(powers.T, 1 / k)


def gauss(stages):
    """(A for q, A for p, b) of a Gauss method."""
    A, b = collocation((np.polynomial.legendre.leggauss(stages)[0] + 1) / 2)
    return A, A, b


def lobatto(stages):
    """(A, B, b) of Lobatto IIIA for q and IIIB for p, from b_i B_ij + b_j A_ji = b_i b_j."""
    inner = np.polynomial.legendre.Legendre.basis(stages - 1).deriv().roots()
    A, b = collocation((np.array([-1.0, *inner, 1.0]) + 1) / 2)
    return A, b - (b * A.T / b[:, None]), b


def partitioned_end(A, B, b):
    """End of the Henon-Heiles orbit by a partitioned Runge-Kutta method, A for q and B for p."""
    _, q, p = SYSTEMS["henon-heiles"]()
    q, p = np.array(q), np.array(p)
    for _ in range(STEPS):
        V, F = np.zeros((len(b), 2)), np.zeros((len(b), 2))
        for _ in range(60):
            x, y = (q + H * A @ V).T
            V, F = p + H * B @ F, np.stack([-x - 2 * x * y, -y - x * x + y * y], axis=1)
        q, p = q + H * b @ V, p + H * b @ F
    return np.concatenate([q, p])


OTHERS = {
    "variational-midpoint": lambda: end_of("implicit-midpoint"),
    "variational-trapezoidal": lambda: end_of("stormer-verlet"),
    "variational-gauss-2": lambda: partitioned_end(*gauss(2)),
    "variational-gauss-3": lambda: partitioned_end(*gauss(3)),
    "variational-lobatto-3": lambda: partitioned_end(*lobatto(3)),
    "variational-lobatto-4": lambda: partitioned_end(*lobatto(4)),
}


@pytest.mark.parametrize("id", OTHERS)
def test_with_minimal_quadrature_it_is_a_known_method(id):
    assert np.abs(end_of(id) - OTHERS[id]()).max() < ROUND_OFF


def test_with_more_nodes_it_is_a_new_method():
    """Its steps differ from those of the known methods, which differ from one another too (control)."""
    assert set(IDS) == {*OTHERS, "variational-2-3"}
    ends = [*(f() for f in OTHERS.values()), end_of("variational-2-3")]
    for i, a in enumerate(ends):
        assert all(np.abs(a - b).max() > VISIBLE for b in ends[:i])


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


@pytest.mark.parametrize(("omega", "h"), [(50, 0.02), (100, 0.01)])
@pytest.mark.parametrize("id", ["variational-midpoint", "variational-gauss-2"])
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
