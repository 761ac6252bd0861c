"""Integrators for a fast linear part: published formulas, exactness, symplecticity, resonances, round-off."""

from __future__ import annotations

import math
from functools import cache

import mpmath
import numpy as np
import pandas as pd
import pytest
import sympy as sp

from phasebench.benchmarks.measure.step_map import jacobian, symplecticity_defect
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.fpu import oscillatory_energies
from phasebench.benchmarks.studies import oscillatory
from phasebench.integrators import Hamiltonian
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, to_number
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.records.oscillatory import METHODS
from phasebench.integrators.registry import method
from phasebench.integrators.stepping import kernel

PAGE = oscillatory.STUDY.page

IDS = [m.id for m in METHODS]
TRIGONOMETRIC = [m.id for m in METHODS if m.id not in ("r-respa", "imex")]
OMEGA = 50.0


def sinc(x):
    """sin(x) / x of doubles."""
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


@cache
def fpu(**parameters):
    return problem("fpu", **parameters)


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
    s = integrate(system or fpu(), id, h=h, steps=1, q0=state[0], p0=state[1], parameters=parameters)
    return np.array([s.q[-1], s.p[-1]])


@pytest.mark.parametrize("id", TRIGONOMETRIC)
@pytest.mark.parametrize("x", [0.3, 2.0, 4.0, 7.5])
def test_a_step_equals_the_published_formula(id, x):
    """Hairer, Lubich & Wanner 2006, XIII (2.7)-(2.9), for cosines of both signs."""
    h, (q, p) = x / OMEGA, STATE
    xi = h * FREQUENCIES
    psi, phi = (f(xi) for f in PUBLISHED[id])
    psi1, c = psi / sinc(xi), np.cos(xi)
    g0 = slow(phi * q)
    q1 = c * q + h * sinc(xi) * p + h**2 / 2 * psi * g0
    p1 = -FREQUENCIES * np.sin(xi) * q + c * p + h / 2 * (c * psi1 * g0 + psi1 * slow(phi * q1))
    assert np.abs(step(id, h) - [q1, p1]).max() < 1e-13
    others = [i for i in TRIGONOMETRIC if i != id]
    assert min(np.abs(step(i, h) - [q1, p1]).max() for i in others) > 1e-9, "the control: another method's step"


def strang_step(flow, h):
    """Half a kick, the linear flow, half a kick."""
    q, p = STATE
    q, p = flow(q, p + h / 2 * slow(q))
    return np.array([q, p + h / 2 * slow(q)])


def exact_flow(h):
    """Exact flow of the linear part over h."""

    def flow(q, p):
        c, s = np.cos(h * FREQUENCIES), np.sin(h * FREQUENCIES)
        return c * q + h * sinc(h * FREQUENCIES) * p, c * p - FREQUENCIES * s * q

    return flow


def midpoint_flow(h):
    """Midpoint rule (I - h A / 2)^-1 (I + h A / 2) for the linear part."""
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [-np.diag(FREQUENCIES**2), np.zeros((6, 6))]]) * h / 2

    def flow(q, p):
        return np.linalg.solve(np.eye(12) - A, (np.eye(12) + A) @ np.concatenate([q, p])).reshape(2, 6)

    return flow


def verlet_flow(h, n):
    """n Stormer-Verlet steps of length h / n for the linear part."""

    def flow(q, p):
        for _ in range(n):
            p = p - h / n / 2 * FREQUENCIES**2 * q
            q = q + h / n * p
            p = p - h / n / 2 * FREQUENCIES**2 * q
        return q, p

    return flow


@pytest.mark.parametrize("x", [0.3, 2.5, 8.0])
def test_impulse_methods_kick_flow_and_kick(x):
    h = x / OMEGA
    flows = {
        "deuflhard": (exact_flow(h), {}),
        "imex": (midpoint_flow(h), {}),
        "r-respa": (verlet_flow(h, 10), {"substeps": 10}),
    }
    for id, (_, parameters) in flows.items():
        for other, (another, _) in flows.items():
            gap = np.abs(step(id, h, **parameters) - strang_step(another, h)).max()
            assert gap < 1e-12 if id == other else gap > 1e-8, (id, other)
    few = step("r-respa", h, substeps=3)
    assert np.abs(few - strang_step(verlet_flow(h, 3), h)).max() < 1e-9


@pytest.mark.parametrize("id", IDS)
def test_without_a_fast_part_methods_are_stormer_verlet(id):
    made = problem("henon-heiles")
    slow_only = Hamiltonian(q=made.system.q, p=made.system.p, H=made.system.H, frequencies=[0, 0])
    state = np.array(made.q0), np.array(made.p0)
    gap = np.abs(step(id, 0.3, slow_only, state) - step("stormer-verlet", 0.3, slow_only, state)).max()
    assert gap < 1e-15
    fast = np.abs(step(id, 0.3, made.system, state) - step("stormer-verlet", 0.3, slow_only, state)).max()
    assert fast > 1e-5, "the control: with the linear part declared fast it is not"


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("h", [0.1, 0.9, 3.1, 40.0])
def test_the_harmonic_oscillator_is_exact_for_any_step(id, h):
    found = problem("harmonic-oscillator")
    s = integrate(found, id, h=h, steps=200)
    error = max(np.abs(s.q[:, 0] - np.cos(s.t)).max(), np.abs(s.p[:, 0] + np.sin(s.t)).max())
    if id in TRIGONOMETRIC:
        assert error < 1e-12
    else:
        assert error > 1e-6, "the control: an approximate propagator"


def defect(id, system, state, h=0.6):
    """Largest violation of symplecticity in one step of a method."""

    def advance(y):
        return step(id, h, system, y.reshape(2, -1)).ravel()

    return symplecticity_defect(jacobian(advance, np.concatenate(state)))


@pytest.mark.parametrize("id", IDS)
def test_symplectic_if_and_only_if_the_filters_match(id):
    """With two frequencies if and only if psi = sinc phi; with one frequency always."""
    springs = defect(id, fpu(m=1, omega=5.0).system, ([0.7, 0.2], [0.5, 0.9]))
    equal = defect(id, problem("henon-heiles").system, ([0.1, 0.3], [0.2, -0.2]))
    assert equal < 1e-10
    assert springs < 1e-9 if method(id).symplectic else springs > 1e-3
    if id in PUBLISHED:
        x = np.linspace(0.1, 2.5, 7)
        psi, phi = (f(x) for f in PUBLISHED[id])
        assert method(id).symplectic == bool(np.allclose(psi, sinc(x) * phi))


def deviations(id, x, t_end):
    """(status, greatest errors of H and of the oscillatory energy I) of a method's run with h omega = x."""
    (row,) = oscillatory.errors(method(id), [x / math.pi], t_end)
    return row["status"], *(row.get(name, math.nan) for name in ("energy error", "oscillatory energy error"))


@pytest.mark.parametrize("id", [*IDS, "stormer-verlet"])
def test_stability_beyond_the_limit_of_stormer_verlet(id):
    """h omega = 2.5 > 2 up to t = 1000: 20,000 steps; initially I = 1, H = 2.0012."""
    status, H, energy = deviations(id, 2.5, 1000.0)
    if id == "stormer-verlet":
        assert status == "diverged"
        assert deviations(id, 1.0, 1000.0)[0] == "ok"
        return
    assert status == "ok"
    assert H < 0.2
    assert energy < 0.2


def test_the_impulse_method_resonates():
    """At h omega = pi and 2 pi; halfway to the next multiple both methods are good."""
    for k in (1, 2):
        wild, tame = (deviations(id, k * math.pi, 200.0)[1] for id in ("deuflhard", "mollified-impulse"))
        assert not wild < 10, wild
        assert tame < 0.5
    for id in ("deuflhard", "mollified-impulse"):
        assert deviations(id, 0.5 * math.pi, 200.0)[1] < 0.1


@pytest.mark.parametrize("id", ["gautschi", "hochbruck-lubich"])
def test_an_infinite_coefficient_is_refused_and_its_pole_named(id):
    for times in (1, 3):
        with pytest.raises(InvalidInput, match=rf"h omega is {times}\.0 pi, where the method's kick is infinite"):
            integrate(fpu(), id, h=times * math.pi / OMEGA, steps=1)
    assert integrate(fpu(), id, h=2 * math.pi / OMEGA, steps=1).status == "ok", "the control: an even multiple"


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("h", [0.1, 1.3])
def test_round_off_does_not_make_the_propagator_grow(id, h):
    """A million steps of the oscillator with omega = 3; r-respa conserves a modified energy."""
    found = problem("harmonic-oscillator", omega=3.0)
    s = integrate(found, id, h=h, steps=1_000_000, save_every=100)
    if id == "r-respa":
        z = (3.0 * h / 10) ** 2
        kept = s.p[:, 0] ** 2 + 9 * (1 - z / 4) * s.q[:, 0] ** 2
    else:
        kept = s.p[:, 0] ** 2 + 9 * s.q[:, 0] ** 2
    assert np.abs(kept / kept[0] - 1).max() < 1e-12


@pytest.mark.parametrize("turn", [0.0, math.pi])
def test_increments_are_compensated_on_both_branches(turn):
    """Rotations by 0.001 and pi + 0.001: the compensations must rotate too (otherwise the error is 1e-13)."""
    found = problem("harmonic-oscillator", omega=3.0)
    s = integrate(found, "deuflhard", h=(turn + 0.001) / 3, steps=1_000_000, save_every=100)
    kept = s.p[:, 0] ** 2 + 9 * s.q[:, 0] ** 2
    assert np.abs(kept / kept[0] - 1).max() < 1e-14


def test_coefficients_are_exact_where_the_sine_vanishes():
    """At the double nearest to h omega = 2 pi the sine loses 16 digits; omega = 50."""
    h = 2 * math.pi / OMEGA
    prepared = kernel.prepare(method("deuflhard"), fpu().system)
    found = prepared.begin(prepared.step._replace(h=h), *STATE).filters[3, -1]
    with mpmath.workdps(80):
        wanted = float(mpmath.sin(mpmath.mpf(h) * 50) / 50)
    assert abs(found / wanted - 1) < 1e-15
    assert abs(math.sin(h * OMEGA) / OMEGA / wanted - 1) > 1e-6, "the control: doubles"


@pytest.mark.parametrize("digits", [30, 60])
@pytest.mark.parametrize("x", [0.1, 1.5, 1.7, 3.0, 4.5])
def test_shears_give_the_rotation_to_all_digits(digits, x):
    """The cosine is s (1 - a b), where a b, its distance from 1 or -1, is at most 1."""
    with precision(digits):
        prepared = kernel.prepare(method("deuflhard"), fpu().system, MULTIPRECISION)
        h = to_number(x / OMEGA, MULTIPRECISION)
        _, _, a, b, s = prepared.begin(prepared.step._replace(h=h), *STATE).filters[:, -1]
        wanted = to_number(mpmath.cos(mpmath.mpf(x / OMEGA) * 50), MULTIPRECISION)
        assert abs(s * (1 - a * b) - wanted) < 10.0 ** (2 - digits)
        assert 0 <= a * b <= 1


def test_control_a_product_of_rounded_rotations_grows():
    c, s = math.cos(0.3), math.sin(0.3)
    q, p = 1.0, 0.0
    for _ in range(1_000_000):
        q, p = c * q + s / 3 * p, -3 * s * q + c * p
    assert abs((p * p + 9 * q * q) / 9 - 1) > 1e-11


@pytest.mark.parametrize("m", [1, 3, 4])
def test_the_problem_equals_the_published_one(m):
    made = fpu(m=m)
    x, y = 1.0, 1 / OMEGA
    soft = [x - y, *([-x - y] if m > 1 else []), *([x + y] if m == 1 else [])]
    values = [np.array([z]) for z in (made.q0, made.p0)]
    H = made.system.observe(made.system.H, *values)[0]
    assert pytest.approx(0.5 * 2 + 0.5 + sum(s**4 for s in soft) / 4, rel=1e-15) == H
    energies = oscillatory_energies(made)
    assert [made.system.observe(e, *values)[0] for e in energies] == [1.0] + [0.0] * (m - 1)
    rate = sum(sp.diff(sum(energies), v) * r for v, r in zip(made.system.p, made.system.dp, strict=True))
    rate += sum(sp.diff(sum(energies), v) * r for v, r in zip(made.system.q, made.system.dq, strict=True))
    assert sp.expand(rate) != 0, "the oscillatory energy is no exact invariant"


def test_bad_parameters_are_refused():
    for parameters in ({"omega": 0.0}, {"m": 0}, {"m": 1.5}, {"m": 10_000}):
        with pytest.raises(InvalidInput, match="must be"):
            problem("fpu", **parameters)
    for substeps in (0, 1.5):
        with pytest.raises(InvalidInput, match="substeps"):
            method("r-respa", substeps=substeps)
    with pytest.raises(InvalidInput, match="linear fast part"):
        integrate(problem("pendulum"), "imex", h=0.1, steps=1)


def test_the_verdict_of_the_page_follows_from_its_rows(tmp_path):
    both = [oscillatory.errors(method(id), [0.1, 0.5, 1.5], t_end=20.0) for id in ("hairer-lubich", "stormer-verlet")]
    rows = pd.DataFrame([*both[0], *both[1]])
    assert list(rows["status"]) == ["ok", "ok", "ok", "ok", "ok", "diverged"]
    assert rows["energy error"].isna().tolist() == [False] * 5 + [True]
    assert [(v.measured, v.outcome) for v in PAGE.judge(lambda name: rows)] == [(1, "pass")]
    assert PAGE.table(lambda name: rows).frame["where it is lost"].tolist() == ["", "above 0.5 π"]
    (picture,) = PAGE.figures(lambda name: rows, tmp_path)
    assert (tmp_path / picture.file).exists()
    worse = rows.assign(**{"energy error": rows["energy error"].where(rows["h omega / pi"] != 0.5, 30.0)})
    assert [(v.measured, v.outcome) for v in PAGE.judge(lambda name: worse)] == [(0, "finding")]
    assert PAGE.table(lambda name: worse).frame["where it is lost"].tolist() == [
        "at 1 other step",
        "above 0.1 π",
    ]
