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


def test_size_of_a_timed_run():
    """So many steps that end at t_end; or, of an adaptive integrator, t_end."""
    made = problem("pendulum")
    fixed, adaptive = (clock.clock(integrator(id), made, t_end=2.0, steps=8, run=Run(1.0)) for id in ("rk4", "heyoka"))
    assert (fixed.size, adaptive.size) == ((0.25, 8), (2.0,))
