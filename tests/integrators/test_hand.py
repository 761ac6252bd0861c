"""Hand-written systems, defined by loops instead of a formula: they agree with formulas, and run at d = 10,000."""

from __future__ import annotations

import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import fpu, problem, toda
from phasebench.benchmarks.problems.user_file import load
from phasebench.integrators import InvalidInput, integrate
from phasebench.integrators.compile.codegen import TUPLE_LIMIT, to_number
from phasebench.integrators.systems.hand import HandHamiltonian, uncompiled_loop, unit_mass_field
from support.solutions import end

PATH = str(Path(__file__).parents[2] / "examples" / "problems" / "chain.py")
CHAIN = load(PATH)
#: Name -> (module, function that makes the formula, constants of the loops, other constants).
LOOPS = {
    "fpu": (fpu, lambda: fpu.formula(7.0, 2), (49,), (50,)),
    "toda": (toda, lambda: toda.formula(4), (), None),
    "chain": (CHAIN, lambda: chain(4, 4), (4,), (5,)),
}
#: Names of q and p of the smallest system that loops may define.
NAMES = [[f"{x}{i}" for i in range(TUPLE_LIMIT + 1)] for x in "qp"]


def chain(N, k):
    """(symbols q, symbols p, H) of a chain of N double wells with springs of stiffness k, the example problem."""
    q, p = sp.symbols(f"q:{N}", real=True), sp.symbols(f"p:{N}", real=True)
    wells = sum((x**2 - 1) ** 2 / 4 for x in q)
    return q, p, sum(x**2 for x in p) / 2 + k * sum((b - a) ** 2 for a, b in pairwise(q)) / 2 + wells


def values(module, constants, q, p, arithmetic="double"):
    """Values (q', p', grad V, H, size of H) of the loops at a state, run as Python."""
    of = [to_number(c, arithmetic) for c in constants]
    H, M = module.energy(*of)(q, p)
    field, grad_V = (uncompiled_loop(name, getattr(module, name), of) for name in ("field", "grad_V"))
    return np.concatenate([*field(q, p, 0.0, 0.0), grad_V(q), [H, M]])


def by_formula(q_names, p_names, H, q, p, number=float):
    """(q', p', grad V, H, size of H's terms) at a state from the formula of H, with exact derivatives, as numbers."""
    at = dict(zip((*q_names, *p_names), map(sp.Float, (*map(str, q), *map(str, p)), [60] * 2 * len(q)), strict=True))
    dq, dp = ([sp.diff(H, x) for x in names] for names in (p_names, q_names))
    terms = sum(sp.Abs(t) for t in sp.Add.make_args(H))
    M = terms + sum(sp.Abs(x * g) for x, g in zip((*p_names, *q_names), (*dq, *dp), strict=True))
    found = [*dq, *(-g for g in dp), *dp, H, M]
    return np.array([number(sp.N(e.subs(at), 50)) for e in found])


@pytest.mark.parametrize("name", LOOPS)
def test_loops_agree_with_their_formula(name):
    module, formula, constants, others = LOOPS[name]
    q_names, p_names, H = formula()
    q, p = np.random.default_rng(2).normal(size=(2, len(q_names)))
    expected = by_formula(q_names, p_names, H, q, p)
    assert values(module, constants, q, p) == pytest.approx(expected, rel=1e-13)
    if others is not None:
        assert values(module, others, q, p) != pytest.approx(expected, rel=1e-3)


def springs_that_return():
    """{loop's name: loop} for springs of stiffness k; the loops return new arrays."""
    return {"field": lambda k: lambda q, p, h, lam: (p.copy(), -k * q), "grad_V": lambda k: lambda q: k * q}


def springs_that_write():
    """The loops of `springs_that_return`, writing into given arrays instead."""

    def grad_V(k):
        def f(q, g):
            for i in range(len(q)):
                g[i] = k * q[i]

        return f

    return {"field": lambda k: unit_mass_field(grad_V(-k)), "grad_V": grad_V}


def springs_energy(k):
    """A user's function f(q, p) -> (H, size of its terms) of uncoupled springs of stiffness k, written as a loop."""

    def f(q, p):
        H = 0 * q[0]
        for i in range(len(q)):
            H += p[i] * p[i] / 2 + k * q[i] * q[i] / 2
        return H, 3 * H

    return f


@pytest.mark.parametrize("id", ["stormer-verlet", "rk4", "rk4-relaxation", "implicit-midpoint"])
def test_loops_that_write_and_that_return_agree_bit_by_bit(id):
    """In kernels that pass arrays to write into, and in others."""
    d, ends = TUPLE_LIMIT + 2, []
    names = [[f"{x}{i}" for i in range(d)] for x in "qp"]
    start = dict(zip(("q0", "p0"), np.random.default_rng(6).normal(size=(2, d)), strict=True))
    for loops, k in ((springs_that_return(), 3), (springs_that_write(), 3), (springs_that_write(), 4)):
        system = HandHamiltonian(q=names[0], p=names[1], loops=loops | {"energy": springs_energy}, constants=(k,))
        ends.append(end(integrate(system, id, h=0.1, steps=9, **start)))
    assert (ends[0] == ends[1]).all()
    assert not np.isclose(ends[0], ends[2]).any(), "the control"


def test_a_chain_of_10000_runs_without_a_formula():
    made = problem(PATH)
    assert (made.system.d, problem(PATH, N=40).system.d) == (10_000, 40)
    ends = [
        end(integrate(system, "stormer-verlet", h=0.05, steps=40, q0=made.q0, p0=made.p0))
        for system in (made.system, pickle.loads(pickle.dumps(made.system)))
    ]
    assert np.array_equal(*ends)

    def force(q):
        return 4 * np.diff(np.diff(q), prepend=0.0, append=0.0) - (q * q - 1) * q

    q, p = np.array(made.q0), np.array(made.p0)
    for _ in range(40):
        p = p + 0.025 * force(q)
        q = q + 0.05 * p
        p = p + 0.025 * force(q)
    assert np.abs(ends[0] - [*q, *p]).max() < 1e-12
    assert np.abs(q - made.q0).max() > 0.1


def test_methods_that_need_a_formula_refuse_loops():
    made = CHAIN.make(N=30)
    assert np.array_equal(made.system.observe(lambda Q, P: Q[:, 0], np.eye(30), np.eye(30)), np.eye(30)[0])
    for id in ("rk4-projected-energy", "generating-function"):
        with pytest.raises(InvalidInput, match="loops and no formula"):
            integrate(made, id, h=0.05, steps=1)
    with pytest.raises(InvalidInput, match="loops and no formula"):
        made.system.dq  # noqa: B018
    for id in ("rk4-relaxation", "implicit-midpoint"):
        assert integrate(made, id, h=0.05, steps=2).status == "ok"


def test_missing_loops_and_small_systems_are_refused():
    loops = {"grad_V": CHAIN.grad_V, "field": CHAIN.field, "energy": CHAIN.energy}
    for left in ("field", "energy"):
        few = {name: loop for name, loop in loops.items() if name != left}
        with pytest.raises(InvalidInput, match=f"the loop '{left}' is missing"):
            HandHamiltonian(q=NAMES[0], p=NAMES[1], loops=few)
    with pytest.raises(InvalidInput, match="more than 20"):
        HandHamiltonian(q=NAMES[0][:-1], p=NAMES[1][:-1], loops=loops)
