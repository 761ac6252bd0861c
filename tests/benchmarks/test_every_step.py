"""A run observed at every step has the states of a run that saves every row, in less memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phasebench.benchmarks.measure import every_step
from phasebench.benchmarks.measure.integrator import Integrator, integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, driver
from phasebench.reference.peers import Peer
from support.commands import call, integrate_json, run_json
from support.steps import leapfrog

NOTHING = {"h": None, "t_end": None, "steps": None, "q0": None, "p0": None}
#: (problem, method, h, steps): explicit, energy-preserving, blowing up, and with a failing solver.
RUNS = [
    ("henon-heiles:box", "stormer-verlet", 0.1, 1003),
    ("kepler", "scheme-v", 0.05, 1003),
    ("henon-heiles:box", "rk4", 2.0, 503),
    ("henon-heiles:chaotic", "implicit-midpoint", 3.0, 503),
]


def watch_run(name: str, method, h: float, steps: int, **more):
    """The run of an integrator on a problem, observed at every step."""
    return every_step.watch(problem(name), integrator(method), **(NOTHING | {"h": h, "steps": steps} | more))


@pytest.fixture
def small(monkeypatch):
    """Let the buffer hold 77 steps of two degrees of freedom, so that a run fills it many times."""
    monkeypatch.setattr(every_step, "BUFFER", 154)


@pytest.mark.parametrize("every", [None, 1, 7])
@pytest.mark.parametrize("run", RUNS, ids=lambda run: f"{run[0]}, {run[1]}")
def test_rows_and_extremes_equal_those_of_a_full_run(small, run, every):
    name, method, h, steps = run
    made = problem(name)
    whole = driver.integrate(made, method, h=h, steps=steps)
    found = watch_run(*run, every=every)
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


def test_extremes_between_saved_rows_are_seen(small):
    """Observing every step finds a larger energy error than the saved rows show."""
    name, method, h, steps = RUNS[0]
    found = watch_run(name, method, h, steps, every=500)
    made, s = problem(name), found.solution
    H = made.system.energies(s.q, s.p)
    assert found.extremes.energy.worst > 1.2 * np.abs(H - H[0]).max()


def test_status_uses_the_steps_between_saved_rows(small, monkeypatch):
    """The oscillator at a large h: its energy error oscillates and is small at the saved rows."""
    monkeypatch.setattr(every_step, "KEPT", 2)
    name, method, h, steps = RUNS[2]
    assert (
        watch_run(name, method, h, steps).solution.status
        == driver.integrate(problem(name), method, h=h, steps=steps).status
    )
    lost = watch_run("harmonic-oscillator", "stormer-verlet", 1.999, 1001)
    assert (
        lost.solution.status
        == driver.integrate(problem("harmonic-oscillator"), "stormer-verlet", h=1.999, steps=1001).status
        != "ok"
    )


def test_user_step_is_observed_like_a_method(small):
    name, method, h, steps = RUNS[0]
    own, ours = (watch_run(name, m, h, steps, every=10) for m in (leapfrog, method))
    assert own.solution.q == pytest.approx(ours.solution.q, abs=1e-11)
    assert own.extremes.energy.worst == pytest.approx(ours.extremes.energy.worst, rel=1e-6)
    assert own.solution.method.step is leapfrog


def test_too_many_rows_are_refused_with_a_hint():
    with pytest.raises(InvalidInput, match="--every"):
        watch_run("henon-heiles:box", "stormer-verlet", 0.1, 10**10, every=1)


def test_long_run_ends_at_the_time_limit():
    run = ("henon-heiles:box", "stormer-verlet", "--h", "0.001", "--steps", "10000000000")
    _, found = run_json(*run, "--time-limit", "0.3")
    assert found["status"] == "timeout"
    assert found["steps"] > 1000
    assert found["t"] == pytest.approx(0.001 * found["steps"])
    assert 0 < found["energy_error"]["max"] < 1e-8


# -- the time of a run -------------------------------------------------------------------------------------------------


@pytest.fixture
def runs(monkeypatch):
    """The list of the runs made, each ("watched" if observed at every step or "bare", number of steps).

    The clock is fabricated: 1000 steps take 1 s bare and 3 s observed.
    """
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


def test_seconds_exclude_the_observation(runs):
    """A short run is repeated bare; observed, it takes three times as long here."""
    found = integrate_json("henon-heiles:box", "pefrl", "--h", "0.1", "--steps", "50")
    assert found["seconds"] == pytest.approx(0.05)
    assert runs == [("watched", 50), ("bare", 50)]


def test_long_run_is_not_repeated(runs):
    """Short parts are repeated with and without observation; their ratio gives the time without."""
    found = integrate_json("henon-heiles:box", "pefrl", "--h", "0.1", "--steps", "20000")
    assert found["seconds"] == pytest.approx(20.0)
    assert runs[0] == ("watched", 20000)
    again = sum(steps for _, steps in runs[1:])
    assert 0 < again < 0.1 * 20000
    assert {kind for kind, _ in runs[1:]} == {"watched", "bare"}


@pytest.mark.parametrize("method", ["shake", "rk4"])
def test_a_long_run_with_constraints_is_timed(method, monkeypatch):
    """Its later states may be off the constraints by more than a start may be."""
    monkeypatch.setattr(every_step, "SHORT", 0.0)
    assert integrate_json("spherical-pendulum", method, "--h", "0.01", "--t-end", "100")["seconds"] > 0


def test_shake_may_start_off_the_hidden_constraints():
    start = ["--q", "1,0,0", "--p", "0.1,0.75,0.25", "--h", "0.01", "--t-end", "0.1"]
    codes = [call("integrate", "spherical-pendulum", id, *start).exit_code for id in ("shake", "rattle")]
    assert codes == [0, 2]


def test_the_trajectory_is_kept_where_an_error_cannot_be_told(tmp_path):
    """A trajectory's error is told from 20 times: 21 steps are no multiple."""
    words = ["integrate", "pendulum", "pefrl", "--h", "0.1", "--steps", "21", "--quantity", "trajectory"]
    done = call(*words, "--output", tmp_path / "t.csv")
    assert done.exit_code == 2
    assert "must be a multiple" in " ".join(done.output.split())
    assert len((tmp_path / "t.csv").read_text().splitlines()) == 23


@pytest.mark.parametrize("method", ["pefrl", "gauss-4", "rebound-leapfrog"])
def test_printed_error_belongs_to_the_printed_state(method):
    from phasebench.reference.certificates import stored

    made = problem("henon-heiles:box")
    _, found = run_json(made.label, method, "--h", "0.01", "--t-end", "10", "--error")
    end = stored.end(made, 10.0)
    off = max(np.abs(np.array(found["q"]) - end.q).max(), np.abs(np.array(found["p"]) - end.p).max())
    assert found["global_error"] == off
