"""HBVM and cPG with quadrature nodes in SIMD lanes against nodes one by one: coefficients, Newton's method, limits."""

from __future__ import annotations

from fractions import Fraction
from functools import partial

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.integrators.coefficients import quadrature
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import collocation, path_lanes
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from support import two_degrees
from support.two_degrees import of, run

#: Separable H with diagonal T, for which the kicks are the unknowns.
KICKS = {
    "masses": "p1**2/2 + p2**2/6 - cos(q1) - cos(q2) + sin(q1*q2)/10",
    "powers": "p1**2/2 + p2**2/2 + (1 + q1**2 + q2**2)**(3/2) + 1/sqrt(2 + q1**2) + q2**2/5",
    "degree 6": "p1**2/2 + p2**2/2 + q1**6 + q1**2*q2**2/3 + q2**4",
}
#: H for which both increments are the unknowns.
FIELDS = {
    "angles": "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)",
    "quartic": "p1**4/4 + p2**2/2 + q1**2/2 + q2**4 + q1*p2**2/5",
}
#: Methods with four and two unknown vectors; rules of one row, of two rows, and a list of rules.
CASES = [("hbvm-8-4", "masses"), ("hbvm-8-4", "degree 6"), *(("cpg-2", name) for name in (*KICKS, *FIELDS))]
#: Runs a method with its quadrature nodes evaluated one after the other, not in SIMD lanes.
one_by_one = partial(two_degrees.one_by_one, path_lanes)


@pytest.mark.processor
@pytest.mark.parametrize(("id", "name"), CASES)
def test_lanes_reach_the_state_of_single_nodes(id, name):
    """Up to the round-off of fifty steps: lanes sum in another order and use their own sin, cos and exp."""
    made = of((KICKS | FIELDS)[name])
    assert isinstance(prepare(method(id), made).step, path_lanes.Path)
    (lanes, n), (nodes, m) = run(made, id), one_by_one(made, id)
    assert np.abs(lanes - nodes).max() < 3e-14
    assert abs(n["gradient"] - m["gradient"]) <= 0.05 * m["gradient"]
    assert n["fallbacks"] == m["fallbacks"] == n["newton"] == 0


@pytest.mark.parametrize(("table", "place"), [("A", (0, 1)), ("B", (4, 1)), ("drift", (2, 0)), ("drift", (0, 0))])
def test_control_a_wrong_coefficient_is_seen(monkeypatch, table, place):
    laned = path_lanes.build_path

    def spoiled(*arguments):
        step = laned(*arguments)
        getattr(step, table)[place] += 1e-9
        return step

    monkeypatch.setattr(path_lanes, "build_path", spoiled)
    made = of(KICKS["degree 6"])
    lanes = run(made, "hbvm-8-4")[0]
    monkeypatch.undo()
    assert np.abs(lanes - one_by_one(made, "hbvm-8-4")[0]).max() > 1e-12


@pytest.mark.parametrize("rest", ["q1**4", "q1**2*p1**2/10", "cos(q1)"])
def test_newton_takes_over_when_the_iteration_diverges(rest):
    """For kicks, both increments, and each rule of a list; few sweeps show that the Jacobian is correct."""
    stiff = of(f"p1**2/2 + p2**2/6 + 1250*q1**2 + q2**2/2 + q1*q2 + {rest}")
    (lanes, n), (nodes, m) = run(stiff, "cpg-2", 0.1, 20), one_by_one(stiff, "cpg-2", 0.1, 20)
    assert n["newton"] >= 20 <= m["newton"]
    assert n["gradient"] < 1.2 * m["gradient"]
    assert np.abs(lanes - nodes).max() < 1e-11


@pytest.mark.parametrize("id", ["cpg-2", "hbvm-8-4", "gauss-3", "gauss-equip-3"])
def test_an_unsolvable_step_ends_a_run(id):
    """A step whose first increments overflow ends the run with a status."""
    made = of("p1**2/2 + p2**2/2 + q1**6 + q2**4")
    assert not isinstance(prepare(method(id), made).step, collocation.Collocation)
    s = integrate(made, id, h=10.0, steps=3, q0=[1e50, 0.5], p0=[0.2, -0.3])
    assert s.status in ("not-converged", "diverged")
    assert len(s.q) == 1


@pytest.mark.parametrize("s", [1, 2, 3, 4])
def test_the_matrix_of_the_path_of_q(s):
    """The matrix of Legendre polynomials by their integrals is exactly skew in doubles but for its first entry.

    Newton's method may start at ``like``, zero.
    """
    step = path_lanes.build_path(s, [s], SYSTEMS["henon-heiles"]()[0], "double")
    X = step.drift[1 : 1 + s, :s].T
    rule = quadrature.gauss_legendre(s + 1)
    for m in range(s):
        for j in range(s):
            terms = (b * quadrature.legendre(s, c)[m] * quadrature.legendre_integrals(s, c)[j] for c, b in rule)
            with mpmath.workdps(30):
                assert abs(mpmath.fsum(terms) - X[m, j]) < 1e-16
            assert X[m, j] + X[j, m] == (m == j == 0)
    assert step.drift[0].tolist() == [1, 0, 0, 0]
    assert not step.drift[1:, s:].any()
    assert (set(step.like), set(step.terms)) == ({0.0}, {0.0})


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
RULES = [
    *((id, "henon-heiles") for id in ("hbvm-2-1", "hbvm-4-2", "hbvm-6-3", "hbvm-8-4", "cpg-1", "cpg-2")),
    ("hbvm-8-4", "coupled"),
    ("cpg-2", "perturbed-kepler"),
]


@pytest.mark.parametrize(("id", "name"), RULES)
def test_double_rules_integrate_linear_functions_exactly(id, name):
    """Rules rounded to doubles do; else every step would add the same round-off to energy and phase."""
    for c, b in exact_rules(id, SYSTEMS[name]()[0]):
        assert sum(b) == 1
        assert all(x + y == 1 for x, y in zip(c, reversed(c), strict=True))
        assert b == b[::-1]
        exact = quadrature.gauss_legendre(len(c))
        assert max(abs(float(x - y)) for x, (y, _) in zip(map(mpmath.mpf, map(float, c)), exact, strict=True)) < 1.2e-16
        assert max(abs(float(x - y)) for x, (_, y) in zip(map(mpmath.mpf, map(float, b)), exact, strict=True)) < 2e-16
