"""References say how far they are, and end where they cannot in time."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import problem
from phasebench.reference.solvers import gauss, taylor, watch


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand."""
    now = [0.0]
    monkeypatch.setattr(watch.time, "perf_counter", lambda: now[0])
    return now


def test_a_run_ends_when_its_time_is_over_or_before_where_it_has_no_hope(clock):
    with watch.watching(100.0, lambda told: None):
        clock[0] = 4.0
        watch.seen("run", 1.0, 100.0)
        clock[0] = 8.0
        watch.seen("run", 1.2, 100.0)  # at this rate it takes more than 3 times the limit, but the rate is young
        clock[0] = 10.0
        with pytest.raises(watch.TooLong, match=r"the run came to t = 2 in 6 s, and would need about 5 minutes"):
            watch.seen("run", 2.0, 100.0)
    with watch.watching(100.0, lambda told: None):
        for clock[0], t in ((10.0, 0.0), (30.0, 20.0), (109.0, 99.0)):
            watch.seen("run", t, 100.0)
        clock[0] = 111.0
        with pytest.raises(watch.TooLong):
            watch.seen("run", 99.5, 100.0)


def test_each_run_has_a_rate_of_its_own(clock):
    with watch.watching(100.0, lambda told: None):
        watch.seen("first", 0.0, 1.0)
        clock[0] = 50.0
        watch.seen("first", 1.0, 1.0)
        watch.seen("second", 0.0, 1.0)
        clock[0] = 60.0
        watch.seen("second", 0.3, 1.0)
        watch.seen("second", 0.01, 1.0)  # begun again: no rate of it is known
        watch.seen("second", 0.02, 1.0)


def test_it_is_told_how_far_they_are_not_more_often_than_one_can_read(clock):
    told = []
    with watch.watching(100.0, told.append):
        for k in range(100):
            clock[0] = 1 + 0.01 * k
            watch.seen("run", k / 10, 1e3)
    assert told[0] == "run: t = 0 of 1000"
    assert 4 <= len(told) <= 6


def test_the_limit_itself_is_in_time(clock):
    with watch.watching(100.0, lambda told: None):
        for clock[0], t in ((4.0, 4.0), (50.0, 50.0), (100.0, 99.0)):
            watch.seen("run", t, 100.0)


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
def test_what_it_would_need_is_said_in_units_that_one_can_grasp(clock, spent, t, said):
    with watch.watching(10.0, lambda told: None):
        watch.seen("run", 0.0, 100.0)
        clock[0] = spent
        with pytest.raises(watch.TooLong, match=f"the run came to t = .*{re.escape(said)}$"):
            watch.seen("run", t, 100.0)


@pytest.mark.parametrize(("needs", "told"), [(1.0, False), (1.5, True)])
def test_a_second_is_not_said(clock, needs, told):
    with watch.watching(0.1, lambda told: None):
        watch.seen("run", 0.0, 100.0)
        clock[0] = 0.5
        with pytest.raises(watch.TooLong) as said:
            watch.seen("run", 50.0, 100.0 * needs)
    assert ("would need" in str(said.value)) is told


def test_nobody_listens_outside(clock):
    with watch.watching(1.0, lambda told: None):
        pass
    clock[0] = 1e9
    watch.seen("run", 1.0, 2.0)
    assert not watch.watched()


def test_solvers_end_and_are_not_changed():
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


def test_the_command_says_that_it_is_too_long():
    done = CliRunner().invoke(app, ["certify", "harmonic-oscillator", "--t-end", "1e9", "--timeout", "0.01"])
    assert done.exit_code == 2
    assert "cannot be certified to 1e+09 in 0.01 s (--timeout): the 200-bit run came to t = " in done.stderr
    done = CliRunner().invoke(app, ["certify", "pendulum", "--t-end", "1", "--timeout", "0"])
    assert done.exit_code == 2
    assert "--timeout is 0.0" in done.stderr
