"""What a certificate measures, on steps that are made for it: long runs, structure, what is kept between calls."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.certificate import battery, conservation, structure
from phasebench.benchmarks.certificate.basics import adapts
from phasebench.benchmarks.certificate.behaviour import state_between_steps
from phasebench.benchmarks.certificate.stepping import StepFailed, Stepper
from phasebench.benchmarks.certificate.subject import subject
from phasebench.benchmarks.certificate.verdicts import Tables
from phasebench.integrators.engine.codegen import MULTIPRECISION

PENDULUM = battery.known("pendulum")


def leapfrog(system, q, p, h):
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


def made(step):
    return subject(step, {}, ("separable",))


class Failing:
    """The identity, which fails at a call of each step size; `asked` are the calls by step size."""

    def __init__(self, lasts, raised=None):
        self.lasts, self.raised, self.asked = lasts, raised, {}

    def __call__(self, system, q, p, h):
        self.asked[h] = self.asked.get(h, 0) + 1
        if self.asked[h] < self.lasts(h):
            return q, p
        if self.raised:
            raise self.raised
        return q * np.nan, p


# -- long runs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gradients", "steps"), [(1, 2400), (50, 800), (90, 400), (150, 400)])
def test_a_dear_step_takes_fewer_steps(gradients, steps):
    def dear(system, q, p, h):
        for _ in range(gradients):
            system.dH_dq(q, p)
        return q, p

    assert conservation.long_run(made(dear), PENDULUM, 0)["steps"] == steps


def test_a_step_that_asks_for_nothing_takes_all_steps():
    assert conservation.long_run(made(lambda system, q, p, h: (q, p)), PENDULUM, 0)["steps"] == 2400


def test_a_run_that_does_not_last_is_made_again_with_half_the_step():
    shorter = Failing(lambda h: 300 if h > 0.06 else np.inf, FloatingPointError("overflow"))
    row = conservation.long_run(made(shorter), PENDULUM, 0)
    assert (row["status"], row["h"], row["time"]) == ("ok", 0.05, 0.05 * 2400)
    assert set(shorter.asked) == {0.2, 0.1, 0.05, 0.025}, "the shortest, in which gradients are counted, too"


def test_a_run_lasts_at_no_step_where_it_ends_on_the_last_one():
    """2400 steps and no number at the last of them; the 20 in which gradients are counted come before."""
    last = Failing(lambda h: 2420 if h < 0.03 else 2400)
    row = conservation.long_run(made(last), PENDULUM, 0)
    assert (row["status"], row["on"]) == ("diverged", "pendulum")
    assert row["reason"] == "after 2400 steps of h = 0.025 the state was not finite"
    assert last.asked == {0.2: 2400, 0.1: 2400, 0.05: 2400, 0.025: 2420}


def test_a_step_that_is_broken_is_no_run_that_does_not_last():
    with pytest.raises(StepFailed, match="KeyError"):
        conservation.long_run(made(Failing(lambda h: 30, KeyError("x"))), PENDULUM, 0)


def test_the_energy_of_a_run_and_its_slope_are_those_of_the_rows():
    """Of a step that adds to p: on H = p^2/2 at a flat place of the potential, by hand."""
    entry = battery.Entry("flat", battery._one("p**2/2 + 0*q"), (0.0, 1.0))

    def pushed(system, q, p, h):
        return q + h * p, np.sqrt(p * p + 2e-3 * h)

    row = conservation.long_run(made(pushed), entry, 0)
    assert row["energy"]["low"] < row["energy"]["slope"] < row["energy"]["high"]
    assert row["energy"]["slope"] == pytest.approx(1e-3, rel=1e-6)
    assert row["energy"]["time"] == pytest.approx(480.0)
    assert row["curve"][-1] == pytest.approx([480.0, 0.48])
    assert len(row["curve"]) == 401


# -- structure --------------------------------------------------------------------------------------------------------


def test_a_structure_is_told_at_a_shorter_step_where_the_first_cannot_be_taken():
    def short(system, q, p, h):
        if abs(h) > 0.3:
            raise FloatingPointError("no root")
        return leapfrog(system, q, p, h)

    assert structure.measured(Stepper(made(leapfrog), PENDULUM), 0, structure.symmetry)["h"] == 0.5
    assert structure.measured(Stepper(made(short), PENDULUM), 0, structure.symmetry)["h"] == 0.125


@pytest.mark.parametrize("rough", [(1, 0), (0, 1)])
def test_round_off_inside_is_seen_in_every_component(rough):
    def rounded(system, q, p, h):
        q, p = leapfrog(system, q, p, h)
        return tuple(x * (1 + (float(x[0]) / x[0] - 1) * of) for x, of in zip((q, p), rough, strict=True))

    assert structure.smooth(Stepper(made(leapfrog), PENDULUM, MULTIPRECISION), 0) < structure.SMOOTH
    assert structure.smooth(Stepper(made(rounded), PENDULUM, MULTIPRECISION), 0) > 1e-18


# -- what is kept between calls, how an adaptive one converges --------------------------------------------------------


def test_with_one_system_steps_in_turns_are_of_two_of_its_orbits():
    rows = state_between_steps(made(leapfrog), [PENDULUM], 0)
    assert [(r["what"], r["value"]) for r in rows] == [("the same step twice", 0.0), ("steps in turns", 0.0)]
    last = {}

    def keeps(system, q, p, h):
        h = h + last.get("q", q)[0] * 1e-3
        last["q"] = q.copy()
        return leapfrog(system, q, p, h)

    assert max(r["value"] for r in state_between_steps(made(keeps), [PENDULUM], 0)) > 1e-5


def test_steps_are_taken_in_turns_on_three_pairs_of_systems():
    rows = state_between_steps(made(leapfrog), list(battery.entries()), 0)
    assert [r["what"] for r in rows].count("steps in turns") == 3


def test_what_is_told_of_an_adaptive_integrator_is_its_error_at_the_smallest_tolerance():
    row = {"on": "tao", "tolerances": [1e-4, 1e-7, 1e-10], "errors": [1e-4, 1e-3, 2e-9]}
    better = {"on": "quartic", "tolerances": [1e-4, 1e-7, 1e-11], "errors": [1e-4, 1e-6, 1e-9]}
    found = adapts(Tables({"tolerance": [better, row]}))
    assert (found.verdict, found.measured, found.why) == ("holds", 2e-9, "error 2.0e-09 at tolerance 1e-10 on tao")


# -- the battery ------------------------------------------------------------------------------------------------------

ALL = {e.name: e for e in (*battery.entries(), *battery.lasting(), battery.oscillator())}


def test_long_runs_are_made_on_three_systems_and_orders_told_from_steps_that_are_halved():
    """So that errors of a step and of its half can be compared, over a time that a double is."""
    assert [e.name for e in battery.lasting.__wrapped__()] == ["henon-heiles", "kepler", "dimer"]
    assert all(2 * n in battery.LADDER for n in battery.LADDER if n <= 32)
    assert sorted({*battery.LADDER}) == list(battery.LADDER)
    assert float(battery.SPAN) == battery.SPAN


@pytest.mark.parametrize("entry", ALL.values(), ids=ALL)
def test_a_seed_moves_every_component_to_either_side(entry):
    moved = np.array([entry.start(seed) - entry.state for seed in range(40)]) / battery.MOVED
    assert (abs(moved) < 1).all()
    assert (moved.min(axis=0) < -0.7).all()
    assert (moved.max(axis=0) > 0.7).all()
    assert (entry.start(3) == entry.start(3)).all()


@pytest.mark.parametrize("entry", ALL.values(), ids=ALL)
def test_states_are_of_the_size_of_one_and_reversible_systems_are(entry):
    assert np.linalg.norm(entry.state) < 1.5
    q, p = np.split(entry.start(0), 2)
    H = entry.system.observe(entry.system.H, *np.array([[q, q], [p, -p]]))
    assert entry.reversible == (abs(H[0] - H[1]) < 1e-14)


def test_orbits_of_the_battery_are_bounded():
    """A pendulum that swings, an ellipse that is not far from a circle."""
    pendulum, kepler = (ALL[name] for name in ("pendulum", "kepler"))
    assert pendulum.state[1] ** 2 / 2 - np.cos(pendulum.state[0]) < 0.5
    q, p = np.split(np.array(kepler.state), 2)
    energy, momentum = p @ p / 2 - 1 / np.linalg.norm(q), q[0] * p[1] - q[1] * p[0]
    assert 0.05 < np.sqrt(1 + 2 * energy * momentum**2) < 0.3
