"""References report their progress and stop when they cannot finish in time."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import problem
from phasebench.reference.solvers import gauss, taylor, watch


@pytest.fixture
def clock(monkeypatch):
    """The list of one number that replaces the clock, in seconds."""
    now = [0.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    return now


def test_a_run_ends_after_its_time_or_without_hope(clock):
    with watch.watching(100.0, lambda told: None):
        clock[0] = 4.0
        watch.report_time("run", 1.0, 100.0)
        clock[0] = 8.0
        watch.report_time("run", 1.2, 100.0)  # more than 3 times the limit, but the rate is not yet reliable
        clock[0] = 10.0
        with pytest.raises(watch.TooLong, match=r"the run came to t = 2 in 6 s, and would need about 5 minutes"):
            watch.report_time("run", 2.0, 100.0)
    with watch.watching(100.0, lambda told: None):
        for clock[0], t in ((10.0, 0.0), (30.0, 20.0), (109.0, 99.0)):
            watch.report_time("run", t, 100.0)
        clock[0] = 111.0
        with pytest.raises(watch.TooLong):
            watch.report_time("run", 99.5, 100.0)


def test_each_run_has_its_own_rate(clock):
    with watch.watching(100.0, lambda told: None):
        watch.report_time("first", 0.0, 1.0)
        clock[0] = 50.0
        watch.report_time("first", 1.0, 1.0)
        watch.report_time("second", 1.0, 20.0)  # at the rate of the first run it would need 1000 s
        clock[0] = 60.0
        watch.report_time("second", 6.0, 20.0)
        watch.report_time("second", 0.01, 20.0)  # a restarted run has no rate yet
        watch.report_time("second", 0.02, 20.0)


def test_progress_is_reported_at_a_readable_rate(clock):
    told = []
    with watch.watching(100.0, told.append):
        for k in range(100):
            clock[0] = 1 + 0.01 * k
            watch.report_time("run", k / 10, 1e3)
    assert told[0] == "run: t = 0 of 1000"
    assert 4 <= len(told) <= 6


def test_the_limit_itself_is_in_time(clock):
    with watch.watching(100.0, lambda told: None):
        for clock[0], t in ((4.0, 4.0), (50.0, 50.0), (100.0, 99.0)):
            watch.report_time("run", t, 100.0)


@pytest.mark.parametrize(
    ("spent", "t", "said"),
    [
        (60.0, 50.0, "in 60 s, and would need about 2 minutes"),
        (120.0, 0.01, "and would need about 13.9 days"),
        (119.0, 0.5, "and would need about 6.61 hours"),
        (119.0, 99.9, "and would need about 119 s"),
        (60.0, 0.03, "and would need about 2.31 days"),
        (60.0, 0.037, "and would need about 45 hours"),
    ],
)
def test_the_time_needed_is_reported_in_suitable_units(clock, spent, t, said):
    with watch.watching(10.0, lambda told: None):
        watch.report_time("run", 0.0, 100.0)
        clock[0] = spent
        with pytest.raises(watch.TooLong, match=f"the run came to t = .*{re.escape(said)}$"):
            watch.report_time("run", t, 100.0)


@pytest.mark.parametrize(("needs", "told"), [(1.0, False), (1.5, True)])
def test_a_time_below_one_second_is_not_reported(clock, needs, told):
    with watch.watching(0.1, lambda told: None):
        watch.report_time("run", 0.0, 100.0)
        clock[0] = 0.5
        with pytest.raises(watch.TooLong) as said:
            watch.report_time("run", 50.0, 100.0 * needs)
    assert ("would need" in str(said.value)) is told


def test_nothing_is_reported_outside_watching(clock):
    with watch.watching(1.0, lambda told: None):
        pass
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


def test_the_command_reports_a_timeout():
    done = CliRunner().invoke(app, ["certify", "harmonic-oscillator", "--t-end", "1e9", "--time-limit", "0.01"])
    assert done.exit_code == 2
    assert "cannot be certified to 1e+09 in the time limit of 0.01 s: the 200-bit run came to t = " in done.stderr
    done = CliRunner().invoke(app, ["certify", "pendulum", "--t-end", "1", "--time-limit", "0"])
    assert done.exit_code == 2
    assert "--time-limit is 0; it must be a positive number of seconds" in done.stderr
