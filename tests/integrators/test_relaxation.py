"""Relaxation Runge-Kutta methods: energy to round-off, relaxed times near n h, with controls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from phasebench.benchmarks.measure.metrics import order, slope
from phasebench.benchmarks.problems import problem
from phasebench.integrators import driver
from phasebench.integrators.compile.codegen import DOUBLE
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families import relaxation
from phasebench.integrators.families.relaxation import relaxation_method
from phasebench.integrators.records.projection import METHODS
from phasebench.integrators.registry import method
from phasebench.integrators.stepping.kernel import prepare, value
from phasebench.integrators.values.vector import State, jit, scale
from support.solutions import last, relative_errors

BOX, CHAOTIC, KEPLER = (problem(n) for n in ("henon-heiles:box", "henon-heiles:chaotic", "perturbed-kepler"))
RELAXED = {m.id: m for m in METHODS if m.family == "relaxation"}
KEPT, FAR = 2e-14, 1e3
#: Factor by which steps of a high-order method are longer, so that its error exceeds round-off.
LONGER = {"dop853-relaxation": 8}


@pytest.mark.parametrize(("P", "h"), [(BOX, 0.05), (KEPLER, 0.01)], ids=["box", "kepler"])
@pytest.mark.parametrize("id", RELAXED)
def test_energy_is_conserved_to_round_off(P, h, id):
    """With relaxation H is conserved to round-off; control: without it H drifts."""
    h *= LONGER.get(id, 1)
    s, plain = (integrate(P, m, h=h, t_end=1000) for m in (RELAXED[id], RELAXED[id].data[0]))
    assert s.status == "ok"
    assert s.counts["fallbacks"] == 0
    assert relative_errors(s)[0] < KEPT
    assert relative_errors(plain)[0] > FAR * KEPT


def offsets(gamma, h):
    """t_n - n h for steps with these gamma, each aimed at the next grid time."""
    found = [0.0]
    for g in gamma:
        found.append((g - 1) * (h - found[-1]))
    return np.array(found[1:])


@pytest.mark.parametrize("id", RELAXED)
def test_the_relaxed_time_stays_near_the_grid(id):
    h = np.array([0.2, 0.1, 0.05]) * LONGER.get(id, 2) / 2
    greatest = []
    for x in h:
        gamma = integrate(BOX, id, h=x, t_end=1000).parameter
        offset = np.abs(offsets(gamma, x))
        greatest.append(offset.max())
        assert offset[-len(offset) // 4 :].max() < 1.2 * offset[: len(offset) // 4].max()
        # Control: steps that do not aim at the grid drift away from it.
        assert abs((gamma - 1).sum() * x) > 20 * offset.max()
    assert slope(np.log(h), np.log(greatest)).value == pytest.approx(RELAXED[id].order, abs=0.5)


@pytest.mark.parametrize("id", ["rk4-relaxation", "kutta-3-relaxation"])
def test_a_step_approximates_the_relaxed_time(id):
    """The error is of order p + 1 at time gamma h, of order p at time h."""
    h = np.array([0.1, 0.05, 0.025])
    relaxed_time, grid_time = [], []
    for x in h:
        s = integrate(CHAOTIC, id, h=x, steps=1, q0=[0.3, 0.2], p0=[0.1, 0.4])
        for t, errors in ((s.parameter[0] * x, relaxed_time), (x, grid_time)):
            exact = integrate(CHAOTIC, "rk4", t_end=t, steps=2000, q0=[0.3, 0.2], p0=[0.1, 0.4])
            errors.append(np.abs(last(s) - last(exact)).max())
    p = RELAXED[id].order
    assert slope(np.log(h), np.log(relaxed_time)).value == pytest.approx(p + 1, abs=0.3)
    assert slope(np.log(h), np.log(grid_time)).value == pytest.approx(p, abs=0.3)


def test_control_without_adjusted_time_an_order_is_lost():
    P, base, h = problem("pendulum"), method("rk4"), 0.1 / 2.0 ** np.arange(4)
    exact = last(integrate(P, "rk4", h=0.001, t_end=10))
    observed = []
    for adjust in (True, False):
        m = relaxation_method(base, adjust_time=adjust)
        e = [np.abs(last(integrate(P, m, h=x, t_end=10)) - exact).max() for x in h]
        observed.append(order(h, e))
        assert m.order == round(observed[-1].value)
    assert [o.value for o in observed] == pytest.approx([4, 3], abs=0.2)


@pytest.mark.parametrize("adjust", [True, False])
def test_steps_equal_a_plain_implementation(adjust):
    """With another root finder; step lengths follow from the sum of relaxed times, or are h."""
    f, H = BOX.system.vector_field(), lambda y: BOX.system.observe(BOX.system.H, y[None, :2], y[None, 2:])[0]
    y, t, h = np.concatenate([BOX.q0, BOX.p0]), 0.0, 0.2
    H0 = H(y)
    for n in range(40):
        step = (n + 1) * h - t
        k1 = f(0, y)
        k2 = f(0, y + step / 2 * k1)
        k3 = f(0, y + step / 2 * k2)
        d = step / 6 * (k1 + 2 * k2 + 2 * k3 + f(0, y + step * k3))
        gamma = brentq(lambda g, y=y, d=d: H(y + g * d) - H0, 0.9, 1.1, xtol=1e-15)
        y, t = y + gamma * d, t + gamma * step if adjust else (n + 1) * h
    s = integrate(BOX, relaxation_method("rk4", adjust_time=adjust), h=h, steps=40)
    assert s.status == "ok"
    assert np.abs(last(s) - y).max() < 1e-11
    plain = integrate(BOX, "rk4", h=h, steps=40)
    assert np.abs(last(plain) - y).max() > 1e-6
    other = integrate(BOX, relaxation_method("rk4", adjust_time=not adjust), h=h, steps=40)
    assert np.abs(last(other) - y).max() > 1e-6


def test_the_time_offset_survives_between_calls(monkeypatch):
    """The relaxed time is part of the state."""
    ends = []
    for first in (1000, 7):
        monkeypatch.setattr(driver, "FIRST", first)
        ends.append(last(integrate(BOX, "kutta-3-relaxation", h=0.2, steps=50)))
    assert np.array_equal(*ends)


def test_a_step_without_a_root_is_a_counted_base_step():
    P = problem("pendulum")
    s = integrate(P, "rk4-relaxation", h=0.8, steps=125, q0=[0.0], p0=[2.5])
    missed = np.flatnonzero(np.isnan(s.parameter))
    assert 0 < len(missed) == s.counts["fallbacks"]
    i = missed[0]
    length = 0.8 - [0.0, *offsets(s.parameter[:i], 0.8)][-1]
    base = integrate(P, "rk4", h=length, steps=1, q0=s.q[i], p0=s.p[i])
    assert np.abs(last(base) - np.concatenate([s.q[i + 1], s.p[i + 1]])).max() < 1e-13


@pytest.mark.parametrize("id", ["explicit-euler", "stormer-verlet"])
def test_only_runge_kutta_methods_of_order_2_or_more_are_relaxed(id):
    with pytest.raises(InvalidInput, match="order 2 or more"):
        relaxation_method(id)


def search(c, start=-1.0):
    """(gamma, whether it is a root, evaluations) of the relaxation's root search with a made-up energy.

    The energy is H(y + gamma d) = (start + gamma)^2 / 2 and its target -c.
    """
    system = problem("harmonic-oscillator").system
    step = prepare(method("rk4-relaxation"), system).step._replace(H0=-c, eps=2.0**-52)
    there, one, nothing = (value([x], 1, DOUBLE) for x in (start, 1.0, 0.0))
    return relaxation.root(step, State(there, nothing, nothing, nothing), one, nothing)


def test_a_search_without_a_root_returns_the_base_step():
    """For x^2 / 2 + c, without a root, Newton's method stalls at 0 or wanders around it until its limit."""
    assert search(1e-3) == (1.0, False, 1)
    ends = {search(c, start=-1.1) for c in np.geomspace(1e-5, 1e-2, 200)}
    assert {(gamma, found) for gamma, found, _ in ends} == {(1.0, False)}
    evaluations = {n for _, _, n in ends}
    assert max(evaluations) == relaxation.LIMIT
    assert len(evaluations) > 5, "others leave the neighbourhood of 1 before"
    gamma, found, evaluations = search(-0.02, start=-1.1)
    assert found
    assert abs(gamma - 0.9) < 1e-14
    assert evaluations < 8


@pytest.mark.parametrize(("root", "near"), [(1.4, True), (0.65, True), (2.0, False), (4.0, False)])
def test_only_roots_within_a_half_of_1_are_accepted(root, near):
    """Newton's method from 1 finds the root of gamma^2 / 2 - root^2 / 2 wherever it is."""
    gamma, found, evaluations = search(-(root**2) / 2, start=0.0)
    assert found == near
    assert near or evaluations == 1, "the first of Newton's steps leads out"
    assert gamma == pytest.approx(root if near else 1.0, abs=1e-14)


#: Unit of round-off, a power of two so that its multiples are exact.
UNIT = 2.0**-40


def along_a_line(error, told=1.0, rounding=0.0):
    """(final error in units, whether it is a root, evaluations) of the relaxation's root search with H = x.

    ``error``: initial error in units of round-off. Newton's method is given ``told`` times the slope; H is farther from
    0 than x by ``rounding`` units.
    """

    @jit
    def energy(q, p):
        return q[0] + (rounding if q[0] >= 0 else -rounding) * UNIT, 1.0

    @jit
    def field(q, p, h, c):
        return scale(0.0, q), scale(-told, p)

    step = relaxation.Relaxation(field, energy, np.zeros((1, 1)), True, eps=UNIT)
    start, one, nothing = (value([x], 1, DOUBLE) for x in (error * UNIT - 1, 1.0, 0.0))
    gamma, found, evaluations = relaxation.root(step, State(start, one, nothing, nothing), one, nothing)
    return (gamma - 1) / UNIT + error + np.copysign(rounding, gamma - 1 + error * UNIT), found, evaluations


def test_the_search_ends_at_round_off():
    """Each Newton step leaves a fifth of the error: 1000 units, 200, 40, 8, 1.6, 0.32."""
    left, found, evaluations = along_a_line(1000, told=1.25)
    assert found
    assert evaluations == 5
    assert left == pytest.approx(0.32, abs=1e-3)


@pytest.mark.parametrize(("told", "steps"), [(2.5, 6), (2.0, 4)])
def test_a_slowly_converging_search_ends_above_round_off(told, steps):
    """Each Newton step leaves three fifths, 1000, 600, 360, 216, 130, 78, 47 units, or a half."""
    left, found, evaluations = along_a_line(1000, told=told)
    assert found
    assert evaluations == steps
    assert left == pytest.approx(1000 * (1 - 1 / told) ** steps, abs=1e-2)


def test_limits_of_round_off_and_of_the_radius():
    assert along_a_line(1, told=2.0) == (1, True, 0)
    assert along_a_line(1.5, told=2.0) == (0.75, True, 1)
    for beyond, found in ((0, True), (1, False)):
        error = relaxation.RADIUS / UNIT + beyond
        assert along_a_line(-error) == ((0, True, 1) if found else (-error, False, 1))


@pytest.mark.parametrize("rounding", [20, 32, 40])
def test_a_stagnating_error_is_accepted_up_to_a_bound(rounding):
    """The error alternates in sign without shrinking; up to 64 units this counts as the round-off of H."""
    near = 2 * rounding <= relaxation.SLACK
    left, found, evaluations = along_a_line(1000, rounding=rounding)
    assert found == near
    assert evaluations == (2 if near else relaxation.LIMIT)
    assert left == (2 * rounding if near else 1000 + rounding)


@pytest.mark.parametrize("id", RELAXED)
def test_evaluations_are_stages_plus_newton_steps(id):
    """One or two Newton steps suffice near gamma = 1."""
    base = RELAXED[id].data[0]
    steps = 20
    told, plain = (integrate(BOX, m, h=0.2, steps=steps).counts for m in (RELAXED[id], base))
    assert told["steps"] == steps
    assert told["fallbacks"] == told["iterations"] == 0
    assert 0 < told["gradient"] - plain["gradient"] <= 3 * steps
