"""The clock of a prepared run: the mean of many runs from perturbed starts; disturbed readings are repeated."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem


class Run:
    """A run that advances a fake clock by a given number of seconds."""

    def __init__(self, seconds: float, away: float = 0.0, disturbed: int = 0, spared: int = 2):
        self.now = self.thread = 0.0
        self.seconds, self.away, self.disturbed, self.spared = seconds, away, disturbed, spared
        self.starts: list[tuple] = []
        self.sizes: list[tuple] = []

    def restart(self, q, p):
        """Record the initial state of the next call."""
        self.starts.append((*q, *p))

    def advance(self, *size):
        """Let the clock run by ``seconds``; disturbed calls take ``away`` more, the first ``spared`` never do."""
        self.sizes.append(size)
        self.thread += self.seconds
        self.now += self.seconds
        if self.disturbed and len(self.sizes) > self.spared:
            self.disturbed -= 1
            self.now += self.away


@pytest.fixture
def make_clock(monkeypatch):
    """A function that makes a `Clock` for a `Run` on the fake clock."""

    def make(run: Run, **more) -> clock.Clock:
        monkeypatch.setattr(clock.time, "perf_counter", lambda: run.now)
        monkeypatch.setattr(clock.time, "thread_time", lambda: run.thread)
        return clock.Clock(run, (0.1, 10), ((1.0,), (0.5,)), **more)

    return make


def test_long_run_is_timed_once_after_warm_up(make_clock):
    run = Run(0.01)
    assert make_clock(run)() == pytest.approx(0.01)
    assert run.sizes == [(0.1, 10)] * 3  # two to warm up, one counted


def test_first_very_long_run_counts(make_clock):
    run = Run(1.0)
    one = make_clock(run)
    assert one() == pytest.approx(1.0)
    assert len(run.sizes) == 1
    assert one() == pytest.approx(1.0)
    assert len(run.sizes) == 2


def test_short_run_is_repeated_from_different_starts(make_clock):
    run = Run(7e-6)
    one = make_clock(run)
    assert one() == pytest.approx(7e-6)
    counted = run.starts[2:]
    assert len(counted) == 15
    assert len(set(counted)) == min(15, clock.STARTS)
    assert np.abs(np.array(counted) / counted[0] - 1).max() < 20 * clock.EPS
    assert 15 * 7e-6 >= clock.LEAST > 14 * 7e-6


def test_disturbed_reading_is_repeated_and_counted(make_clock):
    quiet, run = Run(1e-3), Run(1e-3, away=1e-3, disturbed=2)
    sharing = clock.Sharing()
    assert make_clock(run, sharing=sharing)() == pytest.approx(1e-3)
    assert (sharing.readings, sharing.repeated, sharing.disturbed) == (3, 2, 0)
    sharing = clock.Sharing()
    assert make_clock(quiet, sharing=sharing)() == pytest.approx(1e-3)
    assert (sharing.readings, sharing.repeated, sharing.disturbed) == (1, 0, 0)


def test_persistent_disturbance_is_reported(make_clock):
    run, sharing = Run(1e-3, away=1e-3, disturbed=1000), clock.Sharing()
    assert make_clock(run, sharing=sharing)() == pytest.approx(2e-3)
    assert sharing.disturbed == 1
    assert sharing.readings == 1 + clock.AGAIN


def test_disturbed_first_long_run_is_repeated(make_clock):
    run, sharing = Run(1.0, away=1.0, disturbed=1, spared=0), clock.Sharing()
    assert make_clock(run, sharing=sharing)() == pytest.approx(1.0)
    assert len(run.sizes) == 2
    assert (sharing.readings, sharing.repeated, sharing.disturbed) == (2, 1, 0)


def test_number_of_repetitions_is_limited(make_clock):
    run, sharing = Run(1.0, away=1.0, disturbed=1000, spared=0), clock.Sharing()
    make_clock(run, sharing=sharing)()
    assert len(run.sizes) == 1 + clock.AGAIN
    assert (sharing.readings, sharing.disturbed) == (1 + clock.AGAIN, 1)


def test_small_share_of_lost_time_is_no_disturbance(make_clock):
    sharing = clock.Sharing()
    make_clock(Run(1e-3, away=0.9 * clock.SHARED * 1e-3, disturbed=1000), sharing=sharing)()
    assert sharing.repeated == 0


@pytest.mark.parametrize(("id", "size"), [("stormer-verlet", {"steps": 1000}), ("heyoka", {"tol": 1e-12})])
def test_time_grows_with_the_span(id, size):
    made, one = problem("henon-heiles:box"), integrator(id)
    steps = size.get("steps")
    readings = [
        min(
            clock.clock(one, made, t_end=k * 10.0, **size | ({"steps": k * steps} if steps else {}))() for _ in range(5)
        )
        for k in (1, 8)
    ]
    assert 3 < readings[1] / readings[0] < 20
    assert clock.call(one, made, t_end=10.0, **size) < readings[0]


def test_methods_and_peers_are_timed_alike():
    """A run of either that was timed goes on from the state that is set afterwards."""
    made = problem("kepler")
    for id, size in (("stormer-verlet", {"steps": 10}), ("heyoka", {"tol": 1e-9})):
        one = integrator(id)
        run = one.prepare(made, tol=size.get("tol"))
        told = clock.clock(one, made, t_end=1.0, **size, run=run)
        told()
        ends = []
        for turn in (1.0, 1.01, 1.0):
            run.restart(np.array(made.q0), turn * np.array(made.p0))
            assert run.advance(*told.size) == 0
            ends.append(run._end[0, 0].copy() if id == "stormer-verlet" else np.array(run._calls.state())[:2])
        assert np.array_equal(ends[0], ends[2])
        assert np.abs(ends[0] - ends[1]).max() > 1e-4


def test_integrator_is_prepared_once_per_tolerance():
    made, one, peer = problem("kepler"), integrator("stormer-verlet"), integrator("heyoka")
    clocks = clock.Clocks(made, 1.0)
    assert not clocks.ready(one)
    assert clocks.of(one, steps=10).run is clocks.of(one, steps=20).run
    assert clocks.ready(one)
    assert clocks.of(peer, tol=1e-9).run is clocks.of(peer, tol=1e-9).run is not clocks.of(peer, tol=1e-6).run
    assert clocks.of(one, steps=10).size == (0.1, 10)
    assert clocks.of(peer, tol=1e-9).size == (1.0,)
    clocks.of(one, steps=10)()
    assert clocks.sharing.readings >= 1
    assert 0 < clocks.call(one, steps=10) < 1e-3
