"""Ensembles and sections of a problem by its name, its record or its system are those of the same orbits."""

from __future__ import annotations

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
