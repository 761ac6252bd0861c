"""SUNDIALS's symplectic methods as peers: stored answers, orders, steps, and what is told without the package."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from phasebench.benchmarks.cli.advise import can_be_installed
from phasebench.benchmarks.problems import problem
from phasebench.reference.peers import integrate_peer, record, sundials4py

PEERS = {p.id: p for p in sundials4py.PEERS}
#: H - H0 at t = 50 as SUNDIALS stores it in examples/arkode/C_serial/ark_kepler_*.out: method -> (h, answer).
STORED = {
    "leapfrog-2-2": (1e-3, -1.0321183419037538e-07),
    "pseudo-leapfrog-2-2": (1e-3, 3.2112992007782282e-06),
    "mclachlan-2-2": (1e-3, 7.5370554486475783e-07),
    "ruth-3-3": (0.1, 8.9150805802473698e-04),
    "mclachlan-3-3": (0.1, 8.9881034690120210e-04),
    "mclachlan-4-4": (0.1, -5.3723049984188975e-06),
    "mclachlan-5-6": (0.1, 7.5734793938408984e-06),
    "yoshida-6-8": (0.1, 1.2681182276619296e-04),
}
KEPLER, HENON = problem("kepler", e=0.6), problem("henon-heiles:box")


@pytest.fixture
def package():
    """The package; tests that need it are skipped where it is not there, as on a Python before 3.12."""
    try:
        return sundials4py.load()
    except ImportError as error:
        pytest.skip(f"sundials4py cannot be imported ({error})")


def test_without_the_package_it_is_said_which_python_it_needs(monkeypatch):
    """The hint how to install what advice left out names the package from its oldest Python on."""
    monkeypatch.setitem(sys.modules, "sundials4py", None)
    for version, old in (((3, 11, 9), True), (sundials4py.OLDEST, False)):
        monkeypatch.setattr(record.sys, "version_info", version)
        s = integrate_peer(problem("pendulum"), "sundials-leapfrog-2-2", h=0.1, steps=3)
        assert s.status == "skipped"
        assert "pip install sundials4py" in s.reason
        assert ("it needs Python 3.12 or newer, and this is 3.11" in s.reason) == old
        assert can_be_installed({"integrator": "sundials-mclachlan-4-4"}) != old
        assert can_be_installed({"integrator": "gala-leapfrog"})


@pytest.mark.parametrize("name", STORED)
def test_stored_answers_of_the_kepler_problem(package, name):
    """ark_kepler stops at t = 50, steps are h here: the last of its 50,001 steps of 0.001 is round-off."""
    h, stored = STORED[name]
    for kind, size, same in (("", h, True), ("-compensated", h, True), ("", h * (1 + 1e-4), False)):
        s = integrate_peer(KEPLER, f"sundials-{name}{kind}", h=size, steps=round(50 / h), save_every=0)
        assert s.status == "ok"
        assert (s.energy()[-1] - s.energy()[0] == pytest.approx(stored, rel=1e-6, abs=1e-12)) == same


def test_what_stood_in_memory_before_does_not_matter(package):
    for _ in range(20):
        left_behind = [np.full(4, np.nan) for _ in range(1000)]
        del left_behind
        s = integrate_peer(HENON, "sundials-leapfrog-2-2", h=0.05, steps=1)
        assert (s.status, s.counts["steps"]) == ("ok", 1)


def test_compensated_sums_lose_less_of_the_angular_momentum(package):
    lost = []
    for kind in ("", "-compensated"):
        s = integrate_peer(KEPLER, f"sundials-mclachlan-4-4{kind}", h=0.01, steps=20_000, save_every=100)
        lost.append(np.abs(s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0] - 0.8).max())
    assert lost[1] < 1e-15 < 3e-15 < lost[0]
