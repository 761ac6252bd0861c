"""Systems defined by loops: they agree with formulas, run at d = 10,000, and take long steps by the banded solver."""

from __future__ import annotations

import math
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_banded

from phasebench.benchmarks.problems import fpu, klein_gordon, n_body, nls, problem, toda
from phasebench.benchmarks.problems.user_file import load
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.integrators.compile.codegen import TUPLE_LIMIT, to_number
from phasebench.integrators.families.banded import structure_of
from phasebench.integrators.outcome import solver_failure
from phasebench.integrators.prepared import prepare
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import banded, structure
from phasebench.integrators.systems.hand import HandHamiltonian, uncompiled_loop, unit_mass_field
from support.solutions import end, last

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


# -- the banded Newton solver: the steps of full matrices, at a cost that grows linearly with d ------------------------


EPS = np.finfo(float).eps
BAND = {"parameters": {"solver": "banded"}}
#: Name -> (module, constants, d, step where fixed-point iteration converges, step where it does not).
LATTICES = {
    "toda": (toda, (), 25, 0.1, 3.0),
    "fpu": (fpu, (2500,), 24, 0.01, 0.2),
    "klein-gordon": (klein_gordon, (4, 2), 24, 0.1, 1.0),
    "nls": (nls, (4, 4), 24, 0.02, 0.5),
}


def by_loops(module, d, constants=()):
    loops = {n: getattr(module, n) for n in ("field", "grad_V", "energy") if hasattr(module, n)}
    return HandHamiltonian(
        q=[f"q{i}" for i in range(d)], p=[f"p{i}" for i in range(d)], loops=loops, constants=constants
    )


def lattice(name, d=None, size=0.1):
    """(hand-written system, initial data of that size) of a lattice."""
    module, constants, least, *_ = LATTICES[name]
    q0, p0 = size * np.random.default_rng(7).normal(size=(2, d or least))
    return by_loops(module, d or least, constants), {"q0": q0, "p0": p0}


def ends(system, id, start, h, steps=15, **parameters):
    """(solution, end state) of a run from these initial data."""
    s = integrate(system, id, h=h, steps=steps, parameters=parameters, **start)
    return s, last(s)


@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("long", [False, True])
def test_banded_steps_equal_full_steps(name, long):
    """Both where the fixed-point iteration converges and where it does not."""
    system, start = lattice(name)
    full, end = ends(system, "implicit-midpoint", start, LATTICES[name][4 if long else 3])
    found, other = ends(system, "implicit-midpoint", start, LATTICES[name][4 if long else 3], solver="banded")
    assert full.status == found.status == "ok"
    assert ((full.counts["newton"] == 15), found.counts["newton"]) == (long, 15)
    assert np.abs(other - end).max() < 2e-14 * np.abs(end).max()
    assert np.abs(end - [*start["q0"], *start["p0"]]).max() > 1e-2, "the control"
    assert not long or found.counts["gradient"] < full.counts["gradient"] / 5


@pytest.mark.parametrize(
    ("id", "parameters"),
    [("scheme-i", {"lam": -1}), ("scheme-iii", {"lam": 0.9}), ("implicit-euler", {}), ("scheme-iii-yoshida-4", {})],
)
def test_every_one_stage_method_takes_the_same_steps(id, parameters):
    system, start = lattice("nls")
    full, end = ends(system, id, start, 0.03, **parameters)
    found, other = ends(system, id, start, 0.03, **parameters, solver="banded")
    assert full.status == found.status
    assert len(full.q) == len(found.q) > 1
    assert found.counts["newton"] >= len(found.q) - 1, "the banded solver, which takes no fixed-point iterations"
    assert np.abs(other - end).max() < 1e-13 * np.abs(end).max()


def test_tuples_higher_order_fields_and_sites_that_do_not_act_on_themselves():
    q, p = sp.symbols("q:6", real=True), sp.symbols("p:6", real=True)
    bonds = sum(q[i] * q[i + 1] * q[(i + 2) % 6] for i in range(5)) + q[0] * q[1]
    pushed = Hamiltonian(q=q, p=p, H=sum(x**2 for x in p) / 2 + bonds)
    start = {"q0": np.linspace(0.5, 1.0, 6), "p0": np.zeros(6)}
    toda = problem("toda")
    for system, id, own in ((pushed, "implicit-midpoint", start), (toda, "scheme-ii", {})):
        full, found = (integrate(system, id, h=0.3, steps=4, **own, **more) for more in ({}, BAND))
        assert full.status == found.status != "not-converged"
        assert np.abs(full.q - found.q).max() < 1e-13 * np.abs(full.q).max()


@pytest.mark.parametrize("id", ["implicit-midpoint", "scheme-iii"])
def test_a_run_keeps_its_matrix_for_its_step_size(id):
    """A short run with another step size in between changes neither the end nor the counts."""
    system, start = lattice("toda", 21)
    run = prepare(system, id, **BAND, **start)
    first, *_, code = run(1.0, 3)
    counts = dict(run.counts)
    assert (code, counts["steps"], counts["newton"]) == (run.SOLVED, 3, 3 * (1 if id == "implicit-midpoint" else 2))
    run(1e-3, 1)
    assert (run(1.0, 3)[0] == first).all()
    assert run.counts == counts
    assert (integrate(system, id, h=1.0, steps=3, **BAND, **start).q[-1] == first).all()


def test_explicit_steps_stay_explicit():
    system, start = lattice("toda")
    (explicit, end), (same, other) = (
        ends(system, "scheme-i", start, 0.1, lam=1, **more) for more in ({}, {"solver": "banded"})
    )
    assert (end == other).all()
    assert same.counts == explicit.counts


def test_unsolvable_equations_are_reported():
    system, start = lattice("nls", size=1.0)
    for more, advice in (({}, "or try solver='banded'"), ({"solver": "banded"}, "take a smaller h")):
        s = integrate(system, "implicit-midpoint", h=0.5, steps=3, parameters=more, **start)
        assert s.status == "not-converged", s.reason
        assert advice in s.reason
    for id, d, advised in (("scheme-iii", 21, True), ("scheme-iii", 20, False), ("gauss-2", 21, False)):
        assert ("or try solver='banded'" in solver_failure(method(id).family, d).advice) == advised


def test_a_useless_matrix_is_replaced():
    """Long steps of large amplitude, where the matrix must be renewed; the full solver reaches the same state."""
    system, start = lattice("fpu", size=3.0)
    full, end = ends(system, "implicit-midpoint", start, 1.0)
    found, other = ends(system, "implicit-midpoint", start, 1.0, solver="banded")
    assert full.status == found.status == "ok"
    assert np.abs(other - end).max() < 1e-12 * np.abs(end).max()
    gentle, _ = ends(system, "implicit-midpoint", lattice("fpu", size=0.01)[1], 1.0, solver="banded")
    assert found.counts["gradient"] > 2 * gentle.counts["gradient"]
    hard, _ = ends(system, "implicit-midpoint", lattice("fpu", size=10.0)[1], 10.0, 4, solver="banded")
    assert hard.status == "ok", "where simplified Newton stalls, Newton's method itself takes over"


def test_evaluations_do_not_grow_with_the_lattice():
    counts = {}
    for d in (24, 96):
        for more in ({}, {"solver": "banded"}):
            system, start = lattice("fpu", d)
            counts[d, bool(more)] = ends(system, "implicit-midpoint", start, 0.2, 5, **more)[0].counts["gradient"]
    assert counts[96, True] < 1.2 * counts[24, True]
    assert counts[96, False] > 3 * counts[24, False], "the control"


def rows(reach):
    return [set(map(int, r)) for r in reach]


def test_coupled_masses_widen_the_structure():
    """T = p.M^-1 p / 2 with coupling in M^-1: the derivative of the kick equation contains Hessian times M^-1."""
    d = 6
    q, p = sp.symbols(f"q:{d}", real=True), sp.symbols(f"p:{d}", real=True)
    V = sum((q[i + 1] - q[i]) ** 2 / 2 + q[i] ** 4 / 4 for i in range(d - 1))
    for coupling, far in ((0, 1), (1, 2)):
        T = sum(x**2 for x in p) + sum(coupling * p[i] * p[i + 1] for i in range(d - 1)) / 2
        found = structure_of(Hamiltonian(q=q, p=p, H=T + V), 1)
        assert rows(found) == [set(range(max(0, j - far), min(d, j + far + 1))) for j in range(d)]


@pytest.mark.parametrize("n", [3, 8, 500])
def test_a_ring_has_a_band_of_width_two(n):
    """The sparsity of a ring is detected and numbered so that its band is narrow."""
    calls = []

    def f(x):
        calls.append(1)
        return (x - np.roll(x, 1)) ** 2 + (np.roll(x, -1) - x) ** 2

    reach = structure.find_structure(f, [np.linspace(1, 2, n)])
    assert rows(reach) == [{(j - 1) % n, j, (j + 1) % n} for j in range(n)]
    place, width = structure.band_order(reach)
    assert sorted(place) == list(range(n))
    assert width <= 2
    assert len(calls) < 12 * (1 + np.log2(n))


def test_probes_that_raise_or_are_not_finite_are_skipped():
    def each(f):
        return lambda x: np.array([f(z) for z in x])

    for f in (np.sqrt, each(math.sqrt), each(lambda x: math.exp(1000 * abs(min(x, 0)))), each(lambda x: 1 / max(x, 0))):
        with np.errstate(all="ignore"):
            assert rows(structure.find_structure(f, [-np.ones(9), np.ones(9)])) == [{i} for i in range(9)]
    with pytest.raises(InvalidInput, match="finite at none"):
        structure.find_structure(each(math.sqrt), [-np.ones(9)])


def grad_V(k):
    """The force of a ring of springs with a comparison that hides the effect of the last particle on the fifth."""

    def f(q, g):
        n = len(q)
        for i in range(n):
            g[i] = k * (2 * q[i] - q[i - 1] - q[(i + 1) % n])
        if q[n - 1] > -1e9:
            g[4] += k * q[n - 1]

    return f


def test_systems_without_a_band_are_refused():
    energy = {"energy": lambda k: lambda q, p: ((p * p).sum() / 2 + 0 * k, 1.0)}
    loops = {"grad_V": grad_V, "field": lambda k: unit_mass_field(grad_V(-k))} | energy
    names = [[f"{x}{i}" for i in range(30)] for x in "qp"]
    hiding = HandHamiltonian(q=names[0], p=names[1], loops=loops, constants=(1,)), np.ones(30), np.zeros(30)
    dense = by_loops(n_body, 90, (1,)), *map(np.array, n_body.plummer(30))
    for (system, q, p), words in ((hiding, "component 4"), (dense, "not banded")):
        with pytest.raises(InvalidInput, match=words):
            integrate(system, "implicit-midpoint", h=0.1, steps=1, q0=q, p0=p, **BAND)
    assert integrate(hiding[0], "implicit-midpoint", h=0.1, steps=1, q0=hiding[1], p0=hiding[2]).status == "ok"
    with pytest.raises(InvalidInput, match="not banded"):
        banded.band_of([np.arange(200) if j == 0 else np.array([0, j]) for j in range(200)])


@pytest.mark.parametrize(("n", "width"), [(1, 0), (2, 1), (9, 2), (5, 4), (200, 3)])
@pytest.mark.parametrize("diagonal", [0.0, 1e-9, 100.0])
def test_solutions_equal_scipys(n, width, diagonal):
    """A small diagonal forces interchanges; rows around the matrix are others'."""
    rng = np.random.default_rng(n + width)
    A, ab = np.zeros((n + 2, 3 * width + 2)), np.zeros((2 * width + 1, n))
    for i in range(n):
        for j in range(max(0, i - width), min(n, i + width + 1)):
            x = diagonal if i == j and diagonal and width else rng.normal()
            A[1 + i, j - i + width], ab[width + i - j, j] = x, x
    b = rng.normal(size=n)
    expected, table = solve_banded((width, width), ab, b), np.array([np.zeros(n), b])
    A[[0, -1]] = 5.0
    assert banded.factorize(A, 1, n, width)
    banded.substitute(A, 1, n, width, table, 1)
    condition = np.abs(expected).max() / np.abs(b).max() * np.abs(ab).max()
    assert np.abs(table[1] - expected).max() < 100 * EPS * n * condition * np.abs(expected).max()
    assert (table[0] == 0).all()
    assert (A[[0, -1]] == 5).all()
    if n > 2:
        assert (A[1:-1, -1].astype(int) != np.arange(n)).any() == (diagonal < 1), "interchanges"


def test_a_singular_matrix_is_reported():
    A = np.zeros((8, 8))
    A[:, 1] = 1.0
    assert not banded.factorize(A, 0, 8, 2)


def test_solver_is_a_parameter_of_the_method():
    chosen = method("scheme-iii", lam=0.25, solver="banded")
    assert (chosen.label, chosen(lam=1).family) == ("scheme-iii(lam=0.25, solver=banded)", "banded")
    assert method(chosen, solver="banded") == chosen
    assert method("scheme-iii", lam=0.25).family == "parametric"
    refused = ("implicit-midpoint", "sparse", "must be banded"), ("gauss-2", "banded", "no banded solver")
    for id, solver, words in (*refused, ("implicit-midpiont", "banded", "no method")):
        with pytest.raises(InvalidInput, match=words):
            method(id, solver=solver)


def test_columns_of_one_colour_share_no_row():
    rng = np.random.default_rng(5)
    for n in (3, 8, 40):
        reach = [np.unique(np.append(j, rng.integers(0, n, 2))) for j in range(n)]
        colours = structure.colour_columns(reach, n)
        for colour in set(colours):
            rows = np.concatenate([r for r, c in zip(reach, colours, strict=True) if c == colour])
            assert len(set(rows.tolist())) == len(rows)
        band = [np.arange(max(j - 1, 0), min(j + 2, n)) for j in range(n)]
        assert structure.colour_columns(band, n) == [j % 3 for j in range(n)]
