"""Splittings and special kernels: masses, quadratic T, processors, modified kicks, a fast linear part, parts."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.measure.battery import variants
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput, SplitHamiltonian, integrate
from phasebench.integrators.coefficients import BY_NAME, GROUPS
from phasebench.integrators.compile import codegen
from phasebench.integrators.families import parametric, splitting
from phasebench.integrators.families.parts import flows
from phasebench.integrators.records import oscillatory, processed
from phasebench.integrators.registry import METHODS, method
from phasebench.integrators.stepping import kernel
from support.one_of_each import kinds
from support.solutions import last
from support.systems import chain, of_masses

# -- diagonal masses: the drift multiplies by numbers, with the same bits as with the function grad T -----------------


def end(system):
    q, p = np.linspace(0.3, 0.7, system.d), np.linspace(-0.2, 0.4, system.d)
    return last(integrate(system, "stormer-verlet", q0=q, p0=p, h=0.01, steps=200))


@pytest.mark.processor
@pytest.mark.parametrize("d", [2, codegen.TUPLE_LIMIT + 1])
def test_masses_and_grad_t_agree_bit_by_bit(d, monkeypatch):
    with_masses = end(chain(d))
    monkeypatch.setattr(Hamiltonian, "inverse_masses", None)
    system = chain(d)
    assert not isinstance(kernel.prepare(method("stormer-verlet"), system).step.dT, np.ndarray)
    np.testing.assert_array_equal(end(system), with_masses)


def test_control_another_mass_would_be_seen():
    others = chain(2, lambda p: of_masses(p) + p[-1] ** 2 / 10**9)
    assert np.any(end(others) != end(chain(2)))


@pytest.mark.parametrize("h", [1.0, 2.0])
def test_a_kick_of_length_1_is_not_special(h):
    """The last kick of a step is merged with the first of the next; a merged kick may have length 1."""
    s = integrate(Hamiltonian(q="q", p="p", H="p**2/2 + q**2/50"), "stormer-verlet", h=h, steps=2, q0=[0.3], p0=[0.2])
    q, p = 0.3, 0.2
    for _ in range(2):
        p -= h / 2 * q / 25
        q += h * p
        p -= h / 2 * q / 25
    assert [s.q[-1, 0], s.p[-1, 0]] == pytest.approx([q, p], abs=1e-15)


# -- quadratic T: the special kernels reach the states of the general one ---------------------------------------------

ROUND_OFF = 2e-13
ONE_STAGE = kinds(
    [method("scheme-i", lam="1/3"), *(m for m in variants() if m.family == "parametric" and m.data[0] == 1)]
)


class General(Hamiltonian):
    """A Hamiltonian that reports no structure, which forces the general kernel."""

    separable = False
    quadratic_kinetic = False


def full_mass():
    return Hamiltonian(q="q1 q2", p="p1 p2", H="p1**2 + p1*p2 + p2**2 + cos(q1)/3 + q1**2*q2**2/2 + q2**2/2")


SYSTEMS = {"henon-heiles": lambda: problem("henon-heiles").system, "full mass matrix": full_mass}
STARTS = {"henon-heiles": ([0.1, 0.3], [0.2, -0.1]), "full mass matrix": ([0.5, -0.3], [0.2, 0.4])}


def run(system, method, name, steps=40):
    q, p = STARTS[name]
    s = integrate(system, method, h=0.02, steps=steps, q0=q, p0=p)
    assert s.status == "ok"
    return np.hstack([s.q, s.p])


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("label", ONE_STAGE)
def test_the_special_kernel_equals_the_general_one(label, name):
    m, system = ONE_STAGE[label], SYSTEMS[name]()
    general = General(q=system.q, p=system.p, H=system.H, singular=system.singular)
    special, forced = kernel.prepare(m, system), kernel.prepare(m, general)
    assert forced.run is parametric.run
    assert forced.step.field is not None
    assert special.run is splitting.run or special.step.field is None, "the special form was not chosen"
    assert np.abs(run(system, m, name) - run(general, m, name)).max() < ROUND_OFF


def weights(lam, rounded=False):
    """Sums of the two weights in each substep of Scheme III, as exact fractions of the doubles.

    The weights are those prepared, or (``rounded``) 1 - lambda and lambda rounded independently.
    """
    step = kernel.prepare(method("scheme-iii", lam=lam), SYSTEMS["henon-heiles"]()).step
    pairs = zip(step.mu, step.lam, strict=True) if not rounded else [(float(1 - lam), float(lam))]
    return {Fraction(float(mu)) + Fraction(float(weight)) for mu, weight in pairs}


def test_weights_of_symplectic_substeps_add_up_to_one():
    """Otherwise the map would be symplectic to round-off only."""
    several = [Fraction(k, n) for n in (3, 7, 11, 1000) for k in (-5, -1, 1, 2, 9)]
    assert {total for lam in several for total in weights(lam)} == {1}
    assert {total for lam in several for total in weights(lam, rounded=True)} > {1}, "the control"


# -- processors -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", [t.name for t in GROUPS["processed"]])
def test_steps_between_rows_cost_the_kernel_alone(id):
    """A row costs the processor and its inverse; the last kick of a step is the first of the next."""
    kernel, pre = map(processed.letters, processed.parts_of(BY_NAME[id]))
    kernel, pre = processed.weights(kernel), processed.rows(pre)
    own = sum(b != 0 for b in kernel[1][1:])
    own += kernel[1][0] != 0 and kernel[1][-1] == 0
    row = 2 * sum(b != 0 for _, b in pre) + 2 * (kernel[1][0] != 0)
    pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    for every in (1, 5):
        s = integrate(pendulum, id, h=0.05, steps=20, q0=[1.3], p0=[0.4], save_every=every)
        assert s.counts["gradient"] == 20 * own + 20 // every * row


# -- modified kicks ---------------------------------------------------------------------------------------------------


def test_loops_without_a_formula_need_no_hessian():
    made = problem(str(Path(__file__).parents[2] / "examples" / "problems" / "chain.py"), N=30)
    ends = [
        integrate(made.system, "hessian-free-badab", h=h, t_end=1.0, q0=made.q0, p0=made.p0).q[-1]
        for h in (0.1, 0.05, 0.025)
    ]
    ratio = np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max()
    assert abs(np.log2(ratio) - 4) < 0.2
    with pytest.raises(InvalidInput, match="loops and no formula"):
        integrate(made.system, "chin-4a", h=0.1, t_end=1.0, q0=made.q0, p0=made.p0)


def trace_error(weight: float, h: float) -> float:
    """tr M - 2 cos h of a step drift, kick, drift on the oscillator whose kick is p - (h - 2 weight h^3) q."""
    drift, kick = np.array([[1.0, h / 2], [0.0, 1.0]]), np.array([[1.0, 0.0], [-(h - 2 * weight * h**3), 1.0]])
    return float(np.trace(drift @ kick @ drift) - 2 * np.cos(h))


def test_takahashi_imada_has_effective_order_four():
    """A trace does not change under conjugation: the order of its error less two is that of the best conjugate."""
    weight = float(next(m for m in METHODS if m.id == "takahashi-imada").data[0][1][2])
    orders = [np.log2(trace_error(w, 0.2) / trace_error(w, 0.1)) for w in (weight, 1.001 * weight)]
    assert orders[0] == pytest.approx(6, abs=0.05)
    assert orders[1] < 5.5, "the control"
    made = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
    first, second = (integrate(made, "takahashi-imada", h=0.2, steps=1, q0=[q], p0=[1 - q]) for q in (1.0, 0.0))
    assert first.q[-1, 0] + second.p[-1, 0] - 2 * np.cos(0.2) == pytest.approx(trace_error(weight, 0.2), rel=1e-6)


# -- a fast linear part: published formulas, exactness, poles, round-off -----------------------------------------------


TRIGONOMETRIC = [m.id for m in oscillatory.METHODS if m.id not in ("r-respa", "imex")]
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


# -- parts with exact flows --------------------------------------------------------------------------------------------


#: Parts of every kind; among the monomials a = b, a > b, a < b, a negative power, and c a function of variables.
KINDS = (
    "p2**2/2 + p1**3/9",
    "sin(q1)*exp(q2)/3",
    "p2**2/(2*q1**2)",
    "(q1**2 - p1**2)/3 + p2**4",
    "-p1**2/q1",
    "q1*p1*(1 + sin(q2))/5",
    "q1**3*p1/5",
    "q1**2*p1**2*q2/3",
    "p1/q1**2*exp(p2)",
    "q1*p1*3/4 + q2*p2**2/7",
)
Q, P = (0.7, 0.4), (0.3, -0.6)


def split(*parts: str, **more) -> SplitHamiltonian:
    return SplitHamiltonian(q="q1 q2", p="p1 p2", parts=parts, **more)


@pytest.mark.parametrize("part", KINDS)
def test_a_derived_flow_is_that_of_its_part(part):
    dq, dp = split(part, "p2**2").part_flow(0)(Q, P, 0.3)
    alone = Hamiltonian(q="q1 q2", p="p1 p2", H=part)
    s = integrate(alone, "gauss-8", h=0.01, steps=30, q0=list(Q), p0=list(P))
    moved = np.array([*Q, *P]) + [*dq, *dp]
    assert np.abs(moved - [*s.q[-1], *s.p[-1]]).max() < 1e-15 * 5
    far = np.array([*Q, *P]) + np.concatenate(split(part, "p2**2").part_flow(0)(Q, P, 0.31))
    assert np.abs(far - moved).max() > 1e-4, "the control: another time"


def test_a_small_change_loses_no_digits():
    """The exact changes of r and p by -p^2/r over a short time, in 50 digits."""
    system = SplitHamiltonian(q="r", p="p", parts=["-p**2/r", "p**2/2"])
    with mpmath.workdps(50):
        r, p, t = mpmath.mpf(7.5), mpmath.mpf(0.3), mpmath.mpf(2.0**-30)
        u = 1 - 3 * t * p / r**2
        exact = r * (mpmath.cbrt(u) ** 2 - 1), p * (mpmath.cbrt(u) - 1)
    (dr,), (dp,) = system.part_flow(0)((7.5,), (0.3,), 2.0**-30)
    assert dr == pytest.approx(float(exact[0]), rel=1e-15)
    assert dp == pytest.approx(float(exact[1]), rel=1e-15)


@pytest.mark.parametrize(
    "part",
    ["(1 - 2/q1)*p1**2/2", "q1*p1*q2*p2", "p1**2*q1**(1/2)", "p1**2/2 + q1**4"],
)
def test_a_part_without_a_known_flow_is_named(part):
    with pytest.raises(InvalidInput) as told:
        split(part, "p2**2")
    assert f"'{part}'" in str(told.value)
    assert "split it further" in str(told.value)


# -- the methods -------------------------------------------------------------------------------------------------------


def test_neighbours_of_one_part_are_one():
    assert flows([(1, 0, 1), (2, 1, 0)], 3) == ([0, 1, 2, 1, 0], [1, 1, 3, 2, 2])
    assert flows([(1, 1, 0), (2, 0, 1)], 3) == ([2, 1, 0, 1, 2], [1, 1, 3, 2, 2])


def test_two_parts_are_a_splitting():
    made = SplitHamiltonian(q="q", p="p", parts=["-cos(q)", "p**2/2"])
    pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
    for id, own in (("abc-4", "blanes-moan-s6"), ("abc-6", "blanes-moan-s10")):
        a, b = (integrate(x, m, h=0.3, steps=40, q0=[1.0], p0=[0.5]) for x, m in ((made, id), (pendulum, own)))
        assert np.abs(a.q - b.q).max() < 2e-14


# -- problems ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parameters", "said"),
    [
        ("kerr", {"a": 1.5}, "the spin a is 1.5"),
        ("kerr", {"E": 0.5}, "no orbit passes r = 11"),
        ("magnetized-schwarzschild", {"L": 50.0}, "no orbit passes r = 11"),
    ],
)
def test_bad_parameters(name, parameters, said):
    with pytest.raises(InvalidInput, match=said):
        problem(name, **parameters)


def test_parts_on_the_command_line():
    H, parts = "p1**2/2 - p1**2/q1 + p2**2/(2*q1**2) - 1/q1", ("p1**2/2", "-p1**2/q1", "p2**2/(2*q1**2) - 1/q1")
    start = ["--q", "10,0", "--p", "0,4", "--h", "1", "--steps", "5"]
    words = ["integrate", "abc-2", "--hamiltonian", H, *start, "--json"]
    told = CliRunner().invoke(app, [*words, *(w for part in parts for w in ("--part", part))])
    assert json.loads(told.stdout)["status"] == "ok"
    fewer = json.loads(CliRunner().invoke(app, [*words, "--part", parts[0], "--part", parts[2]]).stdout)
    assert fewer["reason"] == "the parts do not add up to H: -p1**2/q1 is left"
    both = json.loads(CliRunner().invoke(app, [*words, "--part", parts[0], "--constraint", "q1 = 10"]).stdout)
    assert both["reason"] == "constraints and parts are given; a system has the one or the other"


@pytest.mark.parametrize("name", ["t", "lambda_"])
def test_a_coordinate_may_have_any_name(name):
    """The result does not depend on the name, also where a formula has symbols of its own: a flow's time, lambda."""
    ends = []
    for q in ("x", name):
        split = SplitHamiltonian(q=q, p="u", parts=["u**2/2", f"{q}**2/2 + {q}**4"])
        mixed = Hamiltonian(q=q, p="u", H=f"u**2/2 + {q}**2/2 + {q}**4*u**2/9")
        runs = [(split, "abc-2"), (mixed, "generating-function")]
        ends.append([integrate(s, id, h=0.1, steps=10, q0=[1.0], p0=[0.3]).q[-1, 0] for s, id in runs])
    assert ends[0] == pytest.approx(ends[1], rel=1e-14)
