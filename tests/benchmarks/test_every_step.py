"""One run that is watched at every step: the same states as a run whose rows are all kept, in less memory."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.measure import every_step
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, driver
from phasebench.reference.peers import Peer

NOTHING = {"h": None, "t_end": None, "steps": None, "q0": None, "p0": None}
#: problem, method, h, steps: one that is solved, one that keeps the energy, one that blows up, one that is not solved.
RUNS = [
    ("henon-heiles:box", "stormer-verlet", 0.1, 1003),
    ("kepler", "scheme-v", 0.05, 1003),
    ("henon-heiles:box", "rk4", 2.0, 503),
    ("henon-heiles:chaotic", "implicit-midpoint", 3.0, 503),
]


def watched(name: str, method, h: float, steps: int, **more):
    return every_step.watch(problem(name), integrator(method), **(NOTHING | {"h": h, "steps": steps} | more))


@pytest.fixture
def small(monkeypatch):
    """Pieces of 77 steps at the most of two degrees of freedom, so that there are many."""
    monkeypatch.setattr(every_step, "BUFFER", 154)


@pytest.mark.parametrize("every", [None, 1, 7])
@pytest.mark.parametrize("run", RUNS, ids=lambda run: f"{run[0]}, {run[1]}")
def test_rows_and_extremes_are_those_of_a_run_that_keeps_all(small, run, every):
    name, method, h, steps = run
    made = problem(name)
    whole = driver.integrate(made, method, h=h, steps=steps)
    found = watched(*run, every=every)
    rows = sorted({*range(0, len(whole.t), every or 1), len(whole.t) - 1})
    s = found.solution
    assert (s.status, s.counts["steps"]) == (whole.status, whole.counts["steps"])
    assert np.array_equal(s.t, whole.t[rows])
    assert np.array_equal(s.q, whole.q[rows])
    assert np.array_equal(s.p, whole.p[rows])
    H = made.system.energies(whole.q, whole.p)
    assert found.extremes.energy.worst == np.abs(H - H[0]).max()
    assert found.extremes.energy.end == H[-1] - H[0]
    for invariant, extreme in found.extremes.invariants.items():
        values = made.invariant(invariant, whole.q, whole.p)
        assert extreme.worst == np.abs(values - values[0]).max()


def test_what_happens_between_rows_is_seen(small):
    """Control: of the rows that are kept alone the error would be smaller."""
    name, method, h, steps = RUNS[0]
    found = watched(name, method, h, steps, every=500)
    made, s = problem(name), found.solution
    H = made.system.energies(s.q, s.p)
    assert found.extremes.energy.worst > 1.2 * np.abs(H - H[0]).max()


def test_a_run_is_judged_by_the_rows_between_too(small, monkeypatch):
    """The pendulum at a wide step: its energy error comes and goes, and is small at the rows that are kept."""
    monkeypatch.setattr(every_step, "KEPT", 2)
    name, method, h, steps = RUNS[2]
    assert (
        watched(name, method, h, steps).solution.status
        == driver.integrate(problem(name), method, h=h, steps=steps).status
    )
    lost = watched("harmonic-oscillator", "stormer-verlet", 1.999, 1001)
    assert (
        lost.solution.status
        == driver.integrate(problem("harmonic-oscillator"), "stormer-verlet", h=1.999, steps=1001).status
        != "ok"
    )


def test_a_step_of_ones_own_is_watched_as_a_method_is(small):
    from phasebench.benchmarks.measure.own_step import from_function

    def step(system, q, p, h):
        p = p - h / 2 * system.dH_dq(q, p)
        q = q + h * system.dH_dp(q, p)
        return q, p - h / 2 * system.dH_dq(q, p)

    name, method, h, steps = RUNS[0]
    own, ours = watched(name, from_function(step), h, steps, every=10), watched(name, method, h, steps, every=10)
    assert own.solution.q == pytest.approx(ours.solution.q, abs=1e-11)
    assert own.extremes.energy.worst == pytest.approx(ours.extremes.energy.worst, rel=1e-6)
    assert own.solution.method.step is step


def test_rows_that_do_not_fit_are_refused_with_the_option_that_helps():
    with pytest.raises(InvalidInput, match="--every"):
        watched("henon-heiles:box", "stormer-verlet", 0.1, 10**10, every=1)


def test_more_steps_than_fit_in_memory_run_until_the_time_is_over():
    arguments = ["integrate", "henon-heiles:box", "stormer-verlet", "--h", "0.001", "--steps", "10000000000"]
    done = CliRunner().invoke(app, [*arguments, "--timeout", "0.3", "--json"])
    found = json.loads(done.stdout)
    assert found["status"] == "timeout"
    assert found["steps"] > 1000
    assert found["t"] == pytest.approx(0.001 * found["steps"])
    assert 0 < found["energy_error"]["max"] < 1e-8


# -- one run, and its time ---------------------------------------------------------------------------------------------


@pytest.fixture
def runs(monkeypatch):
    """The runs that are made: ("watched" or "bare", steps); a bare one says that it took 1 s for each 1000 steps."""
    made = []
    watch, run = every_step.watch, Integrator.run

    def watching(problem, integrator, **options):
        found = watch(problem, integrator, **options)
        made.append(("watched", found.solution.counts["steps"]))
        taken = found.solution.counts["steps"] * 3e-3
        return found._replace(solution=replace(found.solution, seconds=taken))

    def bare(self, problem, **options):
        found = run(self, problem, **options)
        if options.get("save_every", 1) == 0 and not isinstance(self.record, Peer):
            made.append(("bare", found.counts["steps"]))
            found = replace(found, seconds=found.counts["steps"] * 1e-3)
        return found

    monkeypatch.setattr(every_step, "watch", watching)
    monkeypatch.setattr(Integrator, "run", bare)
    return made


def printed(*arguments: str):
    done = CliRunner().invoke(app, ["integrate", "henon-heiles:box", "pefrl", *arguments, "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_seconds_are_those_without_rows(runs):
    """Of a short run they are a second run's; that of the run with its rows is three times as long here."""
    found = printed("--h", "0.1", "--steps", "50")
    assert found["seconds"] == pytest.approx(0.05)
    assert runs == [("watched", 50), ("bare", 50)]


def test_a_long_run_is_made_once(runs):
    """Parts of it are made again, each both ways, and their ratio tells the time without rows."""
    found = printed("--h", "0.1", "--steps", "20000")
    assert found["seconds"] == pytest.approx(20.0)
    assert runs[0] == ("watched", 20000)
    again = sum(steps for _, steps in runs[1:])
    assert 0 < again < 0.1 * 20000
    assert {kind for kind, _ in runs[1:]} == {"watched", "bare"}


@pytest.mark.parametrize("method", ["pefrl", "gauss-4", "rebound-leapfrog"])
def test_the_error_is_that_of_the_state_which_is_printed(method):
    from phasebench.reference.certificates import stored

    made = problem("henon-heiles:box")
    done = CliRunner().invoke(
        app, ["integrate", made.label, method, "--h", "0.01", "--t-end", "10", "--error", "--json"]
    )
    found, end = json.loads(done.stdout), stored.end(made, 10.0)
    off = max(np.abs(np.array(found["q"]) - end.q).max(), np.abs(np.array(found["p"]) - end.p).max())
    assert found["global_error"] == off
