"""Ensembles and sections accept a problem's name, record or system and agree with single orbits."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from support.steps import leapfrog

Q, P = [[1.0], [2.0]], [[0.0], [0.5]]
PENDULUM = problem("pendulum")


@pytest.mark.parametrize("named", ["pendulum", PENDULUM, PENDULUM.system])
def test_ensemble_equals_its_single_orbits(named):
    found = pb.integrate_ensemble(named, "stormer-verlet", Q, P, h=0.1, steps=10)
    assert found.status.tolist() == ["ok", "ok"]
    for k in range(2):
        one = pb.integrate("pendulum", "stormer-verlet", h=0.1, steps=10, q0=Q[k], p0=P[k])
        assert np.abs(found.q[k][-1] - one.q[-1]).max() < 1e-14


@pytest.mark.parametrize("named", ["pendulum", PENDULUM])
def test_section_counts_the_crossings(named):
    """From rest at 1 the period is 6.7: q crosses 0 upwards at 3/4 of each period, three times until t = 20."""
    found = pb.section(named, "stormer-verlet", Q[:1], P[:1], of="q", h=0.1, t_end=20.0)
    assert found.counts().tolist() == [3]


def test_ensemble_of_a_user_step_has_a_status_per_orbit():
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


def test_section_of_a_user_step_equals_the_method():
    mine, ours = (pb.section("pendulum", m, Q, P, of="q", h=0.1, t_end=30.0) for m in (leapfrog, "stormer-verlet"))
    assert len(ours) > 5
    np.testing.assert_array_equal(mine.orbit, ours.orbit)
    np.testing.assert_allclose(mine.t, ours.t, atol=1e-11)


def test_unusable_methods_and_options_are_refused():
    for method, options, words in (
        ("heyoka", {}, "one orbit at a time"),
        (leapfrog, {"lanes": True}, "does not run in lanes"),
        (leapfrog, {"parameters": {"lam": 1}}, "no parameters"),
        ("rk44", {}, "did you mean rk4"),
    ):
        with pytest.raises(pb.InvalidInput, match=words):
            pb.integrate_ensemble("pendulum", method, Q, P, h=0.1, steps=1, **options)


def test_ensembles_and_sections_as_frames_and_figures():
    starts = np.array([[0.0, 0.1], [0.0, 0.2], [9.0, 9.0]]), np.tile([0.3, 0.0], (3, 1))
    found = pb.integrate_ensemble("henon-heiles", "stormer-verlet", *starts, h=0.1, steps=90)
    frame = found.to_frame()
    assert list(frame) == ["t", "q1", "q2", "p1", "p2", "h", "status", "reason"]
    np.testing.assert_array_equal(frame[["q1", "q2"]], found.q)
    assert "2 ok, 1 diverged" in repr(found)
    assert sum(len(line.get_xdata()) for line in found.plot().axes[0].lines) == 3
    crossings = pb.section("henon-heiles", "stormer-verlet", *starts, of="q1", h=0.1, t_end=40.0)
    assert crossings.to_frame()["orbit"].tolist() == crossings.orbit.tolist()
    np.testing.assert_array_equal(crossings.to_frame()["p2"], crossings.p[:, 1])
    drawn = np.vstack([line.get_xydata() for line in crossings.plot().axes[0].lines])
    np.testing.assert_array_equal(drawn, np.column_stack([crossings.q[:, 1], crossings.p[:, 1]]))
    assert f"{len(crossings)} crossings of q1 = 0" in repr(crossings)
    with pytest.raises(pb.InvalidInput, match="one degree of freedom"):
        pb.section("pendulum", "rk4", Q, P, of="q", h=0.1, steps=10).plot()


def test_options_are_in_signature_and_docstring():
    for f in (pb.integrate_ensemble, pb.section):
        parameters = inspect.signature(f).parameters
        assert {"h", "t_end", "steps", "parameters", "lanes", "threads", "progress"} <= set(parameters)
        assert not any(p.kind is p.VAR_KEYWORD for p in parameters.values())
        told = [line.partition(" : ")[0] for line in f.__doc__.splitlines() if " : " in line]
        assert set(parameters) <= {name.strip() for names in told for name in names.split(",")}
