"""Box schemes: tableaus, and local conservation laws that hold or converge as declared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure import box_laws as laws
from phasebench.benchmarks.problems import klein_gordon, nls, problem
from phasebench.benchmarks.studies import multisymplectic
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.compile import codegen
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.multisymplectic import Stages, run, scheme, schemes
from phasebench.integrators.systems.multisymplectic import Box, Staggered

MODULES = {"nls": nls, "klein-gordon": klein_gordon}
DECLARED = [s.id for s in schemes().values() if s.multisymplectic]
CONTROLS = [s.id for s in schemes().values() if not s.multisymplectic]
N, FEW, LENGTH = 5, 3, 2 * np.pi


@pytest.fixture(params=MODULES)
def name(request):
    return request.param


def case(name, cells=N, strength=1.0):
    """(equation, initial values y, tangent vectors, grid spacing dx) of a wave equation on ``cells`` grid cells."""
    dx = LENGTH / cells
    y, *tangents = multisymplectic.CASES[name].data(dx * np.arange(cells))
    return MODULES[name].multisymplectic(strength), y, tangents, dx


def residual_row(name, chosen, h=0.01, steps=3, cells=9, strength=1.0):
    """The measured residuals of the local conservation laws of a box scheme, as a row of the results."""
    equation, y, tangents, dx = case(name, cells, strength)
    space = chosen.division(equation, cells, dx)
    return laws.measure(
        space, chosen, run(equation, chosen, y, dx, h, steps, tangents), h, multisymplectic.CASES[name].invariant
    )


def units(row, law=laws.TWO_FORM):
    """The residual of a local conservation law in a row of the table, in units of the round-off expected of it."""
    return row[law] / row[f"{law}, round-off"]


# -- equations and space discretizations -------------------------------------------------------------------------------


def test_gradient_and_hessian_of_s(name):
    equation, *_ = case(name)
    z = np.random.default_rng(1).normal(size=len(equation.K))
    moved = np.eye(len(z)) * 1e-5
    slope = [(equation.S(z + e) - equation.S(z - e)) / 2e-5 for e in moved]
    assert equation.gradient(z) == pytest.approx(slope, abs=1e-7)
    curve = [(equation.gradient(z + e) - equation.gradient(z - e)) / 2e-5 for e in moved]
    assert equation.hessian(z) == pytest.approx(np.array(curve), abs=1e-7)
    assert np.array_equal(equation.K, -equation.K.T)
    assert np.array_equal(equation.L, -equation.L.T)


@pytest.mark.parametrize("division", [Box, Staggered])
def test_space_discretization_is_symplectic(name, division):
    equation, y, _, dx = case(name)
    space = division(equation, N, dx)
    slope, back = space.slope(np.eye(N)), space.back(np.eye(N))
    assert back == pytest.approx(-slope.T, abs=1e-13)
    wave = np.exp(1j * dx * np.arange(N))[:, None]
    assert np.abs(space.slope(wave)) == pytest.approx(np.full((N, 1), abs(space.slope(wave)[0, 0])))
    if division is Box:
        nodes = space.nodes(y)
        assert (nodes + np.roll(nodes, -1, axis=0)) / 2 == pytest.approx(y, abs=1e-14)
        assert (np.roll(nodes, -1, axis=0) - nodes) / dx == pytest.approx(space.slope(y), abs=1e-13)
    difference = [(space.field(y + e) - space.field(y - e)).ravel() / 2e-6 for e in 1e-6 * directions(y)]
    assert space.jacobian(y) == pytest.approx(np.array(difference).T, abs=1e-7)


def directions(y):
    """The unit vectors of the state space, each in the shape of y."""
    return np.eye(y.size).reshape(y.size, *y.shape)


@pytest.mark.parametrize("id", schemes())
def test_equation_holds_at_the_stages(name, id):
    """K T + L z_x = grad S(Z) in all components, including those without a time derivative."""
    equation, y, _, dx = case(name)
    chosen = scheme(id)
    space = chosen.division(equation, N, dx)
    k = equation.slopes
    (step,) = run(equation, chosen, y, dx, 0.02, 1)
    for Y, T in zip(step.Y, step.T, strict=True):
        z, rate = space.lift(Y), space.lift(T)
        z_x = np.concatenate([space.slope(z[:, :-k]), space.back(z[:, -k:])], axis=1)
        rest = rate @ equation.K.T + z_x @ equation.L.T - equation.gradient(z)
        assert np.abs(rest).max() < 1e-12


def test_invalid_input_is_refused():
    equation, y, _, dx = case("nls")
    with pytest.raises(InvalidInput, match="odd"):
        Box(equation, 4, dx)
    with pytest.raises(InvalidInput, match="cells"):
        Staggered(equation, 2, dx)
    with pytest.raises(InvalidInput, match="did you mean"):
        scheme("preissman-box")
    with pytest.raises(InvalidInput, match="h > 0"):
        list(run(equation, scheme("preissmann-box"), y, dx, 0.0, 1))
    with pytest.raises(InvalidInput, match="needed"):
        list(run(equation, scheme("preissmann-box"), y[:, :1], dx, 0.1, 1))


@pytest.mark.parametrize("size", [2.0**-40, 2.0**40])
def test_steps_of_a_linear_equation_scale(name, size):
    """The stopping rule of Newton's method does not depend on units."""
    equation, y, _, dx = case(name, strength=0.0)
    for id in ("gauss-box", "equip-box"):
        (one,), (other,) = (run(equation, scheme(id), z, dx, 1.0, 1) for z in (y, size * y))
        assert np.abs(other.end / size - one.end).max() < 1e-13


def test_derivative_of_the_stages_by_the_parameter(name):
    """The parameter enters linearly; the weights of the stages are unequal."""
    equation, y, _, dx = case(name)
    chosen = replace(scheme("equip-box"), b=np.array([0.25, 0.75]))
    stages = Stages(Box(equation, N, dx), chosen, y, 0.02, 0.01)
    (A_q, A_p), (B_q, B_p) = chosen.at(0.0), chosen.at(1.0)
    q, p = np.split(stages.T, 2, axis=-1)
    more = [0.02 * np.einsum("ij,jnc->inc", B, x) for B, x in ((B_q - A_q, q), (B_p - A_p, p))]
    assert stages.by_parameter() == pytest.approx(np.concatenate(more, axis=-1), abs=1e-15)


def test_tangents_with_a_variable_parameter_keep_energy(name):
    """The energy at the end of a step is fixed, so its derivative by the initial state vanishes."""
    equation, y, tangents, dx = case(name)
    space = Box(equation, N, dx)
    (step,) = run(equation, scheme("equip-box"), y, dx, 0.2, 1, tangents)
    assert step.found

    def moved(tangent):
        ends = [space.total_energy(step.end + e * tangent.end) for e in (1e-6, -1e-6)]
        return abs(ends[0] - ends[1]) / 2e-6

    assert max(map(moved, step.moving)) < 1e-6
    assert max(map(moved, step.tangents)) > 1e-3, "the control"


def test_tableaus_are_the_textbooks():
    """The box schemes have the tableaus of Gauss, Radau IIA, the midpoint rule and symplectic Euler."""
    made, off = schemes.__wrapped__(), np.sqrt(3) / 6
    wanted = {
        "gauss-box": ([[1 / 4, 1 / 4 - off], [1 / 4 + off, 1 / 4]], [1 / 2, 1 / 2]),
        "radau-box": ([[5 / 12, -1 / 12], [3 / 4, 1 / 4]], [3 / 4, 1 / 4]),
        "preissmann-box": ([[1 / 2]], [1]),
    }
    for id, (A, b) in wanted.items():
        for found, x in ((made[id].A_q, A), (made[id].A_p, A), (made[id].b, b)):
            assert found == pytest.approx(np.array(x, float), abs=1e-16)
    assert (made["euler-box"].A_q, made["euler-box"].A_p) == (0, 1)


def test_repr_of_a_scheme_omits_its_tableau():
    for id in schemes():
        assert "array" not in repr(scheme(id))
        assert id in repr(scheme(id))


# -- the schemes -------------------------------------------------------------------------------------------------------


def canonical_system(space) -> Hamiltonian:
    """The nonlinear Schroedinger equation on the grid of ``space`` as a canonical Hamiltonian system."""
    D = sp.Matrix(space.slope(np.eye(space.N)))
    q, p = (sp.symbols([f"{x}{j}" for j in range(space.N)], real=True) for x in "qp")
    bending = sum(((D * sp.Matrix(x)).T * (D * sp.Matrix(x)))[0] for x in (q, p)) / 2
    return Hamiltonian(q=q, p=p, H=bending - sum((x**2 + y**2) ** 2 / 2 for x, y in zip(q, p, strict=True)))


@pytest.mark.parametrize(
    ("id", "method"),
    [("euler-box", "symplectic-euler-p"), ("preissmann-box", "implicit-midpoint")],
)
def test_box_scheme_is_a_method_in_time(id, method):
    """A box scheme equals a method of the package on the equation discretized in space; control: half the step.

    Both share no code.
    """
    equation, y, _, dx = case("nls", FEW)
    chosen = scheme(id)
    system = canonical_system(chosen.division(equation, FEW, dx))
    *_, step = run(equation, chosen, y, dx, 0.05, 4)
    ends = [integrate(system, method, h=h, t_end=0.2, q0=y[:, 0], p0=y[:, 1], save_every=0) for h in (0.05, 0.025)]
    same, other = (np.abs(np.hstack([s.q[-1], s.p[-1]]) - step.end.T.ravel()).max() for s in ends)
    assert same < 1e-12
    assert other > 1e-7


def test_staggered_grid_is_that_of_the_wave_problems(name):
    """The staggered grid has the central differences in space of the registered wave problems."""
    made = problem(name, N=N, L=LENGTH)
    equation, y, _, dx = case(name)
    q, p = np.split(y.T.ravel() * np.sqrt(dx), 2)
    T = tuple if codegen.compiled() and codegen.value_kind(made.system.d) == "tuple" else np.array
    rates = np.hstack(made.system.field()(T(q), T(p), 0.0, 0.0)) / np.sqrt(dx)
    assert Staggered(equation, N, dx).field(y).T.ravel() == pytest.approx(rates, abs=1e-12)


# -- the laws ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", DECLARED)
def test_multisymplectic_law_holds(name, id):
    assert units(residual_row(name, scheme(id), h=0.004)) < multisymplectic.UNITS


@pytest.mark.parametrize("id", CONTROLS)
def test_control_multisymplectic_law_is_violated(name, id):
    assert units(residual_row(name, scheme(id))) > 1e3


@pytest.mark.parametrize("id", ["euler-box", "preissmann-box", "gauss-box"])
def test_perturbed_coefficient_is_detected(name, id):
    chosen = scheme(id)
    off = replace(chosen, A_q=chosen.A_q + 1e-6)
    assert units(residual_row(name, off, h=0.004)) > 1e3


def test_variable_parameter_breaks_the_law(name):
    row = residual_row(name, scheme("equip-box"))
    assert units(row) < multisymplectic.UNITS
    assert units(row, laws.FOLLOWS) > 1e6
    assert row["total energy error"] < 1e-12
    assert row["quadratic invariant error"] < 1e-13
    assert row["steps without a root"] == 0
    assert 0 < row["largest parameter"] < 0.1


def test_linear_equation_satisfies_all_laws(name):
    """Energy and momentum are quadratic there; with S of degree four their local laws are violated."""
    linear, full = (residual_row(name, scheme("preissmann-box"), strength=s) for s in (0.0, 1.0))
    for law in (laws.ENERGY, laws.MOMENTUM):
        assert units(linear, law) < multisymplectic.UNITS
        assert units(full, law) > 1e3


def test_laws_on_the_staggered_grid(name):
    """Midpoint rule, linear equation: local energy is exact, the momentum residual falls as dx^2."""
    chosen = replace(scheme("preissmann-box"), division=Staggered)
    assert units(residual_row(name, chosen, strength=0.0), laws.ENERGY) < multisymplectic.UNITS
    assert units(residual_row(name, chosen), laws.ENERGY) > 1e3
    coarse, fine = (residual_row(name, chosen, h=1e-3, cells=cells)[laws.MOMENTUM] for cells in (33, 66))
    assert coarse / fine == pytest.approx(4, rel=0.1)
    early, late = (residual_row(name, scheme("euler-box"), h=h)[laws.ENERGY] for h in (2e-3, 1e-3))
    assert early / late == pytest.approx(2, rel=0.1)


def test_small_increments_are_not_lost():
    """A thousand steps, each changing less than half of the last digit."""
    equation, y, _, dx = case("nls", FEW)
    *_, step = run(equation, scheme("preissmann-box"), y, dx, 1e-17, 1000)
    rate = Box(equation, FEW, dx).field(y)
    large = np.abs(y) > 0.5
    assert (np.abs(1e-17 * rate[large]) < np.spacing(y[large]) / 2).all()
    assert (step.end - y)[large] == pytest.approx(1e-14 * rate[large], abs=1.2 * np.spacing(1.0))
    assert np.abs(1e-14 * rate[large]).max() > 3 * np.spacing(1.0)


def test_avf_box_preserves_the_energy_of_every_cell(name):
    assert units(residual_row(name, scheme("avf-box")), laws.ENERGY) < multisymplectic.UNITS
    assert units(residual_row(name, replace(scheme("avf-box"), means=False)), laws.ENERGY) > 1e3


def test_largest_residual_is_stored():
    law = laws.Residuals()
    law.add((np.array([1.0, -3.0]), np.array([-1.0, 2.5])), 1e-3)
    law.add((np.array([2.0]), np.array([-1.9])), 2e-3)
    assert law.row("x") == {"x": 0.5, "x, largest term": 3.0, "x, round-off": 2e-3}
    assert set(laws.Residuals().row("x").values()) == {0.0}


def test_unit_of_round_off_follows_the_steepest_wave(name):
    """The box's slope of a wave of k periods is tan(k dx / 2) 2 / dx; here k = 2 on five cells."""
    equation, y, tangents, dx = case(name)
    h, steep = 0.01, 2 * np.tan(dx) / dx
    assert laws.steepest(Box(equation, N, dx)) == pytest.approx(steep)
    row = residual_row(name, scheme("preissmann-box"), h=h, steps=1, cells=N)
    largest = np.abs(y).max()
    wanted = {
        laws.TWO_FORM: (steep**2 + 1 / h) * np.prod([np.abs(t).max() for t in tangents]),
        laws.ENERGY: steep**2 / h * largest**2,
        laws.MOMENTUM: steep**2 / h * largest**2,
    }
    for law, size in wanted.items():
        assert row[f"{law}, round-off"] == pytest.approx(np.finfo(float).eps * size, rel=1e-9, abs=0)


def test_steps_without_a_root_are_counted():
    equation, y, tangents, dx = case("nls")
    steps = run(equation, scheme("equip-box"), y, dx, 0.01, 3, tangents)
    missed = [replace(step, found=k == 1, alpha=-0.5 if k == 1 else 0.25) for k, step in enumerate(steps)]
    row = laws.measure(Box(equation, N, dx), scheme("equip-box"), missed, 0.01, multisymplectic.mass)
    assert (row["steps without a root"], row["largest parameter"]) == (2, 0.5)


def test_unsolvable_step_gives_a_row():
    row = multisymplectic.measure("nls", "euler-box", multisymplectic.IN_TIME, 9, 1e9, steps=1)
    assert row["status"] == "not-converged"
    assert "smaller h" in row["reason"]


# -- initial data and ladders ------------------------------------------------------------------------------------------


def waves(values) -> np.ndarray:
    """Amplitudes of the cosines (real) and sines (imaginary part) of each component: array (k, m)."""
    found = np.fft.rfft(values, axis=0) / len(values)
    found[1:] *= 2
    return np.round(found, 12)


def test_initial_data_are_the_stated_waves():
    """psi = 1 + 0.4 cos x + 0.2 i sin x and the like; tangents have at most two periods."""
    x = 2 * np.pi / 9 * np.arange(9)
    values = {
        "nls": [[1, 0], [0.4, -0.2j]],
        "klein-gordon": [[1, 0, 0, 0.5], [0.5, -0.3j, -0.2j, 0.2]],
    }
    for name, wanted in values.items():
        y, u, v = multisymplectic.CASES[name].data(x)
        assert waves(y)[:2].tolist() == wanted
        assert not waves(y)[2:].any()
        for tangent in (u, v):
            assert not waves(tangent)[3:].any()
            assert np.abs(waves(tangent)[:3]).max(axis=0) == pytest.approx(np.ones(tangent.shape[1]))


@pytest.mark.parametrize("id", ["preissmann-box", "euler-box"])
def test_ladder_refines_first_in_time_then_in_space(name, id):
    rungs = multisymplectic.ladder(multisymplectic.CASES[name], scheme(id))
    kinds = multisymplectic.IN_TIME, multisymplectic.IN_SPACE
    in_time, in_space = ([(N, h, steps) for (what, N, h), steps in rungs.items() if what == falls] for falls in kinds)
    assert len(in_time) == 4
    assert {cells for cells, _, _ in in_time} == {min(multisymplectic.CELLS)}
    longest = in_time[0][1]
    assert [h / longest for _, h, _ in in_time] == [1, 1 / 2, 1 / 4, 1 / 8]
    assert {h * steps / longest for _, h, steps in in_time} == {10}
    assert [cells for cells, _, _ in in_space] == sorted(multisymplectic.CELLS)
    assert {h for _, h, _ in in_space} == {longest / 8}
    assert all(cells % 2 for cells in multisymplectic.CELLS), "the box scheme needs it"


def test_longest_step_is_in_the_asymptotic_range(name):
    h = multisymplectic.CASES[name].longest
    rows = [
        multisymplectic.measure(name, "preissmann-box", multisymplectic.IN_TIME, 17, h / k, steps=10 * k)
        for k in (1, 2)
    ]
    assert [row["status"] for row in rows] == ["ok", "ok"]
    coarse, fine = (row[laws.ENERGY] for row in rows)
    assert coarse / fine == pytest.approx(4, rel=0.1)
