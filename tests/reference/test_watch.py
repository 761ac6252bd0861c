"""References report their progress and stop when they cannot finish in time."""

from __future__ import annotations

import contextlib

import pytest

from phasebench.benchmarks.problems import problem
from phasebench.reference.solvers import gauss, taylor, watch


@pytest.fixture
def clock(monkeypatch):
    """The list of one number that replaces the clock, in seconds."""
    now = [0.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    return now


#: What happens: limit, (seconds, run, t, t_end)...; the last of them stops the run, or none.
GOES_ON = {
    "more than 3 times the limit, but the rate is not yet reliable": (100, (4, "run", 1.0, 100), (8, "run", 1.2, 100)),
    "the limit itself is in time": (100, (4, "run", 4, 100), (50, "run", 50, 100), (100, "run", 99, 100)),
    "each run has its own rate": (100, (0, "a", 0, 1), (50, "a", 1, 1), (50, "b", 1, 20), (60, "b", 6, 20)),
    "a run that is started again has no rate yet": (
        *(100, (0, "a", 0.0, 20), (50, "a", 19, 20), (60, "a", 0.01, 20)),
        (60, "a", 0.02, 20),
    ),
}
STOPS = {
    "without hope": (100, (4, "run", 1.0, 100), (10, "run", 2.0, 100)),
    "after the limit": (100, (0, "run", 0, 100), (20, "run", 20, 100), (99, "run", 99, 100), (101, "run", 99.5, 100)),
}


@pytest.mark.parametrize(("what", "stops"), [*((x, False) for x in GOES_ON), *((x, True) for x in STOPS)])
def test_a_run_ends_after_its_time_or_without_hope(clock, what, stops):
    limit, *reports, last = (GOES_ON | STOPS)[what]
    with watch.watching(limit, lambda told: None):
        for clock[0], *report in reports:
            watch.report_time(*report)
        clock[0] = last[0]
        with pytest.raises(watch.TooLong, match="the run came to t = ") if stops else contextlib.nullcontext():
            watch.report_time(*last[1:])


@pytest.mark.parametrize(
    ("spent", "t", "said"),
    [
        (60.0, 50.0, " in 60 s, and would need about 2 minutes"),
        (120.0, 0.01, " and would need about 13.9 days"),
        (60.0, 0.037, " and would need about 45 hours"),
        (119.0, 99.9, " and would need about 119 s"),
        (0.5, 50.0, "the run came to t = 50"),
    ],
)
def test_the_time_needed_is_reported_in_suitable_units_from_one_second_on(clock, spent, t, said):
    with watch.watching(0.1, lambda told: None):
        watch.report_time("run", 0.0, 100.0)
        clock[0] = spent
        with pytest.raises(watch.TooLong) as stopped:
            watch.report_time("run", t, 100.0)
    assert str(stopped.value).endswith(said)


def test_progress_is_reported_at_a_readable_rate_and_only_while_watched(clock):
    told = []
    with watch.watching(100.0, told.append):
        for k in range(100):
            clock[0] = 1 + 0.01 * k
            watch.report_time("run", k / 10, 1e3)
    assert told[0] == "run: t = 0 of 1000"
    assert 4 <= len(told) <= 6
    clock[0] = 1e9
    watch.report_time("run", 1.0, 2.0)
    assert not watch.is_watched()


def test_watching_does_not_change_the_solvers():
    made, told = problem("harmonic-oscillator"), []
    args = made.system, made.q0, made.p0
    plain = taylor.states(args[0], float, *args[1:], [10.0, 20.0])
    with watch.watching(60.0, told.append):
        assert (taylor.states(args[0], float, *args[1:], [10.0, 20.0]) == plain).all()
        gauss.run(*args, [0.5, 1.0], [1.0])
    assert told[0].startswith("float run: t = ")
    for run in (lambda: taylor.states(args[0], float, *args[1:], [1e9]), lambda: gauss.run(*args, [0.5, 1.0], [1.0])):
        with watch.watching(1e-9, told.append), pytest.raises(watch.TooLong):
            run()
