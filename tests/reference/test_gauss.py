"""The Gauss method in long double: coefficients, order, starting values, kinks."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators import Hamiltonian
from phasebench.reference.solvers import gauss, taylor

LONG = np.longdouble
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
PENDULUM = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


def text(x) -> mpmath.mpf:
    """A long double as an exact mpmath number."""
    return mpmath.mpf(float(x)) + mpmath.mpf(float(x - LONG(float(x))))


def test_coefficients_are_exact_to_thirty_digits():
    """The simplifying assumptions B(16) and C(8), for coefficients stored as sums of two long doubles."""
    rule = gauss.tableau()
    with mpmath.workdps(40):
        b = [text(x) + text(y) for x, y in zip(rule.b, rule.b_rest, strict=True)]
        A = [[text(x) + text(y) for x, y in zip(*rows, strict=True)] for rows in zip(rule.A, rule.A_rest, strict=True)]
        c = [sum(row, mpmath.mpf(0)) for row in A]
        for k in range(1, 17):
            assert abs(sum(x * y ** (k - 1) for x, y in zip(b, c, strict=True)) - mpmath.mpf(1) / k) < 1e-30
        assert abs(sum(x * y**16 for x, y in zip(b, c, strict=True)) - mpmath.mpf(1) / 17) > 1e-12, "the order is 16"
        for k in range(1, 9):
            for row, x in zip(A, c, strict=True):
                assert abs(sum(a * y ** (k - 1) for a, y in zip(row, c, strict=True)) - x**k / k) < 1e-30
        assert max(abs(x - float(y)) for x, y in zip(rule.c, c, strict=True)) < 1e-16
    assert 1e-21 < np.abs(rule.b_rest).max() < 1e-19, "what is left of a number in long double"


@pytest.mark.parametrize("marks", [[], [0.5, 0.6, 1.7, 2.9, 7.0]])
def test_the_circle_is_exact_to_long_double(marks):
    rows = gauss.run(OSCILLATOR, (1.0,), (0.0,), sorted({*marks, *np.arange(0.25, 3.0, 0.25)}), [2.0, 3.0])
    with mpmath.workdps(30):
        for row, t in zip(rows, (2, 3), strict=True):
            assert abs(text(row[0]) - mpmath.cos(t)) < 5e-19
            assert abs(text(row[1]) + mpmath.sin(t)) < 5e-19


@pytest.mark.processor
def test_constants_are_not_rounded_to_doubles():
    """2**(1/2) and 1/3 as doubles would be an error of 1e-16."""
    made = problem("quadrupole-boson:benchmark")
    long, quad = taylor.extended_types()
    ends = taylor.step_ends(made.system, long, made.q0, made.p0, 2.0)
    found = gauss.run(made.system, made.q0, made.p0, [x / 2 for x in ends] + ends, [2.0])[0]
    truth = taylor.states(made.system, quad, made.q0, made.p0, [2.0])[0]
    assert max(abs(float(quad(a) - b)) for a, b in zip(found, truth, strict=True)) < 3e-18 * max(map(abs, found))


def test_unsolvable_stages_are_a_failure():
    with pytest.raises(taylor.ReferenceFailed, match=r"after t = 0\.5; its steps are too large"):
        gauss.run(PENDULUM, (1.5,), (0.3,), [0.25, 0.5], [90.0])


# -- kinks ------------------------------------------------------------------------------------------------------------


def kinked(H, q0, p0, t, *marks):
    """The state at time t by Gauss's method, in steps of 0.1 that also end at the ``marks``."""
    made = from_formula(H, q0, p0, {})
    (row,) = gauss.run(made.system, made.q0, made.p0, sorted({*np.arange(0.1, t, 0.1), *marks}), [t])
    return row.astype(float)


@pytest.mark.parametrize(
    ("H", "q0", "p0", "t", "exact"),
    [
        ("p**2/2 + abs(q)", (0.0,), (1.0,), 4.5, (0.375, 0.5)),  # from a kink
        ("p**2/2 + abs(q)", (2.5,), (-2.0,), 1.0, (0.0, -3.0)),  # to a kink, where a step ends
        ("p**2/2 + abs(q)", (2.5,), (-2.0,), 2.0, (-2.5, -2.0)),
        ("p**2/2 + abs(abs(q) - 1)", (3.0,), (0.0,), 7 - 2 * 2**0.5, (-2.5, -1.0)),  # one in another
        ("(p1**2 + p2**2)/2 + abs(q1) + abs(q2)", (0.0, 0.0), (1.0, 1.0), 4.5, (0.375, 0.375, 0.5, 0.5)),  # at once
        ("(p1**2 + p2**2)/2 + abs(q1) + abs(q2)", (0.0, 0.0), (1.0, 0.0), 4.5, (0.375, 0.0, 0.5, 0.0)),  # along one
    ],
)
def test_kinks_in_every_place(H, q0, p0, t, exact):
    assert kinked(H, q0, p0, t, 1.0) == pytest.approx(exact, abs=1e-14)


def test_control_steps_across_kinks_are_inaccurate(monkeypatch):
    right = gauss.right_hand_side

    def across(system):
        F, _ = right(system)
        return lambda Y, signs: F(Y, np.sign(Y[:1]))[:2], 0

    monkeypatch.setattr(gauss, "right_hand_side", across)
    assert np.abs(kinked("p**2/2 + abs(q)", (2.5,), (-2.0,), 1.95) - (-2.54875, -2.05)).max() > 1e-4
