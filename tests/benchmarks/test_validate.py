"""``validate`` on the examples and on correct steps, and on steps that are wrong late, elsewhere, or never return."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import battery, behaviour, repeats, scaled
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.jumps import jumps
from phasebench.benchmarks.certificate.stepping import Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.certificate.times import runge_kutta
from phasebench.benchmarks.judge import judge
from phasebench.benchmarks.judge.requirements import below
from phasebench.benchmarks.judge.verdict import CONTRADICTED, HOLDS, UNJUDGED
from phasebench.benchmarks.measure.integrator import integrator
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
        (after(leapfrog, euler, 100, 250), True, None),
        (remembering(leapfrog), False, False),
        (remembering(after(leapfrog, euler, 401)), False, True),
    ],
    ids=["leapfrog", "for a while", "a cache", "hidden by a cache"],
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


def substeps(system, q, p, h):
    n = int(np.ceil(min(abs(h), 20.0) / 0.1))
    for _ in range(n):
        q, p = leapfrog(system, q, p, h / n)
    return q, p


def endless(system, q, p, h):
    while abs(q).max() > 100:
        system.dH_dq(q, p)
    return leapfrog(system, q, p, h)


def where(test):
    """The leapfrog, and another step where ``test(q, p, h)``."""
    return lambda system, q, p, h: (symplectic_euler if test(q, p, h) else leapfrog)(system, q, p, h)


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(
    ("step", "lower", "broken"),
    [
        (substeps, False, set()),
        (endless, False, set()),
        (where(lambda q, p, h: len(q) == 7), True, {"symmetric"}),
        (where(lambda q, p, h: 0.11 < h < 0.14), True, {"symmetric"}),
        (where(lambda q, p, h: abs(p).max() > 200), True, {"symmetric"}),
    ],
    ids=["substeps", "endless", "d", "h", "p"],
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


@pytest.mark.usefixtures("few_systems")
@pytest.mark.parametrize(("target", "expected"), [(YOSHIDA, HOLDS), (LOST, CONTRADICTED)])
def test_printed_digits_explain_their_rounding(target, expected):
    """A table of 15 decimals has its order; one that lost three of them in one number has not."""
    assert verdicts(certify(target, {"order": 6}, SEPARABLE, alone=True))["order"] == expected


@pytest.mark.usefixtures("few_systems")
def test_fractions_are_a_composition():
    g = "1.35120719195965763405"
    record = {"gamma": [g, "-1.70241438391931526810", g], "first": "B"}
    found = certify(record, {"order": 4, "symplectic": True}, alone=True)
    assert (found.verdict, found.tables.of("runs")[0]["dH_dq"]) == ("pass", 4)


# -- examples, and correct steps with true and false claims ------------------------------------------------------------


EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


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


WHOLE = {"symplectic": True, "symmetric": True, "reversible": True}
RIGHT = {
    "symplectic-euler": (symplectic_euler, SEPARABLE, {"order": 1, "symplectic": True, "symmetric": False}),
    "leapfrog": (leapfrog, SEPARABLE, {"order": 2, **WHOLE, "bilinear": "preserved"}),
    "rk4": (runge_kutta, (), {"order": 4, "symplectic": False, "stability": 2.828}),
}


#: Claims that are false of a correct step.
FALSE = [
    ("leapfrog", {"order": 1}),
    ("rk4", {"symplectic": True}),
    ("leapfrog", {"symplectic": False}),
    ("symplectic-euler", {"symmetric": True}),
    ("symplectic-euler", {"reversible": True}),
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


# -- controls of the claims -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "false"), FALSE)
def test_false_claim_alone_is_contradicted(name, false):
    verdicts, whole = judgement(name, false)
    assert {n for n, verdict in verdicts.items() if verdict == "contradicted"} == set(false), verdicts
    assert whole == "fail"
