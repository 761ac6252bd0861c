"""The climb and the finals of the trade on integrators whose error and time are laws, so that the answer is known."""

from __future__ import annotations

from itertools import pairwise
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.advice.cheapest import CHEAPER, cheapest
from phasebench.benchmarks.experiments.trade import climb, field, front
from phasebench.benchmarks.experiments.trade.climb import Known, Rung, Task
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.measure.quantities import Truth, quantity
from phasebench.benchmarks.measure.timing import OURS, PEERS
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.problems.questions import QUESTIONS, Question, down_to


class Law:
    """Error (steps / scale)^-order down to a floor; `step` seconds a step."""

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
        self.record = SimpleNamespace(least=1e-16)
        self.seen: list[int] = []
        self.fails, self.failing = fails, failing  # below so many steps it finds no root, after so many seconds

    def run(self, problem, t_end, steps, save_every, **more):
        """A solution whose state is off by the law's error."""
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
        )


@pytest.fixture(autouse=True)
def _laws_tell_their_time(monkeypatch):
    """The clock of a law is what it tells."""
    of_others = Task.clock

    def clock(self, c, steps, tol):
        if not isinstance(c, Law):
            return of_others(self, c, steps, tol)
        size = {"tol": tol} if steps is None else {"steps": steps}
        return lambda: c.run(self.problem, t_end=self.question.t_end, save_every=0, **size).seconds

    monkeypatch.setattr(Task, "clock", clock)
    monkeypatch.setattr(Task, "call", lambda self, c, steps, tol: 1e-7)


def task(last: int = 12) -> Task:
    """A question about a state that is 0."""
    made = problem("pendulum:swinging")
    asked = Question("s", "pendulum:swinging", 100.0, "end-state", down_to(last), "")
    return Task(asked, made, quantity(made, "end-state"), Truth(np.zeros(2), 0.0, ""))


def climbed(*laws: Law, last: int = 12):
    """(the question, the climbs one after another)."""
    asked, known = task(last), Known()
    return asked, [climb.climb(asked, law, known) for law in laws]


def test_a_climb_goes_from_the_widest_step_to_the_finest_accuracy_by_doubling():
    asked, (one,) = climbed(Law("a", 4, 1e-8))
    steps = [r.steps for r in one.rungs]
    assert steps[0] == round(100.0 / (climb.WIDEST * asked.problem.pace.step))
    assert all(1.9 < b / a < 2.1 for a, b in pairwise(steps))
    assert one.rungs[-2].error > 1e-12 >= one.rungs[-1].error
    assert not one.dropped


def test_a_climb_that_begins_above_the_coarsest_accuracy_goes_wider_first():
    _, (one,) = climbed(Law("a", 8, 1e-8, scale=4.0))
    assert one.rungs[0].error > 1e-1 >= one.rungs[1].error
    assert [r.steps for r in one.rungs] == sorted(r.steps for r in one.rungs)


def test_who_never_comes_to_the_end_is_given_up_and_who_does_at_finer_steps_is_not():
    _, (never, late) = climbed(Law("never", 4, 1e-8, fails=10**18), Law("late", 4, 1e-8, fails=1000))
    assert never.dropped
    assert len(never.rungs) == climb.FAILURES
    assert never.why == "10 runs in a row ended as no-root"
    assert not late.dropped
    assert late.rungs[-1].error <= 1e-12


def test_runs_that_fail_slowly_are_made_for_a_while_and_say_nothing_of_those_that_arrive():
    fast = Law("fast", 4, 1e-8)
    _, (_, late, never) = climbed(
        fast,
        Law("late", 4, 1e-8, fails=200, failing=0.9 * climb.WASTED / 4),
        Law("never", 4, 1e-8, fails=10**18, failing=1.1 * climb.WASTED / 4),
    )
    assert sum(r.status == "no-root" for r in late.rungs) > 1
    assert late.rungs[-1].error <= 1e-12
    assert never.dropped
    assert len(never.rungs) == 4


class Newton(Law):
    """An implicit method whose wide steps take longer than its fine ones."""

    def run(self, problem, t_end, steps, save_every, **more):
        """So much longer as the step is wider."""
        told = super().run(problem, t_end, steps, save_every)
        told.seconds = 1e3 * self.step / steps
        return told


def test_a_hopeless_first_run_is_not_made_with_wider_steps():
    newton = Newton("newton", 8, 1.0, scale=4.0)
    _, (_, one) = climbed(Law("fast", 4, 1e-8), newton)
    assert one.dropped
    assert len(newton.seen) == len(one.rungs) == 1
    quick = Newton("newton", 8, 1e-6, scale=4.0)
    climbed(Law("fast", 4, 1e-8), quick)
    assert min(quick.seen) < min(newton.seen)


class Halting(Law):
    """An adaptive peer whose error stands still for a few tolerances."""

    def __init__(self, at: float):
        super().__init__("halting", 4, 1e-8, side=PEERS)
        self.adaptive, self.at = True, at

    def run(self, problem, t_end, save_every, tol, **more):
        """One whose error is the tolerance, but `at` for three decades."""
        error = self.at if self.at / 3000 < tol <= self.at else tol
        return super().run(problem, t_end, self.scale * error**-0.25, save_every)


def test_an_error_that_halts_far_above_round_off_is_climbed_past():
    """A solver of adaptive order may stand still where its order changes."""
    _, (one,) = climbed(Halting(1e-4))
    assert one.rungs[-1].error <= 1e-12
    _, (one,) = climbed(Halting(1e-9))
    assert "round-off" in one.why


def test_a_peer_that_compiles_for_long_climbs_no_further(monkeypatch):
    clock = iter(range(0, 10**6, 2 + round(climb.PREPARING)))
    monkeypatch.setattr(climb.time, "process_time", lambda: float(next(clock)))
    _, (one,) = climbed(Halting(1e-4))
    assert len(one.rungs) == 2
    assert "to compile from a tolerance of 0.01 on" in one.why
    assert not one.dropped


def test_a_run_without_output_is_compiled_only_where_it_may_matter():
    asked, known, one = task(), Known([(1e-6, 1e-4, "fast")]), integrator("rk4")
    far = climb.OVERHEAD + 1.01 * climb.WORTH * 1e-4
    assert asked.beaten(one, 1e-6, far, known)
    assert not asked.beaten(one, 1e-6, 0.98 * far, known)
    assert not asked.beaten(one, 1e-7, far, known), "nobody has reached that error"
    assert not asked.beaten(one, 1e-6, far, None)
    assert not asked.beaten(integrator("heyoka"), 1e-6, far, known), "a peer has nothing to compile for it"


def test_who_takes_far_too_long_is_dropped_at_once_whatever_its_error():
    _, (_, late, slow) = climbed(Law("fast", 4, 1e-8), Law("coarse", 4, 1e-2, scale=1e6), Law("slow", 4, 1e-2))
    assert late.dropped
    assert slow.dropped
    assert len(late.rungs) == len(slow.rungs) == 1
    assert "times as long as fast" in late.why


def test_who_is_too_slow_everywhere_is_dropped_early_and_it_is_said_by_whom():
    _, (_, slow) = climbed(Law("fast", 4, 1e-8), Law("slow", 4, 1e-7))
    assert slow.dropped
    assert slow.rungs[-1].error > 1e-5
    assert "10.0 times as long as fast" in slow.why


def test_who_is_slow_at_first_but_comes_nearer_is_kept():
    """Order 4 at twenty times the price of a step of order 2 loses until 6e-6 and wins from there on."""
    _, (_, high) = climbed(Law("low", 2, 1e-8), Law("high", 4, 2e-7))
    assert high.rungs[2].error > 1e-3
    assert not high.dropped
    assert min(r.error for r in high.rungs) <= 1e-12
    _, (_, high) = climbed(Law("low", 2, 1e-8), Law("high", 2, 2e-7))
    assert high.dropped


class Implicit(Law):
    """Wide steps take many evaluations, or (``told`` is False) seem to take no more than others."""

    def __init__(self, *law, told: bool, **more):
        super().__init__(*law, **more)
        self.told = told

    def run(self, problem, t_end, steps, save_every, **more):
        solution = super().run(problem, t_end, steps, save_every)
        sweeps = 1 + (1400 / steps) ** 2
        solution.seconds *= sweeps
        solution.counts["gradient"] = steps * sweeps if self.told else steps
        return solution


def test_wide_steps_of_implicit_equations_tell_nothing_of_shorter_ones():
    """Off by more than 1 in seven times the time of the best at 1e-12, then nearly as cheap as they are."""
    fast = Law("fast", 8, 1e-6)
    _, (_, late) = climbed(fast, Implicit("late", 16, 1e-6, scale=200.0, told=True))
    assert late.rungs[0].error > 1
    assert late.rungs[0].seconds > 2 * climb.LONGEST * 1e-6 * 100 * 10 ** (12 / 8)
    assert late.why == "reached the finest accuracy"
    _, (_, given_up) = climbed(fast, Implicit("late", 16, 1e-6, scale=200.0, told=False))
    assert given_up.dropped
    assert "times the time in which the best reach 1e-12" in given_up.why


def test_a_climb_ends_where_round_off_is():
    _, (one,) = climbed(Law("a", 4, 1e-8, floor=1e-9))
    assert "round-off" in one.why
    assert not one.dropped
    assert sum(r.error == 1e-9 for r in one.rungs) <= climb.STANDING + 1


def test_a_method_that_never_gets_there_ends_after_a_multiple_of_the_finest_price():
    _, (_, lost) = climbed(Law("fast", 8, 1e-8), Law("never", 0.01, 1e-8))
    assert lost.dropped
    assert lost.rungs[-1].seconds < 10 * 1e-8 * 100 * 10 ** (12 / 8) + 2 * climb.FREE


def test_the_bracket_is_the_last_miss_and_what_follows_it():
    """An error that happens to be small at a wide step is no answer; what follows the least error is round-off."""
    errors = [0.5, 1e-10, 1e-2, 1e-4, 1e-11, 5e-9, 5e-9]
    rungs = [Rung(2**k, None, "ok", e, 1e-6 * 2**k, 2**k, 0) for k, e in enumerate(errors)]
    low, meeting = front.bracket(rungs, 2e-9)
    assert (low.error, [r.error for r in meeting]) == (1e-4, [1e-11])
    assert front.bracket(rungs, 1e-12) == (None, [])
    lucky = [Rung(2**k, None, "ok", e, 1.0, 2**k, 0) for k, e in enumerate([0.03, 0.07, 0.3])]
    assert front.bracket(lucky, 0.1)[1] == []
    assert front.estimate(lucky, 0.1) == inf
    assert front.bracket(rungs, 1.0) == (None, rungs)


def test_of_the_steps_that_meet_an_accuracy_the_cheapest_stands_which_need_not_be_the_widest():
    """Implicit equations take ten times as long where only Newton's method solves them."""
    asked, (late,) = climbed(Implicit("late", 16, 1e-6, scale=200.0, told=True))
    widest = front.bracket(late.rungs, 1e-2)[1][0]
    found = front.refine(asked, late.integrator, late.rungs, 1e-2)
    assert found.steps > 1.5 * widest.steps
    assert found.seconds < CHEAPER * widest.seconds
    assert found.seconds == min(r.seconds for r in late.rungs if r.error <= 1e-2)
    assert front.estimate(late.rungs, 1e-2) <= found.seconds


def test_a_time_that_was_noise_does_not_make_a_finer_step_stand():
    """Before a finer step stands, both are timed again."""
    law = Law("a", 4, 1e-6)
    asked, (one,) = climbed(law)
    widest, *finer = (r for r in one.rungs if r.error <= 1e-3)
    found = front.refine(asked, law, [widest._replace(seconds=20 * widest.seconds), *finer], 1e-3)
    assert found.steps == widest.steps
    assert found.seconds == pytest.approx(widest.seconds)


@pytest.mark.parametrize(("share", "stands"), [(0.85, 0), (0.75, 1)])
def test_a_finer_step_stands_before_the_widest_only_if_it_is_clearly_cheaper(share, stands):
    rungs = [Rung(2**k, None, "ok", 10.0**-k, s, 2**k, 0) for k, s in enumerate((1e-3, share * 1e-3, 2e-3))]
    assert cheapest(rungs) is rungs[stands]
    assert cheapest([]) is None


def test_the_estimate_lies_on_the_law():
    _, (one,) = climbed(Law("a", 4, 1e-8))
    for wanted in (1e-3, 1e-7, 1e-11):
        assert front.estimate(one.rungs, wanted) == pytest.approx(1e-6 * wanted**-0.25, rel=1e-9)
    assert front.estimate(one.rungs, 1e-30) == inf


def test_a_refined_step_meets_the_accuracy_and_is_hardly_finer_than_it_must_be():
    law = Law("a", 4, 1e-8)
    asked, (one,) = climbed(law)
    for wanted in (1e-2, 1e-5, 1e-10):
        found = front.refine(asked, law, one.rungs, wanted)
        needed = 100 * wanted**-0.25
        assert found.error <= wanted
        assert needed <= found.steps <= 1.1 * needed + 1


class Lucky(Law):
    """Its error vanishes from 620 steps on; from 680 on it is that of 620 until the law's is smaller than a ninth."""

    def run(self, problem, t_end, steps, save_every, **more):
        """As the law says, but there."""
        told = super().run(problem, t_end, steps, save_every)
        if 620 <= steps < 680:
            told.q[-1] = 1e-12
        elif 680 <= steps < 1054:
            told.q[-1] = 6.2**-self.order
        return told


def test_a_wide_step_that_is_found_for_a_fine_accuracy_is_known_at_the_coarser_ones(monkeypatch):
    """Of two accuracies the coarser never takes more steps."""
    monkeypatch.setattr(front, "task_of", lambda scene: task(8))
    monkeypatch.setattr(front, "entered", lambda asked: ([Lucky("a", 4, 1e-6)], {}))
    choices = front.measured("s")[front.CHOICES]
    assert [c["accuracy"] for c in choices] == sorted((c["accuracy"] for c in choices), reverse=True)
    steps = [c["ours steps"] for c in choices]
    assert steps == sorted(steps)


def test_the_final_names_the_cheapest_of_either_side_and_their_ratio():
    ours = [Law("second", 2, 1e-8), Law("eighth", 8, 4e-8)]
    peers = [Law("taylor", 8, 8e-8, side=PEERS)]
    asked, found = climbed(*peers, *ours)
    for wanted, best in ((1e-1, "second"), (1e-10, "eighth")):
        rows, choice = front.final(asked, front.finalists(asked, found, wanted), wanted)
        assert choice["ours integrator"] == best
        assert choice["peer integrator"] == "taylor"
        assert {r["side"] for r in rows} == {OURS, PEERS}
        price = {"second": 1e-6 * wanted**-0.5, "eighth": 4e-6 * wanted**-0.125, "taylor": 8e-6 * wanted**-0.125}
        assert choice["ratio"] == pytest.approx(price[best] / price["taylor"], rel=0.15)
        assert choice["ratio low"] <= choice["ratio"] <= choice["ratio high"]
        assert all(r["error"] <= wanted for r in rows)


def test_of_a_side_that_does_not_get_there_nobody_is_named():
    asked, found = climbed(Law("a", 4, 1e-8), Law("b", 4, 1e-8, floor=1e-6, side=PEERS))
    rows, choice = front.final(asked, front.finalists(asked, found, 1e-9), 1e-9)
    assert [r["integrator"] for r in rows] == ["a"]
    assert "peer integrator" not in choice
    assert "ratio" not in choice


def test_what_a_reference_cannot_tell_is_not_asked():
    whole = task()
    blurred = Task(whole.question, whole.problem, whole.quantity, Truth(np.zeros(2), 3e-7, ""))
    assert whole.asked == down_to(12)
    assert blurred.asked == down_to(6)


# -- who competes ------------------------------------------------------------------------------------------------------


def test_a_throughput_of_many_orbits_competes_with_no_single_orbit():
    labels = {c.label for c in field.competitors()}
    assert not labels & set(field.LEFT_OUT)
    assert "heyoka-batch" in field.LEFT_OUT
    assert len(labels) == len(field.competitors())


def test_every_way_to_run_a_peer_fast_is_in_the_field():
    labels = {c.label for c in field.competitors()}
    assert {"heyoka", "heyoka-high-accuracy", "heyoka(compact_mode)", "heyoka-high-accuracy(compact_mode)"} <= labels
    assert {f"rebound-ias15(adaptive_mode={m})" for m in ("individual", "global", "aarseth85")} <= labels
    assert {"rebound-whfast", "rebound-whfast-plain", "rebound-saba-10-6-4", "rebound-bs"} <= labels
    assert {"scipy-dop853-numba", "scipy-lsoda-numba", "scipy-ode(DOP853)", "scipy-odeint(LSODA)"} <= labels
    fixed = [p.settings for p in field.peers() if p.settings.get("integrator") in ("whfast", "saba")]
    assert fixed
    assert all(s["safe_mode"] == 0 for s in fixed)


def test_the_field_of_a_problem_says_why_the_others_cannot():
    can, cannot = field.able(problem("lotka-volterra:4-2"))
    assert "heyoka" in {c.label for c in can}
    assert "quadratic" in cannot["rebound-whfast"] or "REBOUND" in cannot["rebound-whfast"]


def test_the_field_of_many_degrees_of_freedom_is_a_fixed_one():
    can, cannot = field.able(problem("outer-solar-system"))
    labels = {c.label for c in can}
    assert {"gauss-8", "stormer-verlet", "implicit-midpoint", "dop853-relaxation", "wisdom-holman"} <= labels
    assert {"avf", "scheme-v", "rk4-projected-energy"}.isdisjoint(labels)
    assert all("degrees of freedom" in cannot[id] for id in ("avf", "scheme-v", "scheme-ii(lam=2)"))
    waves = {c.label for c in field.able(problem("nls"))[0]}
    assert {"implicit-midpoint", "gauss-5"}.isdisjoint(waves)
    assert "gauss-4" in waves, "of 2 d unknowns a stage, 512 in all"
    few, left_out = field.able(problem("henon-heiles"))
    assert {"avf", "scheme-v", "rk4-projected-energy", "implicit-midpoint"} <= {c.label for c in few}
    assert not any("degrees of freedom" in why for why in left_out.values())


def test_heyoka_runs_in_the_mode_that_it_does_not_choose_besides():
    """And with its own model in both."""
    for name, other, model in (
        ("kepler", "heyoka(compact_mode)", "fixed_centres"),
        ("outer-solar-system", "heyoka(compact_mode=False)", "nbody"),
    ):
        can, cannot = field.able(problem(name))
        labels = {c.label for c in can if c.label.startswith("heyoka")}
        both = [f"heyoka(model={model}, compact_mode{mode})" for mode in ("", "=False")]
        plain = ["heyoka", other, *both]
        assert labels == {*plain, *(x.replace("heyoka", "heyoka-high-accuracy") for x in plain)}
        assert sum("is the same" in why for why in cannot.values()) == 2


def test_who_solves_a_problem_exactly_does_not_compete_on_it():
    _, cannot = field.able(problem("kepler"))
    assert all("exact" in cannot[x] for x in ("rebound-whfast", "rebound-saba-1", "wisdom-holman"))
    can, _ = field.able(problem("perturbed-kepler"))
    assert {"rebound-whfast", "rebound-saba-1", "wisdom-holman"} <= {c.label for c in can}
    _, cannot = field.able(problem("harmonic-oscillator"))
    assert "exact" in cannot["gautschi"]


def test_who_cannot_be_stopped_is_left_out_of_a_long_span_alone():
    made = problem("pendulum:rotating")

    def entered(t_end):
        asked = Question("s", "pendulum:rotating", t_end, "energy", down_to(3), "")
        can, cannot = front.entered(Task(asked, made, quantity(made, "energy"), Truth(np.zeros(1), 0.0, "")))
        return {c.label for c in can}, cannot

    limit = front.FARTHEST * made.pace.step
    (short, none), (long, why) = entered(limit), entered(1.01 * limit)
    assert short - long == set(front.LOOPED)
    assert {"scipy-ode(DOP853)", "scipy-odeint(LSODA)", "heyoka"} <= long
    assert all("too long" in why[id] for id in front.LOOPED)
    assert not {*front.LOOPED} & {*none}


def test_two_scenes_go_to_a_hundred_thousand():
    assert sum(q.t_end >= 1e5 and q.made().pace.unit == 1.0 for q in QUESTIONS) >= 2


def test_rows_are_kept_of_those_who_come_near():
    asked, known = task(), Known()
    fast, fair, slow = (climb.climb(asked, Law(x, 4, s), known) for x, s in (("a", 1e-8), ("b", 1.5e-8), ("c", 1e-7)))
    assert [front.near(asked, k, known) for k in (fast, fair, slow)] == [True, True, False]


def test_a_scene_with_a_real_peer_and_a_real_method():
    """A whole scene in small: heyoka against two of ours on a short pendulum."""
    asked = front.task_of("pendulum-short")
    known = Known()
    found = [
        climb.climb(asked, c, known)
        for c in field.competitors()
        if c.label in ("heyoka", "stormer-verlet", "blanes-moan-srkn6b")
    ]
    rows, choice = front.final(asked, front.finalists(asked, found, 1e-6), 1e-6)
    assert choice["peer integrator"] in ("heyoka", "heyoka(compact_mode)")  # which of its modes is a matter of time
    assert choice["ours integrator"] == "blanes-moan-srkn6b"
    assert all(1e-9 < r["error"] <= 1e-6 for r in rows)
    verlet = next(k for k in found if k.integrator.label == "stormer-verlet")
    assert min(r.error for r in verlet.rungs) > 1e-12
    assert "times" in verlet.why


# -- finals, run by run ------------------------------------------------------------------------------------------------


class Tolerant(Law):
    """An adaptive integrator whose error is the square of its tolerance."""

    def __init__(self, label: str = "tolerant", side=PEERS):
        super().__init__(label, 4, 1e-8, side=side)
        self.adaptive = True

    def run(self, problem, t_end, save_every, tol, **more):
        """A run in as many steps as the error needs."""
        return super().run(problem, t_end, self.scale * tol**-0.5, save_every)


@pytest.mark.parametrize("wanted", [3e-3, 2e-7])
def test_a_refined_tolerance_meets_the_accuracy_and_is_hardly_tighter_than_it_must_be(wanted):
    law = Tolerant()
    asked, (one,) = climbed(law)
    before = len(one.rungs)
    found = front.refine(asked, law, one.rungs, wanted)
    assert found.error <= wanted
    assert 0.95 * wanted**0.5 <= found.tol <= wanted**0.5
    assert len(one.rungs) > before
    assert [r.size for r in one.rungs] == sorted(r.size for r in one.rungs)


def test_who_meets_an_accuracy_at_its_widest_step_is_not_refined():
    law = Law("a", 4, 1e-8)
    asked, (one,) = climbed(law)
    before = list(one.rungs)
    assert front.refine(asked, law, one.rungs, 10 * one.rungs[0].error) == before[0]
    assert one.rungs == before


def test_an_error_that_is_just_the_wanted_one_meets_it():
    law = Law("a", 4, 1e-8, floor=1e-6)
    asked, (one,) = climbed(law)
    _, (coarse, *_) = front.bracket(one.rungs, 1e-6)
    found = front.refine(asked, law, one.rungs, 1e-6)
    assert found.error == 1e-6
    assert found.steps < coarse.steps


def test_after_a_run_that_failed_the_next_one_is_the_estimate():
    failed, good = Rung(1, None, "diverged", inf, 9.0, 1, 0), Rung(2, None, "ok", 1e-5, 2.0, 2, 0)
    assert front.estimate([failed, good], 1e-3) == 2.0


@pytest.mark.parametrize(("seconds", "count"), [(0.01, 3), (0.04, 3), (0.1, 2), (10.0, 2)])
def test_a_final_that_takes_long_has_one_of_each_side_less(seconds, count):
    """Five, or six, in turns: where a run takes a tenth of a second there are two of each side, not three."""
    many = [Law(f"{side}{k}", 4, 1.0, side=side) for side in (OURS, PEERS) for k in range(5)]
    rung = Rung(100, None, "ok", 1e-6, seconds, 100, 0)
    found = front.finalists(task(), [climb.Climb(c, [rung], "", False) for c in many], 1e-3)
    assert [f.integrator.label[:4] for f in found] == [OURS[:4]] * count + [PEERS[:4]] * count


@pytest.mark.parametrize(("seconds", "rounds"), [(1e-6, 15), (0.06, 10), (60.0, 6)])
def test_a_final_is_of_as_many_rounds_as_fit_but_enough_for_an_interval(seconds, rounds, monkeypatch):
    """Of six runs the range has the median with 97 %; of five with 94 %."""
    asked = []
    monkeypatch.setattr(front.timing, "in_turns", lambda work, n: asked.append(n) or {k: np.ones(n) for k in work})
    rung = Rung(100, None, "ok", 1e-6, seconds / 2, 100, 0)
    front.timed(task(), [front.Finalist(Law(name, 4, 1.0), rung) for name in "ab"])
    assert asked == [rounds]


def test_the_rows_of_a_scene_say_which_steps_were_taken_and_who_was_left_out(monkeypatch):
    laws = [Law("a", 4, 1e-8), Law("dear", 4, 1e-4), Law("b", 4, 2e-8, side=PEERS), Tolerant()]
    monkeypatch.setattr(front, "task_of", lambda scene: task(4))
    monkeypatch.setattr(front, "entered", lambda asked: (laws, {"nobody": "it cannot"}))
    tables = front.measured("s")
    assert set(tables) == set(front.TABLES)
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
