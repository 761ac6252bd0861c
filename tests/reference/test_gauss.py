"""The Gauss method in long double: coefficients, order, starting values; Kepler's equation; horizons."""

from __future__ import annotations

from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators import Hamiltonian
from phasebench.reference.certificates import horizon
from phasebench.reference.solvers import gauss, taylor
from phasebench.reference.solvers.exact import anomaly

LONG = np.longdouble
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
PENDULUM = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


# -- the Gauss method -------------------------------------------------------------------------------------------------


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
    moments = [float(rule.weights @ rule.c**k) for k in range(8)]
    assert moments == pytest.approx([0] * 7 + [1], abs=1e-9 * np.abs(rule.weights).max()), "a divided difference"


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.7, 2.0, 5.0])
def test_stages_start_from_the_last_stage_polynomial(ratio):
    """Extrapolated with degree 7, to at most twice the last step."""
    rule, coefficients = gauss.tableau(), np.array([3.0, -1.0, 0.5, 0.0, 2.0, 1.0, -0.25, 0.125])
    found = np.polyval(coefficients, rule.c) @ gauss._extrapolation(rule, ratio)
    wanted = np.polyval(coefficients, 1 + min(ratio, 2.0) * rule.c)
    assert np.allclose(found.astype(float), wanted, rtol=1e-9)


@pytest.mark.parametrize("marks", [[], [1.0, 2.5], [0.5, 0.6, 1.7, 2.9, 7.0]])
def test_the_circle_is_exact_to_long_double(marks):
    steps = sorted({*marks, *np.arange(0.25, 3.0, 0.25)})
    rows = gauss.run(OSCILLATOR, (1.0,), (0.0,), steps, [2.0, 3.0])
    with mpmath.workdps(30):
        for row, t in zip(rows, (2, 3), strict=True):
            assert abs(text(row[0]) - mpmath.cos(t)) < 5e-19
            assert abs(text(row[1]) + mpmath.sin(t)) < 5e-19


def test_the_error_has_order_sixteen():
    true = gauss.run(PENDULUM, (1.5,), (0.3,), np.arange(0.25, 8, 0.25), [8.0])[0]
    errors = [
        float(np.abs(gauss.run(PENDULUM, (1.5,), (0.3,), np.arange(h, 8, h), [8.0])[0] - true).max())
        for h in (2.0, 1.0)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(16, abs=1.5)


def test_stage_iterations_end_at_round_off(monkeypatch):
    """Henon-Heiles with h = 1: about twenty iterations per step, also where the last unit never settles."""
    calls, right, made = [], gauss.right_hand_side, problem("henon-heiles:box")

    def count_iterations(system):
        F, kinks = right(system)
        return lambda Y, signs: calls.append(len(Y)) or F(Y, signs), kinks

    monkeypatch.setattr(gauss, "right_hand_side", count_iterations)
    gauss.run(made.system, made.q0, made.p0, np.arange(1.0, 20.0), [20.0])
    assert 20 * 12 < len(calls) < 20 * 26


def kinked(H, q0, p0, t, *marks):
    """The state at time t by Gauss's method, in steps of 0.1 that also end at the ``marks``."""
    made = from_formula(H, q0, p0, {})
    (row,) = gauss.run(made.system, made.q0, made.p0, sorted({*np.arange(0.1, t, 0.1), *marks}), [t])
    return row.astype(float)


@pytest.mark.parametrize(("force", "t"), [(1, 20.0), (50, 7.3), (0.3, 41.0)])
def test_a_kink_costs_no_accuracy(force, t):
    """The orbit of H = p^2/2 + k |q| from rest at 1 consists of parabolas."""
    quarter = np.sqrt(2 / force)
    side, since = divmod(t + quarter, 2 * quarter)
    sign, s = (-1) ** side, since - quarter
    exact = sign * (1 - force * s**2 / 2), -sign * force * s
    assert kinked(f"p**2/2 + {force}*abs(q)", (1.0,), (0.0,), t) == pytest.approx(exact, abs=2e-13)


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


def test_unsolvable_stages_are_a_failure():
    with pytest.raises(taylor.ReferenceFailed, match=r"after t = 0\.5; its steps are too large"):
        gauss.run(PENDULUM, (1.5,), (0.3,), [0.25, 0.5], [90.0])


@pytest.mark.parametrize(("ecosine", "esine"), [(0.0, 0.0), (0.6, 0.0), (0.3, -0.4), (0.999999, 0.0), (0.0, 0.99)])
@pytest.mark.parametrize("M", ["-7", "1e-9", "0.3", "3.14", "250"])
def test_keplers_equation_is_solved_to_all_digits(M, ecosine, esine):
    with mpmath.workdps(60):
        M, ecosine, esine = mpmath.mpf(M), mpmath.mpf(ecosine), mpmath.mpf(esine)
        x = anomaly(M, ecosine, esine)
        assert abs(x - ecosine * mpmath.sin(x) + esine * (1 - mpmath.cos(x)) - M) < mpmath.mpf("1e-54") * (1 + abs(M))


def test_numbers_of_bits_and_digits():
    for bits in (64, 113, 256):
        digits = taylor.Bits(bits).digits
        assert bits * np.log10(2) + 5 < digits < bits * np.log10(2) + 15
        assert taylor.Bits(bits).__name__ == f"{bits}-bit"


# -- horizons ---------------------------------------------------------------------------------------------------------


def test_the_horizon_ends_before_the_limit_is_first_exceeded():
    grid, size = [1.0, 2.0, 3.0, 4.0], np.array([1.0, 1.0, 10.0, 1.0])

    def within(*distances: float) -> float:
        """The time up to which an orbit with these distances at `grid` stays within 0.1 of its size."""
        return horizon.within(grid, np.array(distances), size, 0.1)

    assert within(0.0, 0.1, 1.0, 0.1) == 4.0, "relative to the size, and the limit itself is within"
    assert within(0.0, 0.2, 0.0, 0.0) == 1.0
    assert within(0.0, 0.0, 0.5, 0.2) == 3.0
    assert within(0.2, 0.0, 0.0, 0.0) == within(np.nan, 0.0, 0.0, 0.0) == 0.0


def test_marks_combine_grid_and_steps():
    assert horizon._marks([1.0, 2.0], [0.5, 2.0]) == [(0.5, False, True), (1.0, True, False), (2.0, True, True)]


def test_a_neighbour_of_an_oscillator_keeps_its_distance():
    made = SimpleNamespace(system=OSCILLATOR, q0=(1.0,), p0=(0.0,))
    grid = [0.5, np.pi, 6.0]
    near = taylor.states(OSCILLATOR, np.longdouble, (1.0,), (0.0,), grid)
    found = horizon.neighbour(made, grid, near)
    assert found == pytest.approx(horizon.SHIFT * np.array([np.cos(0.5), 1.0, 1.0]), rel=1e-3, abs=0)
