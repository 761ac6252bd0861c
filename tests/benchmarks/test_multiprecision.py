"""Measurements without round-off, on simple steps: a leapfrog, the symplectic Euler methods, Euler's method."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import battery, multiprecision
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, vector
from phasebench.integrators.registry import BY_ID, method

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


# -- variants and systems ---------------------------------------------------------------------------------------------


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
