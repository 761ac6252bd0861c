"""Discrete gradients: the identity DG . x = H(y + x) - H(y), independent implementations, conservation of energy.

The independent ones use mpmath and none of the kernel's code: an average over one coordinate is a difference quotient
of H, an average over several is Simpson's rule, which is exact for the gradient of a quartic H.
"""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.families import averaged, discrete_gradient
from phasebench.integrators.families.averaged import coupled
from phasebench.integrators.record import ROUND_OFF
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping.kernel import freeze, prepare
from support.kinds import arrays_and_tuples_apart
from support.solutions import energy_errors, last
from support.systems import general
from support.values import value

IDS = [m.id for m in METHODS if m.family in ("averaged", "discrete_gradient")]
KERNELS = ("avf", "pavf", "pavf-p", "itoh-abe", "itoh-abe-symmetrized", "gonzalez")
H = 0.125
#: Largest difference of two steps solved to round-off, and a clearly visible one.
UNIT, VISIBLE = 4e-15, 1e-6


# -- the energy -------------------------------------------------------------------------------------------------------


def energy_error(name, id, h, steps):
    """Largest energy error of a run; fail if its status is not "ok"."""
    system, q, p = SYSTEMS[name]()
    s = integrate(system, id, h=h, steps=steps, q0=q, p0=p)
    assert s.status == "ok", s.reason
    assert s.counts["fallbacks"] == 0
    return np.abs(energy_errors(s)).max()


@pytest.mark.parametrize("name", ["henon-heiles", "pendulum", "coupled"])
@pytest.mark.parametrize("id", IDS)
def test_energy_is_conserved_to_round_off(id, name):
    assert method(id).energy == ROUND_OFF
    assert energy_error(name, id, 0.1, 3000) < 3e-14 * (6 if "yoshida" in id else 1)


@pytest.mark.parametrize("name", ["henon-heiles", "pendulum", "coupled"])
def test_control_the_midpoint_rule_does_not_conserve_energy(name):
    assert energy_error(name, "implicit-midpoint", 0.1, 3000) > 1e-5


@pytest.mark.parametrize("h", [1e-2, 1e-4, 1e-6])
def test_gonzalez_gradient_suppresses_round_off(h):
    """(H(y + x) - H(y)) / (x . x) has an error of eps / h^2, which must not reach the state or accumulate."""
    system, q, p = SYSTEMS["pendulum"]()
    a, b = (
        integrate(system, id, h=h, steps=4000, q0=q, p0=p, save_every=0) for id in ("gonzalez", "implicit-midpoint")
    )
    assert abs(energy_errors(a)[-1]) < 2e-15
    # Both have order 2; at small h only round-off is left of their difference.
    assert max(abs(a.q[-1] - b.q[-1]), abs(a.p[-1] - b.p[-1])) < 0.1 * (4000 * h) * h**2 + 4e-15
    assert a.counts["newton"] == 0


# -- the identity -----------------------------------------------------------------------------------------------------


def product(id, name, seed, spoil=lambda step: step):
    """(DG . x, H(y + x) - H(y)) for a random increment x that solves no equation, by the kernel's own functions."""
    system, q, p = SYSTEMS[name]()
    system = general(system)
    x = 0.4 * np.random.default_rng(seed).standard_normal(2 * system.d)
    step = spoil(prepare(method(id), system).step)
    E = lambda q, p: system.observe(system.H, np.array([q]), np.array([p]))[0]  # noqa: E731
    difference = E(q + x[: system.d], p + x[system.d :]) - E(q, p)
    if id == "gonzalez":

        def flow(a):
            equation = discrete_gradient.Increment(step.field, value(*q), value(*p), 1.0, a)
            return np.array(discrete_gradient.increment(value(*x), equation))

        i = flow((difference - pairing(flow(0.0), x)) / (x @ x))
    else:
        i = averaged.mean(value(*x), averaged.Average(step, value(*q), value(*p), value(*p), 1.0, 0, 0))
    return pairing(i, x), difference


def pairing(i, x):
    """The product g . x of a gradient g and x, given the increment i = J^-1 g."""
    d = len(x) // 2
    return np.array(i[:d]) @ x[d:] - np.array(i[d:]) @ x[:d]


@pytest.mark.parametrize("name", ["henon-heiles", "coupled", "tao"])
@pytest.mark.parametrize("id", KERNELS)
def test_a_discrete_gradient_satisfies_the_identity(id, name):
    for seed in range(5):
        found, difference = product(id, name, seed)
        assert abs(found - difference) < UNIT
        assert abs(difference) > 1e-3


@pytest.mark.parametrize("id", ["avf", "pavf", "itoh-abe-symmetrized"])
def test_control_a_perturbed_weight_breaks_the_identity(id):
    def spoil(step):
        step.b[0] *= 1 + 1e-9
        return step

    found, difference = product(id, "coupled", 0, spoil)
    assert abs(found - difference) > 1e4 * UNIT


def test_control_a_block_left_out_breaks_the_identity():
    def spoil(step):
        assert list(step.blocks) == [4]
        return step._replace(blocks=freeze([3]).astype(step.blocks.dtype))

    found, difference = product("itoh-abe", "coupled", 0, spoil)
    assert abs(found - difference) > 1e-3


# -- independent implementations --------------------------------------------------------------------------------------


@cache
def formula(name):
    """(H, list of its derivatives, d) of a system; functions of a list y of mpmath numbers."""
    system = SYSTEMS[name]()[0]
    y = (*system.q, *system.p)
    functions = [sp.lambdify([y], e, "mpmath") for e in (system.H, *(sp.diff(system.H, x) for x in y))]
    return functions[0], functions[1:], system.d


def partial_means(name, y, x, blocks):
    """The discrete gradient along the path that moves one block of components after the other."""
    energy, gradient, _ = formula(name)
    at, out = list(y), [None] * len(y)
    for block in blocks:
        after = [a + b if i in block else a for i, (a, b) in enumerate(zip(at, x, strict=True))]
        for i in block:
            if len(block) == 1 and x[i] != 0:
                out[i] = (energy(after) - energy(at)) / x[i]
            else:
                middle = [(a + b) / 2 for a, b in zip(at, after, strict=True)]
                out[i] = (gradient[i](at) + 4 * gradient[i](middle) + gradient[i](after)) / 6
        at = after
    return out


def gonzalez(name, y, x):
    """Gonzalez' discrete gradient at y with increment x."""
    energy, gradient, _ = formula(name)
    g = [f([a + b / 2 for a, b in zip(y, x, strict=True)]) for f in gradient]
    rest = energy([a + b for a, b in zip(y, x, strict=True)]) - energy(y) - mpmath.fdot(g, x)
    a = rest / mpmath.fdot(x, x) if any(x) else 0
    return [u + a * v for u, v in zip(g, x, strict=True)]


def substep(name, y, h, discrete_gradient_of):
    """One step of length h with a discrete gradient, solved by fixed-point iteration."""
    d = formula(name)[2]
    x = [mpmath.mpf(0)] * len(y)
    for _ in range(200):
        g = discrete_gradient_of(y, x)
        new = [h * u for u in g[d:]] + [-h * u for u in g[:d]]
        change = max(abs(a - b) for a, b in zip(new, x, strict=True))
        x = new
        if change < 1e-25:
            return [a + b for a, b in zip(y, x, strict=True)]
    raise ArithmeticError("the fixed point does not converge")


def direct(id, name):
    """End state of one step by the formulas written in this file."""
    _, q, p = SYSTEMS[name]()
    d = len(q)
    single, halves = [[i] for i in range(2 * d)], [list(range(d, 2 * d)), list(range(d))]
    forth = {"avf": [list(range(2 * d))], "pavf": halves, "itoh-abe": single}
    mean = {"pavf-p": halves, "itoh-abe-symmetrized": single}
    composed = {"pavf-c": halves, "itoh-abe-c": single}
    with mpmath.workdps(34):
        y, h = [mpmath.mpf(x) for x in (*q, *p)], mpmath.mpf(H)

        def along(blocks):
            return lambda y, x: partial_means(name, y, x, blocks)

        if id == "gonzalez":
            y = substep(name, y, h, lambda y, x: gonzalez(name, y, x))
        elif id == "pavf-adjoint":
            y = substep(name, y, h, along(halves[::-1]))
        elif id in forth:
            y = substep(name, y, h, along(forth[id]))
        elif id in mean:
            forwards, backwards = along(mean[id]), along(mean[id][::-1])

            def both(y, x):
                return [(u + v) / 2 for u, v in zip(forwards(y, x), backwards(y, x), strict=True)]

            y = substep(name, y, h, both)
        else:
            for blocks in (composed[id], composed[id][::-1]):
                y = substep(name, y, h / 2, along(blocks))
        return np.array([float(x) for x in y])


DIRECT = (
    "avf",
    "pavf",
    "pavf-adjoint",
    "pavf-c",
    "pavf-p",
    "itoh-abe",
    "itoh-abe-symmetrized",
    "itoh-abe-c",
    "gonzalez",
)


def step(id, name):
    """End state of one step of a method by `integrate`."""
    system, q, p = SYSTEMS[name]()
    s = integrate(system, id, h=H, steps=1, q0=q, p0=p)
    return last(s)


@pytest.mark.parametrize("name", ["henon-heiles", "coupled"])
@pytest.mark.parametrize("id", DIRECT)
def test_a_step_equals_the_direct_formula(id, name):
    assert np.abs(step(id, name) - direct(id, name)).max() < UNIT


def test_control_the_direct_formulas_differ():
    """A path in the wrong order, or a mean in place of a composition, would be noticed."""
    ends = {id: direct(id, "coupled") for id in DIRECT}
    for i, a in enumerate(DIRECT):
        assert all(np.abs(ends[a] - ends[b]).max() > VISIBLE for b in DIRECT[:i])


# -- systems for which paths are equivalent ---------------------------------------------------------------------------


def test_equivalent_paths_give_the_averaged_vector_field():
    separable, single, mixed = (SYSTEMS[n]()[0] for n in ("henon-heiles", "pendulum", "coupled"))
    assert not coupled("momenta, coordinates", separable)
    assert not coupled("components", single)
    assert coupled("components", separable)
    assert all(coupled(path, mixed) for path in ("momenta, coordinates", "components"))
    assert coupled("momenta, coordinates", SYSTEMS["tao"]()[0])
    assert np.array_equal(step("pavf", "henon-heiles"), step("avf", "henon-heiles"))
    assert np.array_equal(step("itoh-abe", "pendulum"), step("avf", "pendulum"))
    # Also by the direct formulas.
    for a in ("pavf", "pavf-adjoint"):
        assert np.abs(direct(a, "henon-heiles") - direct("avf", "henon-heiles")).max() < UNIT
    assert np.abs(direct("itoh-abe", "henon-heiles") - direct("avf", "henon-heiles")).max() > VISIBLE


# -- states that are arrays -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", [pytest.param("itoh-abe-c", marks=pytest.mark.thorough), "gonzalez"])
def test_arrays_and_tuples_agree(id):
    assert arrays_and_tuples_apart(id) < 1e-12


# -- the search for Gonzalez' a ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["henon-heiles", "pendulum", "coupled"])
def test_long_steps_conserve_energy_to_the_last_unit(name):
    """The iteration for Gonzalez' discrete gradient goes on while the energy error still falls."""
    system, q, p = SYSTEMS[name]()
    s = integrate(system, "gonzalez", h=0.8 if name == "pendulum" else 0.4, steps=40, q0=q, p0=p)
    assert s.counts["fallbacks"] == 0
    assert np.abs(energy_errors(s)).max() < 1e-15


def test_a_step_that_misses_the_energy_is_counted_once():
    """A rotating pendulum with steps that are too long: each after which the energy is off is among ``fallbacks``."""
    s = integrate(problem("pendulum").system, "gonzalez", h=2.0, steps=6, q0=[0.0], p0=[2.5])
    missed = np.sum(np.abs(energy_errors(s)) > 1e-9)
    assert 2 <= missed <= s.counts["fallbacks"] <= 6
    assert s.status == "no-root"


@pytest.mark.parametrize(("id", "most"), [("gonzalez", 27), ("gonzalez-yoshida-4", 94)])
def test_each_step_starts_by_extrapolation(id, most):
    """Increments and multipliers are both extrapolated; with only one of them it takes a quarter more evaluations."""
    s = integrate(problem("pendulum"), id, h=0.1, steps=40)
    assert s.counts["steps"] == 40
    assert s.counts["gradient"] <= most * 40
