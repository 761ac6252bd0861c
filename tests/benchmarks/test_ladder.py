"""Runs of a method at ever smaller steps, on fabricated runs: sizes, stopping rules, interpolation between runs."""

from __future__ import annotations

from itertools import islice, pairwise
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.ladder import competitors, curves, race
from phasebench.benchmarks.ladder.bracket import EDGE, Run, aim, bracket, cheapest, cost
from phasebench.benchmarks.ladder.climb import idle, numbers_of_steps, tolerances
from phasebench.benchmarks.ladder.race import Known, refine
from phasebench.benchmarks.ladder.rung import Rung, Task
from phasebench.benchmarks.measure.clock import Clocks
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import END_STATE, ENERGY, Truth
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.questions import down_to
from phasebench.benchmarks.studies.trade import front
from phasebench.integrators.driver import INVALID, TIMEOUT


def rung(steps, error):
    return Rung(steps, None, "ok", error, 1.0)


@pytest.mark.parametrize(
    ("first", "factor", "most", "expected"),
    [
        (3.4, 2, inf, [3, 7, 14, 27]),
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
        ([1.0, 0.69], 0),
        ([1.0, 0.71], 1),
        ([1.0, 0.8, 0.65], 2),
        ([1.0, 0.8, 0.55], 0),
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


# -- the trade-off between cost and error ------------------------------------------------------------------------------


class Law:
    """A stand-in for an integrator: error (steps / 100)^-order, and ``step`` seconds per step; fewer steps fail."""

    adaptive = stoppable = False
    preparable = True
    record = SimpleNamespace(least=1e-16)

    def __init__(self, label: str, order: float, step: float, side=OURS, fails=0):
        self.label = self.id = label
        self.order, self.step, self.fails = order, step, fails
        self.kind = "phasebench" if side == OURS else "heyoka"

    def run(self, problem, t_end, steps, save_every, **more):
        """A solution whose final state is off by the error that the number of steps gives."""
        good = steps >= self.fails
        return SimpleNamespace(
            t=np.array([0.0, t_end]),
            q=np.array([[0.0], [max((steps / 100) ** -self.order, 1e-16)]]),
            p=np.zeros((2, 1)),
            status="ok" if good else "no-root",
            seconds=self.step * steps * good,
            counts={"steps": steps, "gradient": steps},
            reason="",
        )


@pytest.fixture(autouse=True)
def _laws_tell_their_time(monkeypatch):
    """Let each stand-in integrator (`Law`) be timed as the seconds that its run states, not by the clock."""
    of_others = Clocks.of

    def of(self, c, *, steps=None, tol=None):
        if not isinstance(c, Law):
            return of_others(self, c, steps=steps, tol=tol)
        size = {"tol": tol} if steps is None else {"steps": steps}
        return lambda: c.run(self.problem, t_end=self.t_end, save_every=0, **size).seconds

    monkeypatch.setattr(Clocks, "of", of)
    monkeypatch.setattr(Clocks, "call", lambda self, c, *, steps=None, tol=None: 1e-7)


def pendulum_task(last: int = 12) -> Task:
    """A question of the trade-off about the end of a pendulum run, whose true value is set to 0."""
    made = problem("pendulum:swinging")
    return Task(made, 100.0, quantity(made, "end-state"), Truth(np.zeros(2), 0.0, ""), down_to(last))


def climb_laws(*laws: Law, last: int = 12):
    """(the question, the runs of each stand-in integrator at ever finer steps); one integrator after another."""
    asked, known = pendulum_task(last), Known()
    return asked, [race.enter(asked, law, known) for law in laws]


def test_ladder_doubles_steps_to_the_finest_accuracy():
    asked, (one,) = climb_laws(Law("a", 4, 1e-8))
    steps = [r.steps for r in one.rungs]
    assert steps[0] == round(100.0 / (race.WIDEST * asked.problem.pace.step))
    assert all(1.9 < b / a < 2.1 for a, b in pairwise(steps))
    assert one.rungs[-2].error > 1e-12 >= one.rungs[-1].error
    assert not one.dropped


def test_method_that_always_fails_is_dropped():
    _, (never, late) = climb_laws(Law("never", 4, 1e-8, fails=10**18), Law("late", 4, 1e-8, fails=1000))
    assert never.dropped
    assert len(never.rungs) == race.FAILURES
    assert never.why == "10 runs in a row ended as no-root"
    assert not late.dropped
    assert late.rungs[-1].error <= 1e-12


def test_too_slow_method_is_dropped_naming_the_fastest():
    _, (_, slow) = climb_laws(Law("fast", 4, 1e-8), Law("slow", 4, 1e-7))
    assert slow.dropped
    assert slow.rungs[-1].error > 1e-5
    assert "10.0 times as long as fast" in slow.why


def test_method_that_catches_up_is_kept():
    """Order 4 at twenty times the cost per step of order 2 loses above 6e-6 and wins below."""
    _, (_, high) = climb_laws(Law("low", 2, 1e-8), Law("high", 4, 2e-7))
    assert high.rungs[2].error > 1e-3
    assert not high.dropped
    assert min(r.error for r in high.rungs) <= 1e-12
    _, (_, high) = climb_laws(Law("low", 2, 1e-8), Law("high", 2, 2e-7))
    assert high.dropped


def test_bracket_is_the_last_miss_and_the_next_rung():
    """An accuracy lies between the last run that misses it and the next finer one that meets it.

    An error that is small by chance at a wide step does not count, nor do runs at round-off.
    """
    errors = [0.5, 1e-10, 1e-2, 1e-4, 1e-11, 5e-9, 5e-9]
    rungs = [Rung(2**k, None, "ok", e, 1e-6 * 2**k, 2**k, 0) for k, e in enumerate(errors)]
    low, meeting = bracket(rungs, 2e-9)
    assert (low.error, [r.error for r in meeting]) == (1e-4, [1e-11])
    assert bracket(rungs, 1e-12) == (None, [])
    lucky = [Rung(2**k, None, "ok", e, 1.0, 2**k, 0) for k, e in enumerate([0.03, 0.07, 0.3])]
    assert bracket(lucky, 0.1)[1] == []
    assert cost(lucky, 0.1) == inf
    assert bracket(rungs, 1.0) == (None, rungs)


def test_refined_step_just_meets_the_accuracy():
    law = Law("a", 4, 1e-8)
    asked, (one,) = climb_laws(law)
    for wanted in (1e-2, 1e-5, 1e-10):
        found = refine(asked, law, one.rungs, wanted)
        needed = 100 * wanted**-0.25
        assert found.error <= wanted
        assert needed <= found.steps <= 1.1 * needed + 1


def test_final_names_the_cheapest_of_both_sides():
    ours = [Law("second", 2, 1e-8), Law("eighth", 8, 4e-8)]
    peers = [Law("taylor", 8, 8e-8, side=PEERS)]
    asked, found = climb_laws(*peers, *ours)
    for wanted, best in ((1e-1, "second"), (1e-10, "eighth")):
        rows, choice = front.final(asked, front.finalists(asked, found, wanted), wanted)
        assert choice["ours integrator"] == best
        assert choice["peer integrator"] == "taylor"
        assert {r["side"] for r in rows} == {OURS, PEERS}
        price = {"second": 1e-6 * wanted**-0.5, "eighth": 4e-6 * wanted**-0.125, "taylor": 8e-6 * wanted**-0.125}
        assert choice["ratio"] == pytest.approx(price[best] / price["taylor"], rel=0.15)
        assert choice["ratio low"] <= choice["ratio"] <= choice["ratio high"]
        assert all(r["error"] <= wanted for r in rows)


# -- competitors -------------------------------------------------------------------------------------------------------


def test_peers_compete_in_their_fast_modes():
    labels = {c.label for c in competitors.competitors()}
    assert {"heyoka-high-accuracy(compact_mode)", "rebound-ias15(adaptive_mode=aarseth85)"} <= labels
    fixed = [p.settings for p in competitors.peers() if p.settings.get("integrator") in ("whfast", "saba")]
    assert fixed
    assert all(s["safe_mode"] == 0 for s in fixed)


def test_selection_for_many_degrees_of_freedom():
    can, cannot = competitors.able(problem("outer-solar-system"))
    labels = {c.label for c in can}
    assert {"gauss-8", "stormer-verlet", "wisdom-holman"} <= labels
    assert all("degrees of freedom" in cannot[id] for id in ("avf", "scheme-v", "scheme-ii(lam=2)"))
    waves = {c.label for c in competitors.able(problem("nls"))[0]}
    assert {"implicit-midpoint", "gauss-5"}.isdisjoint(waves)
    assert "gauss-4" in waves, "of 2 d unknowns a stage, 512 in all"
    few, left_out = competitors.able(problem("henon-heiles"))
    assert {"avf", "scheme-v"} <= {c.label for c in few}
    assert not any("degrees of freedom" in why for why in left_out.values())


def test_unstoppable_peers_are_left_out_of_long_spans():
    made = problem("pendulum:rotating")

    def entered(t_end):
        truth = Truth(np.zeros(1), 0.0, "")
        can, cannot = front.entrants(Task(made, t_end, quantity(made, "energy"), truth, down_to(3)))
        return {c.label for c in can}, cannot

    limit = front.FARTHEST * made.pace.step
    (short, none), (long, why) = entered(limit), entered(1.01 * limit)
    assert short - long == set(front.LOOPED)
    assert {"scipy-ode(DOP853)", "scipy-odeint(LSODA)", "heyoka"} <= long
    assert all("too long" in why[id] for id in front.LOOPED)
    assert not {*front.LOOPED} & {*none}


# -- final timings -----------------------------------------------------------------------------------------------------


class Tolerant(Law):
    """A stand-in for an adaptive integrator whose error is the square of its tolerance."""

    adaptive = True

    def run(self, problem, t_end, save_every, tol, **more):
        """A run with as many steps as the error needs."""
        return super().run(problem, t_end, 100 * tol**-0.5, save_every)


def test_rows_of_a_scene_list_steps_and_dropped_methods(monkeypatch):
    laws = [Law("a", 4, 1e-8), Law("dear", 4, 1e-4), Law("b", 4, 2e-8, PEERS), Tolerant("tolerant", 4, 1e-8, PEERS)]
    monkeypatch.setattr(front, "task_of", lambda scene: pendulum_task(4))
    monkeypatch.setattr(front, "entrants", lambda asked: (laws, {"nobody": "it cannot"}))
    tables = front.measure("s")
    assert set(tables) == {front.CHOICES, front.FINALS, front.RUNGS, front.DROPPED}
    assert all(row["scene"] == "s" for rows in tables.values() for row in rows)
    assert tuple(c["accuracy"] for c in tables[front.CHOICES]) == down_to(4)
    assert {c["ours integrator"] for c in tables[front.CHOICES]} == {"a"}
    for c in tables[front.CHOICES]:
        assert c["ours h"] * c["ours steps"] == pytest.approx(100.0)
        assert (c["problem"], c["quantity"], c["t_end"]) == ("pendulum:swinging", "end-state", 100.0)
        assert (c["reference"], c["reference uncertainty"]) == ("", 0.0)
    whys = {d["integrator"]: d["why"] for d in tables[front.DROPPED]}
    assert whys["nobody"] == "it cannot"
    assert "times the time in which the best reach 0.0001" in whys["dear"]
    rungs = [r for r in tables[front.RUNGS] if r["integrator"] == "a"]
    assert [r["steps"] for r in rungs] == sorted(r["steps"] for r in rungs)
    assert all(r["h"] is None for r in tables[front.RUNGS] if r["integrator"] == "tolerant")
    assert not {"dear", "nobody"} & {r["integrator"] for r in tables[front.RUNGS]}


@pytest.mark.parametrize(
    ("errors", "ends"),
    [
        ([2.0, 1.5, 1.8, 1.6, 1.7], False),  # a coarse start is no floor
        ([0.1, 0.05, 0.06, 0.05, 0.07], True),
        ([0.1, 0.05, 0.06, 0.05, 0.01], False),
        ([0.1, 0.0], True),
    ],
)
def test_a_curve_ends_at_its_floor(errors, ends):
    runs = [Rung(2**k, None, "ok", error, 0.1) for k, error in enumerate(errors)]
    assert bool(curves._end_reason(runs)) == ends
    assert "too long" in curves._end_reason([*runs, runs[-1]._replace(seconds=1.1 * curves.LONGEST)])
