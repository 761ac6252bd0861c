"""The trade-off between cost and error: runs at ever finer steps, and final timings, of stand-ins with known errors."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.ladder import competitors, race
from phasebench.benchmarks.ladder.bracket import bracket, cost
from phasebench.benchmarks.ladder.cheapest import CHEAPER, cheapest
from phasebench.benchmarks.ladder.race import Known
from phasebench.benchmarks.ladder.refine import refine
from phasebench.benchmarks.ladder.rung import OVERHEAD, WORTH, Rung, Task
from phasebench.benchmarks.measure.clock import Clocks
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.questions import QUESTIONS, down_to
from phasebench.benchmarks.studies.trade import front
from phasebench.reference.peers import BY_ID as REGISTERED


class Law:
    """A stand-in for an integrator: error (steps / scale)^-order, at least ``floor``, and ``step`` seconds per step."""

    def __init__(
        self,
        label: str,
        order: float,
        step: float,
        floor: float = 1e-16,
        scale: float = 100.0,
        side=OURS,
        fails=0,
        failing: float = 0.0,
    ):
        self.label = self.id = label
        self.order, self.step, self.floor, self.scale = order, step, floor, scale
        self.kind = "phasebench" if side == OURS else "heyoka"
        self.adaptive = self.stoppable = False
        self.preparable = True
        self.record = SimpleNamespace(least=1e-16)
        self.seen: list[int] = []
        self.fails, self.failing = fails, failing  # runs with fewer steps fail, after this many seconds

    def run(self, problem, t_end, steps, save_every, **more):
        """A solution whose final state is off by the error that the number of steps gives."""
        self.seen.append(steps)
        error = max((steps / self.scale) ** -self.order, self.floor)
        counts = {"steps": steps, "gradient": steps}
        return SimpleNamespace(
            t=np.array([0.0, t_end]),
            q=np.array([[0.0], [error]]),
            p=np.zeros((2, 1)),
            status="ok" if steps >= self.fails else "no-root",
            seconds=self.step * steps if steps >= self.fails else self.failing,
            counts=counts,
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


def task(last: int = 12) -> Task:
    """A question of the trade-off about the end of a pendulum run, whose true value is set to 0."""
    made = problem("pendulum:swinging")
    return Task(made, 100.0, quantity(made, "end-state"), Truth(np.zeros(2), 0.0, ""), down_to(last))


def climb_laws(*laws: Law, last: int = 12):
    """(the question, the runs of each stand-in integrator at ever finer steps); one integrator after another."""
    asked, known = task(last), Known()
    return asked, [race.enter(asked, law, known) for law in laws]


def test_ladder_doubles_steps_to_the_finest_accuracy():
    asked, (one,) = climb_laws(Law("a", 4, 1e-8))
    steps = [r.steps for r in one.rungs]
    assert steps[0] == round(100.0 / (race.WIDEST * asked.problem.pace.step))
    assert all(1.9 < b / a < 2.1 for a, b in pairwise(steps))
    assert one.rungs[-2].error > 1e-12 >= one.rungs[-1].error
    assert not one.dropped


def test_ladder_continues_to_wider_steps_if_needed():
    _, (one,) = climb_laws(Law("a", 8, 1e-8, scale=4.0))
    assert one.rungs[0].error > 1e-1 >= one.rungs[1].error
    assert [r.steps for r in one.rungs] == sorted(r.steps for r in one.rungs)


def test_method_that_always_fails_is_dropped():
    _, (never, late) = climb_laws(Law("never", 4, 1e-8, fails=10**18), Law("late", 4, 1e-8, fails=1000))
    assert never.dropped
    assert len(never.rungs) == race.FAILURES
    assert never.why == "10 runs in a row ended as no-root"
    assert not late.dropped
    assert late.rungs[-1].error <= 1e-12


def test_slow_failures_are_limited_in_total_time():
    fast = Law("fast", 4, 1e-8)
    _, (_, late, never) = climb_laws(
        fast,
        Law("late", 4, 1e-8, fails=200, failing=0.9 * race.WASTED / 4),
        Law("never", 4, 1e-8, fails=10**18, failing=1.1 * race.WASTED / 4),
    )
    assert sum(r.status == "no-root" for r in late.rungs) > 1
    assert late.rungs[-1].error <= 1e-12
    assert never.dropped
    assert len(never.rungs) == 4


def test_one_slow_failure_does_not_end_a_ladder():
    """A single slow run that fails may be the first one, which includes compilation."""
    _, (one,) = climb_laws(Law("one", 4, 1e-8, fails=60, failing=2 * race.WASTED))
    assert [r.status for r in one.rungs][:2] == ["no-root", "ok"]
    assert not one.dropped


class Loose(Law):
    """A stand-in for an adaptive peer that fails slowly at loose tolerances."""

    def __init__(self, label: str, loosest: float):
        super().__init__(label, 1, 1e-8, side=PEERS)
        self.adaptive, self.loosest = True, loosest

    def run(self, problem, t_end, tol, save_every, **more):
        """A run whose error is its tolerance."""
        told = super().run(problem, t_end, 100, save_every)
        told.q = np.array([[0.0], [tol]])
        told.status = "ok" if tol <= self.loosest else "diverged"
        told.seconds = 1e-3 if tol <= self.loosest else race.WASTED
        return told


def test_peer_that_fails_at_loose_tolerances_is_retried():
    _, (one, never) = climb_laws(Loose("one", 1e-7), Loose("never", 0.0))
    assert not one.dropped
    assert one.rungs[-1].error <= 1e-12
    assert never.dropped
    assert len(never.rungs) == race.FAILURES


class Newton(Law):
    """A stand-in for an implicit method whose runs with wide steps take longer than those with fine ones."""

    def run(self, problem, t_end, steps, save_every, **more):
        """A run whose time is inversely proportional to its number of steps."""
        told = super().run(problem, t_end, steps, save_every)
        told.seconds = 1e3 * self.step / steps
        return told


def test_hopeless_first_run_is_not_widened():
    newton = Newton("newton", 8, 1.0, scale=4.0)
    _, (_, one) = climb_laws(Law("fast", 4, 1e-8), newton)
    assert one.dropped
    assert len(newton.seen) == len(one.rungs) == 1
    quick = Newton("newton", 8, 1e-6, scale=4.0)
    climb_laws(Law("fast", 4, 1e-8), quick)
    assert min(quick.seen) < min(newton.seen)


class Halting(Law):
    """A stand-in for an adaptive peer whose error stays at ``at`` over three decades of tolerance."""

    def __init__(self, at: float):
        super().__init__("halting", 4, 1e-8, side=PEERS)
        self.adaptive, self.at = True, at

    def run(self, problem, t_end, save_every, tol, **more):
        """A run whose error is its tolerance, except for the three decades up to ``at``, where it is ``at``."""
        error = self.at if self.at / 3000 < tol <= self.at else tol
        return super().run(problem, t_end, self.scale * error**-0.25, save_every)


def test_stagnation_above_round_off_does_not_end_a_ladder():
    """The error of a solver of variable order may stagnate where its order changes."""
    _, (one,) = climb_laws(Halting(1e-4))
    assert one.rungs[-1].error <= 1e-12
    _, (one,) = climb_laws(Halting(1e-9))
    assert "round-off" in one.why


def test_peer_with_long_compilation_ends_its_ladder(monkeypatch):
    clock = iter(range(0, 10**6, 2 + round(race.PREPARING)))
    monkeypatch.setattr(race.time, "process_time", lambda: float(next(clock)))
    _, (one,) = climb_laws(Halting(1e-4))
    assert len(one.rungs) == 2
    assert "to compile from a tolerance of 0.01 on" in one.why
    assert not one.dropped


def test_bare_run_is_compiled_only_where_it_matters():
    asked, known, one = task(), Known([(1e-6, 1e-4, "fast")]), integrator("rk4")
    far, cheapest = OVERHEAD + 1.01 * WORTH * 1e-4, known.seconds(1e-6)
    assert asked.beaten(one, far, cheapest)
    assert not asked.beaten(one, 0.98 * far, cheapest)
    assert not asked.beaten(one, far, known.seconds(1e-7)), "nobody has reached that error"
    assert not asked.beaten(integrator("heyoka"), far, cheapest), "a peer has nothing to compile for it"


def test_far_too_slow_method_is_dropped_at_once():
    _, (_, late, slow) = climb_laws(Law("fast", 4, 1e-8), Law("coarse", 4, 1e-2, scale=1e6), Law("slow", 4, 1e-2))
    assert late.dropped
    assert slow.dropped
    assert len(late.rungs) == len(slow.rungs) == 1
    assert "times as long as fast" in late.why


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


class Implicit(Law):
    """A stand-in for a method whose wide steps need many evaluations; unless ``told``, it reports one per step."""

    def __init__(self, *law, told: bool, **more):
        super().__init__(*law, **more)
        self.told = told

    def run(self, problem, t_end, steps, save_every, **more):
        solution = super().run(problem, t_end, steps, save_every)
        sweeps = 1 + (1400 / steps) ** 2
        solution.seconds *= sweeps
        solution.counts["gradient"] = steps * sweeps if self.told else steps
        return solution


def test_cost_of_wide_implicit_steps_is_not_extrapolated():
    """The widest steps have errors above 1 in seven times the best time for 1e-12; fine ones are nearly cheapest."""
    fast = Law("fast", 8, 1e-6)
    _, (_, late) = climb_laws(fast, Implicit("late", 16, 1e-6, scale=200.0, told=True))
    assert late.rungs[0].error > 1
    assert late.rungs[0].seconds > 2 * race.LONGEST * 1e-6 * 100 * 10 ** (12 / 8)
    assert late.why == "reached the finest accuracy"
    _, (_, given_up) = climb_laws(fast, Implicit("late", 16, 1e-6, scale=200.0, told=False))
    assert given_up.dropped
    assert "times the time in which the best reach 1e-12" in given_up.why


def test_ladder_ends_at_round_off():
    _, (one,) = climb_laws(Law("a", 4, 1e-8, floor=1e-9))
    assert "round-off" in one.why
    assert not one.dropped
    assert sum(r.error == 1e-9 for r in one.rungs) <= race.STANDING + 1


def test_hopeless_method_ends_at_a_multiple_of_the_best():
    _, (_, lost) = climb_laws(Law("fast", 8, 1e-8), Law("never", 0.01, 1e-8))
    assert lost.dropped
    assert lost.rungs[-1].seconds < 10 * 1e-8 * 100 * 10 ** (12 / 8) + 2 * race.FREE


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


def test_cheapest_sufficient_step_need_not_be_the_widest():
    """An implicit step takes ten times as long where only Newton's method converges."""
    asked, (late,) = climb_laws(Implicit("late", 16, 1e-6, scale=200.0, told=True))
    widest = bracket(late.rungs, 1e-2)[1][0]
    found = refine(asked, late.integrator, late.rungs, 1e-2)
    assert found.steps > 1.5 * widest.steps
    assert found.seconds < CHEAPER * widest.seconds
    assert found.seconds == min(r.seconds for r in late.rungs if r.error <= 1e-2)
    assert cost(late.rungs, 1e-2) <= found.seconds


def test_noisy_time_does_not_select_a_finer_step():
    """Before a finer step is selected, both are timed again."""
    law = Law("a", 4, 1e-6)
    asked, (one,) = climb_laws(law)
    widest, *finer = (r for r in one.rungs if r.error <= 1e-3)
    found = refine(asked, law, [widest._replace(seconds=20 * widest.seconds), *finer], 1e-3)
    assert found.steps == widest.steps
    assert found.seconds == pytest.approx(widest.seconds)


@pytest.mark.parametrize(("share", "stands"), [(0.85, 0), (0.75, 1)])
def test_finer_step_is_selected_only_if_clearly_cheaper(share, stands):
    rungs = [Rung(2**k, None, "ok", 10.0**-k, s, 2**k, 0) for k, s in enumerate((1e-3, share * 1e-3, 2e-3))]
    assert cheapest(rungs) is rungs[stands]
    assert cheapest([]) is None


def test_estimated_cost_lies_on_the_law():
    _, (one,) = climb_laws(Law("a", 4, 1e-8))
    for wanted in (1e-3, 1e-7, 1e-11):
        assert cost(one.rungs, wanted) == pytest.approx(1e-6 * wanted**-0.25, rel=1e-9)
    assert cost(one.rungs, 1e-30) == inf


def test_refined_step_just_meets_the_accuracy():
    law = Law("a", 4, 1e-8)
    asked, (one,) = climb_laws(law)
    for wanted in (1e-2, 1e-5, 1e-10):
        found = refine(asked, law, one.rungs, wanted)
        needed = 100 * wanted**-0.25
        assert found.error <= wanted
        assert needed <= found.steps <= 1.1 * needed + 1


class Lucky(Law):
    """A stand-in for an integrator whose error vanishes by chance at 620 to 679 steps.

    From 680 to 1053 steps its error is that of 620.
    """

    def run(self, problem, t_end, steps, save_every, **more):
        """A run with the usual error except where it vanishes or is that of 620 steps."""
        told = super().run(problem, t_end, steps, save_every)
        if 620 <= steps < 680:
            told.q[-1] = 1e-12
        elif 680 <= steps < 1054:
            told.q[-1] = 6.2**-self.order
        return told


def test_wide_step_found_later_counts_at_coarser_accuracy(monkeypatch):
    """Of two accuracies the coarser never takes more steps."""
    monkeypatch.setattr(front, "task_of", lambda scene: task(8))
    monkeypatch.setattr(front, "entrants", lambda asked: ([Lucky("a", 4, 1e-6)], {}))
    choices = front.measure("s")[front.CHOICES]
    assert [c["accuracy"] for c in choices] == sorted((c["accuracy"] for c in choices), reverse=True)
    steps = [c["ours steps"] for c in choices]
    assert steps == sorted(steps)


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


def test_side_that_misses_the_accuracy_is_not_named():
    asked, found = climb_laws(Law("a", 4, 1e-8), Law("b", 4, 1e-8, floor=1e-6, side=PEERS))
    rows, choice = front.final(asked, front.finalists(asked, found, 1e-9), 1e-9)
    assert [r["integrator"] for r in rows] == ["a"]
    assert "peer integrator" not in choice
    assert "ratio" not in choice


def test_accuracy_below_the_uncertainty_is_not_requested():
    whole = task()
    blurred = replace(whole, truth=Truth(np.zeros(2), 3e-7, ""))
    assert whole.testable_accuracies == down_to(12)
    assert blurred.testable_accuracies == down_to(6)


# -- competitors -------------------------------------------------------------------------------------------------------


def test_batch_integrators_do_not_compete():
    labels = {c.label for c in competitors.competitors()}
    assert not labels & set(competitors.LEFT_OUT)
    assert "heyoka-batch" in competitors.LEFT_OUT
    assert competitors.LEFT_OUT.keys() <= REGISTERED.keys(), "the control: they are the names of peers"


def test_every_fast_mode_of_a_peer_competes():
    labels = {c.label for c in competitors.competitors()}
    assert {"heyoka", "heyoka-high-accuracy", "heyoka(compact_mode)", "heyoka-high-accuracy(compact_mode)"} <= labels
    assert {f"rebound-ias15(adaptive_mode={m})" for m in ("individual", "global", "aarseth85")} <= labels
    assert {"rebound-whfast", "rebound-whfast-plain", "rebound-saba-10-6-4", "rebound-bs"} <= labels
    assert {"scipy-dop853-numba", "scipy-lsoda-numba", "scipy-ode(DOP853)", "scipy-odeint(LSODA)"} <= labels
    fixed = [p.settings for p in competitors.peers() if p.settings.get("integrator") in ("whfast", "saba")]
    assert fixed
    assert all(s["safe_mode"] == 0 for s in fixed)


def test_excluded_competitors_have_a_reason():
    can, cannot = competitors.able(problem("lotka-volterra:4-2"))
    assert "heyoka" in {c.label for c in can}
    assert cannot["rebound-whfast"].startswith("REBOUND integrates H = ")


def test_selection_for_many_degrees_of_freedom():
    can, cannot = competitors.able(problem("outer-solar-system"))
    labels = {c.label for c in can}
    assert {"gauss-8", "stormer-verlet", "implicit-midpoint", "dop853-relaxation", "wisdom-holman"} <= labels
    assert {"avf", "scheme-v", "rk4-projected-energy"}.isdisjoint(labels)
    assert all("degrees of freedom" in cannot[id] for id in ("avf", "scheme-v", "scheme-ii(lam=2)"))
    waves = {c.label for c in competitors.able(problem("nls"))[0]}
    assert {"implicit-midpoint", "gauss-5"}.isdisjoint(waves)
    assert "gauss-4" in waves, "of 2 d unknowns a stage, 512 in all"
    few, left_out = competitors.able(problem("henon-heiles"))
    assert {"avf", "scheme-v", "rk4-projected-energy", "implicit-midpoint"} <= {c.label for c in few}
    assert not any("degrees of freedom" in why for why in left_out.values())


def test_heyoka_competes_in_both_modes():
    """Compiled in compact mode and not, for H from its formula and for heyoka's built-in model."""
    for name, other, model in (
        ("kepler", "heyoka(compact_mode)", "fixed_centres"),
        ("solar-system", "heyoka(compact_mode=False)", "nbody"),
    ):
        can, cannot = competitors.able(problem(name))
        labels = {c.label for c in can if c.label.startswith("heyoka")}
        both = [f"heyoka(model={model}, compact_mode{mode})" for mode in ("", "=False")]
        plain = ["heyoka", other, *both]
        assert labels == {*plain, *(x.replace("heyoka", "heyoka-high-accuracy") for x in plain)}
        assert sum("is the same" in why for why in cannot.values()) == 2


def test_heyoka_enters_the_final_in_the_mode_that_the_search_could_not_compile(monkeypatch):
    """The search knows heyoka in a mode that takes 2.5 times as long as the best; another takes a tenth of that."""
    asked, found = climb_laws(Law("solver", 8, 8e-8, side=PEERS), Law("slow", 8, 2e-7, side=PEERS))

    def twins(task, member, wanted):
        run = member.rung._replace(seconds=member.rung.seconds / 10)
        return [front.Finalist(Law("fast", 8, 2e-8, side=PEERS), run)] if member.integrator.label == "slow" else []

    monkeypatch.setattr(front, "twins", twins)
    for mode, best in (("slow", "fast"), ("none", "solver")):
        monkeypatch.setattr(front, "is_heyoka", lambda c, mode=mode: c.label == mode)
        assert [m.integrator.label for m in front.finalists(asked, found, 1e-3)] == [best]


def test_exact_methods_do_not_compete():
    _, cannot = competitors.able(problem("kepler"))
    assert all("exact" in cannot[x] for x in ("rebound-whfast", "rebound-saba-1", "wisdom-holman"))
    can, _ = competitors.able(problem("perturbed-kepler"))
    assert {"rebound-whfast", "rebound-saba-1", "wisdom-holman"} <= {c.label for c in can}
    _, cannot = competitors.able(problem("harmonic-oscillator"))
    assert "exact" in cannot["gautschi"]


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


def test_two_scenes_reach_t_100000():
    assert sum(q.t_end >= 1e5 and q.build_problem().pace.unit == 1.0 for q in QUESTIONS) >= 2


def test_rows_are_kept_near_the_fastest_only():
    asked, known = task(), Known()
    fast, fair, slow = (race.enter(asked, Law(x, 4, s), known) for x, s in (("a", 1e-8), ("b", 1.5e-8), ("c", 1e-7)))
    assert [front.near(asked, k, known) for k in (fast, fair, slow)] == [True, True, False]


def test_scene_with_a_real_peer_and_real_methods():
    """On a short pendulum heyoka and the better of two methods are chosen, with errors just below the allowed one.

    The other method is left out, with the reason that it takes too many times as long.
    """
    asked = front.task_of("pendulum-short")
    known = Known()
    found = [
        race.enter(asked, c, known)
        for c in competitors.competitors()
        if c.label in ("heyoka", "stormer-verlet", "blanes-moan-srkn6b")
    ]
    rows, choice = front.final(asked, front.finalists(asked, found, 1e-6), 1e-6)
    assert choice["peer integrator"] in ("heyoka", "heyoka(compact_mode)")  # the faster of its modes depends on timing
    assert choice["ours integrator"] == "blanes-moan-srkn6b"
    assert all(1e-9 < r["error"] <= 1e-6 for r in rows)
    verlet = next(k for k in found if k.integrator.label == "stormer-verlet")
    assert min(r.error for r in verlet.rungs) > 1e-12
    assert "times" in verlet.why


# -- final timings -----------------------------------------------------------------------------------------------------


class Tolerant(Law):
    """A stand-in for an adaptive integrator whose error is the square of its tolerance."""

    def __init__(self, label: str = "tolerant", side=PEERS):
        super().__init__(label, 4, 1e-8, side=side)
        self.adaptive = True

    def run(self, problem, t_end, save_every, tol, **more):
        """A run with as many steps as the error needs."""
        return super().run(problem, t_end, self.scale * tol**-0.5, save_every)


@pytest.mark.parametrize("wanted", [3e-3, 2e-7])
def test_refined_tolerance_just_meets_the_accuracy(wanted):
    law = Tolerant()
    asked, (one,) = climb_laws(law)
    before = len(one.rungs)
    found = refine(asked, law, one.rungs, wanted)
    assert found.error <= wanted
    assert 0.95 * wanted**0.5 <= found.tol <= wanted**0.5
    assert len(one.rungs) > before
    assert [r.fineness for r in one.rungs] == sorted(r.fineness for r in one.rungs)


def test_sufficient_widest_step_is_not_refined():
    law = Law("a", 4, 1e-8)
    asked, (one,) = climb_laws(law)
    before = list(one.rungs)
    assert refine(asked, law, one.rungs, 10 * one.rungs[0].error) == before[0]
    assert one.rungs == before


def test_error_equal_to_the_accuracy_meets_it():
    law = Law("a", 4, 1e-8, floor=1e-6)
    asked, (one,) = climb_laws(law)
    _, (coarse, *_) = bracket(one.rungs, 1e-6)
    found = refine(asked, law, one.rungs, 1e-6)
    assert found.error == 1e-6
    assert found.steps < coarse.steps


def test_cost_after_a_failed_run_is_that_of_the_next():
    failed, good = Rung(1, None, "diverged", inf, 9.0, 1, 0), Rung(2, None, "ok", 1e-5, 2.0, 2, 0)
    assert cost([failed, good], 1e-3) == 2.0


@pytest.mark.parametrize(("seconds", "count"), [(0.01, 3), (0.04, 3), (0.1, 2), (10.0, 2)])
def test_slow_final_has_fewer_finalists(seconds, count):
    """If a run takes 0.1 s, two integrators of each side are timed again at the end instead of three."""
    many = [Law(f"{side}{k}", 4, 1.0, side=side) for side in (OURS, PEERS) for k in range(5)]
    rung = Rung(100, None, "ok", 1e-6, seconds, 100, 0)
    found = front.finalists(task(), [race.Climb(c, [rung], "", False) for c in many], 1e-3)
    assert [f.integrator.label[:4] for f in found] == [OURS[:4]] * count + [PEERS[:4]] * count


@pytest.mark.parametrize(("seconds", "rounds"), [(1e-6, 15), (0.06, 10), (60.0, 6)])
def test_number_of_rounds_in_a_final(seconds, rounds, monkeypatch):
    """With six runs their range covers the median time with probability 97 %; with five, 94 %."""
    asked = []
    monkeypatch.setattr(front.timing, "in_turns", lambda work, n: asked.append(n) or {k: np.ones(n) for k in work})
    rung = Rung(100, None, "ok", 1e-6, seconds / 2, 100, 0)
    front.time_finalists(task(), [front.Finalist(Law(name, 4, 1.0), rung) for name in "ab"])
    assert asked == [rounds]


def test_rows_of_a_scene_list_steps_and_dropped_methods(monkeypatch):
    laws = [Law("a", 4, 1e-8), Law("dear", 4, 1e-4), Law("b", 4, 2e-8, side=PEERS), Tolerant()]
    monkeypatch.setattr(front, "task_of", lambda scene: task(4))
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
