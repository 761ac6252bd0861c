"""Semi-discretized wave equations with handwritten loops, against the formula, the equation and their invariants."""

from __future__ import annotations

import cmath
from itertools import pairwise
from math import cosh, pi, sqrt

import numba
import numpy as np
import pytest

from phasebench.benchmarks.problems import klein_gordon, nls, problem
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number, vector
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.systems.hamiltonian import Hamiltonian
from phasebench.integrators.systems.hand import HandHamiltonian, uncompiled_loop
from phasebench.integrators.values import vector as arrays
from support.values import value

MODULES = {"nls": nls, "klein-gordon": klein_gordon}
SMALL, LENGTH = 4, 5.0
ROUND_OFF = 1e-13


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


def from_formula(system, q, p):
    """(H_p, -H_q, H, M) at (q, p) from the formula of H; M is the scale of its round-off eps M."""
    y = value(*q), value(*p)
    dq, dp = system.field()(*y, 0.0, 0.0)
    return np.array(dq), np.array(dp), *system.energy()(*y)


# -- the loops ---------------------------------------------------------------------------------------------------------


def test_loops_equal_the_formula_on_four_points(name, small):
    for seed in range(3):
        q, p = state(small.d, seed)
        dq, dp, H, M = from_formula(small, q, p)
        ours = loop(name, "field", SMALL)(q, p, 0.0, 0.0)
        assert np.abs(ours[0] - dq).max() < 1e-13 * np.abs(dq).max()
        assert np.abs(ours[1] - dp).max() < 1e-13 * np.abs(dp).max()
        assert loop(name, "energy", SMALL)(q, p) == pytest.approx((H, M), rel=1e-13)
        if name == "klein-gordon":
            assert np.abs(loop(name, "grad_V", SMALL)(q) + dp).max() < 1e-13 * np.abs(dp).max()


def test_control_loops_with_another_spacing_differ(name, small):
    q, p = state(small.d)
    _, dp, H, M = from_formula(small, q, p)
    assert np.abs(loop(name, "field", SMALL + 1)(q, p, 0.0, 0.0)[1] - dp).max() > 1e-2
    found = loop(name, "energy", SMALL + 1)(q, p)
    assert abs(found[0] - H) > 1e-2
    assert abs(found[1] - M) > 1e-2


def test_loops_run_in_multiprecision(name, small):
    """Against the formula at 40 digits: neither a loop nor its constants contain doubles."""
    with precision(40):
        q, p = (vector(row) / 3 for row in state(small.d))
        theirs = small.field(MULTIPRECISION)(q, p, 0, 0)
        ours = loop(name, "field", SMALL, MULTIPRECISION)(q, p, 0, 0)
        assert max(abs(a - b) for x, y in zip(ours, theirs, strict=True) for a, b in zip(x, y, strict=True)) < 1e-37
        pairs = loop(name, "energy", SMALL, MULTIPRECISION)(q, p), small.energy(MULTIPRECISION)(q, p)
        assert all(abs(a - b) < 1e-37 * abs(b) for a, b in zip(*pairs, strict=True))


def test_traits_are_those_of_the_formula(name, small):
    large = problem(name, N=32).system
    assert isinstance(large, HandHamiltonian)
    assert large.traits == small.traits | {"elementary derivatives": False}, "stages are in lanes for formulae alone"
    assert large.unit_mass == small.unit_mass


def test_compiled_and_plain_loops_agree(name):
    system = problem(name, N=32, L=LENGTH).system
    q, p = state(system.d)
    kinds = {"field": (q, p, 0.0, 0.0), "energy": (q, p)}
    for function, arguments in kinds.items():
        ours = np.hstack([*getattr(system, function)()(*arguments)])
        plain = np.hstack([*loop(name, function, 32)(*arguments)])
        assert np.abs(ours - plain).max() < 1e-13 * np.abs(plain).max()


def test_run_derives_no_formula(name):
    made = problem(name)
    assert made.system.d >= 64
    s = integrate(made, "implicit-midpoint", h=0.01, steps=3)
    assert s.status == "ok"
    assert not {"dq", "dp"} & set(vars(made.system))
    assert len(made.system.dq) == made.system.d, "it is on demand"


def test_values_along_rows(name):
    made = problem(name, N=32)
    system = made.system
    Q, P = np.random.default_rng(1).normal(size=(2, 5, system.d))
    by_formula = Hamiltonian.observe(system, system.H, Q, P)
    assert system.observe(system.H, Q, P) == pytest.approx(by_formula, rel=1e-13)
    assert np.array_equal(system.observe(lambda Q, P: Q[:, 0] - P[:, 1], Q, P), Q[:, 0] - P[:, 1])


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


# -- invariants --------------------------------------------------------------------------------------------------------


def errors(name, method, **parameters):
    """Largest relative errors of the energy and of the quadratic invariant."""
    made = problem(name, N=32)
    s = integrate(made, method, h=0.05, steps=200, parameters=parameters)
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    (invariant,) = made.invariants.values()
    values = (made.system.observe(e, s.q, s.p) for e in (made.system.H, invariant))
    return [np.abs(v - v[0]).max() / abs(v[0]) for v in values]


@pytest.mark.parametrize(
    ("method", "parameters", "energy", "mass", "charge"),
    [
        ("implicit-midpoint", {}, False, True, True),
        ("scheme-i", {"lam": "1/2"}, False, True, True),
        ("scheme-i", {"lam": "1/3"}, False, False, True),
        ("scheme-iii", {"lam": "1/3"}, False, False, True),
        ("symplectic-euler-q", {}, False, False, True),
        pytest.param("avf", {}, True, False, False, marks=pytest.mark.thorough),
        ("rk4", {}, False, False, False),
    ],
    ids=lambda x: str(x),
)
def test_invariants_preserved_by_each_method(method, parameters, energy, mass, charge):
    """Scheme I preserves q.D p for every lambda and q.q + p.p at 1/2 only; AVF preserves the energy alone."""
    for name, kept in (("nls", mass), ("klein-gordon", charge)):
        errors_here = errors(name, method, **parameters)
        for error, holds in zip(errors_here, (energy, kept), strict=True):
            assert error < ROUND_OFF if holds else error > 1e3 * ROUND_OFF, (name, errors_here)


# -- operations on arrays ----------------------------------------------------------------------------------------------


def test_compiled_array_operations():
    """The compensated sum agrees bit for bit, norms up to rounding, NaN stays NaN."""
    x, c, dx = np.random.default_rng(5).normal(size=(3, 77)) * np.array([[1.0], [1e-17], [1e-3]])

    @numba.njit(**arrays.ARRAYS)
    def compiled(x, c, dx):
        return arrays.add(x, c, dx), arrays.size(x), arrays.distance(x, dx)

    (total, lost), length, gap = compiled(x, c, dx)
    wanted, rest = arrays.add(x, c, dx)
    assert np.array_equal(total, wanted)
    assert np.array_equal(lost, rest)
    assert np.abs(lost).max() > 0
    assert length == pytest.approx(np.abs(x).sum(), rel=1e-14)
    assert gap == pytest.approx(np.abs(x - dx).sum(), rel=1e-14)
    x[40] = np.nan
    assert np.isnan(compiled(x, c, dx)[1:]).all()
