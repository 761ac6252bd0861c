"""``validate`` on steps that are wrong in ranges of h, sizes or degrees of freedom, in doubles or single precision."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from phasebench.benchmarks.certificate import battery, behaviour, scaled
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.render import unseen
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import EPS
from phasebench.benchmarks.judge.requirements import below
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.coefficients import own_step
from phasebench.benchmarks.measure.own_step import from_function
from phasebench.integrators.errors import InvalidInput
from support.evidence import verdicts
from support.steps import leapfrog

SEPARABLE = ("separable",)
TAO, COUPLED, RING = (battery.find_entry(name) for name in ("tao", "coupled", "ring"))
FEW = tuple(battery.find_entry(name) for name in ("pendulum", "henon-heiles", "tao"))


@pytest.fixture(autouse=True)
def few_systems(monkeypatch):
    """Certify on three systems, which takes a third of the time."""
    monkeypatch.setattr(battery, "entries", lambda: FEW)


def symplectic_euler(system, q, p, h):
    p = p - h * system.dH_dq(q, p)
    return q + h * system.dH_dp(q, p), p


def dissipating(system, q, p, h):
    q, p = leapfrog(system, q, p, h)
    return q, p * (1 - 1e-6 * h)


def substeps(system, q, p, h):
    n = int(np.ceil(min(abs(h), 20.0) / 0.1))
    for _ in range(n):
        q, p = leapfrog(system, q, p, h / n)
    return q, p


def where(test, bad=symplectic_euler):
    """The leapfrog, and another step where ``test(q, p, h)``."""
    return lambda system, q, p, h: (bad if test(q, p, h) else leapfrog)(system, q, p, h)


def swept(step, requires=SEPARABLE, seed=0):
    """(whether a sweep shows that the order is below 2, names of the broken structures)."""
    chosen = subject(step, {}, requires)
    entries = [e for e in battery.entries() if chosen.lacks(e.system) is None]
    rows, broken, reach = scaled.sweep(chosen, entries, seed, ("symplectic", "symmetric"))
    assert reach["steps"] > 100
    return any(below(r, 2) for r in rows), set(broken)


# -- other units ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("step", "found"),
    [
        (leapfrog, (False, set())),
        (substeps, (False, set())),
        (where(lambda q, p, h: len(q) == 7), (True, {"symmetric"})),
        (where(lambda q, p, h: h > 0.55), (True, {"symmetric"})),
        (where(lambda q, p, h: 0.27 < h < 0.45), (True, {"symmetric"})),
        (where(lambda q, p, h: 0.11 < h < 0.14), (True, {"symmetric"})),
        (where(lambda q, p, h: q[0] < -9), (True, {"symmetric"})),
        (where(lambda q, p, h: abs(p).max() > 200), (True, {"symmetric"})),
        (where(lambda q, p, h: h > 3, dissipating), (True, {"symplectic", "symmetric"})),
    ],
)
def test_other_units_find_another_step(step, found):
    assert swept(step) == found


def test_units_are_those_of_the_same_motion():
    """On a system that is not separable, and on it beside another."""
    chosen = subject(lambda system, q, p, h: (q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)))
    for entries in ((TAO,), (TAO, COUPLED, TAO)):
        d = sum(e.system.d for e in entries)
        units = scaled.Units(entries, 3.0, np.full(d, -2.5), np.full(d, -40.0))
        stepper, y = scaled._stepper(chosen, units, 0)
        slope = TAO.system.vector_field()(0.0, TAO.start(0))
        moved = (stepper(y, 0.125) - y) / 0.125
        assert moved[[0, d]] == pytest.approx(slope)
        assert stepper.system.H(y[:d] * -2.5, y[d:] * -40.0) == pytest.approx(
            100 / 3 * sum(battery._energy(e.system, e.start(0)) for e in entries)
        )


def test_step_that_does_not_end_in_other_units_is_left():
    def endless(system, q, p, h):
        while abs(q).max() > 100:
            system.dH_dq(q, p)
        return leapfrog(system, q, p, h)

    assert swept(endless) == (False, set())


def test_units_are_told_on_the_certificate():
    found = certify(where(lambda q, p, h: h > 0.55), {"order": 2}, SEPARABLE, alone=True)
    assert verdicts(found)["order"] == CONTRADICTED
    assert str(found.tables.of("reach")[0]["steps"]) in unseen(found)


# -- buffers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3])
def test_buffers_that_are_used_again_are_found(n):
    buffers, calls = {}, [0]

    def step(system, q, p, h):
        calls[0] += 1
        kept = buffers.setdefault((calls[0] % n, len(q), q.dtype), np.empty(2 * len(q), q.dtype))
        kept[:] = np.concatenate(leapfrog(system, q, p, h))
        return np.split(kept, 2)

    changed = [behaviour.input_changed(subject(s), [FEW[0]], 0)[0]["later"] for s in (step, leapfrog)]
    assert changed[0] > 0 == changed[1]


# -- single precision -------------------------------------------------------------------------------------------------


def single(step):
    """A step in single precision."""

    class Rounded:
        def __init__(self, system):
            self.system = system

        def dH_dq(self, q, p):
            return self.system.dH_dq(q, p).astype(np.float32)

        def dH_dp(self, q, p):
            return self.system.dH_dp(q, p).astype(np.float32)

    def rounded(system, q, p, h):
        q, p = step(Rounded(system), q.astype(np.float32), p.astype(np.float32), np.float32(h))
        return q.astype(float), p.astype(float)

    return rounded


@pytest.mark.parametrize(
    ("step", "claims", "expected"),
    [
        (leapfrog, {"precision": "single"}, {"consistent": HOLDS, "order": HOLDS, "precision": HOLDS}),
        (leapfrog, {}, {"consistent": HOLDS, "order": HOLDS, "precision": UNJUDGED}),
        (leapfrog, {"precision": "double"}, {"consistent": HOLDS, "order": HOLDS, "precision": CONTRADICTED}),
        (symplectic_euler, {"precision": "single"}, {"consistent": HOLDS, "order": CONTRADICTED, "precision": HOLDS}),
    ],
)
def test_single_precision_is_judged_above_its_floor(step, claims, expected):
    found = verdicts(certify(single(step), {"order": 2, **claims}, SEPARABLE, alone=True))
    assert {name: found[name] for name in expected} == expected


def test_rounding_of_a_step_is_measured():
    for step, size in ((leapfrog, EPS), (single(leapfrog), float(np.finfo(np.float32).eps))):
        rows = behaviour.rounding(subject(step), [TAO, RING], 0)
        assert all(size / 10 < r["value"] < 3 * size for r in rows)


def test_structure_in_single_precision():
    claims = {"symplectic": True, "precision": "single"}
    assert verdicts(certify(single(leapfrog), claims, SEPARABLE, alone=True))["symplectic"] == HOLDS
    euler = single(lambda system, q, p, h: (q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)))
    assert verdicts(certify(euler, claims, SEPARABLE, alone=True))["symplectic"] == CONTRADICTED


# -- printed digits, fractions, hints ---------------------------------------------------------------------------------

#: Yoshida 1990, order 6, solution A, as printed, with 15 decimals.
DRIFTS = ("0.39225680523878", "0.510043411918458", "-0.471053385409757", "0.068753168252518")
KICKS = ("0.784513610477560", "0.235573213359357", "-1.17767998417887", "1.315186320683906")
YOSHIDA = {"a": [*DRIFTS, *DRIFTS[::-1]], "b": [*KICKS, *KICKS[2::-1]]}


def code(record):
    """The step of a splitting's record, as code with numbers in doubles."""
    a, b = ([float(x) for x in record[key]] for key in "ab")

    def step(system, q, p, h):
        for drift, kick in zip(a, [*b, 0.0], strict=True):
            q = q + drift * h * system.dH_dp(q, p)
            p = p - kick * h * system.dH_dq(q, p)
        return q, p

    return step


def test_printed_digits_explain_their_rounding():
    """A table of 15 decimals has its order; one that lost three of them in one number has not."""
    wrong = YOSHIDA | {"b": [KICKS[0], "0.235573213360357", *KICKS[2:], *KICKS[2::-1]]}
    for record, expected in ((YOSHIDA, HOLDS), (wrong, CONTRADICTED)):
        for target in (record, code(record)):
            assert verdicts(certify(target, {"order": 6}, SEPARABLE, alone=True))["order"] == expected


@pytest.mark.parametrize("first", ["A", "B"])
def test_fractions_are_a_composition(first):
    g = "1.35120719195965763405"
    record = {"gamma": [g, "-1.70241438391931526810", g], "first": first}
    found = certify(record, {"order": 4, "symplectic": True}, alone=True)
    assert found.verdict == "pass"
    assert found.tables.of("runs")[0]["dH_dq" if first == "B" else "dH_dp"] == 4


RUTH = {"a": ["2/3", "-2/3", "1"], "b": ["7/24", "3/4", "-1/24"]}


def test_splitting_that_begins_with_a_kick_is_hinted_at():
    found = certify(RUTH, {"order": 3}, alone=True)
    assert '"first": "B"' in next(j.why for j in found.claims if j.name == "order")
    assert certify(RUTH | {"first": "B"}, {"order": 3}, alone=True).verdict == "pass"
    found = certify(RUTH, {"order": 4}, alone=True)
    assert '"first"' not in next(j.why for j in found.claims if j.name == "order")


def test_iterations_that_end_early_are_hinted_at():
    def midpoint(iterations):
        def step(system, q, p, h):
            y = z = np.concatenate([q, p])
            for _ in range(iterations):
                q, p = np.split((y + z) / 2, 2)
                z = y + h * np.concatenate([system.dH_dp(q, p), -system.dH_dq(q, p)])
            return np.split(z, 2)

        return step

    for iterations, told in ((5, True), (1, False)):
        found = certify(midpoint(iterations), {"symplectic": True}, alone=True)
        why = next(j for j in found.claims if j.name == "symplectic")
        assert (why.verdict, "more iterations" in why.why) == (CONTRADICTED, told)


def test_arguments_in_another_order_are_refused():
    for step in (lambda q, p, h, system: (q, p), lambda system, p, q, h: (q, p)):
        with pytest.raises(InvalidInput, match=r"called \(system, q, p, h\)"):
            from_function(step)
    for step in (lambda system, q, p, dt: (q, p), lambda system, x, v, h: (x, v)):
        assert from_function(step).step is step
    found = certify(lambda x, v, dt, H: (x + dt * H.dH_dp(x, v), v), {"order": 1}, SEPARABLE, alone=True)
    assert "called (system, q, p, h)" in next(j.why for j in found.claims if j.name == "runs")


def test_multistep_method_is_said_to_be_one():
    found = certify("quinlan-tremaine-8")
    assert found.verdict == "not-judged"
    assert "multistep" in found.claims[0].why


def test_numbers_of_a_file_are_read_as_they_stand(tmp_path):
    path = Path(tmp_path) / "mine.json"
    path.write_text(json.dumps({"a": [1], "b": [0.5, 5e-1], "claims": {"order": 2, "stability": 2.0}}))
    assert certify(path, alone=True).verdict == "pass"
    assert own_step({"a": [1], "b": [0.5, 0.5]}, "here").changed is not None
