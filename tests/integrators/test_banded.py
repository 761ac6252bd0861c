"""The banded Newton solver takes the same steps as full matrices, at a cost that grows linearly with d."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_banded

from phasebench.benchmarks.problems import fpu, klein_gordon, n_body, nls, problem, toda
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.integrators.families.banded import structure_of
from phasebench.integrators.outcome import solver_failure
from phasebench.integrators.prepared import lay_out, prepare
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import banded, structure
from phasebench.integrators.systems.hand import HandHamiltonian, unit_mass_field
from support.solutions import last

EPS = np.finfo(float).eps
#: Name -> (module, constants, d, step where fixed-point iteration converges, step where it does not).
LATTICES = {
    "toda": (toda, (), 25, 0.1, 3.0),
    "fpu": (fpu, (2500,), 24, 0.01, 0.2),
    "klein-gordon": (klein_gordon, (4, 2), 24, 0.1, 1.0),
    "nls": (nls, (4, 4), 24, 0.02, 0.5),
}


def lattice(name, d=None, constants=None):
    """(hand-written system, initial data) of a lattice."""
    module, usual, least, *_ = LATTICES[name]
    d = d or least
    loops = {n: getattr(module, n) for n in ("field", "grad_V", "energy") if hasattr(module, n)}
    q, p = ([f"{x}{i}" for i in range(d)] for x in "qp")
    system = HandHamiltonian(q=q, p=p, loops=loops, constants=usual if constants is None else constants)
    start = 0.1 * np.random.default_rng(7).normal(size=(2, d))
    return system, dict(zip(("q0", "p0"), start, strict=True))


def ends(system, id, start, h, steps=15, **parameters):
    """(solution, end state) of a run from these initial data."""
    s = integrate(system, id, h=h, steps=steps, parameters=parameters, **start)
    return s, last(s)


# -- same steps as with full matrices ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("long", [False, True])
def test_banded_steps_equal_full_steps(name, long):
    """Both where the fixed-point iteration converges and where it does not."""
    system, start = lattice(name)
    h = LATTICES[name][4 if long else 3]
    full, end = ends(system, "implicit-midpoint", start, h)
    found, other = ends(system, "implicit-midpoint", start, h, solver="banded")
    assert full.status == found.status == "ok"
    assert (full.counts["newton"] == 15) == long
    assert np.abs(other - end).max() < 2e-14 * np.abs(end).max()
    moved = np.abs(end - np.concatenate([start["q0"], start["p0"]])).max()
    assert moved > 1e-2, "the control"
    assert found.counts["newton"] == 15
    if long:
        assert found.counts["gradient"] < full.counts["gradient"] / 5


@pytest.mark.parametrize(
    ("id", "parameters"),
    [
        ("scheme-i", {"lam": 1 / 3}),
        ("scheme-i", {"lam": -1}),
        ("scheme-iii", {"lam": 1 / 3}),
        ("scheme-iii", {"lam": 0.9}),
        ("implicit-euler", {}),
        ("scheme-iii-yoshida-4", {}),
    ],
)
@pytest.mark.parametrize("name", ["toda", "nls"])
def test_every_one_stage_method_takes_the_same_steps(name, id, parameters):
    system, start = lattice(name)
    full, end = ends(system, id, start, 0.03, **parameters)
    found, other = ends(system, id, start, 0.03, **parameters, solver="banded")
    assert full.status == found.status
    assert len(full.q) == len(found.q) > 1
    assert found.counts["newton"] >= len(found.q) - 1, "the banded solver, which takes no fixed-point iterations"
    assert np.abs(other - end).max() < 1e-13 * np.abs(end).max()


def test_tuple_states_and_higher_order_fields():
    made = problem("toda")
    full, found = (
        integrate(made, "scheme-ii", h=0.3, steps=10, parameters=more) for more in ({}, {"solver": "banded"})
    )
    assert full.status == found.status == "ok"
    assert np.abs(full.q - found.q).max() < 1e-14 * np.abs(full.q).max()


def test_coupled_masses_widen_the_structure():
    """T = p.M^-1 p / 2 with coupling in M^-1: the derivative of the kick equation contains Hessian times M^-1."""
    d = 6
    q, p = sp.symbols(f"q:{d}", real=True), sp.symbols(f"p:{d}", real=True)
    V = sum((q[i + 1] - q[i]) ** 2 / 2 + q[i] ** 4 / 4 for i in range(d - 1))
    for coupling, far in ((0, 1), (1, 2)):
        T = sum(x**2 for x in p) + sum(coupling * p[i] * p[i + 1] for i in range(d - 1)) / 2
        reach = structure_of(Hamiltonian(q=q, p=p, H=T + V), 1)
        assert [set(r) for r in reach] == [set(range(max(0, j - far), min(d, j + far + 1))) for j in range(d)]


#: Powers that are finite only for small coordinates, for those near 1, or for large ones.
DOMAINS = {"small": lambda x: x**6000, "of one": lambda x: x**400 + x**-400, "large": lambda x: x**-6000}


@pytest.mark.parametrize("name", DOMAINS)
def test_structure_is_probed_where_the_system_is_finite(name):
    q, p = sp.symbols("q:5", real=True), sp.symbols("p:5", real=True)
    V = sum(map(DOMAINS[name], q)) + q[0] * q[1]
    reach = structure_of(Hamiltonian(q=q, p=p, H=sum(x**2 for x in p) / 2 + V), 1)
    assert [set(r) for r in reach] == [{0, 1}, {0, 1}, {2}, {3}, {4}]


@pytest.mark.parametrize("id", ["implicit-midpoint", "scheme-iii"])
def test_a_run_in_pieces_keeps_its_matrix(id):
    """A short run with another step size in between changes neither the end nor the counts."""
    system, start = lattice("toda", 21)
    run = prepare(system, id, parameters={"solver": "banded"}, **start)
    first, *_, code = run(1.0, 3)
    counts = dict(run.counts)
    assert (code, counts["steps"], counts["newton"]) == (run.SOLVED, 3, 3 * (1 if id == "implicit-midpoint" else 2))
    run(1e-3, 1)
    assert (run(1.0, 3)[0] == first).all()
    assert run.counts == counts
    pieces = lay_out(run._prepared, 21, 1.0, start["q0"], start["p0"])
    Q, P = np.zeros((2, 2, 21))
    for k, steps in enumerate((1, 2)):
        assert pieces(Q[k : k + 1], P[k : k + 1], np.zeros((1, 1)), steps) == (1, 0)
    assert (Q[1] == first).all()
    assert pieces.counts["gradient"] == counts["gradient"]
    q, _, code = run(1e3, 1)
    assert code != run.SOLVED
    assert np.isnan(q).all()


def test_a_step_ends_at_its_first_unsolved_substep():
    """The count of evaluations is compared with that of a single failing substep."""
    (system, start), counts = lattice("toda", 21), []
    for id, h, more in (("scheme-iii", 2e3, {"lam": 0.5}), ("implicit-midpoint", 1e3, {})):
        run = prepare(system, id, parameters={"solver": "banded", **more}, **start)
        assert run(h, 1)[2] != run.SOLVED
        counts.append(run.counts["gradient"])
    assert counts[0] == counts[1] > 0


def test_explicit_steps_stay_explicit():
    system, start = lattice("toda")
    explicit, end = ends(system, "scheme-i", start, 0.1, lam=1)
    same, other = ends(system, "scheme-i", start, 0.1, lam=1, solver="banded")
    assert (end == other).all()
    assert same.counts == explicit.counts


def test_unsolvable_equations_are_reported():
    system, start = lattice("nls")
    start = {name: 10 * x for name, x in start.items()}
    for more in ({}, {"solver": "banded"}):
        s = integrate(system, "implicit-midpoint", h=0.5, steps=3, parameters=more, **start)
        assert s.status == "not-converged", s.reason
        assert ("neither the fixed point nor" in s.reason) == ("or try solver='banded'" in s.reason) == (not more)
        assert ("Newton's method in a band does not" in s.reason) == bool(more)
        assert "; take a smaller h" in s.reason


@pytest.mark.parametrize(
    ("id", "d", "advised"), [("scheme-iii", 21, True), ("scheme-iii", 20, False), ("gauss-2", 21, False)]
)
def test_banded_is_suggested_for_large_systems(id, d, advised):
    assert ("or try solver='banded'" in solver_failure(method(id).family, d).advice) == advised


def test_a_useless_matrix_is_replaced():
    """Long steps of large amplitude, where the matrix must be renewed; the full solver reaches the same state."""
    system, start = lattice("fpu")
    start = {name: 30 * x for name, x in start.items()}
    full, end = ends(system, "implicit-midpoint", start, 1.0)
    found, other = ends(system, "implicit-midpoint", start, 1.0, solver="banded")
    assert full.status == found.status == "ok"
    assert np.abs(other - end).max() < 1e-12 * np.abs(end).max()
    gentle, _ = ends(system, "implicit-midpoint", {k: x / 300 for k, x in start.items()}, 1.0, solver="banded")
    assert found.counts["gradient"] > 2 * gentle.counts["gradient"]


def test_a_prepared_run_in_a_band_equals_integrate():
    system, start = lattice("toda")
    found = prepare(system, "implicit-midpoint", parameters={"solver": "banded"}, **start)(3.0, 5)[0]
    whole = integrate(system, "implicit-midpoint", h=3.0, steps=5, parameters={"solver": "banded"}, **start)
    assert (whole.q[-1] == found).all()


# -- the cost ----------------------------------------------------------------------------------------------------------


def test_evaluations_do_not_grow_with_the_lattice():
    """Evaluations per step of the banded solver, and (control) of the full one."""
    counts = {}
    for d in (24, 96):
        system, start = lattice("fpu", d)
        for solver in ("banded", None):
            more = {} if solver is None else {"solver": solver}
            counts[d, solver] = ends(system, "implicit-midpoint", start, 0.2, steps=5, **more)[0].counts["gradient"]
    assert counts[96, "banded"] < 1.2 * counts[24, "banded"]
    assert counts[96, None] > 3 * counts[24, None], "the control"


class CountedFloat(float):
    """A float that counts its arithmetic operations."""

    operations = 0


def _counting(name):
    def operate(self, other):
        CountedFloat.operations += 1
        return CountedFloat(getattr(float, name)(self, float(other)))

    return operate


for _name in ("__mul__", "__rmul__", "__truediv__", "__rtruediv__", "__sub__", "__add__"):
    setattr(CountedFloat, _name, _counting(_name))


def operations(n, width):
    """Number of arithmetic operations to factorize a banded matrix and to solve with it once."""
    A = np.zeros((n, 3 * width + 2), object)
    A[:, : 2 * width + 1] = np.random.default_rng(1).normal(size=(n, 2 * width + 1))
    A[...] = np.vectorize(CountedFloat, otypes=[object])(A)
    CountedFloat.operations = 0
    assert banded.factorize.py_func(A, 0, n, width)
    table = np.array([[CountedFloat(1.0)] * n], object)
    banded.substitute.py_func(A, 0, n, width, table, 0)
    return CountedFloat.operations


def test_operations_grow_linearly_with_the_lattice():
    few, many = operations(50, 3), operations(200, 3)
    assert 3.9 < many / few < 4.4
    assert many < 200 * 3 * (4 * 3 + 10)
    assert operations(50, 49) > 5 * few, "the control: as wide as it is long"


@pytest.mark.parametrize("name", LATTICES)
def test_matrix_size_grows_linearly_with_the_lattice(name):
    sizes = {}
    for d in (40, 160):
        system, start = lattice(name, d)
        run = prepare(system, "implicit-midpoint", parameters={"solver": "banded"}, **start)
        band = run._prepared.step.band
        sizes[d] = band.width, len(band.owner), run._layout.carry.work.size / d
    assert sizes[40] == sizes[160]
    assert sizes[40][0] <= 7
    assert sizes[40][1] <= 9


# -- structure ---------------------------------------------------------------------------------------------------------


def ring(n, f=lambda x: x * x):
    """(function of neighbour differences of x on a ring, list that gets an entry at each evaluation)."""
    calls = []

    def slope(x):
        calls.append(1)
        return f(x - np.roll(x, 1)) + f(np.roll(x, -1) - x)

    return slope, calls


@pytest.mark.parametrize("n", [3, 8, 37, 500])
def test_a_ring_has_a_band_of_width_two(n):
    """The sparsity of a ring is detected and numbered so that its band is narrow."""
    f, calls = ring(n)
    reach = structure.find_structure(f, [np.linspace(1, 2, n)])
    assert all(set(r) == {(j - 1) % n, j, (j + 1) % n} for j, r in enumerate(reach))
    place, width = structure.band_order(reach)
    assert sorted(place) == list(range(n))
    assert width <= 2
    assert len(calls) < 12 * (1 + np.log2(n))


def test_colours_share_no_row():
    rng = np.random.default_rng(2)
    reach = [np.unique(rng.integers(0, 40, size=4)) for _ in range(40)]
    colours = structure.colour_columns(reach, 40)
    owner = structure.owners(reach, colours)
    for j, rows in enumerate(reach):
        assert (owner[colours[j], rows] == j).all()
    assert (owner >= 0).sum() == sum(map(len, reach))


def test_colours_and_widths_of_a_diagonal_and_a_chain():
    alone, chain = [[j] for j in range(7)], [[i for i in (j - 1, j, j + 1) if 0 <= i < 7] for j in range(7)]
    for reach, colours, width in ((alone, 1, 0), (chain, 3, 1)):
        reach = [np.array(rows) for rows in reach]
        assert set(structure.colour_columns(reach, 7)) == set(range(colours))
        assert structure.band_order(reach)[1] == width


def test_probes_that_are_not_finite_are_skipped():
    f, _ = ring(9, np.sqrt)
    with pytest.raises(InvalidInput, match="finite at none"):
        structure.find_structure(f, [np.arange(9.0)])
    reach = structure.find_structure(lambda x: np.sqrt(x) + np.roll(x, 1), [-np.ones(9), np.ones(9)])
    assert all(set(r) == {j, (j + 1) % 9} for j, r in enumerate(reach))


def test_probes_at_which_a_function_raises_are_skipped():
    for f in (math.sqrt, lambda x: math.exp(1000 * abs(min(x, 0))), lambda x: 1 / max(x, 0)):
        reach = structure.find_structure(lambda x, f=f: np.array([f(z) for z in x]), [-np.ones(9), np.ones(9)])
        assert [list(rows) for rows in reach] == [[i] for i in range(9)]
    with pytest.raises(InvalidInput, match="finite at none"):
        structure.find_structure(lambda x: np.array([math.sqrt(z) for z in x]), [-np.ones(9)])


def test_a_hidden_dependence_is_reported():
    """A function is refused if a branch hides a dependence at the points where its sparsity is probed."""

    def honest(x):
        return x + np.roll(x, 1)

    def hiding(x):
        far = x[-1] if x[-1] == x[-1] else 0.0
        return honest(x) + np.where(np.arange(len(x)) == 4, 3 * far, 0.0)

    at = [np.linspace(1, 2, 12)]
    assert len(structure.find_structure(honest, at)) == 12
    with pytest.raises(InvalidInput, match="component 4 depends on more"):
        structure.find_structure(hiding, at)


def hiding_chain():
    """Loops of a ring of springs with a comparison that hides the effect of the last particle on the fifth."""

    def grad_V(k):
        def f(q, g):
            n = len(q)
            for i in range(n):
                g[i] = k * (2 * q[i] - q[i - 1] - q[(i + 1) % n])
            if q[n - 1] > -1e9:
                g[4] += k * q[n - 1]

        return f

    def energy(k):
        return lambda q, p: ((p * p).sum() / 2 + 0 * k, 1.0)

    return {"grad_V": grad_V, "field": lambda k: unit_mass_field(grad_V(-k)), "energy": energy}


def test_a_system_with_hidden_dependences_is_refused():
    q, p = ([f"{x}{i}" for i in range(30)] for x in "qp")
    system = HandHamiltonian(q=q, p=p, loops=hiding_chain(), constants=(1,))
    start = {"q0": np.ones(30), "p0": np.zeros(30)}
    with pytest.raises(InvalidInput, match="component 4"):
        integrate(system, "implicit-midpoint", h=0.1, steps=1, parameters={"solver": "banded"}, **start)
    assert integrate(system, "implicit-midpoint", h=0.1, steps=1, **start).status == "ok"


def test_dense_systems_are_refused():
    loops = {n: getattr(n_body, n) for n in ("field", "grad_V", "energy")}
    q, p = ([f"{x}{i}" for i in range(90)] for x in "qp")
    system = HandHamiltonian(q=q, p=p, loops=loops, constants=(1,))
    start = dict(zip(("q0", "p0"), map(np.array, n_body.plummer(30)), strict=True))
    with pytest.raises(InvalidInput, match="not banded"):
        integrate(system, "implicit-midpoint", h=0.1, steps=1, parameters={"solver": "banded"}, **start)


def test_a_star_has_no_band():
    n = 200
    star = [np.arange(n) if j == 0 else np.array([0, j]) for j in range(n)]
    with pytest.raises(InvalidInput, match="not banded"):
        banded.band_of(star)


def torus(n):
    """Sparsity (rows of each column) of a periodic lattice of n times n sites."""
    sites = np.arange(n * n).reshape(n, n)
    near = [sites, *(np.roll(sites, by, axis) for by in (1, -1) for axis in (0, 1))]
    return list(np.stack(near, axis=-1).reshape(n * n, 5))


def test_the_band_of_a_square_lattice_is_as_wide_as_its_side():
    assert banded.band_of(torus(12)).width <= 2 * 12
    with pytest.raises(InvalidInput, match="unknowns far"):
        banded.band_of(torus(70))


# -- the linear algebra ------------------------------------------------------------------------------------------------


def banded_matrix(n, width, seed, diagonal=0.0):
    """(A as `factorize` takes it, SciPy's banded form) of a random matrix; a small diagonal forces interchanges.

    The first and the last row of A are none of the matrix's.
    """
    rng = np.random.default_rng(seed)
    A, ab = np.zeros((n + 2, 3 * width + 2)), np.zeros((2 * width + 1, n))
    for i in range(n):
        for j in range(max(0, i - width), min(n, i + width + 1)):
            x = diagonal if i == j and diagonal else rng.normal()
            A[1 + i, j - i + width], ab[width + i - j, j] = x, x
    return A, ab


@pytest.mark.parametrize(("n", "width"), [(1, 0), (2, 1), (7, 0), (9, 2), (30, 5), (5, 4), (200, 3)])
@pytest.mark.parametrize("diagonal", [0.0, 1e-9, 100.0])
def test_solutions_equal_scipys(n, width, diagonal):
    if width == 0 and diagonal == 1e-9:
        diagonal = 1.0
    A, ab = banded_matrix(n, width, n + width, diagonal)
    b = np.random.default_rng(n).normal(size=n)
    expected = solve_banded((width, width), ab, b)
    table = np.array([np.zeros(n), b])
    A[[0, -1]] = 5.0
    assert banded.factorize(A, 1, n, width)
    banded.substitute(A, 1, n, width, table, 1)
    condition = np.abs(expected).max() / np.abs(b).max() * np.abs(ab).max()
    assert np.abs(table[1] - expected).max() < 100 * EPS * n * condition * np.abs(expected).max()
    assert (table[0] == 0).all()
    assert (A[[0, -1]] == 5).all()
    pivots = A[1:-1, -1].astype(int)
    if n != 2:
        assert (pivots != np.arange(n)).any() == (diagonal < 1 and width > 0)


def test_a_singular_matrix_is_reported():
    A, _ = banded_matrix(8, 2, 0)
    A[1:, 2:3] = 0.0
    A[1:, [0, 1, 3, 4]] = 0.0
    assert not banded.factorize(A, 1, 8, 2)


# -- the parameter `solver` -------------------------------------------------------------------------------------------


def test_solver_is_a_parameter_of_the_method():
    chosen = method("scheme-iii", lam=0.25, solver="banded")
    assert chosen.label == "scheme-iii(lam=0.25, solver=banded)"
    assert chosen(lam=1).data == method("scheme-iii", lam=1).data
    assert chosen(lam=1).family == "banded"
    assert method(chosen, solver="banded") == chosen
    assert method("scheme-iii", lam=0.25).family == "parametric"
    assert method("implicit-midpoint", solver="banded").label == "implicit-midpoint(solver=banded)"


def test_other_solvers_and_methods_are_refused():
    with pytest.raises(InvalidInput, match="must be banded"):
        method("implicit-midpoint", solver="sparse")
    with pytest.raises(InvalidInput, match="must be banded"):
        method("implicit-midpoint", solver="banded")(solver="sparse")
    with pytest.raises(InvalidInput, match="no banded solver"):
        method("gauss-2", solver="banded")
    with pytest.raises(InvalidInput, match="no method"):
        method("implicit-midpiont", solver="banded")
