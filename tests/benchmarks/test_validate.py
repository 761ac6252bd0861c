"""``validate`` on the examples and on correct steps; each claim has a control that must be contradicted."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numba
import numpy as np
import pytest

from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.times import runge_kutta
from phasebench.benchmarks.judge import judge
from support.evidence import verdicts
from support.steps import leapfrog, symplectic_euler

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SEPARABLE = ("separable",)


# -- the examples --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "contradicted"),
    [
        ("mislabelled_order.py", {"order"}),
        ("not_symplectic.py", {"symplectic"}),
        ("truncated_coefficients.py", {"consistent", "order"}),
        ("exchanged_kick.py", {"order"}),
        ("identity.py", {"consistent"}),
        ("keeps_state.py", {"stateless"}),
        ("changes_its_input.py", {"pure"}),
        ("raises.py", {"runs"}),
        ("euler_after_1500_calls.py", {"stateless", "symplectic", "reversible"}),
        ("symplectic_euler_after_1000_calls.py", {"stateless", "order"}),
        ("forgets_components.py", {"consistent", "order", "symplectic"}),
        ("wrong_above_three.py", {"order", "symplectic"}),
        ("dissipates_when_fast.py", {"consistent", "order", "symplectic"}),
        ("substeps_by_force.py", {"symplectic"}),
    ],
)
def test_an_example_that_is_wrong_is_caught(file, contradicted):
    found = certify(EXAMPLES / file, alone=True)
    assert found.verdict == "fail"
    assert {name for name, verdict in verdicts(found).items() if verdict == "contradicted"} == contradicted


@pytest.mark.parametrize("file", ["leapfrog.py", "forest_ruth.json", "adaptive.py", "package_adapter.py", "boris.py"])
def test_an_example_that_is_right_passes(file):
    found = certify(EXAMPLES / file, alone=True)
    assert found.verdict == "pass", found.summary()


def test_defect_that_may_be_round_off_is_not_judged():
    found = certify(EXAMPLES / "shrinks_slightly.py", alone=True)
    assert (verdicts(found)["symplectic"], found.verdict) == ("not judged", "not-judged")


def test_every_example_is_tested():
    named = {file for mark in test_an_example_that_is_right_passes.pytestmark for file in mark.args[1]}
    named |= {row[0] for mark in test_an_example_that_is_wrong_is_caught.pytestmark for row in mark.args[1]}
    named.add("shrinks_slightly.py")
    named.add("elsewhere_rows.py")  # no step: see test_elsewhere
    assert {p.name for p in EXAMPLES.iterdir() if p.suffix in (".py", ".json")} == named


# -- correct steps --------------------------------------------------------------------------------------------


def splitting(drifts, kicks):
    def step(system, q, p, h):
        for a, b in zip(drifts, kicks, strict=True):
            q = q + a * h * system.dH_dp(q, p)
            p = p - b * h * system.dH_dq(q, p)
        return q, p

    return step


#: Ruth 1983.
ruth = splitting((1, -2 / 3, 2 / 3), (-1 / 24, 3 / 4, 7 / 24))


def slopes(system, y):
    q, p = np.split(y, 2)
    return np.concatenate([system.dH_dp(q, p), -system.dH_dq(q, p)])


def fixed_point(equation, y):
    """The fixed point of a contraction, iterated from y."""
    last = np.inf
    for _ in range(100):
        new = equation(y)
        change = abs(new - y).max()
        y = new
        if change >= last or change == 0:
            return y
        last = change
    return y


NODES, WEIGHTS = (x / 2 for x in np.polynomial.legendre.leggauss(2))


def averaged_field(system, q, p, h):
    """The averaged vector field method for a polynomial H of degree 4, by two Gauss nodes."""
    y = np.concatenate([q, p])

    def equation(z):
        return y + h * sum(w * slopes(system, y + (c + 0.5) * (z - y)) for c, w in zip(NODES, WEIGHTS, strict=True))

    return np.split(fixed_point(equation, y), 2)


@numba.njit
def drift(x, h, v):
    """x + h v, compiled for arrays of doubles."""
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = x[i] + h * v[i]
    return out


def compiled_leapfrog(system, q, p, h):
    p = drift(p, -h / 2, system.dH_dq(q, p))
    q = drift(q, h, system.dH_dp(q, p))
    return q, drift(p, -h / 2, system.dH_dq(q, p))


WHOLE = {"symplectic": True, "symmetric": True, "reversible": True}
RIGHT = {
    "symplectic-euler": (symplectic_euler, SEPARABLE, {"order": 1, "symplectic": True, "symmetric": False}),
    "leapfrog": (leapfrog, SEPARABLE, {"order": 2, **WHOLE}),
    "ruth": (ruth, SEPARABLE, {"order": 3, "symplectic": True, "reversible": False}),
    "rk4": (runge_kutta, (), {"order": 4, "symplectic": False, "stability": 2.828}),
    "averaged": (
        averaged_field,
        ("polynomial degree",),
        {"order": 2, "energy": "preserved", "symplectic": False, "symmetric": True},
    ),
    "compiled-leapfrog": (compiled_leapfrog, SEPARABLE, {"order": 2, **WHOLE, "bilinear": "preserved"}),
}


#: Claims that are false of a correct step.
FALSE = [
    ("leapfrog", {"order": 3}),
    ("leapfrog", {"order": 1}),
    ("rk4", {"symplectic": True}),
    ("leapfrog", {"symplectic": False}),
    ("symplectic-euler", {"symmetric": True}),
    ("ruth", {"reversible": True}),
    ("rk4", {"energy": "bounded"}),
    ("leapfrog", {"energy": "preserved"}),
    ("leapfrog", {"energy": "drift"}),
    ("rk4", {"bilinear": "preserved"}),
    ("rk4", {"quadratic": "preserved"}),
    ("leapfrog", {"stability": 2.1}),
]


@cache
def certificate_of(name):
    """The certificate of a correct step, measured once for its true and false claims."""
    step, requires, claims = RIGHT[name]
    false = {key: value for of, one in FALSE if of == name for key, value in one.items()}
    return certify(step, false | claims, requires, alone=True)


def judgement(name, claims):
    """({claim: verdict}, overall verdict) for these claims on the measurements of a correct step."""
    found = judge.judgements(claims, certificate_of(name).tables)
    return {j.name: j.verdict for j in found}, judge.verdict(found)


@pytest.mark.parametrize("name", RIGHT)
def test_correct_step_passes(name):
    verdicts, whole = judgement(name, RIGHT[name][2])
    assert whole == "pass", verdicts
    assert bool(certificate_of(name).doubles) is (name == "compiled-leapfrog")


# -- controls of the claims -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "false"), FALSE)
def test_false_claim_alone_is_contradicted(name, false):
    verdicts, whole = judgement(name, false)
    assert {n for n, verdict in verdicts.items() if verdict == "contradicted"} == set(false), verdicts
    assert whole == "fail"
