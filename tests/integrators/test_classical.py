"""The classical methods as they are published: the conditions of a tableau's order, and the equations of a step."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.coefficients.table import value
from phasebench.integrators.driver import integrate
from phasebench.integrators.records import projection
from phasebench.integrators.registry import method
from support.trees import DIGITS, order_residual, vector

#: H = (|p|^2 + |q|^2)/2 + q1^2 q2 - q2^3/3: other tests have its kernels compiled.
P = problem("henon-heiles:chaotic")


@pytest.mark.parametrize("id", ["explicit-euler", "rk4", "kutta-3"])
def test_a_tableau_is_explicit_and_of_its_order(id):
    """Of every tree; of those with one vertex more one at least is missed."""
    m = projection.KUTTA_3 if id == "kutta-3" else method(id)
    with mpmath.workdps(DIGITS):
        *rows, b = (vector(value(str(x)) for x in row) for row in m.data)
        A = np.array(rows)
        assert A.shape == (len(b), len(b))
        assert not np.triu(A).any()
        assert order_residual(A, b, range(1, m.order + 1)) < 1e-25
        assert order_residual(A, b, [m.order + 1]) > 1e-6


H = 0.3


def force(q):
    """-dV/dq."""
    return -np.array([q[0] + 2 * q[0] * q[1], q[1] + q[0] ** 2 - q[1] ** 2])


def kick(q, p, by):
    return q, p + by * H * force(q)


def drift(q, p, by):
    return q + by * H * p, p


def euler(where):
    """The residual of z1 = z0 + h f, f at a place between (q0, p0) and (q1, p1)."""

    def residual(q0, p0, q1, p1):
        q, p = where(q0, p0, q1, p1)
        return q1 - q0 - H * p, p1 - p0 - H * force(q)

    return residual


def splitting(*parts):
    """What is missed after kicks and drifts, each over a part of the step."""

    def residual(q0, p0, q1, p1):
        q, p = q0, p0
        for move, by in parts:
            q, p = move(q, p, by)
        return q1 - q, p1 - p

    return residual


#: Hairer, Lubich & Wanner 2006, I.1: the equations of a step.
EQUATIONS = {
    "explicit-euler": euler(lambda q0, p0, q1, p1: (q0, p0)),
    "implicit-euler": euler(lambda q0, p0, q1, p1: (q1, p1)),
    "symplectic-euler-p": euler(lambda q0, p0, q1, p1: (q0, p1)),
    "symplectic-euler-q": euler(lambda q0, p0, q1, p1: (q1, p0)),
    "implicit-midpoint": euler(lambda q0, p0, q1, p1: ((q0 + q1) / 2, (p0 + p1) / 2)),
    "stormer-verlet": splitting((kick, 0.5), (drift, 1), (kick, 0.5)),
    "stormer-verlet-dkd": splitting((drift, 0.5), (kick, 1), (drift, 0.5)),
}


@pytest.mark.parametrize("id", EQUATIONS)
def test_a_step_solves_its_equations_and_no_others(id):
    s = integrate(P, id, h=H, steps=1)
    missed = {name: np.abs(f(*s.q[:1], *s.p[:1], *s.q[1:], *s.p[1:])).max() for name, f in EQUATIONS.items()}
    assert missed.pop(id) < 1e-15
    assert min(missed.values()) > 1e-4
