"""SIMD lanes: functions, operations and conditions, generated formulas, and Gauss methods with laned stages."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

import mpmath
import numpy as np
import pytest
import sympy as sp
from numba import njit

from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.families import averaged, collocation, equip, gauss_lanes, path_lanes
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.systems.poisson import PoissonSystem
from phasebench.integrators.values import elementary, lane_formulae
from phasebench.integrators.values.lanes import put, take
from phasebench.integrators.values.masks import broadcast_like, count, fails, number, retire_lanes, select, where
from phasebench.integrators.values.vector import TUPLES
from support.solutions import last

pytestmark = pytest.mark.processor
WIDTH = 8
LIKE = (0.0,) * WIDTH
RANDOM = np.random.default_rng(0)


def over(function):
    """Compile a function of one row of SIMD lanes, and return it as a function of an array."""

    @njit
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


def exact(name, x):
    with mpmath.workdps(40):
        return [getattr(mpmath, name)(mpmath.mpf(float(a))) for a in x]


def units(name, x):
    """Largest error of an elementary function in SIMD lanes at the points x, in units in the last place."""
    y, wanted = LANED[name](x), exact(name, x)
    with mpmath.workdps(40):
        wrong = [abs(mpmath.mpf(float(a)) - b) for a, b in zip(y, wanted, strict=True)]
        return max(float(e / np.spacing(abs(float(b)))) for e, b in zip(wrong, wanted, strict=True))


RANGES = [(name, span, 2.5) for name in ("sin", "cos") for span in (2, 100, 1e6)]
RANGES += [("exp", 1, 1.5), ("exp", 700, 1.5)]
RANGES += [(name, span, 3) for name in ("sinh", "cosh", "tanh") for span in (1e-6, 0.7, 2.0, 30.0, 700.0)]


@pytest.mark.parametrize(("name", "span", "most"), RANGES)
def test_functions_are_exact_to_the_last_places(name, span, most):
    assert units(name, RANDOM.uniform(-span, span, 1024)) < most


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine_near_their_zeros_and_beyond_a_million(name):
    """There the error is below the spacing of x; NaN beyond 1e12."""
    assert units(name, np.pi / 2 * np.arange(-512, 512)) < 2.5
    x = RANDOM.uniform(-1e12, 1e12, 1024)
    error = np.abs(LANED[name](x) - np.array(exact(name, x), float))
    assert np.all(error < 4e-16 + np.spacing(np.abs(x)))
    assert np.isnan(LANED[name](np.array([2e12, -2e12, np.inf, -np.inf, np.nan, 1e300, -1e18, 3e12]))).all()


def test_functions_at_special_values():
    x = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 800.0, -800.0, 20.0])
    with np.errstate(all="ignore"):
        for name in ("exp", "sinh", "cosh", "tanh"):
            np.testing.assert_allclose(LANED[name](x), getattr(np, name)(x), rtol=1e-15)
    x = RANDOM.uniform(0, 100, 512)
    assert np.array_equal(LANED["sqrt"](x), np.sqrt(x)), "rounded correctly"


@pytest.mark.parametrize(
    ("coefficient", "name", "size"),
    [
        (elementary.SINE[7], "sin", 100),
        (elementary.LOG_2[1], "exp", 700),
        (elementary.HYPERBOLIC_TANGENT[9], "tanh", 0.6),
    ],
)
def test_control_a_wrong_coefficient_is_seen(monkeypatch, coefficient, name, size):
    text = Path(elementary.__file__).read_text()
    assert text.count(repr(coefficient)) == 1
    spoiled = ModuleType("spoiled")
    spoiled.__package__ = elementary.__package__
    exec(text.replace(repr(coefficient), repr(coefficient * 1.01)), spoiled.__dict__)
    monkeypatch.setitem(LANED, name, over(getattr(spoiled, name)))
    assert units(name, RANDOM.uniform(-size, size, 1024)) > 2.5


@njit(**TUPLES)
def _compare(table, out, two):
    a, b = take(table, 0, LIKE), take(table, 1, LIKE)
    one, zero = broadcast_like(1.0, a), broadcast_like(0, a)
    for k, held in enumerate((a < b, a <= b, a > b, a >= b, a == b, a != b, a < two, 2.0 >= a)):  # noqa: SIM300
        put(out, k, select(held, one, zero), LIKE)


def test_comparisons_are_those_of_numpy():
    a = np.array([1.0, 2.0, 3.0, np.nan, np.inf, -np.inf, 0.0, 2.0])
    b, out = np.array([2.0, 2.0, 1.0, 1.0, np.inf, np.inf, -0.0, np.nan]), np.empty((8, WIDTH))
    _compare(np.array([a, b]), out, 2)
    assert out.tolist() == [list(row) for row in (a < b, a <= b, a > b, a >= b, a == b, a != b, a < 2, a <= 2)]


@njit(**TUPLES)
def _choose(table, out):
    x, y = take(table, 0, LIKE), take(table, 1, LIKE)
    one, zero = broadcast_like(1.0, x), broadcast_like(0.0, x)
    held, odd = x < y, take(table, 2, LIKE) == 1
    pair, kept = select(held, (x, 2 * x), (y, -y)), retire_lanes(x < 3, x < 2, (x, y))
    put(out, 0, pair[0], LIKE)
    put(out, 1, pair[1], LIKE)
    put(out, 2, select(held, x, 7), LIKE)
    put(out, 3, where(held, 0.5, y), LIKE)
    put(out, 4, select(fails(held), x, y), LIKE)
    put(out, 5, kept[0][0], LIKE)
    for k, mask in enumerate((held & odd, held | odd, ~held, ~held & ~odd)):
        put(out, 6 + k, select(mask, one, zero), LIKE)
    return number(held), kept[1], count(held & ~held), bool(x > 6), bool(x > 7)


def test_conditions_select_lane_by_lane():
    """A condition is true if it holds in any lane."""
    x, out = np.arange(8.0), np.empty((10, WIDTH))
    y, odd = 7 - x, x % 2 == 1
    assert _choose(np.array([x, y, odd]), out) == (4, True, 0, True, False)
    held = x < y
    rows = [np.where(held, a, b) for a, b in ((x, y), (2 * x, -y), (x, 7), (0.5, y), (y, x))]
    rows += [np.where((x < 3) & ~(x < 2), np.nan, x), held & odd, held | odd, ~held, ~held & ~odd]
    np.testing.assert_array_equal(out, rows)


x, y, z, w = sp.symbols("x y z w", positive=True)
THIRD = sp.Rational(1, 3)
SUPPORTED = [x + y * z, x**2 - 3 / y, (x + y) ** 12, sp.sqrt(x + 1) * x ** sp.Rational(-5, 2), sp.sin(x) + sp.exp(z), x]
UNSUPPORTED = [sp.tan(x), sp.sin(x) + sp.log(y), abs(sp.sin(x) - y), x**THIRD, (x + y) ** sp.Rational(49, 2), x**49]
UNSUPPORTED += [x**-49, x**y, x**sp.pi]


def test_supported_formulas():
    for e in SUPPORTED:
        assert lane_formulae.supported([e, x * y])
    for e in UNSUPPORTED:
        assert not lane_formulae.supported([x * y, sp.sin(e * z)])


# -- stages and quadrature nodes in lanes beside those taken one by one -----------------------------------------------

#: H for which the kicks are the unknowns, and from "angles" on H for which both increments are.
FORMULAE = {
    "pendulum": "p1**2/2 + p2**2/2 - cos(q1) - cos(q2) + sin(q1*q2)/10",
    "powers": "p1**2/2 + p2**2/2 + (1 + q1**2 + q2**2)**(3/2) + 1/sqrt(2 + q1**2) + q2**(-2)/50",
    "masses": "p1**2/2 + p2**2/6 + q1**2/2 + q2**4/4",
    "degree 6": "p1**2/2 + p2**2/2 + q1**6 + q1**2*q2**2/3 + q2**4",
    "logarithm": "p1**2/2 + p2**2/2 + log(1 + q1**2) + q2**2/2",
    "angles": "(p1**2 + 2*p2**2 - 2*p1*p2*cos(q1 - q2))/(2 + 2*sin(q1 - q2)**2) - 2*cos(q1) - cos(q2)",
    "exponentials": "exp(p1) - 2*p1 + exp(q1) - q1 + exp(p2/2) + q2**2",
    "quartic": "p1**4/4 + p2**2/2 + q1**2/2 + q2**4",
}
STIFF = "p1**2/2 + p2**2/6 + 1250*q1**2 + q2**2/2 + q1*q2"
#: Of an equation whose parameter is known to the round-off of the energy.
FAR = {"gauss-equip-3": 1e-12}
CASES = [
    *((gauss_lanes, "gauss-3", name) for name in (*FORMULAE, "species", "no energy")),
    (equip, "gauss-equip-3", "pendulum"),
    (path_lanes, "hbvm-8-4", "degree 6"),
    *((path_lanes, "cpg-2", name) for name in ("pendulum", "angles")),
    (averaged, "avf", "pendulum"),
    *((averaged, id, "angles") for id in ("pavf-p", "itoh-abe-c")),
]


def of(name):
    """A system of `FORMULAE`; "species" is two uncoupled Lotka-Volterra pairs, "no energy" has no H."""
    if name == "species":
        u, v, x, y = sp.symbols("u v x y", positive=True)
        B = sp.Matrix([[0, 0, -u * v, 0], [0, 0, 0, -x * y], [u * v, 0, 0, 0], [0, x * y, 0, 0]])
        H = sp.log(u) - u + 2 * sp.log(v) - v + sp.log(x) - x + sp.log(y) - y
        return PoissonSystem(q=[u, x], p=[v, y], B=B, H=H, dq=[u * (v - 2), x * (y - 1)], dp=[v * (1 - u), y * (1 - x)])
    if name == "no energy":
        return PartitionedSystem(q="q1 q2", p="p1 p2", dq=["p1", "p2 - q1**2"], dp=["-q1 - p1/9", "cos(q2)*p1"])
    # Declared regular, so that a step across a singularity is not rejected.
    return Hamiltonian(q="q1 q2", p="p1 p2", H=FORMULAE.get(name, name), singular=())


def check(family, id, made, **run):
    """The counts of a run in lanes; one with stages or nodes one by one ends alike, after about as many evaluations."""
    asked, serves = [], family.serves
    with patch.object(family, "serves", lambda *of: asked.append(serves(*of)) or asked[-1]):
        lanes = integrate(made, id, **run)
    assert asked == [True]
    with patch.object(family, "serves", lambda *of: False):
        rows = integrate(made, id, **run)
    assert {lanes.status, rows.status} <= {"ok", "inaccurate", "unstable"}
    found, counts = last(rows), rows.counts
    far = 1e-11 if counts["newton"] else FAR.get(id, 1e-13)
    assert np.abs(last(lanes) - found).max() < far * max(1, np.abs(found).max())
    assert lanes.counts["fallbacks"] == counts["fallbacks"]
    assert (lanes.counts["newton"] > 0) == (counts["newton"] > 0)
    assert counts["newton"] or abs(lanes.counts["gradient"] - counts["gradient"]) <= 0.05 * counts["gradient"]
    return lanes.counts


@pytest.mark.parametrize(("family", "id", "name"), CASES, ids=lambda x: x if isinstance(x, str) else "")
def test_every_kind_of_formula_agrees_with_stages_and_nodes_one_by_one(family, id, name):
    check(family, id, of(name), h=0.1, steps=50, q0=[1.7, 1.1], p0=[0.2, 0.3])


@pytest.mark.parametrize("rest", ["q1**4", "q1**2*p1**2/10", "cos(q1)"])
@pytest.mark.parametrize(
    ("family", "id", "h"), [(gauss_lanes, "gauss-3", 0.2), (path_lanes, "cpg-2", 0.1)], ids=["gauss-3", "cpg-2"]
)
def test_newton_in_lanes_takes_over(family, id, h, rest):
    """In both forms of the stage equations: kicks as the unknowns, and both increments (dq, dp)."""
    counts = check(family, id, of(f"{STIFF} + {rest}"), h=h, steps=20, q0=[0.7, 0.5], p0=[0.2, -0.3])
    assert counts["newton"] >= 20


def test_control_a_wrong_coefficient_is_seen_in_the_end(monkeypatch):
    laned = gauss_lanes.build_lanes

    def spoiled(*arguments):
        step = laned(*arguments)
        step.A[0, 1] += 1e-9
        return step

    monkeypatch.setattr(gauss_lanes, "build_lanes", spoiled)
    with pytest.raises(AssertionError):
        check(gauss_lanes, "gauss-3", of("angles"), h=0.1, steps=50, q0=[1.7, 1.1], p0=[0.2, 0.3])


def test_other_systems_use_stages_one_by_one():
    for H in ("p1**2/2 + p2**2/2 + q1*log(1 + q1**2)", "p1**4/4 + p2**2/2 + tan(q1**2)/2 + q2**2"):
        made = Hamiltonian(q="q1 q2", p="p1 p2", H=H)
        assert not gauss_lanes.serves(3, made)
        assert prepare(method("gauss-3"), made).run is collocation.run


@pytest.mark.parametrize("s", [2, 3, 5, 8])
def test_coefficients_in_lanes_are_exactly_symplectic(s):
    """In both forms of the stage equations; unused lanes repeat the first stage with weight zero."""
    for name, kicks in (("pendulum", True), ("quartic", False)):
        step = gauss_lanes.build_lanes(s, of(name), "double")
        assert (step.inverse_mass is not None) == kicks
        A, c = ([Fraction(x) for x in rows] for rows in (step.A[:s, :s].T.ravel(), step.nodes[0, :s]))
        for i in range(s):
            for j in range(s):
                a, b = A[i * s + j], A[j * s + i]
                assert a - b == c[i] - c[j] if kicks else a + b == 1
        assert len(step.like) / 2 < s <= len(step.like)
        assert (step.nodes[0][s:] == step.nodes[0][0]).all()
        assert (step.A[:s, s:] == step.A[:s, :1]).all()
        assert not step.nodes[1][s:].any()
        assert not step.A[s:].any()
