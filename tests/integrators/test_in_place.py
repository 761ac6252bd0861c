"""Explicit methods run on arrays from their families' own limits on: with the bits of tuples, and they alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from numba import types

from phasebench.integrators import Hamiltonian
from phasebench.integrators.engine import codegen, kernel, preparation
from phasebench.integrators.families import runge_kutta, splitting
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method

FAMILY = {
    "stormer-verlet": splitting,
    "mclachlan-atela-4": splitting,
    "symplectic-euler-q": splitting,
    "rk4": runge_kutta,
    "dop853": runge_kutta,
}


def system(d):
    """Neighbours that repel each other, of masses that no double is."""
    q, p = sp.symbols(f"q0:{d}", real=True), sp.symbols(f"p0:{d}", real=True)
    T = sum(sp.Rational(i + 1, 3) * x**2 / 2 for i, x in enumerate(p))
    V = sum(x**2 / 2 for x in q) + sum(1 / sp.sqrt((x - y) ** 2 + 1) for x, y in pairwise(q))
    return Hamiltonian(q=q, p=p, H=T + V)


class Start:
    """A system with initial data."""

    def __init__(self, d):
        self.system = system(d)
        self.q0, self.p0 = np.linspace(0.3, 1.7, d), np.linspace(-0.2, 0.4, d)


def end(problem, id, kind):
    run = prepare(problem, id)
    assert run.values == kind
    q, p, code = run(0.01, 200)
    assert code == run.SOLVED
    return np.concatenate([q, p]), run.counts


@pytest.mark.processor
@pytest.mark.parametrize("id", ["mclachlan-atela-4", "rk4"])
def test_arrays_end_where_tuples_do_to_the_last_bit(id, monkeypatch):
    monkeypatch.setattr(preparation, "KEPT", False)
    problem = Start(FAMILY[id].MOST + 1)
    arrays, counts = end(problem, id, "array")
    monkeypatch.setattr(FAMILY[id], "MOST", codegen.TUPLE_LIMIT)
    tuples, the_same = end(problem, id, "tuple")
    np.testing.assert_array_equal(arrays, tuples)
    assert counts == the_same
    assert np.abs(arrays - np.concatenate([problem.q0, problem.p0])).max() > 0.1, "the control: it moves"


@pytest.mark.parametrize("id", FAMILY)
def test_a_family_says_from_how_many_degrees_of_freedom_on(id):
    most = FAMILY[id].MOST
    assert most < codegen.TUPLE_LIMIT
    assert [kernel.prepare(method(id), system(d)).arrays for d in (most, most + 1)] == [False, True]


NOT_IN_PLACE = ["implicit-midpoint", "scheme-i", "gauss-4", "rk4-projected-energy", "rk4-relaxation"]


@pytest.mark.parametrize("id", NOT_IN_PLACE)
def test_what_is_not_in_place_stays_on_tuples(id):
    made = system(splitting.MOST + 1)
    prepared = kernel.prepare(method(id), made)
    assert not prepared.arrays
    taken = made.grad_V().nopython_signatures[0]
    assert taken.args[0] == types.UniTuple(types.float64, made.d), "the system's own functions are as they were"


def test_numbers_of_many_digits_have_no_kind():
    with codegen.precision(40):
        made = kernel.prepare(method("stormer-verlet"), system(splitting.MOST + 1), codegen.MULTIPRECISION)
    assert not made.arrays
