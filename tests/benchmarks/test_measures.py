"""Metrics on synthetic data with known answers; times, which of two is cheaper, the C loop and the clock."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import inf

import mpmath
import numpy as np
import pytest

from phasebench.benchmarks.measure import (
    c_loop,
    clock,
    metrics,
    multiprecision,
    step_map,
    timing,
)
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.timing import NONE, NOWHERE, OURS, PEERS, TIED, Median
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate
from phasebench.integrators.compile.codegen import MULTIPRECISION, precision, vector

# -- times -------------------------------------------------------------------------------------------------------------


class Clock:
    """A fake clock, which only the callables of a test advance."""

    def __init__(self):
        self.now, self.calls = 0.0, []

    def perf_counter(self):
        return self.now

    def takes(self, name, seconds):
        def work():
            self.calls.append(name)
            self.now += seconds(self.calls.count(name))

        return work


def test_interleaved_alternates_and_drops_the_first_round(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    work = {"a": clock.takes("a", lambda n: 100.0 if n == 1 else n), "b": clock.takes("b", lambda n: 2.0 * n)}
    found = timing.time_in_turns(work, rounds=4)
    assert found["a"].tolist() == [2, 3, 4, 5]
    assert found["b"].tolist() == [4, 6, 8, 10]
    turns = ["".join(clock.calls[i : i + 2]) for i in range(0, 10, 2)]
    assert set(turns) == {"ab", "ba"}
    assert all(x != y for x, y in pairwise(turns))


ONE, TWO, WIDE = Median(1.0, 0.9, 1.1), Median(2.0, 1.9, 2.1), Median(2.0, 1.05, 3.0)


@pytest.mark.parametrize(
    ("ours", "peers", "said"),
    [
        (ONE, TWO, OURS),
        (TWO, ONE, PEERS),
        (ONE, WIDE, TIED),
        (WIDE, ONE, TIED),
        (ONE, NOWHERE, OURS),
        (NOWHERE, ONE, PEERS),
        (NOWHERE, NOWHERE, NONE),
        # The accuracy is reached only perhaps.
        (Median(1.0, 0.9, inf), TWO, TIED),
        (Median(1.0, 0.9, inf), NOWHERE, TIED),
        (Median(3.0, 2.9, inf), TWO, PEERS),
        (NOWHERE, Median(1.0, 0.9, inf), TIED),
    ],
)
def test_cheaper_of_two_costs(ours, peers, said):
    assert timing.cheaper(ours, peers) == said


# -- the C loop --------------------------------------------------------------------------------------------------------

needs_compiler = pytest.mark.skipif(c_loop.compiler() is None, reason="there is no C compiler")


def distance(name, h=0.01, steps=1000, merged=False):
    """Largest difference between the final states of the C loop and of stormer-verlet."""
    made = problem(name)
    seconds, y = c_loop.Loop(made, merged).run(h, steps)
    assert 0 < seconds < 60, "of the loop, not of the clock"
    s = integrate(made, "stormer-verlet", h=h, steps=steps)
    return np.abs(y - np.concatenate([s.q[-1], s.p[-1]])).max()


@needs_compiler
@pytest.mark.parametrize(("name", "merged"), [("pendulum", True), ("kepler", False), ("outer-solar-system", False)])
def test_c_loop_is_stormer_verlet(name, merged):
    assert distance(name, merged=merged) < 1e-10


@needs_compiler
def test_control_wrong_loop_is_detected(monkeypatch):
    source = c_loop.source
    monkeypatch.setattr(c_loop, "source", lambda *of: source(*of).replace("p_0 += 0.5 * ", "p_0 += 0.51 * "))
    assert not distance("pendulum", merged=True) < 1e-6


def test_ranks_agree_with_published_tables():
    """David & Nagaraja; the sign test's critical values at 5 %, two-sided."""
    assert [timing.rank(n) for n in (3, 5, 6, 8, 9, 11, 12, 15, 20, 21, 25)] == [1, 1, 1, 1, 2, 2, 3, 4, 6, 6, 8]
    assert timing.rank(40_001) == 19_805  # n/2 - 0.98 sqrt(n), computed exactly and fast


# -- the clock of a prepared run ---------------------------------------------------------------------------------------


class Run:
    """A run that advances a fake clock by a given number of seconds."""

    def __init__(self, seconds: float, away: float = 0.0, disturbed: int = 0):
        self.now = self.thread = 0.0
        self.seconds, self.away, self.disturbed = seconds, away, disturbed
        self.starts: list[tuple] = []
        self.sizes: list[tuple] = []

    def restart(self, q, p):
        """Record the initial state of the next call."""
        self.starts.append((*q, *p))

    def advance(self, *size):
        """Let the clock run by ``seconds``; disturbed calls take ``away`` more, the first two never do."""
        self.sizes.append(size)
        self.thread += self.seconds
        self.now += self.seconds
        if self.disturbed and len(self.sizes) > 2:
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


# -- metrics -----------------------------------------------------------------------------------------------------------


H = 0.1 / 2.0 ** np.arange(10)

# -- orders ------------------------------------------------------------------------------------------------------------


def without(*places):
    """Errors of order 2 of which some are unknown."""
    errors = H**2
    errors[list(places)] = np.nan
    return errors


@pytest.mark.parametrize(
    ("h", "error", "more", "value", "points", "first"),
    [
        (H[::-1], H[::-1] ** 2, {}, 2, 10, H[0]),
        (H[:3], H[:3] ** 2, {}, 2, 3, H[0]),
        (H, without(4), {}, 2, 5, H[5]),  # the window ends there
        (H, np.where(np.arange(10) == 9, np.inf, without(0)), {}, 2, 8, H[1]),
        (H, np.maximum(H, H[4]) ** 2, {"noise": 1.5 * H[4] ** 2}, 2, 4, H[0]),
        (H, np.maximum(H, H[4]) ** 2, {}, 0, 6, H[4]),  # the control: the constant errors of round-off fit best
        (H, np.concatenate([np.full(6, 1.0), H[6:] ** 2]), {"ceiling": 0.5}, 2, 4, H[6]),
    ],
)
def test_order_of_a_window(h, error, more, value, points, first):
    found = metrics.order(h, error, **more)
    assert found.value == pytest.approx(value, abs=1e-9)
    assert (found.points, found.first) == (points, pytest.approx(first, rel=1e-15))


@pytest.mark.parametrize("p", [1, 2, 4, 6])
def test_order_excludes_coarse_steps_and_round_off(p):
    h = 0.2 / 1.5 ** np.arange(16)
    noise = 10.0 ** (-2 * p - 4)
    error = h**p * (1 + 60 * h**2) + noise * (1 + 0.3 * np.sin(37.0 * np.arange(len(h))))
    o = metrics.order(h, error, noise=10 * noise)
    assert abs(o.value - p) < 0.1
    assert o.first < h[0]
    assert o.points >= 3
    assert abs(np.polyfit(np.log(h), np.log(error), 1)[0] - p) > 0.1, "the control: all points together mislead"


def test_order_of_too_few_points_is_nan():
    o = metrics.order(H, np.where(np.arange(len(H)) < 2, H**2, 0.0))
    assert o.points == 0
    assert np.isnan(o.value)
    with pytest.raises(ValueError, match="at least 3"):
        metrics.slope([0, 1], [0, 1])


def test_slope_interval_covers_the_truth():
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(200):
        s = metrics.slope(np.log(H), np.log(H**2) + 0.1 * rng.standard_normal(len(H)))
        inside += s.low <= 2 <= s.high
    assert 0.9 < inside / 200 < 0.99


# -- defects of maps ---------------------------------------------------------------------------------------------------


def test_return_distance_is_relative_to_the_state():
    there, back, y = (lambda x: 2 * x), (lambda x: x / 2 + [0.0, 0.5]), np.array([3.0, 4.0])
    assert step_map.return_distance(there, back, y) == 0.5
    assert step_map.return_distance(there, back, y, sizes=np.array([1.0, 5.0])) == pytest.approx(0.1)


# -- the reference ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("T", "most"), [(Fraction(1, 64), 1e-34), (Fraction(1, 4), 1e-34), (1, 1e-20)])
def test_extrapolation_within_its_stated_uncertainty(T, most):
    with precision(40):
        length = multiprecision.to_number(T, MULTIPRECISION)
        end, doubt = multiprecision.extrapolate(lambda y: -2 * y, vector([3, 1]), length)
        exact = mpmath.exp(-2 * mpmath.mpf(T.numerator) / T.denominator)
        off = max(abs(mpmath.mpf(str(x)) - y) for x, y in zip(end, (3 * exact, exact), strict=True))
        assert off <= mpmath.mpf(str(doubt))
        assert 0 < doubt < most


# -- variants and systems ---------------------------------------------------------------------------------------------
