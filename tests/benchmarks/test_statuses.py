"""The statuses have one source, which the help and the site print; what the reason of an unstable run points to."""

from __future__ import annotations

import pytest

import phasebench as pb
from support.commands import call


def test_help_prints_all_statuses():
    text = " ".join(call("integrate", "--help", COLUMNS="200").output.split())
    assert all(f"{name}: {status.meaning}" in text for name, status in pb.STATUSES.items())


@pytest.mark.parametrize(("h", "status", "pointed"), [(2.01, "unstable", True), (1.99, "inaccurate", False)])
def test_unstable_run_points_to_the_stability_limit(h, status, pointed):
    run = pb.integrate("harmonic-oscillator", "stormer-verlet", h=h, steps=200)
    assert run.status == status
    assert ("`phasebench stability stormer-verlet`" in run.reason) is pointed


def test_ok_does_not_see_an_error_of_the_phase():
    run = pb.integrate("pendulum", "stormer-verlet", h=2.5, steps=40, q0=[1.5], p0=[0.0])
    assert run.status == "ok"
    assert "of the size of H's terms" in run.reason
    assert run.error().error > 1.0


def test_integrate_takes_its_time_limit_by_the_old_name_for_one_release():
    with pytest.warns(DeprecationWarning, match="timeout= is now time_limit=") as told:
        assert pb.integrate("harmonic-oscillator", "rk4", h=0.1, steps=10, timeout=60.0).status == "ok"
    assert told[0].filename == __file__


def test_advise_takes_its_time_limit_by_the_old_name_for_one_release():
    with (
        pytest.warns(DeprecationWarning, match="limit= is now time_limit="),
        pytest.raises(pb.InvalidInput, match="time_limit"),
    ):
        pb.advise("pendulum", t_end=1.0, accuracy=1e-3, limit=-1.0)
    with pytest.raises(pb.InvalidInput, match="both are given"):
        pb.advise("pendulum", t_end=1.0, accuracy=1e-3, limit=1.0, time_limit=2.0)
