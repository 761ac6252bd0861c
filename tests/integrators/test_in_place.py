"""Explicit methods switch to in-place arrays beyond a size given by their family, with unchanged results."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from numba import types

from phasebench.integrators.compile import codegen
from phasebench.integrators.families import force_gradient, runge_kutta, splitting
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel
from phasebench.integrators.values import inplace
from support.systems import chain

FAMILY = {
    "stormer-verlet": splitting,
    "mclachlan-atela-4": splitting,
    "symplectic-euler-q": splitting,
    "rk4": runge_kutta,
    "dop853": runge_kutta,
    "blanes-p7-6": splitting,
    "chin-4a": force_gradient,
    "hessian-free-adada": force_gradient,
}


def system(d):
    """A chain of d particles with neighbour repulsion."""
    return chain(d, bond=lambda r: 1 / sp.sqrt(r**2 + 1))


class Start:
    """Stand-in for a problem: a system of d degrees of freedom with initial data."""

    def __init__(self, d):
        self.system = system(d)
        self.q0, self.p0 = np.linspace(0.3, 1.7, d), np.linspace(-0.2, 0.4, d)


def end(problem, id, kind):
    """(end state, counts) of a prepared run, whose values must be of that kind ("array" or "tuple")."""
    run = prepare(problem, id)
    assert run.values == kind
    q, p, code = run(0.01, 200)
    assert code == run.SOLVED
    return np.concatenate([q, p]), run.counts


@pytest.mark.processor
@pytest.mark.parametrize("id", ["mclachlan-atela-4", "blanes-p7-6", "rk4", "chin-4a", "hessian-free-adada"])
def test_arrays_and_tuples_agree_bit_by_bit(id, monkeypatch):
    problem = Start(FAMILY[id].MOST + 1)
    arrays, counts = end(problem, id, "array")
    monkeypatch.setattr(FAMILY[id], "MOST", codegen.TUPLE_LIMIT)
    tuples, the_same = end(problem, id, "tuple")
    np.testing.assert_array_equal(arrays, tuples)
    assert counts == the_same
    assert np.abs(arrays - np.concatenate([problem.q0, problem.p0])).max() > 0.1, "the control: it moves"


@pytest.mark.parametrize("id", FAMILY)
def test_the_size_beyond_which_a_family_uses_arrays(id):
    most = FAMILY[id].MOST
    assert most < codegen.TUPLE_LIMIT
    assert [kernel.prepare(method(id), system(d)).arrays for d in (most, most + 1)] == [False, True]


# -- parts of a Runge-Kutta step on arrays, run as Python -------------------------------------------------------------


@pytest.mark.parametrize("id", ["explicit-euler", "rk4", "dop853"])
def test_sums_over_a_row_in_pairs_of_terms(id):
    """Rows of the tableau with odd, even and zero numbers of terms."""
    table, h, d = kernel.array(method(id).data, codegen.DOUBLE), 0.3, 3
    slopes = np.random.default_rng(1).standard_normal((len(table) - 1, 2 * d))
    for i, row in enumerate(table):
        memory = np.full((len(table), 2 * d), np.nan)  # NaN except for the slopes computed so far
        memory[:i] = slopes[:i]
        found = np.concatenate(runge_kutta._total(table, i, h, memory, np.zeros(d)))
        np.testing.assert_allclose(found, h * row[:i] @ slopes[:i], rtol=0, atol=1e-15 * len(table))
        np.testing.assert_array_equal(memory[:i], slopes[:i])


def test_a_slope_is_evaluated_at_the_increments():
    """`_evaluate_arrays` writes the field at (q + dq, p + dp) into the given row of a memory and keeps q and p."""
    q, p, dq, dp = np.array([1.0, 2.0]), np.array([3.0, 5.0]), np.array([0.25, 0.5]), np.array([-0.5, 0.125])
    evaluate, memory = runge_kutta._evaluate_arrays(*[None] * 8), np.zeros((3, 4))
    evaluate(lambda q, p, h, _: (10 * p + h, -q), q, p, dq, dp, 0.5, memory, 1)
    np.testing.assert_array_equal(memory, [[0] * 4, [25.5, 51.75, -1.25, -2.5], [0] * 4])
    assert (*q, *p) == (1, 2, 3, 5)


# -- methods that use arrays ------------------------------------------------------------------------------------------

NOT_IN_PLACE = ["implicit-midpoint", "scheme-i", "gauss-4", "rk4-projected-energy", "rk4-relaxation"]


@pytest.mark.parametrize("id", NOT_IN_PLACE)
def test_other_families_stay_on_tuples(id):
    made = system(splitting.MOST + 1)
    prepared = kernel.prepare(method(id), made)
    assert not prepared.arrays
    taken = made.grad_V().signature()
    assert taken.args[0] == types.UniTuple(types.float64, made.d), "the system's own functions are as they were"


@pytest.mark.parametrize("id", [*FAMILY, *NOT_IN_PLACE])
def test_only_in_place_kernels_use_in_place_functions(id, monkeypatch):
    """Families with kernels that work in place, and no others, ask for in-place functions from their size on."""
    asked = []
    monkeypatch.setattr(inplace, "in_place_version", lambda system, arithmetic, most: asked.append(most) or system)
    kernel.prepare(method(id), system(2))
    assert asked == ([FAMILY[id].MOST] if id in FAMILY else [])


def test_multiprecision_does_not_use_in_place_arrays():
    with codegen.precision(40):
        made = kernel.prepare(method("stormer-verlet"), system(splitting.MOST + 1), codegen.MULTIPRECISION)
    assert not made.arrays
