"""The solver of the stage equations, its starting values, and compensated summation."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from phasebench.benchmarks.measure.metrics import slope
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.solve import (
    FIXED_POINT_LIMIT,
    LEVELS,
    NOT_FINITE,
    SOLVED,
    STALLED,
    predict,
    remember,
    solver,
)
from phasebench.integrators.values import vector
from support.values import value

EPS = np.finfo(float).eps
WORK = np.zeros((8, 8))


def equation(f):
    """Compile a function whose result is a vector, for use as an equation x = G(x)."""
    return njit(f) if codegen.compiled() else lambda *arguments: np.array(f(*arguments))


# -- starting values --------------------------------------------------------------------------------------------------


ZERO = value(0.0, 0.0)


def table(values, slots=1, slot=0):
    """The solver's memory of the increments of earlier steps, filled with (v, -2 v) for v in ``values``."""
    memory = np.zeros(((LEVELS + 1) * slots, 2))
    for known, v in enumerate(values):
        remember(memory, slot, slots, known, value(float(v), -2.0 * float(v)))
    return memory


@pytest.mark.parametrize("degree", range(LEVELS))
def test_the_start_extrapolates_a_polynomial(degree):
    values = [(0.3 * n - 1) ** degree for n in range(LEVELS + 1)]
    x = predict(table(values[:LEVELS]), 0, 1, LEVELS, ZERO)
    assert x == pytest.approx((values[LEVELS], -2 * values[LEVELS]), abs=1e-13)


def test_control_higher_degrees_are_not_extrapolated():
    values = [(0.3 * n - 1) ** LEVELS for n in range(LEVELS + 1)]
    x = predict(table(values[:LEVELS]), 0, 1, LEVELS, ZERO)
    assert abs(x[0] - values[LEVELS]) > 1e-3


def test_the_start_uses_only_known_steps():
    memory = table([5.0])
    assert tuple(predict(memory, 0, 1, 1, ZERO)) == (5.0, -10.0)
    assert tuple(predict(np.zeros((LEVELS + 1, 2)), 0, 1, 0, ZERO)) == (0.0, 0.0)


def test_several_equations_of_a_step_are_stored_separately():
    memory = table([1.0, 2.0], slots=2, slot=0)
    assert tuple(predict(memory, 1, 2, 2, ZERO)) == (0.0, 0.0)
    assert predict(memory, 0, 2, 2, ZERO) == pytest.approx((3.0, -6.0))


# -- the equation -----------------------------------------------------------------------------------------------------


@equation
def affine(x, arguments):
    """Two independent affine equations with contraction factors ``factor`` and -``factor`` / 2."""
    factor, constant = arguments
    return (factor * x[0] + constant, -0.5 * factor * x[1] + constant)


@equation
def no_solution(x, arguments):
    """The equation x = x^2 + 1, which has no real solution."""
    return (x[0] * x[0] + 1.0, x[1])


@equation
def infinite(x, arguments):
    return (np.nan, x[1])


@njit
def of_one(x, g, arguments):
    """The scales that the solver asks for, of both unknowns: 1, as for increments of variables of size 1."""
    return 1.0, 1.0


def called(solve):
    """Make a solver, which only compiled code can call, callable from Python."""
    return njit(lambda arguments, x, span, eps, work: solve(arguments, x, span, eps, work), **vector.TUPLES)


solve_affine, solve_none, solve_infinite = (called(solver(G, of_one)) for G in (affine, no_solution, infinite))


def fixed_point(factor, constant):
    """Exact solution of `affine` with this factor and constant."""
    return constant / (1 - factor), constant / (1 + 0.5 * factor)


@pytest.mark.parametrize("factor", [0.0, 1e-8, 0.1, 0.3])
def test_a_contraction_needs_no_newton(factor):
    x, evaluations, newton, status = solve_affine((factor, 0.7), ZERO, 1.0, EPS, WORK)
    assert (status, newton) == (SOLVED, 0)
    assert evaluations <= 60
    assert x == pytest.approx(fixed_point(factor, 0.7), rel=4 * EPS)


@pytest.mark.parametrize("factor", [0.999, -1.0, 1.5, -30.0, 1e6])
def test_newton_takes_over_from_a_stalled_iteration(factor):
    x, _, newton, status = solve_affine((factor, 0.7), ZERO, 1.0, EPS, WORK)
    assert (status, newton) == (SOLVED, 1)
    assert x == pytest.approx(fixed_point(factor, 0.7), rel=1e-12)


def test_a_singular_equation_is_not_solved():
    assert solve_affine((1.0, 0.7), ZERO, 1.0, EPS, WORK)[3] != SOLVED


def test_an_equation_without_a_solution_is_not_solved():
    assert solve_none((0.0, 0.0), value(0.3, 0.0), 1.0, EPS, WORK)[3] in (STALLED, NOT_FINITE)


def test_an_infinite_value_is_not_a_solution():
    assert solve_infinite((0.0, 0.0), value(0.3, 0.0), 1.0, EPS, WORK)[3] in (STALLED, NOT_FINITE)


def test_the_limit_on_iterations_and_newtons_differences():
    """Changes that halve converge fast enough; slower ones reach the limit on iterations."""
    slow, half = (solve_affine((f, 1.25), value(0.0, 1.0), 1.0, EPS, WORK)[1:] for f in (0.999, 0.5))
    assert slow[0] > FIXED_POINT_LIMIT
    assert (slow[0] - FIXED_POINT_LIMIT) % 3 == 0, "two unknowns take two differences and the residual"
    assert half[0] > FIXED_POINT_LIMIT
    assert half[2] == SOLVED


@equation
def of_their_size(x, g, arguments):
    """The scales that the solver asks for: the sizes of the unknowns themselves."""
    return abs(x[0]) + abs(g[0]), abs(x[1]) + abs(g[1])


def test_an_overflowing_solution_is_not_finite():
    factor, constant = 1 + 1e-6, 1e303
    start = value(0.0, fixed_point(factor, constant)[1])
    with np.errstate(all="ignore"):
        found = called(solver(affine, of_their_size))((factor, constant), start, 1.0, EPS, WORK)
    assert found[2:] == (1, NOT_FINITE)


UNIT = 2.0**-40


@equation
def in_two_units(x, arguments):
    """u = 3 cos(v / UNIT), v = 3 UNIT sin(u): the second unknown has a far smaller scale."""
    return (3 * np.cos(x[1] / UNIT), 3 * UNIT * np.sin(x[0]))


@njit
def of_their_units(x, g, arguments):
    """The sizes of the two unknowns, which the solver asks for: those in which they are of the order of 1."""
    return 1.0, UNIT


@pytest.mark.parametrize(("lengths", "solved"), [(of_their_units, True), (of_one, False)])
def test_difference_steps_follow_the_scales(lengths, solved):
    x, _, newton, status = called(solver(in_two_units, lengths))((0.0,), value(1.1, UNIT), 1.0, EPS, WORK)
    assert (newton, status == SOLVED) == (1, solved)
    if solved:
        assert np.abs(np.subtract(x, in_two_units(x, (0.0,))) / (1, UNIT)).max() < 1e-13


# -- stiff steps ------------------------------------------------------------------------------------------------------


def midpoint_map(omega, h):
    """Matrix of the implicit midpoint rule on the harmonic oscillator, a Cayley transform."""
    a = Fraction(h) * Fraction(omega) / 2
    c, s = float((1 - a * a) / (1 + a * a)), float(2 * a / (1 + a * a))
    return np.array([[c, s / omega], [-s * omega, c]])


@pytest.mark.parametrize(("omega", "h"), [(1.0, 0.1), (50.0, 0.1), (1e3, 0.1), (1e3, 10.0)])
def test_the_midpoint_rule_where_only_newton_converges(omega, h):
    made = problem("harmonic-oscillator", omega=omega)
    s = integrate(made, "implicit-midpoint", h=h, steps=20, q0=[1.0], p0=[omega / 3])
    assert s.status == "ok"
    assert (s.counts["newton"] > 0) == (h * omega > 2)
    y = np.array([1.0, omega / 3])
    M = midpoint_map(omega, h)
    for n in range(20):
        y = M @ y
        assert np.abs((np.array([s.q[n + 1, 0], s.p[n + 1, 0]]) - y) / [1, omega]).max() < 1e-12


def test_control_another_method_differs_from_the_closed_form():
    s = integrate(problem("harmonic-oscillator"), "stormer-verlet", h=0.1, steps=1, q0=[1.0], p0=[1 / 3])
    assert np.abs([s.q[1, 0], s.p[1, 0]] - midpoint_map(1.0, 0.1) @ [1.0, 1 / 3]).max() > 1e-5


# -- compensated summation --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("increment", [0.1, 1e-3, -1 / 3])
def test_the_compensated_sum_beats_the_naive_one(increment):
    n = 100_000
    x, c, naive = np.array([1.0]), np.array([0.0]), 1.0
    for _ in range(n):
        x, c = vector.add(x, c, np.array([increment]))
        naive += increment
    exact = 1 + n * Fraction(increment)
    error, naive_error = abs(Fraction(x[0]) - exact), abs(Fraction(naive) - exact)
    assert error <= Fraction(np.spacing(abs(float(exact))))
    assert naive_error > 20 * max(error, Fraction(np.spacing(abs(float(exact)))))


@vector.jit
def accumulate(n, increment):
    """Sum n increments by compensated summation."""
    x, c = (1.0, -1.0), (0.0, 0.0)
    for _ in range(n):
        x, c = vector.add(x, c, (increment, -increment))
    return x


def test_compilation_preserves_compensation():
    n = 1_000_000
    x = accumulate(n, 0.1)
    exact = float(1 + n * Fraction(0.1))
    assert np.abs(np.array(x) - [exact, -exact]).max() <= np.spacing(exact)
    assert abs(1.0 + np.full(n, 0.1).cumsum()[-1] - exact) > 100 * np.spacing(exact), "the control: the plain sum"


# -- Brouwer's law ----------------------------------------------------------------------------------------------------


def growth(errors_at, t):
    """Exponent of the growth in time of the root mean square over an ensemble."""
    return slope(np.log(t), np.log(np.sqrt((errors_at**2).mean(0))))


@pytest.mark.parametrize("lam", [Fraction(1, 2), Fraction(1, 4), Fraction(1)])
def test_energy_round_off_grows_as_a_random_walk(lam):
    """Scheme I (midpoint rule for 1/2), its quadratic invariant of the harmonic oscillator, a million steps.

    The exponent is 1/2 for a random walk and 1 for a bias, such as stage weights whose doubles do not sum to 1. Step
    and weights are sums of few powers of two, since products with other numbers have a bias near 1e-19 per step
    (measured: 1.7e-13 after a million steps at lambda = 1/3).
    """
    m, h, every = method("scheme-i", lam=lam), 0.125, 20_000
    errors = []
    for k in range(24):
        s = integrate(problem("harmonic-oscillator"), m, h=h, steps=50 * every, save_every=every, p0=[0.1 + k / 31])
        q, p = s.q[:, 0].astype(np.longdouble), s.p[:, 0].astype(np.longdouble)
        value = p * p + q * q + h * (1 - 2 * np.longdouble(lam.numerator) / lam.denominator) * p * q
        errors.append(((value - value[0])[1:] / value[0]).astype(float))
    errors = np.array(errors)
    assert growth(errors, np.arange(1, 51)).value < 0.75
    assert np.abs(errors.mean(0)[-1]) < 1e-13


def test_control_a_biased_walk_is_seen():
    rng = np.random.default_rng(4)
    t = np.arange(1, 51)
    walk = rng.standard_normal((24, 50)).cumsum(1)
    assert growth(walk, t).value < 0.75
    assert growth(walk + 3.0 * t, t).value > 0.9
