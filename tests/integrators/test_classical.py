"""Classical methods as published: order conditions of the tableaus, and the equations that a step satisfies."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators.coefficients.table import value
from phasebench.integrators.coefficients.trees import DIGITS, order_residual, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.records import projection
from phasebench.integrators.registry import method

#: The Henon-Heiles problem, whose kernels other tests compile too.
P = problem("henon-heiles:chaotic")


@pytest.mark.parametrize("id", ["explicit-euler", "rk4", "kutta-3"])
def test_a_tableau_is_explicit_and_of_its_order(id):
    """All order conditions up to the order hold; at least one of the next order fails."""
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
    """Kick over the fraction ``by`` of a step."""
    return q, p + by * H * force(q)


def drift(q, p, by):
    """Drift over the fraction ``by`` of a step."""
    return q + by * H * p, p


def euler(where):
    """Residual function of the step z1 = z0 + h f(z), with z chosen by ``where`` from (q0, p0) and (q1, p1)."""

    def residual(q0, p0, q1, p1):
        """z1 - z0 - h f(z)."""
        q, p = where(q0, p0, q1, p1)
        return q1 - q0 - H * p, p1 - p0 - H * force(q)

    return residual


def splitting(*parts):
    """Residual function of a sequence of kicks and drifts over fractions of a step."""

    def residual(q0, p0, q1, p1):
        """(q1, p1) minus the state after the kicks and drifts."""
        q, p = q0, p0
        for move, by in parts:
            q, p = move(q, p, by)
        return q1 - q, p1 - p

    return residual


#: Equations of a step: Hairer, Lubich & Wanner 2006, I.1.
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
def test_a_step_solves_its_own_equations_only(id):
    s = integrate(P, id, h=H, steps=1)
    missed = {name: np.abs(f(*s.q[:1], *s.p[:1], *s.q[1:], *s.p[1:])).max() for name, f in EQUATIONS.items()}
    assert missed.pop(id) < 1e-15
    assert min(missed.values()) > 1e-4
