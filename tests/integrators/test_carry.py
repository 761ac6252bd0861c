"""What a kernel carries from step to step: a run does not depend on stored rows, calls of the kernel, or neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import SYSTEMS
from phasebench.integrators import driver, integrate, integrate_ensemble, prepare, trajectory
from phasebench.integrators.registry import method
from support.one_of_each import FIRST
from support.plain import systems_for

#: The first of each family, and those that keep more than it: a copy, a relaxed time, a corrector, a processor.
IDS = [
    *(m.id for m in FIRST.values()),
    *("tao-2", "scheme-v", "rk4-relaxation", "wisdom-holman-corrector", "blanes-casas-ros-p3"),
    *("implicit-midpoint-symmetric-projection", "lie-midpoint", "he-splitting-4", "gauss-8-adaptive", "cpg-2"),
]
STEPS, H = 30, 0.05


def start(id: str) -> tuple:
    """(system, q, p) on which a method runs."""
    return SYSTEMS[systems_for(method(id))[0]]()


@pytest.mark.parametrize("id", dict.fromkeys(IDS))
def test_rows_and_calls_of_the_kernel_do_not_change_the_orbit(id, monkeypatch):
    system, q, p = start(id)
    every, some = (integrate(system, id, h=H, steps=STEPS, q0=q, p0=p, save_every=n) for n in (1, 7))
    for module in (driver, trajectory):
        monkeypatch.setattr(module, "PIECE", 4)
    pieces = integrate(system, id, h=H, steps=STEPS, q0=q, p0=p, save_every=0)
    run = prepare(system, id, q0=q, p0=p)
    run(0.9 * H, 5)
    again = np.concatenate(run(H, STEPS)[:2])
    assert every.status == some.status == pieces.status == "ok"
    assert np.abs(some.q[:-1] - every.q[:-1:7]).max() < 1e-14
    end = np.concatenate([every.q[-1], every.p[-1]])
    for s in (some, pieces):
        assert np.abs(np.concatenate([s.q[-1], s.p[-1]]) - end).max() < 1e-14
    assert np.abs(again - end).max() < 1e-14
    assert np.abs(end - [*q, *p]).max() > 1e-3


@pytest.mark.parametrize("id", dict.fromkeys(IDS))
def test_orbits_side_by_side_are_those_alone(id):
    system, q, p = start(id)
    n = 9
    P = np.array(p) * (1 + np.linspace(0, 0.05, n))[:, None]
    many = integrate_ensemble(system, id, np.tile(q, (n, 1)), P, h=H, steps=STEPS)
    assert set(many.status) == {"ok"}
    for k in (0, 4, n - 1):
        alone = integrate(system, id, h=H, steps=STEPS, q0=q, p0=P[k], save_every=0)
        assert np.abs(np.concatenate([many.q[k] - alone.q[-1], many.p[k] - alone.p[-1]])).max() < 1e-13
    assert np.ptp(many.q[:, 0]) > 1e-4, "the control: the orbits differ"


def momentum_of_leapfrog(h: float, steps: int) -> float:
    """The largest change of the angular momentum on the Kepler problem by leapfrog, as plain sums."""
    x, y, u, v = 0.8, 0.3, -0.2, 0.9
    L, worst = x * v - y * u, 0.0
    for _ in range(steps):
        x, y = x + h / 2 * u, y + h / 2 * v
        f = -h / (x * x + y * y) ** 1.5
        u, v = u + f * x, v + f * y
        x, y = x + h / 2 * u, y + h / 2 * v
        worst = max(worst, abs(x * v - y * u - L))
    return worst


@pytest.mark.parametrize("id", ["wisdom-holman", "stormer-verlet", "pefrl", "chin-4a", "gauss-2"])
def test_what_rounding_loses_of_a_step_is_carried_to_the_next(id):
    """Short steps keep the angular momentum to round-off; plain sums (the control) lose ten times as much."""
    system, q, p = SYSTEMS["perturbed-kepler"]()
    s = integrate(system, id, h=1e-3, steps=100_000, save_every=1000, q0=q, p0=p)
    L = s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0]
    assert np.abs(L - L[0]).max() < 2e-15
    assert momentum_of_leapfrog(1e-3, 100_000) > 1e-14
