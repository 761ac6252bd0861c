"""Ensembles and sections of a problem by its name, its record or its system are those of the same orbits."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem

Q, P = [[1.0], [2.0]], [[0.0], [0.5]]
PENDULUM = problem("pendulum")


@pytest.mark.parametrize("named", ["pendulum", PENDULUM, PENDULUM.system])
def test_an_ensemble_is_its_orbits(named):
    found = pb.integrate_ensemble(named, "stormer-verlet", Q, P, h=0.1, steps=10)
    assert found.status.tolist() == ["ok", "ok"]
    for k in range(2):
        one = pb.integrate("pendulum", "stormer-verlet", h=0.1, steps=10, q0=Q[k], p0=P[k])
        assert np.abs(found.q[k][-1] - one.q[-1]).max() < 1e-14


@pytest.mark.parametrize("named", ["pendulum", PENDULUM])
def test_a_section_counts_how_often_it_is_met(named):
    """From 1 at rest the pendulum's period is 6.7: it passes 0 upwards at three quarters of it, and of the next two."""
    found = pb.section(named, "stormer-verlet", Q[:1], P[:1], of="q", h=0.1, t_end=20.0)
    assert found.counts().tolist() == [3]


def leapfrog(system, q, p, h):
    """Kick, drift, kick."""
    p = p - h / 2 * system.dH_dq(q, p)
    q = q + h * system.dH_dp(q, p)
    return q, p - h / 2 * system.dH_dq(q, p)


def test_a_step_of_ones_own_takes_every_orbit_and_each_has_a_status():
    starts, still = np.array([[0.1], [np.nan], [2.0], [1e3]]), np.zeros((4, 1))
    wide = np.hstack([starts, still]), np.hstack([still, still])
    found = [pb.integrate_ensemble("henon-heiles", m, *wide, h=0.1, steps=90) for m in (leapfrog, "stormer-verlet")]
    assert found[0].status.tolist() == found[1].status.tolist() == ["ok", "invalid", "diverged", "diverged"]
    mine, ours = (
        pb.integrate_ensemble("pendulum", m, starts[::2], still[:2], h=0.1, steps=50, save_every=7)
        for m in (leapfrog, "stormer-verlet")
    )
    assert mine.status.tolist() == ["ok", "ok"]
    assert mine.Q.shape == ours.Q.shape == (2, 9, 1)
    np.testing.assert_allclose(mine.Q, ours.Q, atol=1e-12)
    np.testing.assert_array_equal(mine.times, ours.times)
    assert mine.counts["steps"] == 100
    assert not mine.in_lanes.any()


def test_a_section_of_a_step_of_ones_own_is_that_of_the_method_it_is():
    mine, ours = (pb.section("pendulum", m, Q, P, of="q", h=0.1, t_end=30.0) for m in (leapfrog, "stormer-verlet"))
    assert len(ours) > 5
    np.testing.assert_array_equal(mine.orbit, ours.orbit)
    np.testing.assert_allclose(mine.t, ours.t, atol=1e-11)


def test_what_no_ensemble_is_made_of_is_refused():
    for method, options, words in (
        ("heyoka", {}, "one orbit at a time"),
        (leapfrog, {"lanes": True}, "lanes"),
        (leapfrog, {"parameters": {"lam": 1}}, "no parameters"),
        ("rk44", {}, "did you mean rk4"),
    ):
        with pytest.raises(pb.InvalidInput, match=words):
            pb.integrate_ensemble("pendulum", method, Q, P, h=0.1, steps=1, **options)


def test_options_stand_in_the_signature():
    for f in (pb.integrate_ensemble, pb.section):
        parameters = inspect.signature(f).parameters
        assert {"h", "t_end", "steps", "parameters", "lanes", "threads", "progress"} <= set(parameters)
        assert not any(p.kind is p.VAR_KEYWORD for p in parameters.values())
        assert all(f"{name}" in f.__doc__ for name in parameters)
