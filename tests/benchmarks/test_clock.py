"""The clock of a prepared run: the mean of many runs, from starts that differ; disturbed readings are taken again."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure import clock
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem


class Run:
    """A run that takes a number of seconds of a clock that is moved by hand."""

    def __init__(self, seconds: float, away: float = 0.0, disturbed: int = 0):
        self.now = self.thread = 0.0
        self.seconds, self.away, self.disturbed = seconds, away, disturbed
        self.starts: list[tuple] = []
        self.sizes: list[tuple] = []

    def restart(self, q, p):
        """Keep the start."""
        self.starts.append((*q, *p))

    def advance(self, *size):
        """Take the seconds; while it is disturbed the process is away for more."""
        self.sizes.append(size)
        self.thread += self.seconds
        self.now += self.seconds
        if self.disturbed and len(self.sizes) > 2:
            self.disturbed -= 1
            self.now += self.away


@pytest.fixture
def timed(monkeypatch):
    """A clock on a run by hand."""

    def made(run: Run, **more) -> clock.Clock:
        monkeypatch.setattr(clock.time, "perf_counter", lambda: run.now)
        monkeypatch.setattr(clock.time, "thread_time", lambda: run.thread)
        return clock.Clock(run, (0.1, 10), ((1.0,), (0.5,)), **more)

    return made


def test_a_long_run_is_clocked_once_after_one_that_is_not_counted(timed):
    run = Run(0.01)
    assert timed(run)() == pytest.approx(0.01)
    assert run.sizes == [(0.1, 10)] * 3  # two to warm up, one counted


def test_the_first_of_a_run_that_takes_longer_counts(timed):
    run = Run(1.0)
    one = timed(run)
    assert one() == pytest.approx(1.0)
    assert len(run.sizes) == 1
    assert one() == pytest.approx(1.0)
    assert len(run.sizes) == 2


def test_a_short_run_is_repeated_until_a_reading_is_long_enough_from_starts_that_differ(timed):
    run = Run(7e-6)
    one = timed(run)
    assert one() == pytest.approx(7e-6)
    counted = run.starts[1:]
    assert len(counted) == 15
    assert len(set(counted)) == min(15, clock.STARTS)
    assert np.abs(np.array(counted) / counted[0] - 1).max() < 20 * clock.EPS
    assert 15 * 7e-6 >= clock.LEAST > 14 * 7e-6


def test_a_disturbed_reading_is_taken_again_and_counted(timed):
    quiet, run = Run(1e-3), Run(1e-3, away=1e-3, disturbed=2)
    sharing = clock.Sharing()
    assert timed(run, sharing=sharing)() == pytest.approx(1e-3)
    assert (sharing.readings, sharing.repeated, sharing.disturbed) == (3, 2, 0)
    sharing = clock.Sharing()
    assert timed(quiet, sharing=sharing)() == pytest.approx(1e-3)
    assert (sharing.readings, sharing.repeated, sharing.disturbed) == (1, 0, 0)


def test_what_stays_disturbed_is_told(timed):
    run, sharing = Run(1e-3, away=1e-3, disturbed=1000), clock.Sharing()
    assert timed(run, sharing=sharing)() == pytest.approx(2e-3)
    assert sharing.disturbed == 1
    assert sharing.readings == 1 + clock.AGAIN


def test_a_share_below_the_bound_is_no_disturbance(timed):
    sharing = clock.Sharing()
    timed(Run(1e-3, away=0.9 * clock.SHARED * 1e-3, disturbed=1000), sharing=sharing)()
    assert sharing.repeated == 0


@pytest.mark.parametrize(("id", "size"), [("stormer-verlet", {"steps": 1000}), ("heyoka", {"tol": 1e-12})])
def test_a_longer_span_takes_longer_and_a_call_is_less_than_a_run(id, size):
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


def test_the_clock_of_a_method_and_of_a_peer_encloses_the_same_call():
    """Either integrates from the start that it was given last, and hands nothing back."""
    made = problem("kepler")
    for id, size in (("stormer-verlet", {"steps": 10}), ("heyoka", {"tol": 1e-9})):
        one = integrator(id)
        run = one.prepare(made, tol=size.get("tol"))
        told = clock.clock(one, made, t_end=1.0, **size, run=run)
        told()
        run.restart(np.array(made.q0), np.array(made.p0))
        assert run.advance(*told.size) == run.SOLVED
