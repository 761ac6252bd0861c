"""``validate`` on steps that are wrong late, on other states, discontinuously, or that never return."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import battery, order, repeats, states
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.jumps import jumps
from phasebench.benchmarks.certificate.stepping import Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.benchmarks.judge.judge import judgements
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.errors import InvalidInput
from support.commands import integrate_json
from support.evidence import verdicts
from support.steps import leapfrog

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HENON_HEILES = battery.find_entry("henon-heiles")
SEPARABLE = ("separable",)


def build_integrator(step):
    """The integrator of a step that requires a separable system."""
    return subject(step, {}, SEPARABLE)


def euler(system, q, p, h):
    return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)


# -- state between calls ----------------------------------------------------------------------------------------------


def repeat_changes(step, calls: int = 400):
    """(change of repeated calls, change of calls with states close by, number of sampled calls) after a run of a step.

    A change is the distance between what the step function returned in the run and returns when called again.
    """
    heard, kept = repeats.listening(build_integrator(step), 0)
    Stepper(heard, HENON_HEILES).run(HENON_HEILES.start(0), 0.1, calls)
    again, beside = repeats.repeat_calls(heard, kept)
    return again["value"], beside["value"], len(kept.kept)


def after(first, then, from_call: int, to_call: float = np.inf):
    """A step function that is ``first``, but ``then`` between its calls number ``from_call`` and ``to_call``."""
    count = [0]

    def step(system, q, p, h):
        count[0] += 1
        return (then if from_call <= count[0] < to_call else first)(system, q, p, h)

    return step


def test_repeated_calls_return_the_same():
    again, beside, kept = repeat_changes(leapfrog)
    assert (again, beside) == (0.0, 0.0)
    assert kept > 40


@pytest.mark.parametrize(("begin", "end"), [(380, np.inf), (100, 250)])
def test_step_that_changes_after_many_calls_is_found(begin, end):
    again, _, _ = repeat_changes(after(leapfrog, euler, begin, end))
    assert again > 1e-4


def test_step_that_caches_its_results_is_found():
    """A cache alone is no fault; one that hides another step is."""

    def remembering(step):
        answers = {}

        def remember(system, q, p, h):
            key = (*q, *p, h)
            if key not in answers:
                answers[key] = step(system, q, p, h)
            return answers[key]

        return remember

    assert repeat_changes(remembering(leapfrog))[:2] == (0.0, 0.0)
    again, beside, _ = repeat_changes(remembering(after(leapfrog, euler, 401)))
    assert again == 0.0
    assert beside > 1e-4


def test_sample_of_calls_is_small_and_uniform():
    _, kept = heard = repeats.listening(build_integrator(lambda system, q, p, h: (q, p)), 0)
    for k in range(40_000):
        heard[0].own.step(None, np.array([float(k)]), np.array([0.0]), 0.1)
    places = [call.q[0] for call in kept.kept]
    assert len(places) <= repeats.MOST
    assert max(places) > 39_000
    assert 0.3 < np.mean(np.array(places) < 20_000) < 0.7


# -- jumps ------------------------------------------------------------------------------------------------------------


def pieces(by: float):
    """A faulty leapfrog step function that is discontinuous: it adds ``by`` to q where q_1 > 0.1."""

    def step(system, q, p, h):
        return leapfrog(system, q + (by if q[0] > 0.1 else 0.0), p, h)

    return step


def test_jump_of_a_map_is_measured():
    assert jumps(build_integrator(leapfrog), HENON_HEILES, 0, 0.0)["value"] == 0.0
    assert jumps(build_integrator(pieces(1e-6)), HENON_HEILES, 0, 0.0)["value"] == pytest.approx(1e-6, rel=0.5)
    small = jumps(build_integrator(pieces(3e-12)), HENON_HEILES, 0, 0.0)
    assert small["floor"] < small["value"] < 100 * small["floor"]


GOOD = {
    "runs": [{"on": "tao", "status": "ok", "reason": ""}],
    "state": [{"on": "tao", "what": "the same step twice", "value": 0.0}],
    "input": [{"on": "tao", "value": 0.0, "later": 0.0}],
    "order": [{"on": "tao", "value": 2.0, "low": 2.0, "high": 2.0, "separable": True, "terms": [0.0, 0.0], "clean": 2}],
    "symplectic": [{"on": "tao", "value": 1e-20, "floor": 1e-13, "own": 1e-2, "h": 0.5, "separable": True}],
}
ENERGY = {"value": 1e-4, "time": 500.0, "scale": 1.0, "steps": 2400}


def verdict_on(claim: str, value=True, **rows) -> str:
    """The certificate's verdict on one claim, from fabricated measurements of a correct step, some tables replaced."""
    return next(j for j in judgements({claim: value}, Tables(GOOD | rows)) if j.name == claim).verdict


@pytest.mark.parametrize(("size", "expected"), [(0.0, HOLDS), (2e-13, UNJUDGED), (2e-11, CONTRADICTED)])
def test_jump_contradicts_symplecticity(size, expected):
    assert verdict_on("symplectic", jumps=[{"on": "tao", "value": size, "floor": 1e-13, "h": 0.5}]) == expected


@pytest.mark.parametrize(
    ("size", "expected"), [(0.9e-13, HOLDS), (2e-13, UNJUDGED), (9e-12, UNJUDGED), (2e-11, CONTRADICTED)]
)
def test_defect_up_to_a_hundred_floors_is_not_judged(size, expected):
    row = GOOD["symplectic"][0] | {"value": size}
    assert verdict_on("symplectic", symplectic=[row]) == expected


@pytest.mark.parametrize(("slope", "expected"), [(0.0, HOLDS), (1.9e-7, UNJUDGED)])
def test_energy_drift_leaves_symplecticity_open(slope, expected):
    energy = ENERGY | {"slope": slope, "low": slope - 1e-9, "high": slope + 1e-9}
    assert verdict_on("symplectic", long=[{"on": "tao", "status": "ok", "energy": energy}]) == expected


# -- states and orders ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        (lambda q, p: False, False),
        (lambda q, p: abs(p).max() > 3, True),
        (lambda q, p: abs(q).max() < 0.02, True),
        (lambda q, p: len(q) > 5, True),
    ],
)
def test_small_and_large_states_find_another_step(wrong, found):
    def step(system, q, p, h):
        return (euler if wrong(q, p) else leapfrog)(system, q, p, h)

    entries = [e for e in battery.entries() if e.system.traits.get("separable")]
    rows = states.states(build_integrator(step), entries, 0, MULTIPRECISION)
    assert all(r["pairs"] == 2 for r in rows)
    assert (min(r["order"] for r in rows) < 1.25) is found


def test_error_that_does_not_fall_has_order_minus_one():
    """Momenta are clipped at 7: the error of a step does not depend on h, which is h^0 = h^(order + 1)."""

    def clipped(system, q, p, h):
        q, p = leapfrog(system, q, p, h)
        return q, np.array([max(min(x, 7), -7) for x in p], dtype=p.dtype)

    large = states.draw_entry(battery.find_entry("quartic"), (0.1, 12.0), 0)
    orders = [states._row(build_integrator(step), large, 0, DOUBLE)["order"] for step in (clipped, leapfrog)]
    assert orders[0] < -0.9
    assert orders[1] == pytest.approx(2, abs=0.1)


def test_order_in_doubles_from_a_series_of_the_error():
    h = 0.25 / np.array(battery.LADDER)
    series = np.stack([3 * h**5 - 40 * h**6 + 90 * h**7, -2 * h**5 + 11 * h**6], axis=1) * 1e-3
    noise = 2e-17 * np.random.default_rng(3).uniform(-1, 1, series.shape)
    assert order.fit_series(h, series + noise, 1e-16).value == 5
    assert order.fit_series(h, noise, 1e-16) is None, "of round-off nothing is told"


def test_step_that_differs_in_multiprecision_uses_doubles():
    """A step that inspects the type of its argument is found; another number of substeps is no fault."""

    def asking(system, q, p, h):
        return (euler if isinstance(h, float) else leapfrog)(system, q, p, h)

    def pieced(system, q, p, h):
        n = 3 if isinstance(h, float) else 2
        for _ in range(n):
            q, p = leapfrog(system, q, p, h / n)
        return q, p

    for step, expected in ((asking, CONTRADICTED), (pieced, HOLDS)):
        found = certify(step, {"order": 2}, SEPARABLE, alone=True)
        assert "another step in many digits" in found.doubles
        assert verdicts(found)["order"] == expected, found.summary()
        assert verdicts(found)["consistent"] == HOLDS


# -- a time limit -----------------------------------------------------------------------------------------------------

LOOPS = """
import numba
CLAIMS = {"order": 2}
calls = [0]

@numba.njit
def compiled():
    k = 0
    while k > -1:
        k = (k + 1) % 7

def python():
    while True:
        calls[0] += 1

class Kind:
    REQUIRES = ("separable",)
    def step(self, system, q, p, h):
        calls[0] += 1
        if calls[0] > AFTER:
            LOOP()
        p = p - h / 2 * system.dH_dq(q, p)
        q = q + h * system.dH_dp(q, p)
        return q, p - h / 2 * system.dH_dq(q, p)

kind = Kind()
"""


@pytest.mark.parametrize(("loop", "lines"), [("python", {13, 14}), ("compiled", {21})])
def test_hanging_step_is_ended_and_its_line_named(tmp_path, loop, lines):
    path = tmp_path / "mine.py"
    path.write_text(LOOPS.replace("AFTER", "110").replace("LOOP", loop))
    found = certify(f"{path}:kind.step", {"order": 2}, alone=True, time_limit=2.5)
    whole = {j.name: j for j in found.claims}
    assert found.verdict == "not-judged"
    assert found.seconds < 12
    assert any(f"{path}, line {line}" in whole["runs"].why for line in lines), whole["runs"].why
    assert whole["pure"].verdict == HOLDS, "what was measured is kept"
    assert found.tables.of("runs")


def test_unreached_time_limit_changes_nothing():
    euler_, limited = (certify(euler, {"order": 2}, alone=True, **more) for more in ({}, {"time_limit": 300.0}))
    assert [j.row() for j in euler_.claims] == [j.row() for j in limited.claims]
    with pytest.raises(InvalidInput, match="time limit is -1"):
        certify(euler, {}, time_limit=-1.0)
    with pytest.raises(InvalidInput, match="no file"):
        certify("./nothing.py", {}, time_limit=60.0)


# -- the user's problem -----------------------------------------------------------------------------------------------


def test_step_for_bodies_is_judged_on_such_a_problem():
    def bodies(system, q, p, h):
        """A leapfrog for at least two bodies in the plane."""
        pairs = q.reshape(-1, 2)
        assert len(pairs) > 1
        return leapfrog(system, q, p, h)

    claims = {"order": 2, "symplectic": True}
    assert certify(bodies, claims, alone=True).verdict == "fail", "the suite's systems have other dimensions"
    found = certify(bodies, claims, alone=True, problems=["figure-eight"])
    assert found.verdict == "pass", found.summary()
    assert {r["on"] for r in found.tables.of("order")} == {"figure-eight"}
    wrong = certify(lambda *a: euler(*a), claims, alone=True, problems=["outer-solar-system"])
    assert verdicts(wrong)["symplectic"] == CONTRADICTED


def test_unit_of_time_is_that_of_the_problem():
    days = battery.of_problem(pb.problem("outer-solar-system"))
    assert 100 < days.unit < 4332 / 2 / np.pi
    assert battery.of_problem(pb.problem("harmonic-oscillator")).unit in (0.5, 1.0)


# -- names ------------------------------------------------------------------------------------------------------------


def test_coefficients_and_object_methods_name_a_method(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(LOOPS.replace("AFTER", "10**9").replace("LOOP", "python"))
    record = tmp_path / "leapfrog.json"
    record.write_text(json.dumps({"a": [1], "b": ["1/2", "1/2"]}))
    runs = [pb.integrate("pendulum", m, h=0.1, steps=20) for m in (f"{path}:kind.step", record, "stormer-verlet")]
    assert [r.status for r in runs] == ["ok"] * 3
    for one in runs[:2]:
        assert one.q == pytest.approx(runs[2].q, abs=1e-13)
    assert integrator(f"{path}:kind.step").record.requires == SEPARABLE
    assert integrator(f"{path}:kind.step").record.claims == {}
    assert integrate_json("pendulum", record, "--h", "0.1", "--t-end", "1")["status"] == "ok"
    for name, said in ((f"{path}:kind.stride", "no 'stride'"), (f"{path}:calls", "is a list")):
        with pytest.raises(InvalidInput, match=said):
            integrator(name)


def test_defect_that_may_be_round_off_is_not_judged():
    found = certify(EXAMPLES / "shrinks_slightly.py", alone=True)
    assert verdicts(found)["symplectic"] == UNJUDGED
    assert found.verdict == "not-judged"
