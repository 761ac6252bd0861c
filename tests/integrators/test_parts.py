"""Hamiltonians of parts with exact flows, and splitting methods through all of them."""

from __future__ import annotations

import json

import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput, SplitHamiltonian, integrate
from phasebench.integrators.families.parts import flows

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
