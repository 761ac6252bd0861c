"""Semi-discretized wave equations with handwritten loops, against the formula, the equation and their invariants."""

from __future__ import annotations

import cmath
from itertools import pairwise
from math import cosh, pi, sqrt

import numpy as np
import pytest

from phasebench.benchmarks.problems import klein_gordon, nls, problem
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, uncompiled_loop

MODULES = {"nls": nls, "klein-gordon": klein_gordon}
SMALL, LENGTH = 4, 5.0


def loop(name, function, N, arithmetic="double"):
    """A wave problem's handwritten loop of this name, such as "field", for N grid points, not compiled."""
    module = MODULES[name]
    return uncompiled_loop(
        function, getattr(module, function), [to_number(c, arithmetic) for c in module.constants(N, LENGTH)]
    )


def state(d, seed=3):
    return np.random.default_rng(seed).normal(size=(2, d))


@pytest.fixture(scope="module", params=MODULES)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def small(name) -> Hamiltonian:
    """The symbolic Hamiltonian on four grid points."""
    made = problem(name, N=SMALL, L=LENGTH)
    assert type(made.system) is Hamiltonian
    return made.system


# -- the loops ---------------------------------------------------------------------------------------------------------


def test_loops_run_in_multiprecision(name, small):
    """Against the formula at 40 digits: neither a loop nor its constants contain doubles."""
    with precision(40):
        q, p = (vector(row) / 3 for row in state(small.d))
        theirs = small.field(MULTIPRECISION)(q, p, 0, 0)
        ours = loop(name, "field", SMALL, MULTIPRECISION)(q, p, 0, 0)
        assert max(abs(a - b) for x, y in zip(ours, theirs, strict=True) for a, b in zip(x, y, strict=True)) < 1e-37
        pairs = loop(name, "energy", SMALL, MULTIPRECISION)(q, p), small.energy(MULTIPRECISION)(q, p)
        assert all(abs(a - b) < 1e-37 * abs(b) for a, b in zip(*pairs, strict=True))
        if name == "klein-gordon":
            force = loop(name, "grad_V", SMALL, MULTIPRECISION)(q)
            assert max(abs(a + b) for a, b in zip(force, theirs[1], strict=True)) < 1e-37


def test_invalid_sizes_are_refused(name):
    for N in (2, 4.5, 10**9):
        with pytest.raises(InvalidInput, match="points"):
            problem(name, N=N)
    for L in (-1.0, 0.0, 1e6):
        with pytest.raises(InvalidInput, match="length"):
            problem(name, L=L)
    assert np.isfinite([*problem(name, L=500.0).q0, *problem(name, L=1e-3).q0]).all()
    q, p, H = MODULES[name].formula(4, 1.0)
    with pytest.raises(InvalidInput, match="degrees of freedom"):
        HandHamiltonian(q=q, p=p, H=H, loops={})


# -- the equation ------------------------------------------------------------------------------------------------------


def soliton_error(N):
    """Largest error of psi at t = 1/2, from the differences in space; that of RK4 is far smaller."""
    made = problem("nls:soliton", N=N, L=32.0)
    s = integrate(made, "rk4", h=1 / 1024, t_end=0.5, save_every=0)
    k, t, dx = 2 * pi / 32, 0.5, 32 / N
    x = -16 + dx * np.arange(N)
    exact = [cmath.exp(1j * (k * y + (1 - k * k) * t)) / cosh(y - 2 * k * t) for y in x]
    return np.abs((s.q[-1] + 1j * s.p[-1]) / sqrt(dx) - exact).max()


def test_soliton_converges_to_second_order_in_space():
    """Zakharov & Shabat 1972: sech(x - 2 k t) exp(i (k x + (1 - k^2) t)) solves the equation."""
    errors = [soliton_error(N) for N in (128, 256, 512)]
    assert errors[-1] < 1e-3
    ratios = [a / b for a, b in pairwise(errors)]
    assert ratios == pytest.approx([4, 4], rel=0.1)


def test_plane_wave_has_its_discrete_frequency():
    """phi = A exp(i (k x - w t)) with w^2 = 1 + A^2 + k^2, with k of the difference quotient."""
    N, L, A = 64, 10.0, 0.7
    system = problem("klein-gordon", N=N, L=L).system
    dx, k = L / N, 2 * pi / L
    w = sqrt(1 + A**2 + (2 / dx * np.sin(k * dx / 2)) ** 2)
    phi = A * sqrt(dx) * np.exp(1j * k * dx * np.arange(N))
    start = [np.concatenate([z.real, z.imag]) for z in (phi, -1j * w * phi)]
    s = integrate(system, "rk4", h=1 / 512, t_end=1.0, q0=start[0], p0=start[1], save_every=0)
    end = s.q[-1][:N] + 1j * s.q[-1][N:]
    assert np.abs(end - phi * np.exp(-1j * w)).max() < 1e-9
    assert np.abs(end - phi * np.exp(1j * w)).max() > 0.1, "the control: the sign"
