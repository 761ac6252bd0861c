"""Runs of a method at ever smaller steps, on fabricated runs: sizes, stopping rules, interpolation between runs."""

from __future__ import annotations

from itertools import islice
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.ladder.bracket import EDGE, Run, aim, cheapest
from phasebench.benchmarks.ladder.climb import idle, numbers_of_steps, tolerances
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.measure.clock import Clocks
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import END_STATE, ENERGY, Truth
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import INVALID, TIMEOUT


def rung(steps, error):
    return Rung(steps, None, "ok", error, 1.0)


@pytest.mark.parametrize(
    ("first", "factor", "most", "expected"),
    [
        (3.4, 2, inf, [3, 7, 14, 27]),
        (0.1, 2, inf, [2, 4, 8, 16]),
        (4, 1.1, inf, [4, 5, 6, 7]),
        (4, 1.6, 11, [4, 6, 10]),
    ],
)
def test_numbers_of_steps_grow_by_a_factor(first, factor, most, expected):
    assert list(islice(numbers_of_steps(first, factor, most=most), 4)) == expected


@pytest.mark.parametrize(("least", "last"), [(1e-14, [1e-13, 1e-14]), (2e-14, [1e-13, 2e-14]), (0.0, [1e-15, 1e-16])])
def test_tolerances_end_at_the_least_one(least, last):
    found = list(tolerances(1e-1, least))
    assert found[:3] == [1e-1, 1e-2, 1e-3]
    assert found[-2:] == last
    assert len(found) == len(set(found))


@pytest.mark.parametrize(
    ("errors", "count"),
    [
        ([], 0),
        ([1.0], 0),
        ([1.0, 0.69], 0),
        ([1.0, 0.71], 1),
        ([1.0, 0.71, 0.71], 2),
        ([1.0, 0.8, 0.65], 2),
        ([1.0, 0.8, 0.55], 0),
        ([1e-9, inf, 1.0], 2),
        ([inf, inf, 1.0, 1.0], 1),
        ([1e-3, nan], 1),
    ],
)
def test_count_of_rungs_without_a_smaller_error(errors, count):
    assert idle(errors) == count


def test_step_size_is_interpolated_by_a_power_law():
    coarse, fine = rung(100, 1e-2), rung(1000, 1e-6)
    assert aim(coarse, fine, 1e-4) == pytest.approx(10**2.5)
    assert aim(coarse, fine, 0.99e-2) == pytest.approx(100 * 10**EDGE)
    assert aim(coarse, fine, 1e-6) == pytest.approx(1000 / 10**EDGE)
    for broken in (rung(100, inf), rung(100, 1e-6)):
        assert aim(broken, fine, 1e-4) == pytest.approx(10**2.5), "half way, where errors do not tell"
    loose, tight = (Rung(None, tol, "ok", tol, 1.0) for tol in (1e-3, 1e-7))
    assert 1 / aim(loose, tight, 1e-5) == pytest.approx(1e-5)


def test_finer_run_is_taken_only_if_it_is_clearly_cheaper():
    wide, near, clear = Run(1e-5, 1.0), Run(1e-6, 0.9), Run(1e-7, 0.7)
    assert cheapest([wide, near]) is wide
    assert cheapest([wide, near, clear]) is clear


# -- one rung ----------------------------------------------------------------------------------------------------------


def task(quantity) -> Task:
    made = problem("pendulum:swinging")
    true = Truth(np.zeros(2), 0.0, "")
    return Task(made, 1.0, quantity, true)


@pytest.mark.parametrize(
    ("quantity", "seconds", "cheapest", "clocked"),
    [
        (END_STATE, 0.04, inf, True),
        (END_STATE, 0.06, inf, False),
        (ENERGY, 0.06, inf, True),
        (END_STATE, 0.04, 0.001, False),
        (END_STATE, 0.04, 0.01, True),
    ],
)
def test_run_is_timed_without_output_where_it_matters(monkeypatch, quantity, seconds, cheapest, clocked):
    """A run is timed again without output unless it is long without rows, or six times slower than the cheapest."""
    rk4 = integrator("rk4")
    of = type(rk4).run
    monkeypatch.setattr(type(rk4), "run", lambda *given, **more: _after(of(*given, **more), seconds))
    monkeypatch.setattr(Clocks, "of", lambda self, c, **size: lambda: 1e-6)
    found = task(quantity).measure(rk4, steps=1000, cheapest=lambda error: cheapest)
    assert found.seconds == (1e-6 if clocked else seconds)
    assert (found.ok, found.steps, found.taken) == (True, 1000, 1000)


def _after(solution, seconds):
    """A copy of a solution whose run time is ``seconds``."""
    names = ("t", "q", "p", "status", "reason", "counts")
    return SimpleNamespace(seconds=seconds, **{name: getattr(solution, name) for name in names})


def test_failed_run_is_a_rung_without_an_error():
    invalid = task(END_STATE).measure(integrator("rk4"), tol=1e-3)
    assert (invalid.status, invalid.error, invalid.seconds) == (INVALID, inf, inf)
    assert "no tolerance" in invalid.reason
    stopped = task(END_STATE).measure(integrator("gauss-8"), steps=5_000_000, timeout=0.01)
    assert (stopped.status, stopped.error) == (TIMEOUT, inf)
    assert 0.0 < stopped.seconds < 5.0


@pytest.mark.parametrize(
    ("id", "name", "rows"),
    [("rebound-ias15", "average", [False]), ("rebound-ias15", "end-state", []), ("heyoka", "average", [])],
)
def test_time_is_of_the_run_whose_error_is_taken(id, name, rows, monkeypatch):
    """IAS15 ends steps at rows, so that without them it would be another run; heyoka interpolates them."""
    made, ran = problem("henon-heiles:chaotic"), []
    monkeypatch.setattr(Task, "run", lambda self, c, size, *, bare: ran.append(bare) or SimpleNamespace(seconds=2.0))
    monkeypatch.setattr(Clocks, "of", lambda self, c, **size: lambda: 1.0)
    task = Task(made, 10.0, quantity(made, name))
    assert task.seconds(integrator(id), {"tol": 1e-6}) == (2.0 if rows else 1.0)
    assert ran == rows
