"""The solver of the stage equations: starting values, when it stops, Newton's method, rows of unknowns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit

from phasebench.benchmarks.measure.battery import as_problem
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile import codegen
from phasebench.integrators.driver import integrate
from phasebench.integrators.records.projection import projection_method
from phasebench.integrators.stepping import newton, solve
from phasebench.integrators.stepping.solve import NOT_FINITE, SOLVED, STALLED
from phasebench.integrators.values import vector

EPS = np.finfo(float).eps
WORK = newton.Work(np.zeros(newton.shape(4)), codegen.once(newton.newton, newton.SIGNATURE), None)
ZERO = (0.0, 0.0)


@njit
def affine(x, arguments):
    """Two independent affine equations with contraction factors ``factor`` and -``factor`` / 2."""
    factor, constant = arguments
    return (factor * x[0] + constant, -0.5 * factor * x[1] + constant)


@njit
def no_solution(x, arguments):
    return (x[0] * x[0] + 1.0, x[1])


@njit
def infinite(x, arguments):
    return (np.nan, x[1])


@njit
def of_one(x, g, arguments):
    """The scales that the solver asks for, of both unknowns."""
    return 1.0, 1.0


@njit
def of_their_size(x, g, arguments):
    return abs(x[0]) + abs(g[0]), abs(x[1]) + abs(g[1])


def called(solve):
    """Make a solver, which only compiled code can call, callable from Python."""
    return njit(lambda arguments, x, span, eps, work: solve(arguments, x, span, eps, work), **vector.TUPLES)


solve_affine, solve_none, solve_infinite = (called(solve.solver(G, of_one)) for G in (affine, no_solution, infinite))


def solution(factor, constant):
    return constant / (1 - factor), constant / (1 + 0.5 * factor)


@pytest.mark.parametrize("factor", [0.0, 1e-8, 0.1, 0.3, 0.999, -1.0, -30.0, 1e6])
def test_newton_takes_over_where_the_iteration_does_not_contract(factor):
    x, evaluations, used, status = solve_affine((factor, 0.7), ZERO, 1.0, EPS, WORK)
    assert (status, used) == (SOLVED, abs(factor) > 0.5)
    assert evaluations <= 60
    assert x == pytest.approx(solution(factor, 0.7), rel=1e-12 if used else 4 * EPS)


def test_equations_without_a_solution_are_not_solved():
    assert solve_affine((1.0, 0.7), ZERO, 1.0, EPS, WORK)[3] in (STALLED, NOT_FINITE)
    for unsolvable in (solve_none, solve_infinite):
        assert unsolvable((0.0, 0.0), (0.3, 0.0), 1.0, EPS, WORK)[3] in (STALLED, NOT_FINITE)
    factor, constant = 1 + 1e-6, 1e303
    start = (0.0, solution(factor, constant)[1])
    with np.errstate(all="ignore"):
        found = called(solve.solver(affine, of_their_size))((factor, constant), start, 1.0, EPS, WORK)
    assert found[2:] == (1, NOT_FINITE), "beyond the largest double"


UNIT = 2.0**-40


@njit
def in_two_units(x, arguments):
    return (3 * np.cos(x[1] / UNIT), 3 * UNIT * np.sin(x[0]))


@njit
def of_their_units(x, g, arguments):
    return 1.0, UNIT


@pytest.mark.parametrize(("lengths", "solved"), [(of_their_units, True), (of_one, False)])
def test_difference_steps_follow_the_scales(lengths, solved):
    x, _, used, status = called(solve.solver(in_two_units, lengths))((0.0,), (1.1, UNIT), 1.0, EPS, WORK)
    assert (used, status == SOLVED) == (1, solved)
    assert not solved or np.abs(np.subtract(x, in_two_units(x, (0.0,))) / (1, UNIT)).max() < 1e-13


@njit
def near_zero(x, arguments):
    return (30.0 * x[0] - 29.0 if abs(x[0]) < 10 else np.nan, 0.5 * x[1])


@pytest.mark.parametrize("start", [2.0, 20.0])
def test_newton_begins_again_from_zero_where_the_start_fails(start):
    x, _, used, status = called(solve.solver(near_zero, of_one))((0.0,), (start, 0.0), 1.0, EPS, WORK)
    assert (used, status) == (1, SOLVED)
    assert x == pytest.approx((1.0, 0.0), abs=1e-14)


class Rows(NamedTuple):
    """Equations whose two unknowns in two units stand in each of two rows."""

    memory: np.ndarray
    stages: int
    like: Any


@njit
def sweep_rows(e, old, new):
    delta = size = 0.0
    for j in range(e.stages):  # a row depends on the other one
        x = in_two_units(vector.load(e.memory, old + 1 - j, e.like), (0.0,))
        delta += vector.distance(x, vector.load(e.memory, old + j, e.like))
        size += vector.size(x)
        vector.store(e.memory, new + j, x)
    return delta, size


@njit
def units_of_rows(e, at):
    return 1.0, UNIT


@njit
def one_unit(e, at):
    return 1.0, 1.0


@pytest.mark.parametrize(("lengths", "solved"), [(units_of_rows, True), (one_unit, False)])
def test_newton_solves_for_rows(lengths, solved):
    """Differences follow the units of each row's halves; the control takes one unit for both."""
    e = Rows(np.zeros((8, 2)), 2, ZERO)
    e.memory[:2] = (1.1, UNIT), (1.0, 1.2 * UNIT)
    _, used, status = called(solve.row_solver(sweep_rows, lengths))(e, 0, 1.0, EPS, WORK)
    assert (used > 0, status == SOLVED) == (True, solved)
    assert used % 5 == 0, "four unknowns take four differences and the residual"
    for j in range(2 if solved else 0):
        found = in_two_units(tuple(e.memory[1 - j]), (0.0,))
        assert np.abs(np.subtract(e.memory[j], found) / (1, UNIT)).max() < 1e-13


def test_when_iterations_stop():
    """At a share of round-off that the rest of the geometric series of changes may have, or where changes stagnate."""
    left = solve.SHARE * EPS
    for theta in (0.01, 0.5, 0.9):
        for factor in (0.99, 1.01):
            delta = factor * left * (1 - theta) / theta
            assert solve.converged(delta, delta / theta, 1.0, 1e9, EPS) == (factor < 1)
    for delta, before, ends in ((60, 50, True), (60, 60, True), (70, 60, False)):
        assert solve.converged(delta * EPS, before * EPS, 1.0, 0.0, EPS) == ends
    unit, noise = EPS, 1e-12
    for delta, before, of, ends in ((unit, np.inf, 0, True), (1.1 * unit, np.inf, 0, False)):
        assert newton.newton_converged(delta, before, unit, of) == ends
    for delta, before, ends in ((900, 1000, True), (900, 2000, False), (1100, 1000, False)):
        assert newton.newton_converged(delta * noise, before * noise, unit, noise) == ends


@pytest.mark.parametrize("n", [1, 2, 5])
def test_linear_equations_are_solved_with_pivoting(n):
    rng = np.random.default_rng(n)
    A, x = rng.normal(size=(n, n)), rng.normal(size=n)
    A[range(n), range(n)] = 1e-20 if n > 1 else 3.0
    system = np.column_stack([A, A @ x])
    assert newton.gauss(system, n)
    assert system[:, n] == pytest.approx(x, rel=1e-12)
    assert not newton.gauss(np.array([[1.0, 2.0, 1.0], [2.0, 4.0, 2.0]]), 2), "singular"


@pytest.mark.parametrize("id", ["avf", "cpg-2"])
@pytest.mark.parametrize("waves", [1, 40])
def test_an_integral_that_no_rule_confirms_is_a_fallback(id, waves):
    """Rules are refined until nothing changes, for q and p each; the energy then does not."""
    made = Hamiltonian(q="q", p="p", H=f"p**2/2 - cos({waves}*q)")
    s = integrate(made, id, h=0.1, steps=20, q0=[0.1], p0=[3.0])
    assert (s.counts["fallbacks"] > 0) == (waves == 40)
    assert np.ptp(made.energies(s.q, s.p)) < 1e-13 or waves == 40


# -- starting values of a step ----------------------------------------------------------------------------------------

#: Method, problem, step -> evaluations of a step at most. Each takes more by a tenth or more if its unknowns start from
#: zero, if one of several does, or if an attempt does not start from the last one.
STARTS = [
    ("scheme-i", "henon-heiles", 0.005, 2.7),
    ("scheme-i", "coupled", 0.005, 5.0),
    ("radau-iia-3", "coupled", 0.02, 20.0),
    ("hbvm-4-2", "coupled", 0.02, 28.0),
    ("gauss-8-adaptive", "kepler", 0.05, 60.0),
    ("gonzalez", "pendulum", 0.1, 27.0),
    ("gonzalez-yoshida-4", "pendulum", 0.1, 94.0),
    ("cohen-hairer-1", "lotka-volterra:4-2", 0.02, 54.0),
    ("cohen-hairer-2", "lotka-volterra:4-2", 0.02, 57.0),
    ("implicit-midpoint-symmetric-projection", "henon-heiles:box", 0.02, 15.2),
    (projection_method("scheme-iii", symmetric=True), "henon-heiles:box", 0.02, 20.3),
]


@pytest.mark.parametrize(("m", "name", "h", "most"), STARTS, ids=lambda x: getattr(x, "id", x))
def test_a_step_starts_from_those_before(m, name, h, most):
    made = as_problem(name) if name == "coupled" else problem(name)
    s = integrate(made, m, h=h, steps=40)
    assert (s.status, s.counts["newton"], s.counts["fallbacks"]) == ("ok", 0, 0)
    assert s.counts["gradient"] < most * 40
