"""SIMD lanes: operations and elementary functions against 40 digits, and Gauss methods with their stages in lanes."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import mpmath
import numba
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, driver, trajectory
from phasebench.integrators.coefficients.quadrature import gauss_legendre
from phasebench.integrators.coefficients.tableaus import LEVELS
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import collocation, gauss_lanes, stage_lanes
from phasebench.integrators.prepared import lay_out
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.systems.poisson import PoissonSystem
from phasebench.integrators.values import elementary
from phasebench.integrators.values.lanes import combine, polynomial, put, take, total
from support.solutions import rough_end

WIDTH = 8
LIKE = (0.0,) * WIDTH
RANDOM = np.random.default_rng(0)


def over(function):
    """Compile a function of one row of SIMD lanes, and return it as a function of an array."""

    @numba.njit
    def each(x, y):
        for i in range(len(x)):
            put(y, i, function(take(x, i, LIKE)), LIKE)

    def on(x):
        x = np.asarray(x, float)
        y = np.empty_like(x)
        each(x.reshape(-1, WIDTH), y.reshape(-1, WIDTH))
        return y

    return on


LANED = {name: over(getattr(elementary, name)) for name in ("sin", "cos", "exp", "sqrt", "sinh", "cosh", "tanh")}


def units(name, x):
    """Errors of an elementary function in SIMD lanes at the points x, in units in the last place."""
    y = LANED[name](x)
    with mpmath.workdps(40):
        exact = [getattr(mpmath, name)(mpmath.mpf(float(a))) for a in x]
        wrong = [abs(mpmath.mpf(float(a)) - b) for a, b in zip(y, exact, strict=True)]
        return np.array([float(e / np.spacing(abs(float(b)))) for e, b in zip(wrong, exact, strict=True)])


# -- functions --------------------------------------------------------------------------------------------------------

MULTIPLES = np.pi / 2 * np.arange(-1024, 1024)
RANGES = {"small": (-2, 2), "ordinary": (-100, 100), "large": (-1e6, 1e6)}


@pytest.mark.processor
@pytest.mark.parametrize("name", ["sin", "cos"])
@pytest.mark.parametrize("size", RANGES)
def test_sine_and_cosine_are_exact_to_the_last_places(name, size):
    assert units(name, RANDOM.uniform(*RANGES[size], 2048)).max() < 2.5


@pytest.mark.processor
@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine_near_their_zeros(name):
    assert units(name, MULTIPLES).max() < 2.5


@pytest.mark.processor
@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine_beyond_a_million(name):
    """An error below the spacing of x; NaN beyond 1e12."""
    x = RANDOM.uniform(-1e12, 1e12, 2048)
    with mpmath.workdps(40):
        exact = np.array([float(getattr(mpmath, name)(mpmath.mpf(a))) for a in x])
    error = np.abs(LANED[name](x) - exact)
    assert np.all(error < 4e-16 + np.spacing(np.abs(x)))
    assert np.isnan(LANED[name](np.array([2e12, -2e12, np.inf, -np.inf, np.nan, 1e300, -1e18, 3e12]))).all()


@pytest.mark.processor
def test_the_exponential_is_exact_to_the_last_place():
    assert units("exp", RANDOM.uniform(-1, 1, 2048)).max() < 1.5
    assert units("exp", RANDOM.uniform(-745, 709.7, 2048)).max() < 1.5


@pytest.mark.processor
def test_overflow_and_underflow_of_the_exponential():
    x = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 710.0, -746.0, 1e300])
    assert np.array_equal(LANED["exp"](x), [1, 1, np.inf, 0, np.nan, np.inf, 0, np.inf], equal_nan=True)


@pytest.mark.processor
@pytest.mark.parametrize("name", ["sinh", "cosh", "tanh"])
@pytest.mark.parametrize("span", [1e-6, 0.7, 2.0, 30.0, 700.0])
def test_hyperbolic_functions_in_lanes(name, span):
    assert units(name, RANDOM.uniform(-span, span, 2048)).max() < 3


@pytest.mark.processor
def test_hyperbolic_functions_at_special_values():
    x = np.array([0.0, np.inf, -np.inf, np.nan, 800.0, -800.0, 20.0, -20.0])
    with np.errstate(over="ignore"):
        for name in ("sinh", "cosh", "tanh"):
            np.testing.assert_allclose(LANED[name](x), getattr(np, name)(x), rtol=1e-15)


@pytest.mark.parametrize("name", LANED)
def test_uncompiled_functions_are_those_of_the_library(name):
    function, x = getattr(elementary, name), [0.25, 2.0]
    wanted = [getattr(math, name)(a) for a in x]
    assert [function(a) for a in x] == wanted
    assert function(np.array(x)).tolist() == wanted


@pytest.mark.processor
def test_the_square_root_is_correctly_rounded():
    x = RANDOM.uniform(0, 100, 512)
    assert np.array_equal(LANED["sqrt"](x), np.sqrt(x))


@pytest.mark.processor
@pytest.mark.parametrize(
    ("number", "name", "size"),
    [
        (elementary.SINE[7], "sin", 100),
        (elementary.EXPONENTIAL[9], "exp", 700),
        (elementary.PI[2], "cos", 1e6),
        (elementary.LOG_2[1], "exp", 700),
        (elementary.HYPERBOLIC_SINE[5], "sinh", 1),
        (elementary.HYPERBOLIC_TANGENT[9], "tanh", 0.6),
    ],
)
def test_control_a_wrong_coefficient_is_seen(monkeypatch, number, name, size):
    text = Path(elementary.__file__).read_text()
    assert text.count(repr(number)) == 1
    spoiled = ModuleType("spoiled")
    spoiled.__package__ = elementary.__package__
    exec(text.replace(repr(number), repr(number * 1.01)), spoiled.__dict__)
    monkeypatch.setitem(LANED, name, over(getattr(spoiled, name)))
    assert units(name, RANDOM.uniform(-size, size, 1024)).max() > 2.5


# -- operations -------------------------------------------------------------------------------------------------------


@pytest.mark.processor
def test_operators_agree_with_arrays():
    @numba.njit
    def mixed(x, y, z):
        a, b = take(x, 0, LIKE), take(y, 0, LIKE)
        put(z, 0, 2 * a + b / 3.0 - a * b, LIKE)
        put(z, 1, -abs(b) / (1 - a), LIKE)
        put(z, 2, 7, LIKE)
        return total(a)

    x, y, z = RANDOM.standard_normal((1, WIDTH)), RANDOM.standard_normal((1, WIDTH)), np.empty((3, WIDTH))
    assert mixed(x, y, z) == pytest.approx(x.sum(), rel=1e-14)
    assert total(x[0]) == pytest.approx(x.sum(), rel=1e-14), "uncompiled"
    assert np.allclose(z, [(2 * x + y / 3 - x * y)[0], (-abs(y) / (1 - x))[0], np.full(WIDTH, 7.0)], rtol=1e-14, atol=0)


@pytest.mark.processor
def test_combine_adds_rows_of_a_matrix():
    A, x, y = RANDOM.standard_normal((5, WIDTH)), RANDOM.standard_normal(WIDTH), RANDOM.standard_normal(WIDTH)
    few = (0.0,) * 3

    @numba.njit
    def compiled(rows, A, z):
        put(z, 0, combine(take(rows, 0, LIKE), take(rows, 1, LIKE), 0.5, A, 2, few), LIKE)

    z = np.empty((1, WIDTH))
    compiled(np.array([x, y]), A, z)
    exact = x + 0.5 * (y[:3] @ A[2:])
    assert np.allclose(z[0], exact, rtol=0, atol=1e-14)
    assert np.allclose(combine(x, y, 0.5, A, 2, few), exact, rtol=0, atol=1e-14)


NUMBERS = (3.0, -0.5, 2.0, 0.25)


@pytest.mark.processor
def test_polynomial_coefficients_from_lanes_or_a_tuple():
    few = (0.0,) * 4
    rows, z = np.array([[*NUMBERS, *[np.nan] * 4], RANDOM.uniform(-2, 2, WIDTH)]), np.empty((2, WIDTH))

    @numba.njit
    def compiled(rows, z):
        put(z, 0, polynomial(take(rows, 0, LIKE), take(rows, 1, LIKE), few), LIKE)
        put(z, 1, polynomial(NUMBERS, take(rows, 1, LIKE), few), LIKE)

    compiled(rows, z)
    exact = np.polyval(NUMBERS[::-1], rows[1])
    for found in (*z, polynomial(rows[0], rows[1], few), polynomial(NUMBERS, rows[1], few)):
        assert np.allclose(found, exact, rtol=0, atol=1e-14)


# -- Gauss methods ----------------------------------------------------------------------------------------------------

BOX, ORBIT = problem("henon-heiles:box"), problem("perturbed-kepler")


def both(monkeypatch, made, s, **run):
    """(run with the stages in SIMD lanes, run with the stages one by one) of Gauss's method with s stages."""
    lanes = integrate(made, f"gauss-{s}", **run)
    with monkeypatch.context() as patch:
        patch.setattr(gauss_lanes, "serves", lambda s, system: False)
        return lanes, integrate(made, f"gauss-{s}", **run)


@pytest.mark.processor
@pytest.mark.parametrize("s", [2, 3, 5, 8])
def test_lanes_reach_the_state_of_single_stages(monkeypatch, s):
    for made, h in ((BOX, 0.3), (ORBIT, 0.05)):
        lanes, rows = both(monkeypatch, made, s, h=h, steps=100, save_every=0)
        assert np.abs(rough_end(lanes) - rough_end(rows)).max() < 1e-13
        assert abs(lanes.counts["gradient"] - rows.counts["gradient"]) <= 0.05 * rows.counts["gradient"]


FORCES = {
    "pendulum": "-cos(q1) - cos(q2) + sin(q1*q2)/10",
    "exponential": "exp(q1 - q2) + exp(q2 - q1) + q1**2/2",
    "powers": "(1 + q1**2 + q2**2)**(3/2) + 1/sqrt(2 + q1**2) + q2**(-2)/50",
    "masses": "q1**2/2 + q2**4/4",
    "logarithm": "log(1 + q1**2) + q2**2/2",
    "uniform": "q1 + 2*q2",
}


@pytest.mark.parametrize("name", FORCES)
def test_every_kind_of_force_agrees_with_its_formula(monkeypatch, name):
    T = "p1**2/2 + p2**2/6" if name == "masses" else "p1**2/2 + p2**2/2"
    # Declared regular, so that a step across the singularity is not rejected.
    made = Hamiltonian(q="q1 q2", p="p1 p2", H=f"{T} + {FORCES[name]}", singular=())
    assert gauss_lanes.serves(3, made)
    lanes, rows = both(monkeypatch, made, 3, h=0.1, steps=50, q0=[0.7, 1.1], p0=[0.2, -0.3])
    assert np.abs(rough_end(lanes) - rough_end(rows)).max() < 1e-13


#: H other than sum p_i^2 / 2 m_i + V(q), for which both increments are unknowns.
FIELDS = {
    "angles": "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)",
    "exponentials": "exp(p1) - 2*p1 + exp(q1) - q1 + exp(p2/2) + q2**2",
    "magnetic": "(p1 + q2*sqrt(q1**2 + q2**2)/3)**2/2 + (p2 - q1*sqrt(q1**2 + q2**2)/3)**2/2 + 1/sqrt(q1**2 + q2**2)",
    "metric": "(1 - 1/(4*q1))*p1**2/2 + (p2 + 1)**2/(2*q1**2) + 1/(1 - 1/(4*q1)) + q2**2/2",
    "quartic": "p1**4/4 + p2**2/2 + q1**2/2 + q2**4",
}


def of_fields(name):
    """The system of this name in `FIELDS`; "species" is two uncoupled Lotka-Volterra pairs, "no energy" has no H."""
    if name == "species":
        u, v, x, y = sp.symbols("u v x y", positive=True)
        B = sp.Matrix([[0, 0, -u * v, 0], [0, 0, 0, -x * y], [u * v, 0, 0, 0], [0, x * y, 0, 0]])
        H = sp.log(u) - u + 2 * sp.log(v) - v + sp.log(x) - x + sp.log(y) - y
        return PoissonSystem(q=[u, x], p=[v, y], B=B, H=H, dq=[u * (v - 2), x * (y - 1)], dp=[v * (1 - u), y * (1 - x)])
    if name == "no energy":
        return PartitionedSystem(q="q1 q2", p="p1 p2", dq=["p1", "p2 - q1**2"], dp=["-q1 - p1/9", "cos(q2)*p1"])
    return Hamiltonian(q="q1 q2", p="p1 p2", H=FIELDS[name])


@pytest.mark.processor
@pytest.mark.parametrize("name", [*FIELDS, "species", "no energy"])
def test_every_kind_of_field_agrees_with_its_formula(monkeypatch, name):
    made = of_fields(name)
    assert gauss_lanes.serves(3, made)
    lanes, rows = both(monkeypatch, made, 3, h=0.1, steps=50, q0=[1.7, 1.1], p0=[0.2, 0.3])
    assert np.abs(rough_end(lanes) - rough_end(rows)).max() < 1e-13 * np.abs(rough_end(rows)).max()
    assert abs(lanes.counts["gradient"] - rows.counts["gradient"]) <= 0.05 * rows.counts["gradient"]


@pytest.mark.parametrize("place", [(0, 1), (2, 0)])
def test_control_a_wrong_coefficient_breaks_symplecticity(place):
    """A coefficient off by 1e-4 shows in the Jacobian of a step, which is no longer symplectic."""

    def defect(spoil):
        """Defect of the symplectic form with one coefficient changed."""
        prepared = prepare(method("gauss-3"), of_fields("angles"))
        prepared.step.A[place] += spoil
        M = np.array([(advance(prepared, k, 1e-5) - advance(prepared, k, -1e-5)) / 2e-5 for k in range(4)]).T
        J = np.kron([[0, 1], [-1, 0]], np.eye(2))
        return np.abs(M.T @ J @ M - J).max()

    assert defect(0.0) < 1e-9
    assert defect(1e-4) > 1e-7


def advance(prepared, k, by):
    """State after one step of a prepared method, with component k of the initial state changed."""
    y = np.array([1.7, 1.1, 0.2, 0.3])
    y[k] += by
    Q, P = np.zeros((1, 2)), np.zeros((1, 2))
    assert lay_out(prepared, 2, 0.3, y[:2], y[2:])(Q, P, np.zeros((1, 1)), 1) == (1, 0)
    return np.concatenate([Q[0], P[0]])


@pytest.mark.parametrize(
    "H",
    [
        "p1**2/2 + p2**2/2 + q1*log(1 + q1**2) + q2**2",
        "p1**2/2 + p2**2/2 + (1 + q1**2)**(1/3) + q2**2",
        "p1**2/2 + p2**2*(1 + q1**2)/2 + q1*log(1 + q1**2) + q2**2",
        "p1**4/4 + p2**2/2 + tan(q1**2)/2 + q2**2",
    ],
)
def test_unsupported_formulas_use_stages_one_by_one(H):
    made = Hamiltonian(q="q1 q2", p="p1 p2", H=H)
    assert not gauss_lanes.serves(3, made)
    assert prepare(method("gauss-3"), made).run is collocation.run


def test_coupled_masses_are_supported_in_lanes(monkeypatch):
    H = "p1**2/2 + p2**2/2 + p1*p2/3 + q1**4 + q2**2 + cos(q1*q2)"
    made = Hamiltonian(q="q1 q2", p="p1 p2", H=H)
    assert prepare(method("gauss-5"), made).run is stage_lanes.run
    laned, one_by_one = both(monkeypatch, made, 5, h=0.2, steps=50, q0=[0.5, 0.3], p0=[0.1, 0.2])
    np.testing.assert_allclose(laned.q, one_by_one.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(laned.p, one_by_one.p, rtol=0, atol=1e-13)


@pytest.mark.parametrize("s", [2, 3, 4, 5, 8])
def test_the_number_of_lanes_and_unused_lanes(s):
    """Unused lanes repeat the first stage with weight zero, so that functions are evaluated at regular points only."""
    step = gauss_lanes.build_lanes(s, BOX.system, "double")
    lanes = len(step.like)
    assert lanes / 2 < s <= lanes
    (c, b), A = step.nodes[:2], step.A
    assert (c[s:] == c[0]).all()
    assert (A[:s, s:] == A[:s, :1]).all()
    assert not b[s:].any()
    assert not A[s:].any()


@pytest.mark.parametrize("s", [2, 3, 5, 8])
def test_double_coefficients_are_exactly_symplectic(s):
    """In both forms of the stage equations: kicks as the unknowns, and both increments (dq, dp)."""
    for made, kicks in ((BOX.system, True), (of_fields("quartic"), False)):
        step = gauss_lanes.build_lanes(s, made, "double")
        assert (step.inverse_mass is not None) == kicks
        A, c = ([Fraction(x) for x in rows] for rows in (step.A[:s, :s].T.ravel(), step.nodes[0, :s]))
        for i in range(s):
            for j in range(s):
                a, b = A[i * s + j], A[j * s + i]
                assert a - b == c[i] - c[j] if kicks else a + b == 1
        assert [Fraction(x) for x in step.nodes[2, :s]] == ([1 - x for x in c] if kicks else [0] * s)


def test_coefficients_have_the_digits_in_use(monkeypatch):
    """Coefficients for lanes have the digits of the working precision even where no functions for lanes exist."""
    monkeypatch.setattr(gauss_lanes, "functions", lambda *_: (None, None))
    with precision(30):
        step = gauss_lanes.build_lanes(3, BOX.system, MULTIPRECISION)
        for (c, b), *found in zip(gauss_legendre(3), step.nodes[0], step.nodes[1], strict=False):
            assert max(abs(mpmath.mpf(str(x)) - y) for x, y in zip(found, (c, b), strict=True)) < 1e-28


def test_large_systems_use_stages_one_by_one():
    names = [[f"{x}{i}" for i in range(21)] for x in "qp"]
    for T in ("p0**4", "p0**2/2"):
        H = f"{T} + " + " + ".join(f"p{i}**2/2 + q{i}**2/2" for i in range(1, 21)) + " + q0**2/2"
        assert not gauss_lanes.serves(3, Hamiltonian(q=names[0], p=names[1], H=H))


STIFF = "p1**2/2 + p2**2/6 + 1250*q1**2 + q2**2/2 + q1*q2"


@pytest.mark.parametrize("rest", ["q1**4", "q1**2*p1**2/10"])
def test_newton_in_lanes_takes_over(monkeypatch, rest):
    """In both forms of the stage equations: kicks as the unknowns, and both increments (dq, dp)."""
    stiff = Hamiltonian(q="q1 q2", p="p1 p2", H=f"{STIFF} + {rest}")
    lanes, rows = both(monkeypatch, stiff, 3, h=0.2, steps=20, q0=[0.9, 0.2], p0=[3.0, -0.4])
    assert lanes.counts["newton"] == rows.counts["newton"] == 20
    assert np.abs(rough_end(lanes) - rough_end(rows)).max() < 1e-11


@pytest.mark.parametrize("moving", [0, 1])
@pytest.mark.parametrize("h", [0.25, 0.3])
def test_newton_scales_differences_by_what_moves(h, moving):
    """The number of evaluations shows it: differences scaled by the whole state would mislead Newton's method."""
    made = Hamiltonian(q="q1 q2", p="p1 p2", H=f"p1**2/2 + p2**2/2 - 400*cos(q{1 + moving})")
    near, far = np.zeros(2), np.full(2, 1e9)
    near[moving] = far[moving] = 0.5
    beside, away = (integrate(made, "gauss-3", h=h, steps=2, q0=q, p0=[0, 0]).counts for q in (near, far))
    assert beside["newton"] == away["newton"] == 2
    assert abs(beside["gradient"] - away["gradient"]) < 0.1 * beside["gradient"]


@pytest.mark.parametrize("rest", ["q1**4", "q1**2*p1**2/10"])
def test_a_run_writes_all_of_its_memory(rest):
    """A run overwrites the memory allocated for it; fewer rows than one unit of allocation remain."""
    stiff = Hamiltonian(q="q1 q2", p="p1 p2", H=f"{STIFF} + {rest}")
    layout = lay_out(prepare(method("gauss-3"), stiff), 2, 0.2, np.array([0.9, 0.2]), np.array([3.0, -0.4]))
    layout.carry.memory.fill(0.123)
    assert layout(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 1)), 3) == (1, 0)
    assert layout.counts["newton"] == 3
    assert (layout.carry.memory == 0.123).all(1).sum() < 3 * LEVELS + 1


def test_a_run_in_pieces_equals_the_whole_run(monkeypatch):
    whole, kept = (integrate(BOX, "gauss-5", h=0.5, steps=40, save_every=n) for n in (0, 1))
    assert np.array_equal(rough_end(whole), rough_end(kept))
    assert len(kept.q) == 41
    for module in (driver, trajectory):
        monkeypatch.setattr(module, "PIECE", 7)
    assert np.array_equal(rough_end(whole), rough_end(integrate(BOX, "gauss-5", h=0.5, steps=40, save_every=0)))
