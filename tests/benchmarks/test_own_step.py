"""Steps of one's own: what they may return, what is refused, and ``validate`` on steps far from what is claimed."""

from __future__ import annotations

import pickle
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import phasebench as pb
from phasebench.benchmarks.certificate import adaptive, battery, behaviour, certificate, conservation
from phasebench.benchmarks.certificate.battery import Entry
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.checks import CHECKS, checked_claims
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS
from phasebench.benchmarks.measure import coefficients, own_step
from phasebench.benchmarks.measure.battery import relativistic_particle
from phasebench.benchmarks.measure.own_step import System
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION, precision
from phasebench.integrators.errors import InvalidInput
from support.evidence import verdicts
from support.steps import leapfrog


def oscillator(omega: float):
    """The problem H = p^2 / 2 + omega^2 q^2 / 2, started at (1, omega)."""
    system = pb.Hamiltonian(q="q", p="p", H=f"p**2/2 + {omega**2}*q**2/2")
    return pb.Problem(id="osc", name="o", source="me", system=system, orbits=(pb.Orbit("start", (1.0,), (omega,)),))


def dop853(system, q, p, t_end, tol):
    d = len(q)

    def f(t, y):
        return np.concatenate([system.dH_dp(y[:d], y[d:]), -system.dH_dq(y[:d], y[d:])])

    y = solve_ivp(f, (0, t_end), np.concatenate([q, p]), method="DOP853", rtol=max(tol, 3e-14), atol=tol).y[:, -1]
    return y[:d], y[d:]


# -- steps that are refused or fail -----------------------------------------------------------------------------------


class NotConverged(ArithmeticError):
    """The error of a user's own solver."""


def refuses(error):
    """A leapfrog that raises this error at steps above 1/2."""

    def step(system, q, p, h):
        if abs(h) > 0.5:
            raise error("h is too large")
        return leapfrog(system, q, p, h)

    return step


def test_a_refusal_of_long_steps_leaves_the_stability_unmeasured():
    """A bug is told where it is claimed; a failure of the numbers leaves the claim open."""
    for error, claims in ((ValueError, {}), (NotConverged, {}), (NotConverged, {"stability": 2.0})):
        row = behaviour.stability(subject(refuses(error), claims, ("separable",)))
        assert "limit" not in row
        assert "h is too large" in row["reason"]
    assert behaviour.stability(subject(leapfrog, {}, ("separable",)))["limit"] == pytest.approx(2.0)
    with pytest.raises(StepFailed, match="ValueError: h is too large"):
        behaviour.stability(subject(refuses(ValueError), {"stability": 2.0}, ("separable",)))


# -- what is a step, and what it says of itself -----------------------------------------------------------------------


def test_a_step_with_an_optional_tolerance_is_a_step():
    assert not subject(lambda system, q, p, h, tol=1e-15: (q, p)).adaptive
    assert subject(dop853).adaptive
    assert subject(lambda system, q, p, T, tol: (q, p)).adaptive
    assert subject(lambda system, q, p, t_end, tol=1e-6: (q, p)).adaptive


# -- numbers that are not finite --------------------------------------------------------------------------------------


def test_an_energy_that_overflows_is_not_preserved():
    def explodes(system, q, p, h):
        a, b = system.dH_dp(q, p), -system.dH_dq(q, p)
        return q + h * a + 5 * h * h * q, p + h * b + 5 * h * h * p

    entry = battery.of_problem(oscillator(0.9))
    row = conservation.long_run(subject(explodes), entry, 0)
    assert row["status"] == "diverged"
    assert CHECKS["energy"].judge("preserved", Tables({"long": [row]})).verdict != "holds"


def test_results_that_are_no_numbers_contradict_a_tolerance():
    def breaks(system, q, p, t_end, tol):
        q, p = dop853(system, q, p, t_end, tol)
        return (q * np.nan, p) if 5e-7 < tol < 5e-6 else (q, p)

    entry = battery.entries()[0]
    for run, expected in ((dop853, "holds"), (breaks, "contradicted")):
        row = adaptive.tolerances(subject(run), entry, 0)
        assert CHECKS["tolerance"].judge(1e6, Tables({"tolerance": [row]})).verdict == expected


@pytest.mark.parametrize("which", [0, 1], ids=["q", "p"])
def test_an_adaptive_run_that_changes_what_it_was_given_is_found(which):
    def changes(system, q, p, t_end, tol):
        state = dop853(system, q, p, t_end, tol)
        (q, p)[which][0] += 1e-3
        return state

    entry = battery.entries()[0]
    assert adaptive.end(subject(dop853), entry, entry.start(0), 1e-4)[1] > 0
    with pytest.raises(adaptive.InputChanged):
        adaptive.end(subject(changes), entry, entry.start(0), 1e-4)


# -- the problem of one's own -----------------------------------------------------------------------------------------


def test_an_adaptive_run_is_measured_in_the_problems_own_time():
    row = adaptive.tolerances(subject(dop853), battery.of_problem(oscillator(200.0)), 0)
    assert row["errors"][-1] < 1e-8 < row["errors"][0]


# -- files of coefficients --------------------------------------------------------------------------------------------


def test_claims_of_a_file_are_numbers_and_its_coefficients_exact(tmp_path):
    file = tmp_path / "leapfrog.json"
    file.write_text('{"a": [0.1, 0.9], "b": [1], "claims": {"stability": 2.5, "order": 2}}')
    own = coefficients.from_file(str(file))
    assert own.claims == {"stability": 2.5, "order": 2}
    q, _ = own.step(System(pb.Hamiltonian(q="q", p="p", H="p**2/2")), np.zeros(1), np.ones(1), 1.0)
    assert q == [1.0]
    free = SimpleNamespace(dH_dq=lambda q, p: 0 * q, dH_dp=lambda q, p: p)
    zero, one = (np.array([Fraction(n)]) for n in (0, 1))
    assert own.step(free, zero, one, Fraction(1))[0] == [Fraction(1)]


@pytest.mark.parametrize("limit", [10**400, float("nan"), 0.0])
def test_a_claim_beyond_the_doubles_is_refused(limit):
    with pytest.raises(InvalidInput, match=r"stability = .*positive number"):
        checked_claims({"stability": limit}, "claims")


@pytest.mark.parametrize("requires", ["null", "[1]"])
def test_requirements_that_are_no_names_are_refused(tmp_path, requires):
    file = tmp_path / "mine.json"
    file.write_text(f'{{"a": [1], "b": [1], "requires": {requires}}}')
    with pytest.raises(InvalidInput, match=r"requires is .*name traits"):
        coefficients.from_file(str(file))


# -- a step of one's own -----------------------------------------------------------------------------------------------


HENON = problem("henon-heiles:box")
HERE = Entry("here", problem("harmonic-oscillator").system, (1.0, 0.0))


def ran(step, **more):
    """The solution of five steps of the user's function on the Henon-Heiles problem."""
    return own_step.integrate_step(HENON, own_step.from_function(step), h=0.1, steps=5, **more)


@pytest.mark.parametrize("made", [tuple, np.array])
def test_step_may_return_any_pair_of_arrays(made):
    found = ran(lambda system, q, p, h: made([q + 1, p]))
    assert np.array_equal(found.q[-1], np.add(HENON.q0, 5))
    assert len(found.t) == 6


# -- a step as a map of states ----------------------------------------------------------------------------------------


def stepper(step, arithmetic=DOUBLE):
    return Stepper(subject(step, {}, ("separable",)), HERE, arithmetic)


def test_doubles_from_a_multiprecision_step_are_refused():
    with precision(40):
        made = stepper(lambda system, q, p, h: (q, [0.5]), MULTIPRECISION)
        with pytest.raises(StepFailed, match="it returned float, mpfr where it was given numbers of many digits"):
            made(made.state(HERE.state), 0.1)


def test_exception_names_the_step_and_its_first_line():
    def raising(system, q, p, h):
        if made.taken == 3:
            raise ValueError("one\ntwo")
        return q, p

    made = stepper(raising)
    with pytest.raises(StepFailed, match=r"^step 3 on here: .*ValueError: one$"):
        made.run(HERE.state, 0.1, 9)


def test_arguments_in_another_order_are_refused():
    for step in (lambda q, p, h, system: (q, p), lambda system, p, q, h: (q, p)):
        with pytest.raises(InvalidInput, match=r"called \(system, q, p, h\)"):
            own_step.from_function(step)
    for step in (lambda system, q, p, dt: (q, p), lambda system, x, v, h: (x, v)):
        assert own_step.from_function(step).step is step


def test_step_of_a_file_travels_by_its_path_and_asks_for_a_canonical_system(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def step(system, q, p, h):\n    return q, p\n")
    made = own_step.from_file(file)
    file.write_text("def step(system, q, p, h):\n    return q + h, p\n")
    assert pickle.loads(pickle.dumps(made)).step(None, 0.0, 0.0, 1.0) == (1.0, 0.0), "the receiver reads the file"
    assert made.lacks(HENON.system) is None
    assert "canonical" in made.lacks(problem("lotka-volterra").system)


# -- steps of charged particles ----------------------------------------------------------------------------------------


BORIS = str(Path(__file__).parents[2] / "examples" / "boris.py")


def drift_only(system, x, v, h):
    return x + h * v, v


def trapezoid(system, x, v, h):
    """The explicit trapezoidal rule, of order 2: it keeps neither volume nor the two-form."""
    a = system.E(x) + np.cross(v, system.B(x))
    y, w = x + h * v, v + h * a
    return x + h / 2 * (v + w), v + h / 2 * (a + system.E(y) + np.cross(w, system.B(y)))


def midpoint(system, q, p, h):
    """The implicit midpoint rule in (q, p), iterated: symplectic."""
    a, b = q, p
    for _ in range(60):
        x, y = (q + a) / 2, (p + b) / 2
        a, b = q + h * system.dH_dp(x, y), p - h * system.dH_dq(x, y)
    return a, b


def in_place(system, x, v, h):
    v += h * (system.E(x) + np.cross(v, system.B(x)))
    return x + h * v, v


def own(step, *requires) -> own_step.OwnStep:
    return own_step.OwnStep(step.__name__, step, {}, requires or ("magnetic",))


@pytest.mark.parametrize(
    ("name", "velocity", "E", "B"),
    [
        ("charged-particle", [0.1, 0.01, 0.0], [0.0, -0.01, 0.0], [0.0, 0.0, 1.0]),
        ("magnetic-mirror", [0.0, 0.3, 0.2], [0.0, 0.0, 0.0], None),
    ],
)
def test_the_fields_are_those_of_the_particle_in_three_components(name, velocity, E, B):
    whole = problem(name)
    seen = own_step.System(whole.system).particle
    x, v = seen.state(np.array(whole.q0), np.array(whole.p0))
    assert v == pytest.approx(velocity, abs=1e-16)
    assert seen.E(x) == pytest.approx(E, abs=1e-17)
    if B is not None:
        assert seen.B(x).tolist() == B
    else:
        assert seen.B([1.0, 2.0, 5.0]) == pytest.approx([-0.05, -0.1, 1.25], rel=1e-15)
    assert seen.evaluations == [1, 1]
    assert seen.momentum(x, v) == pytest.approx(whole.p0, abs=1e-16)
    assert seen.H(x, v) == pytest.approx(whole.system.energies([whole.q0], [whole.p0])[0], rel=1e-15)


@pytest.mark.parametrize(
    ("step", "claims", "contradicted"),
    [
        (BORIS, {"symplectic": True}, {"symplectic"}),  # that a step keeps volume does not make it symplectic
        (trapezoid, {"order": 2, "volume": True}, {"volume"}),
        (trapezoid, {"volume": False}, set()),
        (midpoint, {"symplectic": True, "volume": True}, set()),
        (drift_only, {"volume": True}, {"consistent"}),
        (in_place, {}, {"pure"}),
    ],
)
def test_certificates_of_steps_of_charged_particles(step, claims, contradicted):
    found = verdicts(certificate.certify(step, claims, ("magnetic",), alone=True))
    assert {name for name, verdict in found.items() if verdict == CONTRADICTED} == contradicted
    assert contradicted & {"consistent", "pure"} or {v for k, v in found.items() if k not in contradicted} == {HOLDS}


STEP = "def step(system, x, v, h):\n    return x, v\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("REQUIRES = ('magnetics',)\n" + STEP, r"magnetics.*did you mean magnetic"),
        (STEP.replace("x, v\n", "x, system.E(x)\n"), r"line 2.*REQUIRES = \('magnetic',\)"),
        ("REQUIRES = 'magnetic'\n" + STEP.replace("x, v\n", "x[:2], v\n"), "shape"),
    ],
)
def test_a_wrong_file_gets_its_error(tmp_path, text, said):
    file = tmp_path / "mine.py"
    file.write_text(text)
    with pytest.raises(InvalidInput, match=said):
        pb.integrate("magnetic-mirror", str(file), h=0.1, steps=1)


def test_systems_without_such_a_field_are_refused():
    with pytest.raises(InvalidInput, match=r"requires a system with the trait 'magnetic', which this one lacks"):
        pb.integrate("kepler", BORIS, h=0.1, steps=1)
    with pytest.raises(InvalidInput, match="must not change"):
        own_step.integrate_step(problem("magnetic-mirror"), own(in_place), h=0.1, steps=2)
    start = {"q0": (0.3, -0.5, 0.4), "p0": (0.4, 0.6, -0.3)}
    with pytest.raises(InvalidInput, match="not relativistic, and this one is relativistic"):
        own_step.integrate_step(relativistic_particle(), own(trapezoid), h=0.1, steps=1, **start)
