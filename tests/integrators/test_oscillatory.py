"""Integrators for a fast linear part: published formulas, exactness, poles, round-off."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.records.oscillatory import METHODS
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel

IDS = [m.id for m in METHODS]
TRIGONOMETRIC = [m.id for m in METHODS if m.id not in ("r-respa", "imex")]
OMEGA = 50.0
FPU = problem("fpu")


def sinc(x):
    return np.sinc(np.asarray(x) / np.pi)


#: Published filters (psi, phi): Hairer, Lubich & Wanner 2006, XIII; Grimm & Hochbruck 2006.
PUBLISHED = {
    "gautschi": (lambda x: sinc(x / 2) ** 2, np.ones_like),
    "deuflhard": (sinc, np.ones_like),
    "mollified-impulse": (lambda x: sinc(x) ** 2, sinc),
    "hochbruck-lubich": (lambda x: sinc(x / 2) ** 2, lambda x: sinc(x) * (1 + np.sin(x / 2) ** 2 / 3)),
    "hairer-lubich": (lambda x: sinc(x) ** 2, np.ones_like),
    "grimm-hochbruck": (lambda x: sinc(x) ** 3, sinc),
}


def slow(q):
    """Force -grad U of the slow potential of the Fermi-Pasta-Ulam problem for m = 3, written by hand."""
    x, y = q[:3], q[3:]
    soft = np.array([x[0] - y[0], x[1] - y[1] - x[0] - y[0], x[2] - y[2] - x[1] - y[1], x[2] + y[2]]) ** 3
    signs = np.array([[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, 1], [-1, -1, 0, 0], [0, -1, -1, 0], [0, 0, -1, 1]])
    return -signs @ soft


FREQUENCIES = np.array([0, 0, 0, OMEGA, OMEGA, OMEGA])
STATE = np.array([0.9, -0.4, 0.3, 0.02, -0.015, 0.01]), np.array([0.8, 0.1, -0.5, 1.0, -0.7, 0.3])


def step(id, h, system=None, state=STATE, **parameters):
    """State (q, p) after one step of a method from ``state``, array (2, d); the Fermi-Pasta-Ulam chain by default."""
    s = integrate(system or FPU, id, h=h, steps=1, q0=state[0], p0=state[1], parameters=parameters)
    return np.array([s.q[-1], s.p[-1]])


@pytest.mark.parametrize("id", TRIGONOMETRIC)
@pytest.mark.parametrize("x", [0.3, 4.0])
def test_a_step_equals_the_published_formula(id, x):
    """Hairer, Lubich & Wanner 2006, XIII (2.7)-(2.9), for cosines of both signs."""
    h, (q, p) = x / OMEGA, STATE
    xi = h * FREQUENCIES
    psi, phi = (f(xi) for f in PUBLISHED[id])
    assert method(id).symplectic == bool(np.allclose(psi, sinc(xi) * phi))
    psi1, c = psi / sinc(xi), np.cos(xi)
    g0 = slow(phi * q)
    q1 = c * q + h * sinc(xi) * p + h**2 / 2 * psi * g0
    p1 = -FREQUENCIES * np.sin(xi) * q + c * p + h / 2 * (c * psi1 * g0 + psi1 * slow(phi * q1))
    assert np.abs(step(id, h) - [q1, p1]).max() < 1e-13
    others = [i for i in TRIGONOMETRIC if i != id]
    assert min(np.abs(step(i, h) - [q1, p1]).max() for i in others) > 1e-9, "the control: another method's step"


@pytest.mark.parametrize("id", IDS)
def test_without_a_fast_part_methods_are_stormer_verlet(id):
    made = problem("henon-heiles")
    slow_only = Hamiltonian(q=made.system.q, p=made.system.p, H=made.system.H, frequencies=[0, 0])
    state = np.array(made.q0), np.array(made.p0)
    gap = np.abs(step(id, 0.3, slow_only, state) - step("stormer-verlet", 0.3, slow_only, state)).max()
    assert gap < 1e-15
    fast = np.abs(step(id, 0.3, made.system, state) - step("stormer-verlet", 0.3, slow_only, state)).max()
    assert fast > 1e-5, "the control: with the linear part declared fast it is not"


@pytest.mark.parametrize("id", ["deuflhard", "grimm-hochbruck", "imex", "r-respa"])
@pytest.mark.parametrize("h", [0.9, 40.0])
def test_the_harmonic_oscillator_is_exact_for_any_step(id, h):
    found = problem("harmonic-oscillator")
    s = integrate(found, id, h=h, steps=200)
    error = max(np.abs(s.q[:, 0] - np.cos(s.t)).max(), np.abs(s.p[:, 0] + np.sin(s.t)).max())
    if id in TRIGONOMETRIC:
        assert error < 1e-12
    else:
        assert error > 1e-6, "the control: an approximate propagator"


@pytest.mark.parametrize("id", ["gautschi", "hochbruck-lubich"])
def test_an_infinite_coefficient_is_refused_and_its_pole_named(id):
    for times in (1, 3):
        with pytest.raises(InvalidInput, match=rf"h omega is {times}\.0 pi, where the method's kick is infinite"):
            integrate(FPU, id, h=times * math.pi / OMEGA, steps=1)
    assert integrate(FPU, id, h=2 * math.pi / OMEGA, steps=1).status == "ok", "the control: an even multiple"


@pytest.mark.parametrize(
    ("id", "h", "most"),
    [("deuflhard", 0.001 / 3, 1e-14), ("deuflhard", (math.pi + 0.001) / 3, 1e-14), ("imex", 1.3, 1e-12)],
)
def test_round_off_does_not_make_the_propagator_grow(id, h, most):
    """The compensations rotate with the state, also by more than pi (otherwise the error is 1e-13)."""
    s = integrate(problem("harmonic-oscillator", omega=3.0), id, h=h, steps=500_000, save_every=100)
    kept = s.p[:, 0] ** 2 + 9 * s.q[:, 0] ** 2
    assert np.abs(kept / kept[0] - 1).max() < most


def test_coefficients_are_exact_where_the_sine_vanishes():
    """At the double nearest to h omega = 2 pi the sine loses 16 digits; omega = 50."""
    h = 2 * math.pi / OMEGA
    prepared = kernel.prepare(method("deuflhard"), FPU.system)
    found = prepared.begin(prepared.step._replace(h=h), *STATE).filters[3, -1]
    with mpmath.workdps(80):
        wanted = float(mpmath.sin(mpmath.mpf(h) * 50) / 50)
    assert abs(found / wanted - 1) < 1e-15
    assert abs(math.sin(h * OMEGA) / OMEGA / wanted - 1) > 1e-6, "the control: doubles"


def test_bad_parameters_are_refused():
    for parameters in ({"omega": 0.0}, {"m": 0}, {"m": 1.5}, {"m": 10_000}):
        with pytest.raises(InvalidInput, match="must be"):
            problem("fpu", **parameters)
    with pytest.raises(InvalidInput, match="linear fast part"):
        integrate(problem("pendulum"), "imex", h=0.1, steps=1)
