"""``validate`` on steps that are wrong late, on other states, in other units, discontinuously, or that never return."""

from __future__ import annotations

import json

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import battery, behaviour, repeats, scaled, states
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.jumps import jumps
from phasebench.benchmarks.certificate.stepping import Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.requirements import below
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.integrators.compile.codegen import MULTIPRECISION
from phasebench.integrators.errors import InvalidInput
from support.evidence import verdicts
from support.steps import euler, leapfrog, symplectic_euler

HENON_HEILES = battery.find_entry("henon-heiles")
SEPARABLE = ("separable",)


@pytest.fixture
def few_systems(monkeypatch):
    """Certify on three systems, which takes a third of the time."""
    few = tuple(battery.find_entry(name) for name in ("pendulum", "henon-heiles", "tao"))
    monkeypatch.setattr(battery, "entries", lambda: few)


def build_integrator(step):
    """The integrator of a step that requires a separable system."""
    return subject(step, {}, SEPARABLE)


def why(certificate, name):
    """The reason of a verdict of a certificate."""
    return next(j.why for j in certificate.claims if j.name == name)


# -- state between calls ----------------------------------------------------------------------------------------------


def after(first, then, from_call: int, to_call: float = np.inf):
    """A step function that is ``first``, but ``then`` between its calls number ``from_call`` and ``to_call``."""
    count = [0]

    def step(system, q, p, h):
        count[0] += 1
        return (then if from_call <= count[0] < to_call else first)(system, q, p, h)

    return step


def remembering(step):
    """A step function that keeps its results."""
    answers = {}

    def remember(system, q, p, h):
        key = (*q, *p, h)
        if key not in answers:
            answers[key] = step(system, q, p, h)
        return answers[key]

    return remember


@pytest.mark.parametrize(
    ("step", "again", "beside"),
    [
        (leapfrog, False, False),
        (after(leapfrog, euler, 380), True, None),
        (after(leapfrog, euler, 100, 250), True, None),
        (remembering(leapfrog), False, False),
        (remembering(after(leapfrog, euler, 401)), False, True),
    ],
    ids=["leapfrog", "late", "for a while", "a cache", "hidden by a cache"],
)
def test_step_that_changes_between_calls_is_found(step, again, beside):
    """When 400 calls are repeated, or made with states close by."""
    heard, kept = repeats.listening(build_integrator(step), 0)
    Stepper(heard, HENON_HEILES).run(HENON_HEILES.start(0), 0.1, 400)
    assert len(kept.kept) > 40
    for row, changes in zip(repeats.repeat_calls(heard, kept), (again, beside), strict=True):
        assert changes is None or (row["value"] > 1e-4 if changes else row["value"] == 0.0)


@pytest.mark.parametrize("n", [1, 3])
def test_buffers_that_are_used_again_are_found(n):
    buffers, calls = {}, [0]

    def step(system, q, p, h):
        calls[0] += 1
        kept = buffers.setdefault((calls[0] % n, len(q), q.dtype), np.empty(2 * len(q), q.dtype))
        kept[:] = np.concatenate(leapfrog(system, q, p, h))
        return np.split(kept, 2)

    entry = battery.find_entry("pendulum")
    changed = [behaviour.input_changed(subject(s), [entry], 0)[0]["later"] for s in (step, leapfrog)]
    assert changed[0] > 0 == changed[1]


# -- jumps ------------------------------------------------------------------------------------------------------------


def test_jump_of_a_map_is_measured():
    def pieces(by: float):
        """A leapfrog that adds ``by`` to q where q_1 > 0.1."""
        return lambda system, q, p, h: leapfrog(system, q + (by if q[0] > 0.1 else 0.0), p, h)

    assert jumps(build_integrator(leapfrog), HENON_HEILES, 0, 0.0)["value"] == 0.0
    assert jumps(build_integrator(pieces(1e-6)), HENON_HEILES, 0, 0.0)["value"] == pytest.approx(1e-6, rel=0.5)
    small = jumps(build_integrator(pieces(3e-12)), HENON_HEILES, 0, 0.0)
    assert small["floor"] < small["value"] < 100 * small["floor"]


# -- other states, units and precisions -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "found"),
    [
        (lambda q, p: False, False),
        (lambda q, p: abs(p).max() > 3, True),
        (lambda q, p: abs(q).max() < 0.02, True),
        (lambda q, p: len(q) > 5, True),
    ],
    ids=["nowhere", "large", "small", "many"],
)
def test_small_and_large_states_find_another_step(wrong, found):
    def step(system, q, p, h):
        return (euler if wrong(q, p) else leapfrog)(system, q, p, h)

    entries = [e for e in battery.entries() if e.system.traits.get("separable")]
    rows = states.states(build_integrator(step), entries, 0, MULTIPRECISION)
    assert all(r["pairs"] == 2 for r in rows)
    assert (min(r["order"] for r in rows) < 1.25) is found


def dissipating(system, q, p, h):
    q, p = leapfrog(system, q, p, h)
    return q, p * (1 - 1e-6 * h)


def substeps(system, q, p, h):
    n = int(np.ceil(min(abs(h), 20.0) / 0.1))
    for _ in range(n):
        q, p = leapfrog(system, q, p, h / n)
    return q, p


def endless(system, q, p, h):
    while abs(q).max() > 100:
        system.dH_dq(q, p)
    return leapfrog(system, q, p, h)


def where(test, bad=symplectic_euler):
    """The leapfrog, and another step where ``test(q, p, h)``."""
    return lambda system, q, p, h: (bad if test(q, p, h) else leapfrog)(system, q, p, h)


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(
    ("step", "lower", "broken"),
    [
        (leapfrog, False, set()),
        (substeps, False, set()),
        (endless, False, set()),
        (where(lambda q, p, h: len(q) == 7), True, {"symmetric"}),
        (where(lambda q, p, h: 0.11 < h < 0.14), True, {"symmetric"}),
        (where(lambda q, p, h: q[0] < -9), True, {"symmetric"}),
        (where(lambda q, p, h: abs(p).max() > 200), True, {"symmetric"}),
        (where(lambda q, p, h: h > 3, dissipating), True, {"symplectic", "symmetric"}),
    ],
    ids=["leapfrog", "substeps", "endless", "d", "h", "q", "p", "dissipating"],
)
def test_other_units_find_another_step(step, lower, broken):
    entries = [e for e in battery.entries() if build_integrator(step).lacks(e.system) is None]
    rows, found, reach = scaled.sweep(build_integrator(step), entries, 0, ("symplectic", "symmetric"))
    assert reach["steps"] > 100
    assert (any(below(r, 2) for r in rows), {*found}) == (lower, broken)
    assert all(f"h = {r['h']:.2g}," in r["on"] for r in found.values())


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


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(
    ("step", "claims", "expected"),
    [
        (leapfrog, {"order": 2, "precision": "single", "symplectic": True}, (HOLDS, HOLDS, HOLDS)),
        (leapfrog, {"order": 2}, (HOLDS, UNJUDGED, None)),
        (leapfrog, {"order": 2, "precision": "double"}, (HOLDS, CONTRADICTED, None)),
        (symplectic_euler, {"order": 2, "precision": "single"}, (CONTRADICTED, HOLDS, None)),
        (euler, {"order": 1, "precision": "single", "symplectic": True}, (HOLDS, HOLDS, CONTRADICTED)),
    ],
)
def test_single_precision_is_judged_above_its_floor(step, claims, expected):
    found = verdicts(certify(single(step), claims, SEPARABLE, alone=True))
    assert found["consistent"] == HOLDS
    assert tuple(found.get(name) for name in ("order", "precision", "symplectic")) == expected


def asking(system, q, p, h):
    return (euler if isinstance(h, float) else leapfrog)(system, q, p, h)


def pieced(system, q, p, h):
    n = 3 if isinstance(h, float) else 2
    for _ in range(n):
        q, p = leapfrog(system, q, p, h / n)
    return q, p


@pytest.mark.parametrize(("step", "expected"), [(asking, CONTRADICTED), (pieced, HOLDS)])
def test_step_that_differs_in_multiprecision_uses_doubles(step, expected):
    """A step that inspects the type of its argument is found; another number of substeps is no fault."""
    found = certify(step, {"order": 2}, SEPARABLE, alone=True)
    assert found.doubles
    assert (verdicts(found)["order"], verdicts(found)["consistent"]) == (expected, HOLDS), found.summary()


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
    assert found.verdict == "not-judged"
    assert any(f"{path}, line {line}" in why(found, "runs") for line in lines), why(found, "runs")
    assert verdicts(found)["pure"] == HOLDS, "what was measured is kept"
    assert found.tables.of("runs")


# -- the user's problem -----------------------------------------------------------------------------------------------


def bodies(system, q, p, h):
    """A leapfrog for at least two bodies in the plane."""
    assert len(q.reshape(-1, 2)) > 1
    return leapfrog(system, q, p, h)


def test_step_for_bodies_is_judged_on_such_a_problem():
    claims = {"order": 2, "symplectic": True}
    assert certify(bodies, claims, alone=True).verdict == "fail", "the suite's systems have other dimensions"
    found = certify(bodies, claims, alone=True, problems=["figure-eight"])
    assert found.verdict == "pass", found.summary()
    assert {r["on"] for r in found.tables.of("order")} == {"figure-eight"}
    wrong = certify(lambda *a: euler(*a), claims, alone=True, problems=["outer-solar-system"])
    assert verdicts(wrong)["symplectic"] == CONTRADICTED
    assert 100 < battery.of_problem(pb.problem("outer-solar-system")).unit < 4332 / 2 / np.pi


# -- names, printed digits, hints -------------------------------------------------------------------------------------


def test_coefficients_and_object_methods_name_a_method(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(LOOPS.replace("AFTER", "10**9").replace("LOOP", "python"))
    record = tmp_path / "leapfrog.json"
    record.write_text(json.dumps({"a": [1], "b": ["1/2", "1/2"]}))
    runs = [pb.integrate("pendulum", m, h=0.1, steps=20) for m in (f"{path}:kind.step", record, "stormer-verlet")]
    for one in runs[:2]:
        assert one.status == "ok"
        assert one.q == pytest.approx(runs[2].q, abs=1e-13)
    own = integrator(f"{path}:kind.step").record
    assert (own.requires, own.claims) == (SEPARABLE, {})
    for name, said in ((f"{path}:kind.stride", "no 'stride'"), (f"{path}:calls", "is a list")):
        with pytest.raises(InvalidInput, match=said):
            integrator(name)


#: Yoshida 1990, order 6, solution A, as printed, with 15 decimals.
DRIFTS = ("0.39225680523878", "0.510043411918458", "-0.471053385409757", "0.068753168252518")
KICKS = ("0.784513610477560", "0.235573213359357", "-1.17767998417887", "1.315186320683906")
YOSHIDA = {"a": [*DRIFTS, *DRIFTS[::-1]], "b": [*KICKS, *KICKS[2::-1]]}
LOST = YOSHIDA | {"b": [KICKS[0], "0.235573213360357", *KICKS[2:], *KICKS[2::-1]]}


def code(record):
    """The step of a splitting's record, as code with numbers in doubles."""
    a, b = ([float(x) for x in record[key]] for key in "ab")

    def step(system, q, p, h):
        for drift, kick in zip(a, [*b, 0.0], strict=True):
            q = q + drift * h * system.dH_dp(q, p)
            p = p - kick * h * system.dH_dq(q, p)
        return q, p

    return step


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(
    ("target", "expected"), [(YOSHIDA, HOLDS), (code(YOSHIDA), HOLDS), (LOST, CONTRADICTED), (code(LOST), CONTRADICTED)]
)
def test_printed_digits_explain_their_rounding(target, expected):
    """A table of 15 decimals has its order; one that lost three of them in one number has not."""
    assert verdicts(certify(target, {"order": 6}, SEPARABLE, alone=True))["order"] == expected


@pytest.mark.usefixtures("few_systems")
def test_fractions_are_a_composition():
    g = "1.35120719195965763405"
    record = {"gamma": [g, "-1.70241438391931526810", g], "first": "B"}
    found = certify(record, {"order": 4, "symplectic": True}, alone=True)
    assert (found.verdict, found.tables.of("runs")[0]["dH_dq"]) == ("pass", 4)


@pytest.mark.usefixtures("few_systems")
def test_splitting_that_begins_with_a_kick_is_hinted_at():
    ruth = {"a": ["2/3", "-2/3", "1"], "b": ["7/24", "3/4", "-1/24"]}
    assert '"first": "B"' in why(certify(ruth, {"order": 3}, alone=True), "order")
    assert certify(ruth | {"first": "B"}, {"order": 3}, alone=True).verdict == "pass"
    assert '"first"' not in why(certify(ruth, {"order": 4}, alone=True), "order")


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(("iterations", "told"), [(5, True), (1, False)])
def test_iterations_that_end_early_are_hinted_at(iterations, told):
    def midpoint(system, q, p, h):
        y = z = np.concatenate([q, p])
        for _ in range(iterations):
            q, p = np.split((y + z) / 2, 2)
            z = y + h * np.concatenate([system.dH_dp(q, p), -system.dH_dq(q, p)])
        return np.split(z, 2)

    found = certify(midpoint, {"symplectic": True}, alone=True)
    assert (verdicts(found)["symplectic"], "more iterations" in why(found, "symplectic")) == (CONTRADICTED, told)


def test_multistep_method_is_said_to_be_one():
    found = certify("quinlan-tremaine-8")
    assert found.verdict == "not-judged"
    assert "multistep" in found.claims[0].why
