"""Systems from formulas: their traits, and all their functions compared with NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from phasebench.integrators import ConstrainedHamiltonian, Hamiltonian, InvalidInput, RigidBody, SplitHamiltonian
from phasebench.integrators.systems import shared
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.systems.poisson import PoissonSystem

FORMULAE = {
    "q": "x y",
    "p": "u, v",
    "H": "u**2/2 + v**2/6 + x**4/4 - 2*cos(y) + 7",
    "singular": ("x - 1", "y"),
    "invariants": ("u*v",),
}
TEXT = Hamiltonian(**FORMULAE)
#: Made from text, which gives a key for the cache, and from SymPy expressions, which give none.
MADE = {
    "text": TEXT,
    "expression": Hamiltonian(q=TEXT.q, p=TEXT.p, H=TEXT.H, singular=TEXT.singular, invariants=TEXT.invariants),
}
Q, P = np.random.default_rng(4).normal(size=(2, 3, 2))
(X, Y), (U, V) = Q.T, P.T


def of(H, q="q", p="p", **further):
    """A Hamiltonian of one degree of freedom by default."""
    return Hamiltonian(q=q, p=p, H=H, **further)


@pytest.mark.parametrize("system", MADE.values(), ids=MADE)
def test_functions_of_rows(system):
    assert np.allclose(system.energies(Q, P), U**2 / 2 + V**2 / 6 + X**4 / 4 - 2 * np.cos(Y) + 7, rtol=1e-14)
    assert np.allclose(system.rates(Q, P), [U, V / 3, -(X**3), -2 * np.sin(Y)], rtol=1e-14)
    assert np.allclose(system.speed(Q, P), np.hypot(U, V / 3), rtol=1e-14)
    assert np.allclose(system.distances(Q, P), [abs(X - 1), abs(Y)], rtol=1e-14)
    assert np.allclose(system.observe(system.invariants[0], Q, P), U * V, rtol=1e-14)
    assert system.observe(3, Q, P).tolist() == [3.0] * 3, "a number, once for each row"
    assert of("p**2/2").distances(Q[:, :1], P[:, :1]).shape == (0, 3)
    with np.errstate(all="raise"):
        assert of("p**2/2 - 1/q").energies([[0.0]], [[1.0]]) == -np.inf
    rates = [-2.0, 1.0, -(0.5**3), -2 * np.sin(0.3)]
    assert np.allclose(system.vector_field()(0.0, np.array([0.5, 0.3, -2.0, 3.0])), rates, rtol=1e-14)
    found = np.array(
        system.hessian().subs(dict(zip((*system.q, *system.p), (0.5, 0.3, -2.0, 3.0), strict=True))), float
    )
    assert np.allclose(found, np.diag([3 * 0.5**2, 2 * np.cos(0.3), 1, 1 / 3]), rtol=1e-14)
    observed = system.observe(system.q[0], Q, P)
    assert (observed.tolist(), np.shares_memory(observed, Q)) == (X.tolist(), False)


def test_the_scale_of_energy_omits_constants():
    assert TEXT.constant == 7.0
    assert np.allclose(TEXT.scale(Q, P), U**2 / 2 + V**2 / 6 + X**4 / 4 + 2, rtol=1e-14)
    assert np.isclose(of("p**2/2 + q/cos(q)").scale([[2.0]], [[0.0]]), 2 / abs(np.cos(2.0))), "a pole is no wave"
    assert np.isclose(of("p**2/2 - 3*sin(q)**2*(q - 1)").scale([[0.5]], [[0.0]]), 3 * 0.5 + 3), "multiplied out"


def test_the_round_off_scale_of_the_energy():
    H, M = TEXT.energy()((0.5, 0.3), (-2.0, 3.0))
    terms = 4 / 2 + 9 / 6 + 0.5**4 / 4 + 2 * np.cos(0.3) + 7
    assert np.isclose(H, 4 / 2 + 9 / 6 + 0.5**4 / 4 - 2 * np.cos(0.3) + 7, rtol=1e-14)
    assert np.isclose(M, terms + 0.5 * 0.5**3 + 0.3 * 2 * np.sin(0.3) + 4 + 3 * 3 / 3, rtol=1e-14)


#: H -> (separable, quadratic kinetic energy, unit mass, degree of a polynomial).
KINDS = {
    "p**2/2 + q": (True, True, True, 2),
    "p**2 + q**3": (True, True, False, 3),
    "p**2/2 + p + q": (True, False, False, 2),
    "p**4 + q**2": (True, False, False, 4),
    "cosh(p) + q**2": (True, False, False, None),
    "p**2/2 - cos(q)": (True, True, True, None),
    "(p + q)**2/2 - p*q": (True, True, True, 2),
    "p**2*q**2": (False, False, False, 4),
}


@pytest.mark.parametrize("H", KINDS)
def test_traits_of_a_formula(H):
    system = of(H)
    found = (system.separable, system.quadratic_kinetic, system.unit_mass, system.polynomial_degree)
    assert found == KINDS[H]
    if system.separable:
        assert sp.expand(system.kinetic + system.potential - system.H) == 0
        assert system.kinetic.free_symbols <= {*system.p}
        assert system.potential.free_symbols <= {*system.q}
        assert (system.grad_T() is None) == system.unit_mass
    else:
        assert system.kinetic is system.potential is None


@pytest.mark.parametrize(
    ("T", "unit", "inverse"),
    [
        ("u*v", False, None),
        ("u**2/2 + v**2/3", False, (1, sp.Rational(2, 3))),
        ("u**2 + v**2 + u*v", False, None),
        ("sqrt(2)*u**2 + v**2", False, None),
        ("(u**2 + v**2)/2", True, None),
    ],
)
def test_inverse_masses_are_rational_and_diagonal(T, unit, inverse):
    """None if all masses are one, or if T is not a sum over single momenta."""
    system = of(f"{T} + x*y", "x y", "u v")
    assert (system.quadratic_kinetic, system.unit_mass, system.inverse_masses) == (True, unit, inverse)


def test_the_slow_potential_omits_the_springs():
    fast = of("(u**2 + v**2)/2 + 9*x**2/2 + x**4*y", "x y", "u v", frequencies=(3, 0))
    x, y = fast.q
    assert sp.expand(fast.slow_potential - x**4 * y) == 0
    assert np.allclose(fast.grad_U()((0.5, 2.0)), [4 * 0.5**3 * 2, 0.5**4], rtol=1e-14)
    assert np.allclose(fast.grad_V()((0.5, 2.0)), [9 * 0.5 + 4 * 0.5**3 * 2, 0.5**4], rtol=1e-14)


def test_content_identifies_functions():
    """Two systems have the same content if and only if their formulas and names are the same."""
    pairs = [{"dq": ["p"], "dp": ["-q"]}, {"dq": ["p"], "dp": ["q"]}, {"dq": ["2*p"], "dp": ["-q"]}]
    given = [{"q": "q", "p": "p"} | pair for pair in pairs]
    given += [given[0] | {"energy": "p**2/2 + q**2/2"}, {"q": "x", "p": "p", "dq": ["p"], "dp": ["-x"]}]
    contents = [PartitionedSystem(**g).content for g in given]
    assert len({*contents}) == len(given)
    assert PartitionedSystem(**given[0]).content == contents[0]
    assert TEXT.content == MADE["expression"].content


def test_traits_of_every_kind():
    bare = PartitionedSystem(q="q", p="p", dq=["p*q"], dp=["-q"])
    assert (any(bare.traits.values()), bare.has_energy, bare.polynomial_degree) == (False, False, None)
    assert PartitionedSystem(q="q", p="p", dq=["p"], dp=["-q"], energy="p**2 + q**2").polynomial_degree == 2
    every = of("p**2/2 + q**2/2 + q**3", singular=("q",), invariants=("p",), frequencies=(1,), kepler=object())
    no = {"constrained": False, "rigid body": False, "parts": False, "magnetic": "", "polynomial degree": 3}
    assert every.traits == dict.fromkeys(bare.traits, True) | no
    found = {trait for trait, has in of("p**2/2 + q").traits.items() if has}
    kept = {"canonical", "separable", "quadratic kinetic energy", "Poisson structure", "constant mass matrix"}
    assert found == kept | {"elementary derivatives", "polynomial degree"}


X1, Y1 = sp.symbols("q p", real=True)
#: What is changed in the arguments of a system, of those below.
REFUSED = [
    (Hamiltonian, {"q": "q r"}, "2 coordinates and 1 momenta"),
    (Hamiltonian, {"H": "3"}, "none of the coordinates and momenta"),
    (Hamiltonian, {"H": "p**2 + z"}, "'z' is none of the variables q, p, t"),
    (Hamiltonian, {"invariants": (sp.Symbol("z") + 1,)}, "z in the formula is none of the variables q, p"),
    (Hamiltonian, {"frequencies": (1, 2)}, "frequencies are 1 numbers"),
    (Hamiltonian, {"H": "p**2 + q**2", "frequencies": (1,)}, r"H = \|p\|\^2 / 2"),
    (PartitionedSystem, {"dq": ["p", "q"]}, "2 and 1 right-hand sides for d = 1"),
    (PartitionedSystem, {"dp": []}, "1 and 0 right-hand sides for d = 1"),
    (PartitionedSystem, {"q": "", "p": ""}, "0 coordinates and 0 momenta"),
    (PartitionedSystem, {"q": "p"}, "stands twice"),
    (PoissonSystem, {"B": [[0, 1], [1, 0]]}, "not skew"),
    (PoissonSystem, {"B": [[0]]}, r"shape \(1, 1\); for d = 1 it is \(2, 2\)"),
    (PoissonSystem, {"dp": [X1]}, "not B grad H"),
    (ConstrainedHamiltonian, {"constraints": ["x*u"]}, "momentum u"),
    (ConstrainedHamiltonian, {"constraints": ["1"]}, "none of the coordinates"),
    (ConstrainedHamiltonian, {"constraints": ["x = y = 1"]}, "the character '=' stands in no formula"),
    (ConstrainedHamiltonian, {"constraints": ["x + k"]}, "'k' is none of the variables"),
    (ConstrainedHamiltonian, {"constraints": []}, "no constraint"),
    (ConstrainedHamiltonian, {"constraints": ["x", "y"]}, "as many constraints as coordinates"),
    (ConstrainedHamiltonian, {"constraints": ["x", "y", "x + y"]}, "more constraints than coordinates"),
    (SplitHamiltonian, {"parts": ["p**2"]}, "at least two"),
    (SplitHamiltonian, {"H": "p**2/2 + q**2"}, r"do not add up to H: q\*\*2/2 is left"),
    (SplitHamiltonian, {"parts": ["p**2/2", "q*z"]}, "'z' is none of the variables q, p"),
    *((RigidBody, {"moments": of}, "three positive numbers") for of in ((1, 2), (1, 2, -1), (1, 2, "x"))),
    (RigidBody, {"moments": (1, 2, float("nan"))}, "three positive numbers"),
    (RigidBody, {"moments": (1, 1, 2.5)}, "no body has the moments 1, 1, 5/2"),
    (RigidBody, {"V": "r44"}, "r44"),
    (RigidBody, {"V": "p0*r33"}, "p0"),
]
GOOD = {
    Hamiltonian: {"q": "q", "p": "p", "H": "p**2/2 + q"},
    PartitionedSystem: {"q": "q", "p": "p", "dq": ["p"], "dp": ["-p"]},
    PoissonSystem: {"q": [X1], "p": [Y1], "B": [[0, 1], [-1, 0]], "H": X1 + Y1, "dq": [1], "dp": [-1]},
    ConstrainedHamiltonian: {"q": "x y", "p": "u v", "H": "u**2 + v**2", "constraints": ["x"]},
    SplitHamiltonian: {"q": "q", "p": "p", "parts": ["p**2/2", "q**2/2"]},
    RigidBody: {"moments": (1, "3/2", 2), "V": "r33"},
}


@pytest.mark.parametrize(("kind", "given", "message"), REFUSED)
def test_an_invalid_system_is_refused(kind, given, message):
    with pytest.raises(InvalidInput, match=message):
        kind(**GOOD[kind] | given)


def test_control_the_others_are_systems():
    assert all(kind(**good).d for kind, good in GOOD.items())


# -- expressions in shared form ----------------------------------------------------------------------------------------


SYMBOLS = sp.symbols("x y z u", real=True)
POINT = (0.7, -1.3, 0.4, 1.9)


def value(definitions, expression):
    known = dict(zip(SYMBOLS, POINT, strict=True))
    for symbol, e in definitions:
        known[symbol] = sp.N(e.xreplace(known), 30)
    return float(sp.N(sp.sympify(expression).xreplace(known), 30))


def formula(rng, depth=3):
    """A random formula that is smooth at `POINT`: sums, products, roots and powers of positive sums, sines."""
    if depth == 0:
        return rng.choice(SYMBOLS) * sp.Rational(int(rng.integers(1, 5)), int(rng.integers(1, 3)))
    a, b = formula(rng, depth - 1), formula(rng, depth - 1)
    positive = a**2 + b**2 + 1
    power = sp.Rational(int(rng.choice([-7, -4, -3, -2, -1, 1])), int(rng.choice([1, 2])))
    return [a + b, a - b, a * b, a * positive**power, sp.sin(a - b), (a - b) / positive + b / positive**3][
        rng.integers(6)
    ]


@pytest.mark.parametrize("seed", range(6))
def test_derivatives_of_random_formulae(seed):
    e = formula(np.random.default_rng(seed))
    for derive in (shared.gradient, shared.lighter_gradient):
        definitions, found = derive(e, SYMBOLS)
        for x, slope in zip(SYMBOLS, found, strict=True):
            right = value((), sp.diff(e, x))
            assert value(definitions, slope) == pytest.approx(right, rel=1e-12, abs=1e-12)
    steps = shared.Steps()
    found = steps.rate(e, {SYMBOLS[0]: SYMBOLS[3], SYMBOLS[1]: sp.Integer(2)})
    right = value((), sp.diff(e, SYMBOLS[0]) * SYMBOLS[3] + 2 * sp.diff(e, SYMBOLS[1]))
    assert value(steps.definitions, found) == pytest.approx(right, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", ["a", "z"])
def test_shared_products_are_finite_where_the_expressions_are(name):
    """Whatever names sort first, x/r is shared by x/r and x^2/r^2, and not r/x, which is infinite at x = 0."""
    x, r = sp.Symbol(name, real=True), sp.Symbol("r", real=True)
    definitions, found = shared.gradient(x**2 / (1 + r) ** 2 + x * r / (1 + r), [x, r])
    for zero in (x, r):
        known = {x: sp.Rational(1, 3), r: sp.Rational(1, 5)} | {zero: sp.Integer(0)}
        for symbol, e in definitions:
            known[symbol] = e.xreplace(known)
            assert known[symbol].is_finite
        assert all(e.xreplace(known).is_finite for e in found)
