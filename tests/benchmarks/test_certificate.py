"""`validate`: what it accepts and prints, and its measurements on steps whose answer is known."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.certificate import (
    adaptive,
    battery,
    conservation,
    fronts,
    measures,
    order,
    structure,
    times,
)
from phasebench.benchmarks.certificate.certificate import certify
from phasebench.benchmarks.certificate.render import write
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.cli.validate import WIDEST
from phasebench.benchmarks.judge import checks
from phasebench.benchmarks.judge.evidence import Tables
from phasebench.integrators.compile.codegen import DOUBLE, MULTIPRECISION
from phasebench.integrators.errors import InvalidInput
from support.commands import call
from support.steps import euler, leapfrog

PENDULUM = battery.find_entry("pendulum")
LEAPFROG = {"a": [1], "b": ["1/2", 0.5]}
HEUN = {"A": [[0, 0], [1, 0]], "b": ["1/2", "1/2"]}

# -- targets -----------------------------------------------------------------------------------------------------------


def test_target_is_a_callable_a_file_coefficients_or_a_name(tmp_path, monkeypatch):
    """A module is that of the working folder; sys.path stays as it is."""
    for folder, first in (("elsewhere", "q"), ("here", "p")):
        (tmp_path / folder).mkdir()
        text = f"def step(system, q, p, h):\n    return {first}, {first}\n"
        text += "def run(system, q, p, t_end, tol):\n    return q, p\n"
        (tmp_path / folder / "mine_here.py").write_text(text)
    (tmp_path / "here" / "c.json").write_text(json.dumps(LEAPFROG | {"claims": {"order": 2}}))
    monkeypatch.setattr(sys, "path", [x for x in sys.path if x not in ("", str(tmp_path / "here"))])
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path / "here")
    before = [*sys.path]
    assert subject("mine_here:step").own.step(None, 1, 2, 0) == (2, 2)
    assert sys.path == before
    assert [subject(x).adaptive for x in ("mine_here:run", "mine_here:step", "heyoka")] == [True, False, True]
    assert subject("./mine_here.py", {"order": 3}).own.claims == {"order": 3}
    assert subject("c.json").own.claims == {"order": 2}
    assert subject(LEAPFROG).own.requires == ("separable",)
    assert subject("rk4").own.claims["order"] == 4


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (3, "give a path"),
        ({"a": [1], "b": ["x"]}, "no number"),
        ({"a": [1], "b": [1, 2, 3]}, "alternate"),
        ({"a": [1]}, "for a splitting"),
        ({"A": [[0]], "b": [1, 2]}, "2 rows"),
        (LEAPFROG | {"d": 1}, "'d'"),
    ],
)
def test_invalid_target_is_refused(target, said):
    """Names, files and claims are in `bad_input.txt`."""
    with pytest.raises(InvalidInput, match=said):
        subject(target)


@pytest.mark.parametrize(
    ("record", "end", "slopes"),
    [
        (HEUN, (0.875, -0.5), 2),
        ({"A": [["1/2"]], "b": [1]}, (15 / 17, -8 / 17), None),
        ({"A": [[0, 0], ["1/2", "1/2"]], "b": ["1/2", "1/2"]}, (15 / 17, -8 / 17), None),
        (LEAPFROG, (0.875, -0.46875), None),
    ],
)
def test_one_step_of_coefficients(record, end, slopes):
    """A step on the oscillator from (1, 0) at h = 1/2; an explicit Runge-Kutta method evaluates each stage once."""
    stepper = Stepper(subject(record), battery.oscillator())
    assert stepper(np.array([1.0, 0.0]), 0.5) == pytest.approx(end, abs=1e-15)
    assert slopes is None or list(stepper.system.evaluations) == [slopes, slopes]


# -- output ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def claimed_alone(monkeypatch):
    """Measure claimed properties only; the command in the README measures all of them."""
    monkeypatch.setattr(measures, "EVERYTHING", set())


def test_exit_codes_json_and_lines(tmp_path, monkeypatch, claimed_alone):
    path = tmp_path / "heun.json"
    path.write_text(json.dumps(HEUN))
    done = call("validate", path, "--claim", "order=2", "--json")
    found = json.loads(done.stdout)
    assert (done.exit_code, found["verdict"]) == (0, "pass")
    assert list(found)[:4] == ["integrator", "claims", "measured", "verdict"]
    assert all(list(c) == ["claim", "verdict", "measured", "interval", "on", "why"] for c in found["claims"])
    monkeypatch.setenv("COLUMNS", "40")
    wrong = call("validate", path, "--claim", "order=3")
    assert wrong.exit_code == 1
    assert any(line.startswith("  order 3: contradicted (") for line in wrong.stdout.splitlines())
    unclaimed = call("validate", path, "--json")
    assert (unclaimed.exit_code, json.loads(unclaimed.stdout)["verdict"]) == (1, "not-judged")


def test_certificate_is_reproducible_for_a_seed(tmp_path):
    texts = []
    for k, seed in enumerate((0, 0, 1)):
        found = certify(HEUN, {"order": 2}, seed=seed, alone=True)
        (path, *_) = write(found, tmp_path / str(k))
        whole = json.loads(path.read_text())
        assert whole.pop("seconds") > 0
        whole.pop("times")
        texts.append((json.dumps(whole), (tmp_path / str(k) / "certificate.html").read_bytes()))
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]
    assert "order 2" in (tmp_path / "0" / "certificate.md").read_text()


def test_python_interface_returns_a_table(claimed_alone):
    found = pb.validate(HEUN, order=2, requires="separable")
    frame = found.to_frame()
    assert list(frame.columns) == ["claim", "verdict", "measured", "interval", "on", "why"]
    assert found.verdict == frame.attrs["verdict"] == "pass"
    assert found.claims[-1].claim == frame["claim"].tolist()[-1] == found["claim"].tolist()[-1] == "order 2"
    assert len(found.plot("order").axes[0].lines) > 1
    for wrong in (lambda: found.plot("oder"), lambda: pb.validate(HEUN, ordr=2)):
        with pytest.raises(InvalidInput, match="did you mean order"):
            wrong()


def priced(evaluations=(23.0, 31.4), high=110.0):
    """(tables, times) of a step that takes 100 and 2.34 times the time of the cheapest at errors 1e-2 and 1e-4."""
    errors = [{"error": 10.0 ** (-2 * k), "factor": f} for k, f in enumerate(evaluations, 1)]
    timed = [{"error": 1e-2, "low": 90.0, "factor": 100.0, "high": high}]
    timed.append({"error": 1e-4, "low": 1.0, "factor": 2.34, "high": 1e9})
    times = [{"on": "double-pendulum-chaotic", "errors": timed, "python": None}]
    return Tables({"place": [{"on": "double-pendulum-chaotic", "errors": errors}]}), times


def test_costs_beside_the_cheapest_method():
    rows = times.cost_rows(*priced())
    assert [(r["error"], r["evaluations"], r["time"]) for r in rows] == [(1e-2, 23.0, 100.0), (1e-4, 31.4, 2.34)]
    for high, varies in ((180.0, False), (180.1, True)):
        row = times.cost_rows(*priced(high=high))[0]
        assert (row["time"] is None, row["varies"]) == (varies, varies)
    assert max(map(len, times.format_costs(*priced()))) <= WIDEST
    assert sum(times.NOT_MET in line for line in times.format_costs(*priced((None, None)))) == 1
    assert times.format_costs(Tables({}), []) == []


# -- orders ------------------------------------------------------------------------------------------------------------


def stepper(step, arithmetic=MULTIPRECISION) -> Stepper:
    return Stepper(subject(step), PENDULUM, arithmetic)


@pytest.mark.parametrize(("step", "p"), [(euler, 1), (leapfrog, 2), (times.runge_kutta, 4)])
def test_order_of_known_steps(step, p):
    for arithmetic in (DOUBLE, MULTIPRECISION):
        row = order.order(stepper(step, arithmetic), 1)
        assert row["value"] == pytest.approx(p, abs=0.1)
        assert row["low"] <= row["value"] <= row["high"]
        assert len(row["h"]) == len(row["error"]) == len(battery.LADDER)
        assert (row["h"][0], row["on"], row["arithmetic"]) == (float(battery.SPAN), "pendulum", arithmetic)
        if arithmetic == DOUBLE:
            assert row["constant"] <= row["doubt"] < 1e-8, "nothing is left of a consistent step as h falls"
    assert row["clean"] == p
    found = order.series(stepper(step), 1)
    assert (found.clean, len(found.terms), found.largest(p) < 1e-60) == (p, order.TERMS, True)
    assert 0.01 < found.terms[p] < 10


def test_errors_are_relative_to_the_size_of_the_state():
    """The error of a step that does nothing is the orbit's displacement, relative to the size of its end."""
    _, away, _ = order.ladder_errors(stepper(lambda system, q, p, h: (q + 0 * h, p + 0 * h), DOUBLE), 1)
    start, (end, _) = PENDULUM.start(1), order.flow(PENDULUM, 1, battery.SPAN)
    end = end.astype(float)
    expected = [np.abs(start - end).max() / np.abs(end).max()] * len(battery.LADDER)
    assert np.abs(away).max(axis=1) == pytest.approx(expected)


# -- long runs ---------------------------------------------------------------------------------------------------------


def separable(step):
    return subject(step, {}, ("separable",))


class Failing:
    """A step that returns its argument and fails at call number ``lasts(h)``: it raises ``raised``, or returns NaN.

    ``asked`` counts the calls by step size.
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


def test_failed_long_run_is_repeated_with_half_the_step():
    """At the shortest h, 20 calls that count gradients come first."""
    shorter = Failing(lambda h: 300 if h > 0.06 else np.inf, FloatingPointError("overflow"))
    row = conservation.long_run(separable(shorter), PENDULUM, 0)
    assert (row["status"], row["h"], row["time"]) == ("ok", 0.05, 0.05 * 2400)
    assert set(shorter.asked) == {0.2, 0.1, 0.05, 0.025}
    last = Failing(lambda h: 2420 if h < 0.03 else 2400)
    row = conservation.long_run(separable(last), PENDULUM, 0)
    assert (row["status"], row["on"]) == ("diverged", "pendulum")
    assert row["reason"] == "after 2400 steps of h = 0.025 the state was not finite"
    assert last.asked == {0.2: 2400, 0.1: 2400, 0.05: 2400, 0.025: 2420}
    with pytest.raises(StepFailed, match="KeyError"):
        conservation.long_run(separable(Failing(lambda h: 30, KeyError("x"))), PENDULUM, 0)


def test_energy_error_and_slope_of_a_run():
    """Against a closed form, for a step on H = p^2/2 that increases p."""
    entry = battery.Entry("flat", battery._one("p**2/2 + 0*q"), (0.0, 1.0))
    row = conservation.long_run(separable(lambda system, q, p, h: (q + h * p, np.sqrt(p * p + 2e-3 * h))), entry, 0)
    assert row["energy"]["low"] < row["energy"]["slope"] < row["energy"]["high"]
    assert row["energy"]["slope"] == pytest.approx(1e-3, rel=1e-6)
    assert row["energy"]["time"] == pytest.approx(480.0)
    assert row["curve"][-1] == pytest.approx([480.0, 0.48])
    assert len(row["curve"]) == 401


# -- structure, state between calls, digits ----------------------------------------------------------------------------


@pytest.mark.parametrize("rough", [(1, 0), (0, 1)])
def test_round_off_is_detected_in_every_component(rough):
    def rounded(system, q, p, h):
        q, p = leapfrog(system, q, p, h)
        return tuple(x * (1 + (float(x[0]) / x[0] - 1) * of) for x, of in zip((q, p), rough, strict=True))

    smooth, not_smooth = (
        structure.smooth(Stepper(separable(s), PENDULUM, MULTIPRECISION), 0) for s in (leapfrog, rounded)
    )
    assert smooth < structure.SMOOTH < 1e-18 < not_smooth


def test_tolerance_errors_of_state_and_energy():
    """The measured errors of a made-up run that is off by its tolerance in q and by a third of it in p."""
    truth, beside = order.flow(PENDULUM, 0, adaptive.T_END, 48)[0].astype(float), np.array([1.0, -1 / 3])

    def run(system, q, p, t_end, tol):
        assert t_end == adaptive.T_END
        return np.split(truth + tol * beside, 2)

    row = adaptive.tolerances(subject(run), PENDULUM, 0)
    tols = np.array(row["tolerances"])
    assert row["errors"] == pytest.approx(tols / abs(truth).max(), rel=1e-4)
    energies = [y[1] ** 2 / 2 - np.cos(y[0]) for y in (PENDULUM.start(0), *(truth + tols[:, None] * beside))]
    assert row["energy"] == pytest.approx(abs(np.array(energies[1:]) - energies[0]), abs=1e-15)
    assert (row["repeats"], row["evaluations"]) == (True, [0, 0, 0, 0])
    assert tols[1:] == pytest.approx(tols[:-1] / 100), "so that an order can be seen"


# -- the battery, and what is measured ---------------------------------------------------------------------------------


def test_systems_of_the_battery():
    """A seed moves every component both ways; states have size one; reversibility is declared."""
    entries = {e.name: e for e in (*battery.entries(), *battery.lasting(), battery.oscillator())}
    for name, entry in entries.items():
        moved = np.array([entry.start(seed) - entry.state for seed in range(40)]) / battery.MOVED
        assert (abs(moved) < 1).all(), name
        assert (moved.min(axis=0) < -0.7).all(), name
        assert (moved.max(axis=0) > 0.7).all(), name
        assert (entry.start(3) == entry.start(3)).all()
        assert np.linalg.norm(entry.state) < 1.5
        q, p = np.split(entry.start(0), 2)
        H = entry.system.observe(entry.system.H, *np.array([[q, q], [p, -p]]))
        assert entry.reversible == (abs(H[0] - H[1]) < 1e-14), name
    assert all(2 * n in battery.LADDER for n in battery.LADDER if n <= 32)
    assert float(battery.SPAN) == battery.SPAN


# -- the pytest plugin -------------------------------------------------------------------------------------------------


ROOT = Path(__file__).resolve().parents[2]
PLUGIN = "phasebench.benchmarks.certificate.plugin"
TUTORIAL = (ROOT / "docs" / "tutorials" / "certificate-in-ci.md").read_text()
#: Needed where the plugin is not registered as an entry point.
REGISTERED = bool(importlib.metadata.entry_points(group="pytest11", name="phasebench"))
LOAD = () if REGISTERED else ("-p", PLUGIN)


@pytest.fixture
def project(tmp_path):
    """A project with the tutorial's integrator, in its first version, and its test."""
    for name, code in reversed(re.findall(r"%%writefile (\S+)\n(.*?)```", TUTORIAL, re.DOTALL)):
        (tmp_path / name).write_text(code)
    return tmp_path


def run(project, *arguments):
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, cwd=project, env=dict(os.environ), capture_output=True, text=True, check=False)


def test_tutorials_test_passes_and_fails_readably(project):
    done = run(project, "pytest", *LOAD, "-q", "test_my_integrator.py")
    assert done.returncode == 0, done.stdout + done.stderr
    step = project / "my_integrator.py"
    step.write_text(step.read_text().replace("h / 2", "h / 3"))
    done = run(project, "pytest", *LOAD, "-q", "test_my_integrator.py")
    assert done.returncode == 1
    assert "consistent: contradicted" in done.stdout
    assert "Traceback" not in done.stdout
    assert "certificate.py" not in done.stdout


#: A test that prints the heavy modules imported by a pytest run without the fixture.
UNUSED = """
def test_nothing_else():
    import json, sys
    heavy = ("phasebench.integrators.driver", "phasebench.integrators.systems")
    heavy += ("sympy", "numba", "numpy", "scipy", "pandas", "matplotlib")
    print("LOADED", json.dumps([m for m in heavy if m in sys.modules]))
"""


def test_unused_plugin_imports_nothing_heavy(tmp_path):
    (tmp_path / "test_other.py").write_text(UNUSED)
    others = ("-p", "no:hypothesispytest", "-p", "no:jaxtyping", "-p", "no:benchmark")
    done = run(tmp_path, "pytest", *LOAD, *others, "-q", "-s", "test_other.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads(re.search(r"LOADED (.*)", done.stdout)[1]) == []


def test_true_claims_return_and_false_claims_fail(request):
    claims_hold = importlib.import_module(PLUGIN).claims_hold
    for requires in ("separable", ("separable",)):
        found = claims_hold(leapfrog, requires=requires, order=2)
        assert (found.verdict, found.requires, found.seed, found.offers) == ("pass", ("separable",), 0, [])
    with pytest.raises(pytest.fail.Exception, match="order 3: contradicted") as failure:
        claims_hold(leapfrog, requires="separable", seed=4, order=3)
    assert not failure.value.pytrace, "what is wrong is no line of ours"
    with pytest.raises(TypeError):
        claims_hold(leapfrog, "separable")
    if REGISTERED:
        assert request.getfixturevalue("phasebench_claims")(leapfrog, requires="separable", order=2).verdict == "pass"


def test_what_lies_between_the_floor_and_a_defect_is_told_where_it_is_greatest():
    seen = [("pendulum", 0.5, 3e-12, 1e-12), ("kepler", 0.25, 2e-13, 5e-14), ("coupled", 0.1, 1e-13, 1e-12)]
    rows = [dict(zip(("on", "h", "value", "floor"), r, strict=True)) for r in seen]
    found = checks._unseen(rows)
    assert found.verdict == "not judged"
    assert "2.0e-13 at h = 0.25 on kepler" in found.why
    assert "above the floor" in checks._unseen(rows[2:]).why


def test_the_cheapest_of_each_scene_and_error():
    text = [("a", "0.01", "x", "12"), ("a", "1e-4", "y", "40"), ("b", "0.01", "z", "7")]
    found = fronts.parse([dict(zip(("scene", "error", "integrator", "evaluations"), r, strict=True)) for r in text])
    assert found == {"a": {0.01: ("x", 12.0), 1e-4: ("y", 40.0)}, "b": {0.01: ("z", 7.0)}}
