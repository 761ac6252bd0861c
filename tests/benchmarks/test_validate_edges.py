"""``validate`` on right steps that fail far from what is claimed, and on wrong ones whose numbers are not finite."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import phasebench as pb
from phasebench.benchmarks.certificate import adaptive, battery, behaviour, conservation
from phasebench.benchmarks.certificate.stepping import StepFailed
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.checks import CHECKS, checked_claims
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.measure import coefficients
from phasebench.benchmarks.measure.own_step import System
from phasebench.integrators.errors import InvalidInput
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
