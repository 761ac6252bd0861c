"""Relaxation Runge-Kutta methods: energy to round-off, relaxed times near n h, with controls."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.metrics import order, slope
from phasebench.benchmarks.problems import problem
from phasebench.integrators.driver import integrate
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.families.relaxation import relaxation_method
from phasebench.integrators.records.projection import METHODS
from phasebench.integrators.registry import method
from support.solutions import last, relative_errors
from support.systems import chain

BOX, CHAOTIC, KEPLER = (problem(n) for n in ("henon-heiles:box", "henon-heiles:chaotic", "perturbed-kepler"))
RELAXED = {m.id: m for m in METHODS if m.family == "relaxation"}
KEPT, FAR = 2e-14, 1e3
#: Factor by which steps of a high-order method are longer, so that its error exceeds round-off.
LONGER = {"dop853-relaxation": 8}


@pytest.mark.parametrize(("P", "h"), [(BOX, 0.05), (KEPLER, 0.01)], ids=["box", "kepler"])
@pytest.mark.parametrize("id", ["rk4-relaxation", "dop853-relaxation"])
def test_energy_is_conserved_to_round_off(P, h, id):
    h *= LONGER.get(id, 1)
    s, plain = (integrate(P, m, h=h, t_end=200) for m in (RELAXED[id], RELAXED[id].data[0]))
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
    for id in ("explicit-euler", "stormer-verlet"):
        with pytest.raises(InvalidInput, match="order 2 or more"):
            relaxation_method(id)


def test_a_step_without_a_root_is_a_counted_base_step():
    P = problem("pendulum")
    s = integrate(P, "rk4-relaxation", h=0.8, steps=125, q0=[0.0], p0=[2.5])
    missed = np.flatnonzero(np.isnan(s.parameter))
    assert 0 < len(missed) == s.counts["fallbacks"]
    i = missed[0]
    length = 0.8 - [0.0, *offsets(s.parameter[:i], 0.8)][-1]
    base = integrate(P, "rk4", h=length, steps=1, q0=s.q[i], p0=s.p[i])
    assert np.abs(last(base) - np.concatenate([s.q[i + 1], s.p[i + 1]])).max() < 1e-13


@pytest.mark.parametrize("d", [2, 3])
def test_evaluations_are_stages_plus_newton_steps(d):
    """One or two Newton steps suffice near gamma = 1."""
    start = {"q0": np.linspace(0.3, 0.9, d), "p0": np.linspace(-0.2, 0.4, d)}
    told, plain = (integrate(chain(d), id, h=0.1, steps=20, **start).counts for id in ("rk4-relaxation", "rk4"))
    assert told["fallbacks"] == told["iterations"] == 0
    assert 0 < told["gradient"] - plain["gradient"] <= 3 * 20
