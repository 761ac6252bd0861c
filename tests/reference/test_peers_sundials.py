"""SUNDIALS's symplectic methods as peers: claims, stored answers, orders, steps, and what is told without it."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from phasebench.benchmarks.cli.advise import can_be_installed
from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store import cells
from phasebench.benchmarks.studies.audit import STUDY
from phasebench.integrators import Hamiltonian, InvalidInput, integrate
from phasebench.reference.peers import integrate_peer, record, sundials4py
from phasebench.reference.solvers.taylor import reference
from support.solutions import last

PEERS = {p.id: p for p in sundials4py.PEERS}
#: The table of the user guide, "Symplectic partitioned Butcher tables": method, stages, order.
TABLE = """
EULER_1_1 1 1, LEAPFROG_2_2 2 2, PSEUDO_LEAPFROG_2_2 2 2, MCLACHLAN_2_2 2 2, MCLACHLAN_3_3 3 3, RUTH_3_3 3 3,
MCLACHLAN_4_4 4 4, CANDY_ROZMUS_4_4 4 4, MCLACHLAN_5_6 6 5, YOSHIDA_6_8 8 6, SUZUKI_UMENO_8_16 16 8,
SOFRONIOU_10_36 36 10
"""
STATED = {name: (int(s), int(q)) for name, s, q in (line.split() for line in TABLE.split(","))}
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
#: Order -> steps of the two runs, for which errors are asymptotic and above round-off, and their orbit to its end.
PENDULUM = ("pendulum", 3.0)
STEPS = {1: (100, 200), 2: (40, 80), 3: (40, 80), 4: (20, 40), 5: (16, 32), 6: (16, 32), 8: (8, 16), 10: (40, 50)}
ORBITS = dict.fromkeys(STEPS, PENDULUM) | {10: ("henon-heiles:chaotic", 20.0)}


@pytest.fixture(scope="module")
def package():
    """The package; tests that need it are skipped where it is not there, as on a Python before 3.12."""
    try:
        return sundials4py.load()
    except ImportError as error:
        pytest.skip(f"sundials4py cannot be imported ({error})")


def method(peer) -> str:
    """The method's name in SUNDIALS, without its prefix."""
    return re.search(r"ARKODE_SPRK_(\w+)", peer.name)[1]


def test_every_method_is_there_twice_with_the_order_of_the_table():
    assert sorted(map(method, PEERS.values())) == sorted([*STATED, *STATED])
    for id, peer in PEERS.items():
        stages, order = STATED[method(peer)]
        assert (peer.order, peer.claims.order, peer.claims.symplectic) == (order, order, True)
        assert peer.about.startswith(f"{stages} stage")
        compensated = id.endswith("-compensated")
        assert id == f"sundials-{method(peer).lower().replace('_', '-')}{'-compensated' * compensated}"
        assert peer.settings == {"ARKodeSetUseCompensatedSums": compensated}


def test_without_the_package_a_run_is_skipped_and_says_which_python_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "sundials4py", None)
    for version, why in (
        (sundials4py.OLDEST, "sundials4py"),
        ((3, 11, 9), "it needs Python 3.12 or newer, and this is 3.11"),
    ):
        monkeypatch.setattr(sys, "version_info", version)
        s = integrate_peer(problem("pendulum"), "sundials-leapfrog-2-2", h=0.1, steps=3)
        assert s.status == "skipped"
        assert re.search(f"{why}.*pip install sundials4py", s.reason)
        assert ("needs Python" in s.reason) == (version < sundials4py.OLDEST)


def test_rows_wait_for_a_package_that_is_missing(monkeypatch):
    """No measurement of a package can be made without it, whatever table it belongs to; the others can."""
    known = cells.version_of
    for missing in ("sundials4py", "scipy"):
        monkeypatch.setattr(
            cells, "version_of", lambda name, gone=missing: None if name == gone else known(name) or "1"
        )
        waiting = {c.names & {"sundials4py", "scipy"} for c in STUDY.cells() if not c.available}
        assert waiting == {frozenset({missing})}


def test_only_separable_systems_are_taken():
    with pytest.raises(InvalidInput, match=r"T\(p\) \+ V\(q\)"):
        integrate_peer(problem("double-pendulum"), "sundials-leapfrog-2-2", h=0.1, steps=3)


@pytest.mark.parametrize("name", STORED)
def test_stored_answers_of_the_kepler_problem(package, name):
    """ark_kepler stops at t = 50, steps are h here: the last of its 50,001 steps of 0.001 is round-off."""
    h, stored = STORED[name]
    made = problem("kepler", e=0.6)
    for kind in ("", "-compensated"):
        s = integrate_peer(made, f"sundials-{name}{kind}", h=h, t_end=50.0, save_every=0)
        assert s.status == "ok"
        assert s.energy()[-1] - s.energy()[0] == pytest.approx(stored, rel=1e-6, abs=1e-12)
        assert s.counts["steps"] == round(50 / h)
    other = integrate_peer(made, f"sundials-{name}", h=h * (1 + 1e-4), steps=round(50 / h), save_every=0)
    assert other.energy()[-1] - other.energy()[0] != pytest.approx(stored, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("id", PEERS)
def test_orders(package, id):
    order = PEERS[id].order
    (name, end), steps, errors = ORBITS[order], STEPS[order], []
    made = problem(name)
    truth = reference(made, [end], certify=False)
    for n in steps:
        s = integrate_peer(made, id, t_end=end, steps=n, save_every=0)
        errors.append(np.abs(np.concatenate([s.q[-1] - truth.q[-1], s.p[-1] - truth.p[-1]])).max())
    assert abs(np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) - order) < 0.35


def test_two_methods_have_order_3_where_the_kinetic_energy_is_not_quadratic(package):
    made = problem("lotka-volterra-log:2-2")
    truth = reference(made, [1.0], certify=False)
    exact, orders = np.concatenate([truth.q[-1], truth.p[-1]]), {}
    for name, n in (("mclachlan-4-4", 40), ("candy-rozmus-4-4", 40), ("mclachlan-5-6", 30)):
        ends = [integrate_peer(made, f"sundials-{name}", t_end=1.0, steps=k * n, save_every=0) for k in (1, 2)]
        coarse, fine = (np.abs(last(s) - exact).max() for s in ends)
        orders[name] = np.log2(coarse / fine)
    assert orders["mclachlan-4-4"] == pytest.approx(3, abs=0.15)
    assert orders["mclachlan-5-6"] == pytest.approx(3, abs=0.15)
    assert orders["candy-rozmus-4-4"] == pytest.approx(4, abs=0.15)


def test_leapfrogs_are_ours(package):
    made = problem("henon-heiles:box")
    for name, own in (("pseudo-leapfrog-2-2", "stormer-verlet"), ("leapfrog-2-2", "stormer-verlet-dkd")):
        theirs = integrate_peer(made, f"sundials-{name}", h=0.05, steps=600, save_every=7)
        ours = integrate(made, own, h=0.05, steps=600, save_every=7)
        assert (theirs.t == ours.t).all()
        assert np.abs(theirs.q - ours.q).max() < 1e-12
        assert np.abs(theirs.p - ours.p).max() < 1e-12
        assert theirs.counts["steps"] == 600
        assert theirs.counts["gradient"] in (600, 1200), "version 7.9 leaves out forces whose coefficient is 0"


def test_what_stood_in_memory_before_does_not_matter(package):
    made = problem("henon-heiles:box")
    for _ in range(20):
        left_behind = [np.full(4, np.nan) for _ in range(1000)]
        del left_behind
        s = integrate_peer(made, "sundials-leapfrog-2-2", h=0.05, steps=1)
        assert s.status == "ok"
        assert s.counts["steps"] == 1


def test_compensated_sums_lose_less_of_the_angular_momentum(package):
    made = problem("kepler", e=0.6)
    lost = []
    for kind in ("", "-compensated"):
        s = integrate_peer(made, f"sundials-mclachlan-4-4{kind}", h=0.01, steps=20_000, save_every=100)
        lost.append(np.abs(s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0] - 0.8).max())
    assert lost[1] < 1e-15 < 3e-15 < lost[0]


def test_a_run_that_blows_up_ends_with_its_good_rows(package, capfd):
    well = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    s = integrate_peer(well, "sundials-mclachlan-4-4", h=0.5, steps=60, save_every=1, q0=[2.0], p0=[2.0])
    assert s.status == "diverged"
    assert 1 < len(s.q) < 60
    assert np.isfinite(s.q).all()
    assert capfd.readouterr().err == ""


def test_another_method_shows_and_an_unknown_one_is_refused(package):
    made = problem("pendulum")
    wrong = replace(PEERS["sundials-ruth-3-3"], run=PEERS["sundials-mclachlan-3-3"].run)
    ends = [integrate_peer(made, p, h=0.1, steps=30, save_every=0).q[-1, 0] for p in (wrong, "sundials-ruth-3-3")]
    assert abs(ends[0] - ends[1]) > 1e-7
    with pytest.raises(RuntimeError, match="returned"):
        sundials4py._integrator("ARKODE_SPRK_NONE_9_9", False, made.system, np.ones(2), 0.1)


def test_advice_does_not_send_for_a_package_that_this_python_cannot_have(monkeypatch):
    """The hint how to install what was left out names the package from its oldest Python on."""
    dropped = {"integrator": "sundials-mclachlan-4-4"}
    for version, allowed in (((3, 11), False), ((3, 12), True)):
        monkeypatch.setattr(record.sys, "version_info", version)
        assert can_be_installed(dropped) == allowed
    assert can_be_installed({"integrator": "gala-leapfrog"})
