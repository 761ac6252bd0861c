"""Methods of a solution: energy, invariants, error, data frame, text."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem

PENDULUM = pb.Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")


def swing(**options):
    return pb.integrate(PENDULUM, "stormer-verlet", **{"h": 0.1, "steps": 20, "q0": [1.0], "p0": [0.5]} | options)


def test_energy_of_each_row():
    s = swing()
    np.testing.assert_allclose(s.energy(), s.p[:, 0] ** 2 / 2 - np.cos(s.q[:, 0]), rtol=1e-14)
    assert 1e-5 < np.ptp(s.energy()) < 1e-2


def test_invariants_of_a_problem():
    s = pb.integrate("kepler", "stormer-verlet", h=0.01, t_end=1.0)
    found = s.invariants()
    assert set(found) == set(problem("kepler").invariants)
    momentum = s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
    np.testing.assert_allclose(found["angular-momentum"], momentum, rtol=1e-14)
    assert np.ptp(found["laplace-runge-lenz-1"]) > 1e-7 > 1e-13 > np.ptp(found["angular-momentum"])


@pytest.mark.parametrize("method", ["stormer-verlet", "gauss-4", "heyoka"])
def test_error_is_against_a_finer_run(method):
    options = {"tol": 1e-6} if method == "heyoka" else {"h": 0.25}
    s = pb.integrate(PENDULUM, method, t_end=5.0, q0=[1.0], p0=[0.5], **options)
    exact = pb.integrate(PENDULUM, "gauss-8", t_end=5.0, h=0.05, q0=[1.0], p0=[0.5])
    expected = max(abs(s.q[-1] - exact.q[-1]).max(), abs(s.p[-1] - exact.p[-1]).max())
    found = s.error()
    assert found.error == pytest.approx(expected, abs=1e-13)
    assert 0 < found.uncertainty < 1e-14
    assert (found.horizon, found.source, found.reason) == (5.0, "long double", "")


def test_error_of_a_registered_orbit_uses_its_certificate():
    assert pb.integrate("henon-heiles:box", "rk4", h=0.1, t_end=10).error().source == "certified"
    moved = pb.integrate("henon-heiles:box", "rk4", h=0.1, t_end=10, q0=[0.0, 0.2]).error()
    assert moved.source == "long double"
    assert 0 < moved.error < 1e-3


def test_failed_run_has_no_error():
    away = pb.integrate("henon-heiles:box", "stormer-verlet", h=0.1, t_end=100, q0=[3, 3], p0=[0, 0])
    assert away.status == "diverged"
    with pytest.raises(pb.InvalidInput, match="diverged"):
        away.error()


def test_plot_draws_the_energy_error_and_the_orbit():
    s = swing()
    energy, orbit = s.plot().axes
    np.testing.assert_array_equal(energy.lines[0].get_ydata(), s.energy() - s.energy()[0])
    np.testing.assert_array_equal(orbit.lines[0].get_xydata(), np.hstack([s.q, s.p]))
    wide = pb.integrate("henon-heiles:box", "rk4", h=0.1, steps=9)
    np.testing.assert_array_equal(wide.plot().axes[1].lines[0].get_xydata(), wide.q)


def test_prepared_run_of_a_system_uses_the_given_state():
    run = pb.prepare(PENDULUM, "stormer-verlet", q0=[1.0], p0=[0.5])
    q, p, code = run(0.1, 20)
    s = swing()
    assert (code, q[0], p[0]) == (run.SOLVED, s.q[-1, 0], s.p[-1, 0])
    with pytest.raises(pb.InvalidInput, match="q0"):
        pb.prepare(PENDULUM, "stormer-verlet")


def test_frame_has_the_variables_by_name():
    s = swing()
    frame = s.to_frame()
    assert list(frame) == ["t", "q", "p", "energy"]
    np.testing.assert_array_equal(frame[["t", "q", "p"]].to_numpy(), np.column_stack([s.t, s.q, s.p]))
    np.testing.assert_array_equal(frame["energy"], s.energy())
