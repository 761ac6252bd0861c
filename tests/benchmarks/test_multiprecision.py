"""Measurements without round-off, on simple steps: a leapfrog, the symplectic Euler methods, Euler's method."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure import battery, multiprecision
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, vector
from phasebench.integrators.registry import BY_ID, METHODS, method

OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
VERLET = method("stormer-verlet")


@pytest.fixture(autouse=True)
def digits():
    with precision(40):
        yield


def kick(f, y, h):
    q, p = np.split(y, 2)
    return np.concatenate([q, p + h * f(y)[len(q) :]])


def drift(f, y, h):
    q, p = np.split(y, 2)
    return np.concatenate([q + h * f(y)[: len(q)], p])


STEPS = {
    "leapfrog": lambda f, y, h: kick(f, drift(f, kick(f, y, h / 2), h), h / 2),
    "kick first": lambda f, y, h: drift(f, kick(f, y, h), h),
    "drift first": lambda f, y, h: kick(f, drift(f, y, h), h),
    "euler": lambda f, y, h: y + h * f(y),
}


@pytest.fixture
def made_up(monkeypatch):
    """{name: method} of made-up steps; `multiprecision.advance` is replaced by the step named by a method's id."""

    def advance(system, record, y, h, steps=1):
        f, h = system.vector_field(MULTIPRECISION), multiprecision.to_number(h, MULTIPRECISION)
        for _ in range(steps):
            y = STEPS[record.id](lambda x: f(0, x), y, h)
        return y

    monkeypatch.setattr(multiprecision, "advance", advance)
    return {name: replace(VERLET, id=name) for name in STEPS}


# -- the reference ----------------------------------------------------------------------------------------------------


def off(found, exact):
    """The largest difference of two states."""
    return max(abs(mpmath.mpf(str(x)) - y) for x, y in zip(found, exact, strict=True))


@pytest.mark.parametrize(("T", "most"), [(Fraction(1, 64), 1e-34), (Fraction(1, 4), 1e-34), (1, 1e-20)])
def test_extrapolation_within_its_stated_uncertainty(T, most):
    end, doubt = multiprecision.extrapolate(
        lambda y: -2 * y, vector([3, 1]), multiprecision.to_number(T, MULTIPRECISION)
    )
    exact = mpmath.exp(-2 * mpmath.mpf(T.numerator) / T.denominator)
    assert off(end, (3 * exact, exact)) <= mpmath.mpf(str(doubt))
    assert 0 < doubt < most


@pytest.mark.parametrize(("pieces", "most"), [(8, 1e-34), (2, 1e-32)])
def test_flow_of_the_oscillator_is_a_rotation(pieces, most):
    end, doubt = multiprecision.flow(OSCILLATOR, [1, 0], Fraction(3, 2), pieces=pieces)
    assert off(end, (mpmath.cos(1.5), -mpmath.sin(1.5))) <= mpmath.mpf(str(doubt))
    assert 0 < doubt < most


def test_reference_starts_on_the_orbit():
    system, q, p = battery.SYSTEMS["henon-heiles"]()
    _, y = multiprecision.start("henon-heiles")
    energy = system.energy(MULTIPRECISION)
    assert abs(energy(y[:2], y[2:])[0] - energy(vector(q), vector(p))[0]) < 1e-30
    assert max(abs(y - [*q, *p])) > 0.01
    of, state, end, doubt = multiprecision.reference("tao")
    assert state.astype(float).tolist() == [0.3, -0.7], "as it stands"
    assert max(abs(end - multiprecision.flow(of, state, Fraction(1, 256))[0])) == 0
    assert doubt < 1e-34


# -- measures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "order"), [("leapfrog", 2), ("kick first", 1), ("euler", 1)])
def test_order_is_observed(made_up, name, order):
    found = multiprecision.errors(made_up[name], "pendulum")
    assert multiprecision.observed_order(found).value == pytest.approx(order, abs=0.02)
    assert found["h"] == [1 / 256, 1 / 512, 1 / 768, 1 / 1024]
    assert found["doubt"] < 1e-35 < found["error"][-1]
    noise = found | {"doubt": found["error"][1] / 10}
    assert multiprecision.observed_order(noise).points < 4, "what is no larger than the doubt is noise"


@pytest.mark.parametrize("order", [2, 6])
def test_symplecticity_defect(made_up, order):
    """It is measured from the full Jacobian; for a high order, from one pair of tangent vectors."""
    found = {name: multiprecision.defect(replace(m, order=order), "pendulum") for name, m in made_up.items()}
    assert max(found[name] for name in ("leapfrog", "kick first", "drift first")) < 1e-20
    assert found["euler"] > 1e-5


def test_symmetry_and_adjoints_by_distance(made_up):
    found = {name: multiprecision.distance(m, "pendulum") for name, m in made_up.items()}
    assert found["leapfrog"] < 1e-38
    assert min(found[name] for name in ("kick first", "drift first", "euler")) > 1e-6
    assert multiprecision.distance(made_up["kick first"], "pendulum", made_up["drift first"]) < 1e-38


def test_variable_steps_are_measured_at_a_larger_h():
    assert multiprecision.step_of(VERLET) == Fraction(1, 40)
    assert multiprecision.step_of(replace(VERLET, family="adaptive")) == Fraction(3, 10)
    assert multiprecision.digits(VERLET) == 40
    assert multiprecision.digits(replace(VERLET, order=10)) == 80


def test_failed_cell_has_its_reason(monkeypatch):
    def fails(record, name):
        raise ArithmeticError(f"{record.id} on {name} with {mpmath.mp.dps} digits")

    monkeypatch.setitem(multiprecision.CELLS, "orders", (fails, battery.systems))
    assert multiprecision.measure("orders", "rk4", "tao").startswith("ArithmeticError: rk4 on tao with 40 digits")


def test_coefficient_is_replaced_in_place():
    data = (1, (Fraction(1, 2), 3.0, "text"), ((mpmath.mpf(2), 0.25),))
    found = dict(multiprecision.leaves(data))
    assert found == {(1, 0): Fraction(1, 2), (2, 0, 1): 0.25}, "those that are no integers"
    assert multiprecision.replace_at(data, (2, 0, 1), 7) == (*data[:2], ((mpmath.mpf(2), 7),))
    assert multiprecision.replace_at(data, (0,), 7) == (7, *data[1:])


def test_wrong_coefficient_is_detected(monkeypatch):
    """A kick over a h, a drift over h, a kick over b h: with a wrong b the order and the symmetry are not found."""

    def advance(system, record, y, h, steps=1):
        field, h = system.vector_field(MULTIPRECISION), multiprecision.to_number(h, MULTIPRECISION)
        a, b, *_ = (multiprecision.to_number(x, MULTIPRECISION) for x in record.data)
        for _ in range(steps):
            y = kick(lambda x: field(0, x), y, a * h)
            y = kick(lambda x: field(0, x), drift(lambda x: field(0, x), y, h), b * h)
        return y

    halves = replace(VERLET, id="halves", family="one", data=(Fraction(1, 2), Fraction(1, 2)))
    others = [
        replace(halves, id="another"),
        replace(halves, id="none", family="two", data=(1, 1)),
        replace(halves, id="many", family="three", order=6, data=(Fraction(1, 2),) * 13),
    ]
    monkeypatch.setattr(multiprecision, "advance", advance)
    monkeypatch.setattr(multiprecision, "METHODS", (halves, *others))
    monkeypatch.setattr(multiprecision, "systems", lambda record, few: ["pendulum"] if few else ["tao", "pendulum"])
    found = multiprecision.perturbation_effects()
    assert {*found} == {"halves", "another"}
    assert [row["path"] for row in found["halves"]["rows"]] == [[0], [1]]
    for row in found["halves"]["rows"]:
        assert row["error"] > 10 * found["halves"]["error"] or row["symmetry"] > 1e-12
    spoiled = multiprecision.control_errors()
    assert {*spoiled} == {"halves"}, "the first of its family"
    assert [*spoiled["halves"]] == ["pendulum"]
    assert abs(multiprecision.observed_order(spoiled["halves"]["pendulum"]).value) < 0.1
    right = multiprecision.errors(halves, "pendulum")
    assert multiprecision.observed_order(right).value == pytest.approx(2, abs=0.02)


THIRD = Fraction(1, 3)


def test_adjoints_of_nonsymmetric_methods_with_lambda(monkeypatch):
    others = []

    def distance(record, name, back=None):
        others.append(back and back.parameters["lam"])
        return 0.5 if back is None else 0.25

    of_lambda, symmetric = BY_ID["scheme-i"](lam=THIRD), BY_ID["scheme-iii"](lam=THIRD)
    monkeypatch.setattr(multiprecision, "distance", distance)
    monkeypatch.setattr(multiprecision, "variants", lambda: [VERLET, BY_ID["rk4"], symmetric, of_lambda])
    assert multiprecision.adjoint() == {
        of_lambda.label: {name: {"adjoint": 0.25, "itself": 0.5} for name in multiprecision.FEW}
    }
    assert {*others} == {1 - THIRD, None}


def test_schemes_iv_v_with_a_frozen_parameter(monkeypatch):
    """The parameter is 1/4; a system without one is not measured."""

    def integrate(system, id, *, h, steps, q0, p0, arithmetic):
        parameter = 0.25 if system.d == 2 else np.nan
        return SimpleNamespace(parameter=np.full(steps, parameter), q=np.array([q0, q0 + 1]), p=np.array([p0, p0]))

    monkeypatch.setattr(multiprecision, "integrate", integrate)
    monkeypatch.setattr(multiprecision, "advance", lambda system, record, y, h: y)
    monkeypatch.setattr(multiprecision, "defect", lambda record, name: (record.id, record.parameters["lam"]))
    found = multiprecision.frozen()
    assert {*found} == {"scheme-iv", "scheme-v"}
    for id, fixed in (("scheme-iv", "scheme-i"), ("scheme-v", "scheme-iii")):
        flat = [name for name in multiprecision.FEW if battery.SYSTEMS[name]()[0].d == 2]
        assert found[id] == {name: {"defect": (fixed, 0.25), "distance": 1.0, "lam": 0.25} for name in flat}
        assert 0 < len(flat) < len(multiprecision.FEW)


# -- variants and systems ---------------------------------------------------------------------------------------------


def test_variants_have_every_parameter_value():
    lams = [m.parameters["lam"] for m in battery.variants([BY_ID["scheme-i"]])]
    assert lams == [Fraction(-1), Fraction(1, 3), Fraction(1, 2), Fraction(3, 2)]
    assert battery.variants([BY_ID["scheme-i"]], lam=(Fraction(1, 7),))[0].parameters["lam"] == Fraction(1, 7)
    assert battery.variants([VERLET]) == [VERLET]
    high = [m for m in battery.high_order_variants() if m.id == "generating-function"]
    assert {m.parameters["order"] for m in high} == {5, 6}
    assert battery.by_label([VERLET, BY_ID["rk4"]]) == {"stormer-verlet": VERLET, "rk4": BY_ID["rk4"]}
    with pytest.raises(AssertionError):
        battery.by_label([VERLET, VERLET])


EVERY = ["pendulum", "henon-heiles", "perturbed-kepler", "lotka-volterra", "tao", "coupled"]


@pytest.mark.parametrize(
    ("id", "few", "names"),
    [
        ("stormer-verlet", False, EVERY),
        ("rk4", True, ["pendulum", "henon-heiles", "tao"]),
        ("gauss-8", None, ["pendulum", "henon-heiles", "tao"]),  # of high order
        ("mclachlan-atela-5", None, ["pendulum", "henon-heiles"]),
        ("gautschi", True, ["henon-heiles", "two-frequencies"]),  # systems with a fast part
        ("mclachlan-atela-4", None, ["pendulum", "henon-heiles", "perturbed-kepler"]),
        ("scheme-iv", None, [name for name in EVERY if name != "lotka-volterra"]),
    ],
)
def test_systems_suit_the_method(id, few, names):
    assert battery.systems(BY_ID[id], few) == names


def test_properties_of_the_test_systems():
    fast, coupled = battery.two_frequencies(), battery.coupled_double_well()
    assert sp.Poly(fast.slow_potential, *fast.q).homogeneous_order() == 3, "nothing quadratic is left to the slow part"
    assert len({*fast.frequencies}) == 2
    assert not coupled.separable
    assert not battery.tao().separable
    state = dict(zip((*coupled.q, *coupled.p), (0.4, -0.6, 0.5, 0.3), strict=True))
    for x, y in ((coupled.q, coupled.q[::-1]), (coupled.q, coupled.p)):
        exchanged = coupled.H.subs(dict(zip((*x, *y), (*y, *x), strict=True)), simultaneous=True)
        assert abs((exchanged - coupled.H).subs(state)) > 0.01


def test_long_formulae_are_tested_on_small_systems():
    (high,) = battery.variants([BY_ID["generating-function"]], order=(5,), lam=(Fraction(1, 3),))
    long = next(m for m in METHODS if m.family == "schemes_iv_v" and m.order > 4)
    for record in (high, long):
        assert battery.systems(record) == battery.systems(record, few=False) == ["henon-heiles", "tao"]


def test_expected_properties_on_a_system():
    assert (battery.canonical("tao"), battery.canonical("lotka-volterra")) == (True, False)
    assert battery.expected_order(BY_ID["pavf"], "pendulum") == 2
    assert battery.expected_order(BY_ID["pavf"], "tao") == BY_ID["pavf"].order == 1
    assert battery.expected_order(BY_ID["itoh-abe"], "pendulum") == 2
    assert battery.expected_order(BY_ID["itoh-abe"], "henon-heiles") == BY_ID["itoh-abe"].order == 1
