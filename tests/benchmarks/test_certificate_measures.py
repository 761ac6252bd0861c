"""The measurements of a certificate, on steps written for them: long runs, structure, state kept between calls."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from phasebench.benchmarks.certificate import adaptive, battery, certificate, conservation, measures, render, structure
from phasebench.benchmarks.certificate.behaviour import state_between_steps
from phasebench.benchmarks.certificate.order import flow
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.judge.evidence import Tables, kind
from phasebench.benchmarks.judge.requirements import adapts
from phasebench.integrators.compile.codegen import MULTIPRECISION
from phasebench.integrators.record import BOUNDED, DRIFT
from support.steps import leapfrog

PENDULUM = battery.find_entry("pendulum")


def build_integrator(step):
    """The integrator of a step that requires a separable system."""
    return subject(step, {}, ("separable",))


def entries(chosen):
    return [e for e in battery.entries() if chosen.lacks(e.system) is None]


class Failing:
    """A step function that returns its argument and fails at call number ``lasts(h)`` with step size h.

    It raises ``raised``, or returns NaN if that is None; ``asked`` counts the calls by step size.
    """

    def __init__(self, lasts, raised=None):
        self.lasts, self.raised, self.asked = lasts, raised, {}

    def __call__(self, system, q, p, h):
        self.asked[h] = self.asked.get(h, 0) + 1
        if self.asked[h] < self.lasts(h):
            return q, p
        if self.raised:
            raise self.raised
        return q * np.nan, p


# -- long runs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gradients", "steps"), [(0, 2400), (1, 2400), (50, 800), (90, 400), (150, 400)])
def test_expensive_step_takes_fewer_steps(gradients, steps):
    def dear(system, q, p, h):
        for _ in range(gradients):
            system.dH_dq(q, p)
        return q, p

    assert conservation.long_run(build_integrator(dear), PENDULUM, 0)["steps"] == steps


def test_failed_long_run_is_repeated_with_half_the_step():
    shorter = Failing(lambda h: 300 if h > 0.06 else np.inf, FloatingPointError("overflow"))
    row = conservation.long_run(build_integrator(shorter), PENDULUM, 0)
    assert (row["status"], row["h"], row["time"]) == ("ok", 0.05, 0.05 * 2400)
    assert set(shorter.asked) == {0.2, 0.1, 0.05, 0.025}, "the shortest, in which gradients are counted, too"


def test_run_that_fails_at_its_last_step_has_diverged():
    """Each run of 2400 steps ends in a NaN; at the shortest h, 20 calls that count gradients come first."""
    last = Failing(lambda h: 2420 if h < 0.03 else 2400)
    row = conservation.long_run(build_integrator(last), PENDULUM, 0)
    assert (row["status"], row["on"]) == ("diverged", "pendulum")
    assert row["reason"] == "after 2400 steps of h = 0.025 the state was not finite"
    assert last.asked == {0.2: 2400, 0.1: 2400, 0.05: 2400, 0.025: 2420}


def test_exception_in_a_step_is_not_a_divergence():
    with pytest.raises(StepFailed, match="KeyError"):
        conservation.long_run(build_integrator(Failing(lambda h: 30, KeyError("x"))), PENDULUM, 0)


def test_energy_error_and_slope_of_a_run():
    """Energy error and its slope in time against a closed form, for a step on H = p^2/2 that increases p."""
    entry = battery.Entry("flat", battery._one("p**2/2 + 0*q"), (0.0, 1.0))

    def pushed(system, q, p, h):
        return q + h * p, np.sqrt(p * p + 2e-3 * h)

    row = conservation.long_run(build_integrator(pushed), entry, 0)
    assert row["energy"]["low"] < row["energy"]["slope"] < row["energy"]["high"]
    assert row["energy"]["slope"] == pytest.approx(1e-3, rel=1e-6)
    assert row["energy"]["time"] == pytest.approx(480.0)
    assert row["curve"][-1] == pytest.approx([480.0, 0.48])
    assert len(row["curve"]) == 401


# -- structure --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("iterations", "expected"), [(3, DRIFT), (40, BOUNDED)])
def test_energy_of_equations_solved_in_part_drifts(iterations, expected):
    """The generalized leapfrog with so many fixed-point iterations, on a system where q and p do not separate."""

    def step(system, q, p, h):
        half, new = p, q
        for _ in range(iterations):
            half = p - h / 2 * system.dH_dq(q, half)
        slope = system.dH_dp(q, half)
        for _ in range(iterations):
            new = q + h / 2 * (slope + system.dH_dp(new, half))
        return new, half - h / 2 * system.dH_dq(new, half)

    dimer = next(e for e in battery.lasting() if e.name == "dimer")
    for seed in (0, 3):
        assert kind(conservation.long_run(subject(step), dimer, seed)["energy"]) == expected


def test_structure_is_measured_at_a_shorter_step_if_needed():
    def short(system, q, p, h):
        if abs(h) > 0.3:
            raise FloatingPointError("no root")
        return leapfrog(system, q, p, h)

    assert structure.structure_row(Stepper(build_integrator(leapfrog), PENDULUM), 0, structure.symmetry)["h"] == 0.5
    assert structure.structure_row(Stepper(build_integrator(short), PENDULUM), 0, structure.symmetry)["h"] == 0.125


@pytest.mark.parametrize("rough", [(1, 0), (0, 1)])
def test_round_off_is_detected_in_every_component(rough):
    def rounded(system, q, p, h):
        q, p = leapfrog(system, q, p, h)
        return tuple(x * (1 + (float(x[0]) / x[0] - 1) * of) for x, of in zip((q, p), rough, strict=True))

    assert structure.smooth(Stepper(build_integrator(leapfrog), PENDULUM, MULTIPRECISION), 0) < structure.SMOOTH
    assert structure.smooth(Stepper(build_integrator(rounded), PENDULUM, MULTIPRECISION), 0) > 1e-18


# -- state between calls, convergence of an adaptive method -----------------------------------------------------------


def test_alternating_steps_on_two_orbits_of_one_system():
    rows = state_between_steps(build_integrator(leapfrog), [PENDULUM], 0)
    assert [(r["what"], r["value"]) for r in rows] == [("the same step twice", 0.0), ("steps in turns", 0.0)]
    last = {}

    def keeps(system, q, p, h):
        h = h + last.get("q", q)[0] * 1e-3
        last["q"] = q.copy()
        return leapfrog(system, q, p, h)

    assert max(r["value"] for r in state_between_steps(build_integrator(keeps), [PENDULUM], 0)) > 1e-5


def test_alternating_steps_on_three_pairs_of_systems():
    rows = state_between_steps(build_integrator(leapfrog), list(battery.entries()), 0)
    assert [r["what"] for r in rows].count("steps in turns") == 3


def test_verdict_uses_the_error_at_the_smallest_tolerance():
    row = {"on": "tao", "tolerances": [1e-4, 1e-7, 1e-10], "errors": [1e-4, 1e-3, 2e-9]}
    better = {"on": "quartic", "tolerances": [1e-4, 1e-7, 1e-11], "errors": [1e-4, 1e-6, 1e-9]}
    found = adapts(Tables({"tolerance": [better, row]}))
    assert (found.verdict, found.measured, found.why) == ("holds", 2e-9, "error 2.0e-09 at tolerance 1e-10 on tao")
    for failed, why in (({}, "it was not measured"), ({"tolerance": "no run ended"}, "no run ended")):
        missing = adapts(Tables({"tolerance": []}, failed=failed))
        assert (missing.verdict, missing.why) == ("not judged", why)


# -- the battery ------------------------------------------------------------------------------------------------------

ALL = {e.name: e for e in (*battery.entries(), *battery.lasting(), battery.oscillator())}


def test_systems_of_long_runs_and_steps_of_the_ladder():
    """Steps for orders include halved ones, so that errors can be compared; their time span is an exact double."""
    assert [e.name for e in battery.lasting.__wrapped__()] == ["henon-heiles", "kepler", "dimer"]
    assert all(2 * n in battery.LADDER for n in battery.LADDER if n <= 32)
    assert sorted({*battery.LADDER}) == list(battery.LADDER)
    assert float(battery.SPAN) == battery.SPAN


@pytest.mark.parametrize("entry", ALL.values(), ids=ALL)
def test_seed_perturbs_every_component_both_ways(entry):
    moved = np.array([entry.start(seed) - entry.state for seed in range(40)]) / battery.MOVED
    assert (abs(moved) < 1).all()
    assert (moved.min(axis=0) < -0.7).all()
    assert (moved.max(axis=0) > 0.7).all()
    assert (entry.start(3) == entry.start(3)).all()


@pytest.mark.parametrize("entry", ALL.values(), ids=ALL)
def test_states_have_size_one_and_reversible_is_declared(entry):
    assert np.linalg.norm(entry.state) < 1.5
    q, p = np.split(entry.start(0), 2)
    H = entry.system.observe(entry.system.H, *np.array([[q, q], [p, -p]]))
    assert entry.reversible == (abs(H[0] - H[1]) < 1e-14)


def test_orbits_of_the_battery_are_bounded():
    """The pendulum oscillates; the Kepler ellipse is nearly circular."""
    pendulum, kepler = (ALL[name] for name in ("pendulum", "kepler"))
    assert pendulum.state[1] ** 2 / 2 - np.cos(pendulum.state[0]) < 0.5
    q, p = np.split(np.array(kepler.state), 2)
    energy, momentum = p @ p / 2 - 1 / np.linalg.norm(q), q[0] * p[1] - q[1] * p[0]
    assert 0.05 < np.sqrt(1 + 2 * energy * momentum**2) < 0.3


# -- an adaptive integrator -------------------------------------------------------------------------------------------


def test_tolerance_errors_of_state_and_energy():
    """The measured errors of a made-up run that is off by its tolerance in q and by a third of it in p."""
    entry, truth = PENDULUM, flow(PENDULUM, 0, adaptive.T_END, 48)[0].astype(float)
    beside = np.array([1.0, -1 / 3])

    def run(system, q, p, t_end, tol):
        assert t_end == adaptive.T_END
        return np.split(truth + tol * beside, 2)

    row = adaptive.tolerances(subject(run), entry, 0)
    tols = np.array(row["tolerances"])
    assert row["errors"] == pytest.approx(tols / abs(truth).max(), rel=1e-4)
    ends = truth + tols[:, None] * beside
    energies = [y[1] ** 2 / 2 - np.cos(y[0]) for y in (entry.start(0), *ends)]
    assert row["energy"] == pytest.approx(abs(np.array(energies[1:]) - energies[0]), abs=1e-15)
    assert (row["repeats"], row["evaluations"]) == (True, [0, 0, 0, 0])
    assert tols[1:] == pytest.approx(tols[:-1] / 100), "so that an order can be seen"
    assert tols[-1] == 1e-10


# -- coefficients -----------------------------------------------------------------------------------------------------

TRAPEZOIDAL = {"A": [[0, 0], ["1/2", "1/2"]], "b": ["1/2", "1/2"]}


@pytest.mark.parametrize(
    ("record", "end", "slopes"),
    [
        ({"A": [[0, 0], [1, 0]], "b": ["1/2", "1/2"]}, (0.875, -0.5), 2),
        ({"A": [["1/2"]], "b": [1]}, (15 / 17, -8 / 17), None),
        (TRAPEZOIDAL, (15 / 17, -8 / 17), None),
    ],
)
def test_one_step_of_a_tableau(record, end, slopes):
    """A Runge-Kutta step on the oscillator from (1, 0) at h = 1/2; an explicit method evaluates each stage once."""
    stepper = Stepper(subject(record), battery.oscillator())
    assert stepper(np.array([1.0, 0.0]), 0.5) == pytest.approx(end, abs=1e-15)
    assert slopes is None or list(stepper.system.evaluations) == [slopes, slopes]


# -- which measurements are made --------------------------------------------------------------------------------------


@pytest.fixture
def places(monkeypatch):
    """Replace the certificate's runs against the fastest methods, and their timing, by ones that cost nothing.

    The fixture is the list of the scenes that were run.
    """
    asked = []
    monkeypatch.setattr(measures, "scenes", lambda chosen: ["near", "far"])
    monkeypatch.setattr(measures, "place", lambda chosen, scene: asked.append(scene) or {"on": scene, "errors": []})
    told = {"near": {"on": "near"}, "far": None}
    monkeypatch.setattr(measures, "timed_or_failed", lambda chosen, row, run: told[row["on"]])
    return asked


def adapting(system, q, p, t_end, tol):
    """A user's integrator with a tolerance: 40 leapfrog steps, whatever the tolerance is."""
    for _ in range(40):
        q, p = leapfrog(system, q, p, t_end / 40)
    return q, p


def test_adaptive_method_is_placed_unless_alone(places):
    certificate.certify(adapting, requires=("separable",), alone=True)
    assert places == []
    certificate.certify(adapting, requires=("separable",))
    assert places == ["near", "far"]


def test_step_is_placed_and_timed_if_consistent(places):
    chosen, tables = build_integrator(leapfrog), Tables()
    measures._step(chosen, tables, 0, print, set(), entries(chosen), [])
    measures._place(chosen, tables, print)
    assert places == ["near", "far"]
    assert measures._times(chosen, tables, print) == [{"on": "near"}], "of some nothing can be told"
    measures._place(chosen, Tables(), print)
    assert places == ["near", "far"]


def test_requirement_that_no_system_meets_is_reported():
    found = certificate.certify(subject(leapfrog, {}, ("Kepler part",)), alone=True)
    assert found.verdict == "not-judged"
    assert (
        "none of the systems is of the kind that it requires: method 'leapfrog' requires"
        in next(j for j in found.claims if j.name == "runs").why
    )


def test_round_off_is_measured_on_the_second_system(monkeypatch):
    monkeypatch.setattr(conservation, "round_off", lambda chosen, entry, seed: {"on": entry.name})
    chosen, tables = build_integrator(leapfrog), Tables()
    measures._step(chosen, tables, 0, print, {"round_off"}, entries(chosen), [])
    assert tables.rows["round_off"] == [{"on": "henon-heiles"}]

    def doubles(system, q, p, h):
        return tuple(x.astype(float) for x in leapfrog(system, q, p, h))

    chosen, tables = build_integrator(doubles), Tables()
    assert measures._step(chosen, tables, 0, print, {"round_off"}, entries(chosen), []) != ""
    assert "round_off" not in tables.rows


def test_python_and_command_use_the_same_seed(monkeypatch):
    asked = []

    def certify(target, claims, requires, seed, **more):
        asked.append((claims, requires, seed))
        return certificate.Certificate("mine", [], [], "pass", Tables(), "", (), seed, 0.0)

    monkeypatch.setattr(certificate, "certify", certify)
    certificate.validate(leapfrog, requires="separable", order=2)
    certificate.validate(leapfrog, seed=5)
    assert asked == [({"order": 2}, ("separable",), 0), ({}, (), 5)]


# -- import of targets, the document ----------------------------------------------------------------------------------


def test_target_is_imported_from_the_working_folder(tmp_path, monkeypatch):
    for folder, first in (("elsewhere", "q"), ("here", "p")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "twice_here.py").write_text(f"def step(system, q, p, h):\n    return {first}, {first}\n")
    monkeypatch.setattr(sys, "path", [x for x in sys.path if x not in ("", str(tmp_path / "here"))])
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path / "here")
    before = [*sys.path]
    assert subject("twice_here:step").own.step(None, 1, 2, 0) == (2, 2)
    assert sys.path == before


LIKE = {"low": 1.9, "high": 2.1, "separable": True}
PLACES = [
    {"error": 1e-2, "evaluations": 300.0, "factor": 1.5, "cheapest": "pefrl", "its evaluations": 200.0},
    {"error": 1e-4, "evaluations": None, "factor": None, "cheapest": "gauss-8", "its evaluations": 700.0},
]


def render_with(**more) -> str:
    """The text of a certificate with fabricated measurements, some of them replaced."""
    order = [
        {"on": "pendulum", "value": 2.0, "arithmetic": "multiprecision", **LIKE},
        {"on": "tao", "value": 2.0, "arithmetic": "double", **LIKE},
    ]
    symmetric = [{"on": "pendulum", "value": 2e-30}, {"on": "tao", "status": "failed", "reason": "with -h: no"}]
    round_off = {"on": "henon-heiles", "mean": 0.1, "deviation": 0.5, "steps": 256, "biased": False}
    rows = {"order": order, "symmetric": symmetric, "round_off": [round_off]} | more
    found = certificate.Certificate("mine", [], ["order=2", "symplectic"], "pass", Tables(rows), "", (), 0, 1.0)
    return render.document(found, [])


def test_document_states_the_digits_of_each_measurement():
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in render_with().splitlines() if "|" in line]
    head = next(line for line in lines if line[0] == "system")
    rows = {line[0]: dict(zip(head, line, strict=True)) for line in lines if line[0] in ("pendulum", "tao")}
    assert (rows["pendulum"]["digits"], rows["tao"]["digits"]) == ("40", "16")
    assert rows["pendulum"]["symmetric defect"].startswith("2")
    assert rows["tao"]["symmetric defect"] == "not measured"
    assert "Measured and not claimed: order=2, symplectic." in render_with()


def test_document_lists_errors_by_tolerance():
    text = render_with(tolerance=[{"on": "quartic", "tolerances": [1e-4, 1e-10], "errors": [0.002, 3e-9]}])
    assert "relative errors at tolerances 1e-04, 1e-10" in text
    assert next(line for line in text.splitlines() if "quartic" in line).rstrip("| ").endswith("0.002, 3.00e-09")
    assert "Errors are relative to the largest component of the state" in " ".join(text.split())


@pytest.mark.parametrize(
    ("biased", "grows"), [(True, "not 0: it adds up as t"), (False, "0 as far as can be seen: as the root of t")]
)
def test_document_describes_round_off_growth(biased, grows):
    row = {"on": "henon-heiles", "mean": 0.1, "deviation": 0.5, "steps": 256, "biased": biased}
    text = " ".join(render_with(round_off=[row]).split())
    assert f"over 256 steps on henon-heiles: its mean is {grows}" in text


def test_document_compares_gradient_evaluations():
    assert "fronts of the trade" not in render_with()
    text = render_with(place=[{"on": "pendulum-short", "errors": PLACES}])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if "pendulum-short" in line]
    assert ["pendulum-short", "1e-02", "300", "pefrl", "200", "1.5"] in rows
    assert ["pendulum-short", "1e-04", "not reached", "gauss-8", "700", ""] in rows
