"""Every registered problem: its entry, derivatives, invariants, values from the literature, invalid parameters."""

from __future__ import annotations

import importlib
from fractions import Fraction
from functools import partial

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.every_problem import SMALL
from phasebench.benchmarks.measure.multiprecision import retraction
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.benchmarks.problems.scenes import SCENES
from phasebench.integrators.compile.codegen import compiled, precision, value_kind, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.reference.solvers import taylor
from phasebench.reference.solvers.gauss import share_subexpressions

DIGITS = 40


def state(made, seed=0):
    """A random point near the initial state, in rationals, so that expressions can be evaluated to any precision."""
    rng = np.random.default_rng(seed)
    values = [*made.q0, *made.p0]
    values = [sp.Rational(round(v * 10**6 + int(rng.integers(-5000, 5000)) + 0.5), 10**6) for v in values]
    return on_manifold(made.system, values) if made.system.constrained else values


def on_manifold(system, values):
    """The state near a state where all constraints vanish, as rationals."""
    with precision(2 * DIGITS):
        y = retraction(system)(vector([Fraction(v.p, v.q) for v in values]))
        return [sp.Rational(int(x * 10 ** (2 * DIGITS)), 10 ** (2 * DIGITS)) for x in y]


def function(made, expressions):
    """The expressions, which may refer to the system's definitions, as a function of a point, in multiprecision."""
    given = {x: sp.Dummy() for x in (*made.system.q, *made.system.p)}  # cse's own symbols are x0, x1, ...
    shared = partial(share_subexpressions, [(x, e.xreplace(given)) for x, e in made.system.definitions])
    f = sp.lambdify(
        [[*given.values()]], [e.xreplace(given) for e in map(sp.sympify, expressions)], "mpmath", cse=shared
    )
    return lambda values: f([mpmath.mpf(v.p) / v.q for v in values])


def numbers(made, expressions, values):
    """The values of the expressions at a point, in multiprecision."""
    return function(made, expressions)(values)


def orbits():
    return [(name, orbit) for name, (_, _, names) in PROBLEMS.items() for orbit in names]


@pytest.mark.parametrize("name", PROBLEMS)
def test_registry_entry_agrees_with_the_module(name):
    module_name, line, names = PROBLEMS[name]
    module = importlib.import_module(f"phasebench.benchmarks.problems.{module_name}")
    made = module.make(**module.PARAMETERS)
    assert made.id == name
    assert tuple(o.name for o in made.orbits) == names
    assert line
    assert made.source
    assert made.name
    assert problem(name).start.name == names[0]
    assert set(made.parameters) == set(module.PARAMETERS)


@pytest.mark.parametrize("name", PROBLEMS)
def test_module_declares_the_scenes_of_its_problem(name):
    module = importlib.import_module(f"phasebench.benchmarks.problems.{PROBLEMS[name][0]}")
    stated = getattr(module, "SCENES", ())
    assert [s for s in SCENES if s.problem.partition(":")[0] == name] == sorted(stated, key=SCENES.index)
    assert [s.problem for s in stated] == [problem(s.problem).label for s in stated], (
        "an orbit that is the only one is not named"
    )


@pytest.mark.parametrize("name", PROBLEMS)
def test_time_scales_of_a_problem(name):
    """Over its span an orbit moves by a good part of its size, over a step by much less."""
    made = problem(name, **SMALL.get(name, {}))
    step, span = made.pace.step, made.pace.span
    start = np.array([*made.q0, *made.p0])
    after_step, after_span = taylor.states(made.system, float, made.q0, made.p0, [step, span])
    size = np.abs([start, after_step, after_span]).max()
    assert np.abs(after_step - start).max() < size / 2
    assert np.abs(after_span - start).max() > size / 20


@pytest.mark.parametrize(("name", "orbit"), orbits())
def test_orbit_is_finite_and_of_length_d(name, orbit):
    made = problem(f"{name}:{orbit}")
    assert made.start.name == orbit
    assert len(made.q0) == len(made.p0) == made.system.d
    assert np.isfinite([*made.q0, *made.p0]).all()
    assert all(type(x) is float for x in (*made.q0, *made.p0))
    H = made.system.observe(made.system.H, np.array([made.q0]), np.array([made.p0]))
    assert np.isfinite(H).all()


@pytest.mark.parametrize("name", PROBLEMS)
def test_derivatives_against_differences_of_H(name):
    """The compiled field against differences of H in multiprecision, without symbolic differentiation."""
    made = problem(name)
    system, d = made.system, made.system.d
    values = state(made)
    with mpmath.workdps(DIGITS):
        f = sp.lambdify([[*system.q, *system.p]], system.H, "mpmath")
        y = [mpmath.mpf(v.p) / v.q for v in values]
        delta = mpmath.mpf(10) ** -12
        slopes = []
        for i in range(2 * d):
            plus, minus = (y[:i] + [y[i] + s * delta] + y[i + 1 :] for s in (1, -1))
            slopes.append((f(plus) - f(minus)) / (2 * delta))
    q, p = np.array([float(v) for v in values]).reshape(2, d)
    if compiled() and value_kind(d) == "tuple":
        q, p = tuple(q), tuple(p)
    dq, dp = (np.array(x, float) for x in system.field()(q, p, 0.0, 0.0))
    dH = np.array([float(s) for s in slopes])
    force, velocity = np.abs(dH[:d]).max(), np.abs(dH[d:]).max()
    if system.canonical:
        assert np.abs(dq - dH[d:]).max() < 1e-13 * velocity
        assert np.abs(dp + dH[:d]).max() < 1e-13 * force
        assert np.abs(dp - dH[:d]).max() > 1e-3 * force, "the control: the sign"
    else:
        size = max(force, velocity) * np.abs([*dq, *dp]).max()
        assert abs(dH[:d] @ dq + dH[d:] @ dp) < 1e-13 * size, "dI/dt along the flow"


def rate(system, expression):
    """d/dt of an expression along the flow, {I, H} for a canonical system, in terms of the system's definitions."""
    return sum(expression.diff(x) * dx for x, dx in zip((*system.q, *system.p), system.sides, strict=True))


INVARIANTS = [(n, i) for n in PROBLEMS for i in ("energy", *problem(n).invariants)]


def invariant(made, name):
    return made.system.H if name == "energy" else made.invariants[name]


@pytest.mark.parametrize(("name", "which"), INVARIANTS)
def test_rate_of_an_invariant_vanishes(name, which):
    """{I, H} is formed symbolically and vanishes to 40 digits at random rational points.

    The perturbed Kepler problem preserves its angular momentum, not its Laplace-Runge-Lenz vector: the control
    below.
    """
    made = problem(name, **SMALL.get(name, {}))
    expression = invariant(made, which)
    slopes = [expression.diff(x) for x in (*made.system.q, *made.system.p)]
    evaluate = function(made, [rate(made.system, expression), *slopes])
    with mpmath.workdps(DIGITS):
        for seed in range(4):
            value, *slopes = evaluate(state(made, seed))
            assert any(s != 0 for s in slopes), "a constant is no invariant worth the name"
            assert abs(value) < mpmath.mpf(10) ** (6 - DIGITS) * (1 + max(abs(s) for s in slopes))


def test_control_bracket_of_a_noninvariant():
    made, kepler = problem("perturbed-kepler"), problem("kepler")
    with mpmath.workdps(DIGITS):
        for which in ("laplace-runge-lenz-1", "laplace-runge-lenz-2"):
            (value,) = numbers(made, [rate(made.system, kepler.invariants[which])], state(made))
            assert abs(value) > 1e-6


@pytest.mark.parametrize("name", [n for n in PROBLEMS if problem(n).system.d <= 2])
def test_bracket_with_H_is_zero_symbolically(name):
    made = problem(name)
    for expression in (made.system.H, *made.invariants.values()):
        assert sp.simplify(rate(made.system, expression)) == 0


def energy(name, **parameters):
    made = problem(name, **parameters)
    return float(made.system.observe(made.system.H, np.array([made.q0]), np.array([made.p0]))[0])


def test_literature_values():
    """Values printed by Wang, Bo & Cai (talk), (27)-(30), and Hairer, Lubich & Wanner 2006, I.2 and exercise I.12."""
    assert energy("henon-heiles:box") == pytest.approx(0.02, rel=1e-15)
    assert energy("henon-heiles:chaotic") == pytest.approx(1 / 6, rel=1e-15)
    assert energy("kepler") == pytest.approx(-0.5, rel=1e-14)
    assert energy("perturbed-kepler") == pytest.approx(-0.5 - 0.0075 / (3 * 0.4**3), rel=1e-14)
    assert energy("perturbed-kepler") == pytest.approx(-0.5391, abs=5e-5)
    assert energy("pendulum:rotating") == pytest.approx(2.125)
    for name in ("kepler", "perturbed-kepler"):
        made = problem(name)
        assert float(made.q0[0] * made.p0[1]) == pytest.approx(0.8, rel=1e-15)
    made = problem("henon-heiles:chaotic")
    assert made.q0 == (0.0, 0.82)
    assert made.p0[0] > 0
    assert made.p0[1] == 0


def test_kepler_period_is_two_pi():
    made = problem("kepler", e=0.3)
    s = integrate(made, "scheme-iii-suzuki-6", t_end=2 * np.pi, steps=400)
    assert np.abs([*(s.q[-1] - made.q0), *(s.p[-1] - made.p0)]).max() < 1e-11


def test_lotka_volterra_rests_at_its_equilibrium():
    made = problem("lotka-volterra")
    rates = numbers(made, [*made.system.dq, *made.system.dp], [sp.Integer(1), sp.Integer(2)])
    assert rates == [0, 0]


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("kepler", {"e": 1.0}, "eccentricity"),
        ("kepler", {"e": -0.1}, "eccentricity"),
        ("perturbed-kepler", {"e": 1.5}, "eccentricity"),
        ("kepler", {"e": float("nan")}, "finite"),
        ("perturbed-kepler", {"mu": float("inf")}, "finite"),
        ("kepler", {"e": "0.5"}, "finite"),
        ("kepler", {"e": True}, "finite"),
        ("harmonic-oscillator", {"omega": 10**400}, "finite"),
        ("harmonic-oscillator", {"omega": Fraction(10**400, 3)}, "finite"),
        ("kepler", {"mu": 0.1}, "has no parameter 'mu'; it has e"),
        ("pendulum", {"e": 0.1}, "has none"),
        ("harmonic-oscillator", {"omega": 0.0}, "positive"),
        ("keplar", {}, "did you mean kepler"),
        ("henon-heiles:boxes", {}, "did you mean box"),
        ("pendulum:box", {}, "there is no orbit of 'pendulum' 'box'"),
    ],
)
def test_invalid_parameters_are_refused(name, parameters, message):
    with pytest.raises(InvalidInput, match=message):
        problem(name, **parameters)


def test_valid_parameters_change_the_problem():
    assert problem("kepler", e=0).q0 == (1.0, 0.0)
    assert problem("perturbed-kepler", mu=0.0).system.H.equals(problem("kepler").system.H)
    assert energy("harmonic-oscillator", omega=3) == 4.5


@pytest.mark.parametrize("value", [np.float32(1.5), np.float64(1.5), Fraction(3, 2)])
def test_parameter_may_be_any_real_number(value):
    """Also for a problem from the cache, filled by another process."""
    assert problem("harmonic-oscillator", omega=value) is problem("harmonic-oscillator", omega=1.5)
