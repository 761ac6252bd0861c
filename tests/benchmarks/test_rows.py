"""Rows at given times and events of `pb.integrate`: numbers known in closed form, orders, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb

#: Kepler's orbit has the period 2 pi; the distance is least and largest where this vanishes, at multiples of pi.
TURN = "q1*p1 + q2*p2"
TIMES = np.array([0.0, 0.33, 0.5, 1.0 / 3.0, 7.77])[[0, 1, 3, 2, 4]]


def apart(method, times, h):
    """The largest distance of a method's rows from heyoka's."""
    found, exact = (
        pb.integrate("kepler", m, t_eval=times, t_end=8.0, **more) for m, more in ((method, {"h": h}), ("heyoka", {}))
    )
    assert found.t.tolist() == exact.t.tolist() == list(times)
    return max(np.abs(found.q - exact.q).max(), np.abs(found.p - exact.p).max())


@pytest.mark.parametrize(("method", "order"), [("stormer-verlet", 2), ("scheme-i", 1), ("scheme-v", 2), ("gauss-2", 4)])
def test_rows_between_steps_have_the_order_of_the_method(method, order):
    coarse, fine = (apart(method, TIMES, h) for h in (0.02, 0.01))
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)


def test_control_lines_between_steps_have_not():
    def lines(h):
        found = pb.integrate("kepler", "gauss-4", h=h, t_end=8.0)
        exact = pb.integrate("kepler", "heyoka", t_eval=TIMES, t_end=8.0)
        return np.abs(np.interp(TIMES, found.t, found.q[:, 0]) - exact.q[:, 0]).max()

    assert np.log2(lines(0.02) / lines(0.01)) < 3


@pytest.mark.parametrize("method", ["stormer-verlet", "scheme-v", "rk4", "rebound-leapfrog"])
def test_rows_on_the_grid_are_those_of_the_run(method):
    run = pb.integrate("kepler", method, h=0.1, t_end=2.0)
    found = pb.integrate("kepler", method, h=0.1, t_end=2.0, t_eval=run.t[::5])
    np.testing.assert_array_equal(found.q, run.q[::5])
    np.testing.assert_array_equal(found.p, run.p[::5])


@pytest.mark.parametrize("way", [1, -1])
def test_rows_of_an_adaptive_peer(way):
    found = pb.integrate("harmonic-oscillator", "heyoka", t_end=20.0 * way, t_eval=way * np.linspace(0, 20, 7))
    start = pb.problem("harmonic-oscillator")
    q = float(start.q0[0]) * np.cos(found.t) + float(start.p0[0]) * np.sin(found.t)
    np.testing.assert_allclose(found.q[:, 0], q, rtol=0, atol=1e-13)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("method", ["gauss-8", "heyoka"])
def test_events_lie_where_the_distance_turns(method, way):
    found = pb.integrate("kepler", method, h=0.05, t_end=way * 20.0, events={"turn": TURN, "never": "q1 - 3"})
    np.testing.assert_allclose(found.events["turn"].t, way * np.pi * np.arange(1, 7), rtol=0, atol=1e-10)
    assert not len(found.events["never"])
    assert len(found.t) == 401


def test_an_event_ends_the_run_with_the_bits_of_the_run_without():
    whole = pb.integrate("kepler", "stormer-verlet", h=0.01, t_end=300.0, events={"turn": TURN})
    found = pb.integrate("kepler", "stormer-verlet", h=0.01, t_end=300.0, events={"turn": TURN}, stop="turn")
    assert found.t[-1] == found.events["turn"].t[0] == whole.events["turn"].t[0]
    assert len(found.events["turn"]) == 1
    np.testing.assert_array_equal(found.q[:-1], whole.q[: len(found.t) - 1])
    assert found.counts["steps"] < 1000
    thinned = pb.integrate(
        "kepler", "stormer-verlet", h=0.01, t_end=300.0, events={"turn": TURN}, stop="turn", save_every=100
    )
    assert thinned.t.tolist() == [0.0, 1.0, 2.0, 3.0, found.t[-1]]


def test_times_count_from_t0_and_stop_at_the_event():
    later = pb.integrate(
        "kepler", "gauss-4", h=0.05, t0=5.0, t_end=25.0, events={"turn": TURN}, stop="turn", t_eval=[6.0, 9.0]
    )
    assert later.t.tolist() == [6.0, pytest.approx(5.0 + np.pi, abs=1e-6)]


@pytest.mark.parametrize(("of", "rising"), [("2*q1", True), ("-q1", False)])
def test_a_section_of_a_formula_is_that_of_the_coordinate(of, rising):
    start = [[0.0, 0.1], [0.0, -0.2]], [[0.4, 0.1], [0.3, 0.2]]
    plane, found = (
        pb.section("henon-heiles", "pefrl", *start, of=x, rising=up, h=0.05, t_end=100.0)
        for x, up in (("q1", True), (of, rising))
    )
    np.testing.assert_allclose(found.t, plane.t, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.q, plane.q, rtol=0, atol=1e-12)
    assert f"of {of} = 0" not in repr(plane)
    assert f"crossings of {of} = 0" in repr(found)


def test_a_section_of_either_sign_has_both():
    start = [[0.0, 0.1]], [[0.4, 0.1]]
    either, *ways = (
        pb.section("henon-heiles", "pefrl", *start, of="q1 - q2**2", rising=r, h=0.05, t_end=100.0)
        for r in (None, True, False)
    )
    np.testing.assert_array_equal(either.t, np.sort(np.concatenate([x.t for x in ways])))
    np.testing.assert_allclose(either.q[:, 0], either.q[:, 1] ** 2, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"t_eval": [3.0, 2.0]}, "in the order"),
        ({"t_eval": [-1.0]}, "from t0 = 0 on"),
        ({"t_eval": [11.0]}, "goes to 11, the integration to t_end = 10"),
        ({"t_eval": "early"}, "finite numbers"),
        ({"t_eval": [[1.0]]}, "finite numbers"),
        ({"t_eval": [1.0], "save_every": 2}, "leave one out"),
        ({"events": ["q1"]}, "map names to formulas"),
        ({"events": {"a": "z"}}, "'z' is none of the variables"),
        ({"stop": "turn"}, "none of the events"),
    ],
)
def test_bad_times_and_events_are_refused(changed, message):
    with pytest.raises(pb.InvalidInput, match=message):
        pb.integrate("kepler", "gauss-4", **{"h": 0.1, "t_end": 10.0} | changed)
    with pytest.raises(pb.InvalidInput, match="give h"):
        pb.integrate("kepler", "heyoka", t_end=10.0, events={"turn": TURN})
