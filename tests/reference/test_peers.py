"""The peers against the references, their statuses and errors."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, InvalidInput
from phasebench.reference.peers import BY_ID, PEERS, Peer, integrate_peer, particles, peer
from phasebench.reference.solvers.taylor import reference

T_END = 10.0
COUNTS = {"steps", "gradient", "hessian", "iterations", "fallbacks"}


def error(solution, made) -> float:
    truth = reference(made, solution.t, certify=False)
    return float(np.abs(np.hstack([solution.q - truth.q, solution.p - truth.p])).max())


def test_the_table_of_peers():
    assert len(BY_ID) == len(PEERS)
    for p in PEERS:
        assert p.label == p.id
        assert p.parameters == {}
        assert all((p.name, p.package, p.license, p.about, p.source))
    with pytest.raises(InvalidInput, match="rebound-ias15"):
        peer("rebound-ias51")


@pytest.mark.parametrize("name", ["kepler", "perturbed-kepler"])
@pytest.mark.parametrize(
    ("id", "tol", "bound"),
    [("heyoka", None, 1e-12), ("rebound-ias15", None, 1e-13), ("scipy-dop853", 1e-13, 2e-11)],
)
def test_adaptive_peers_reach_the_reference(name, id, tol, bound):
    made = problem(name)
    solution = integrate_peer(made, id, h=0.01, t_end=T_END, save_every=300, tol=tol)
    assert solution.status == "ok"
    assert (solution.t == [0.01 * n for n in (0, 300, 600, 900, 1000)]).all()
    assert (solution.q[0] == made.q0).all()
    assert error(solution, made) < bound
    other = problem(name, **({"mu": 0.0075 * (1 + 1e-8)} if name == "perturbed-kepler" else {"e": 0.6 + 1e-9}))
    assert error(solution, other) > 10 * bound
    assert set(solution.counts) == COUNTS
    assert 50 < solution.counts["steps"] < 1000
    assert solution.seconds > 0


@pytest.mark.parametrize(("id", "tol"), [("heyoka", None), ("scipy-dop853", 1e-12)])
def test_peers_of_any_problem(id, tol):
    for name, bound in (("henon-heiles:box", 1e-11), ("pendulum", 1e-10), ("lotka-volterra", 1e-10)):
        made = problem(name)
        solution = integrate_peer(made, id, t_end=T_END, tol=tol)
        assert solution.t.tolist() == [0.0, T_END]
        assert 0 < error(solution, made) < bound


def test_a_looser_tolerance_costs_less_and_errs_more():
    made = problem("henon-heiles:box")
    for id in ("heyoka", "scipy-dop853"):
        tight, loose = (integrate_peer(made, id, t_end=T_END, tol=tol) for tol in (1e-12, 1e-5))
        assert error(loose, made) > 10 * error(tight, made)
    assert loose.counts["gradient"] < tight.counts["gradient"] / 2
    kepler = problem("kepler")
    tight, loose = (integrate_peer(kepler, "rebound-ias15", t_end=T_END, tol=tol) for tol in (1e-9, 0.5))
    assert loose.counts["steps"] < tight.counts["steps"]


def test_dop853_defaults_are_scipys():
    from scipy.integrate import solve_ivp

    made = problem("kepler")
    mine = integrate_peer(made, "scipy-dop853", t_end=T_END)
    theirs = solve_ivp(made.system.vector_field(), (0, T_END), [*made.q0, *made.p0], method="DOP853")
    assert mine.counts["gradient"] == theirs.nfev
    assert (np.hstack([mine.q[-1], mine.p[-1]]) == theirs.y[:, -1]).all()


@pytest.mark.parametrize("n", [97, 1000])
def test_whfast_solves_kepler_to_round_off(n):
    made = problem("kepler")
    solution = integrate_peer(made, "rebound-whfast", t_end=T_END, steps=n)
    assert len(solution.t) == n + 1
    assert error(solution, made) < 1e-12
    assert solution.counts["steps"] == n


@pytest.mark.parametrize("id", ["rebound-whfast", "rebound-leapfrog"])
def test_fixed_step_peers_have_their_order_on_the_perturbed_problem(id):
    made = problem("perturbed-kepler")
    errors = []
    for n in (800, 1600, 3200):
        solution = integrate_peer(made, id, t_end=T_END, steps=n, save_every=0)
        assert solution.status == "ok"
        errors.append(error(solution, made))
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (abs(slopes - BY_ID[id].order) < 0.1).all()


def test_saving_rows_changes_whfast_by_round_off_alone():
    made = problem("perturbed-kepler")
    every = integrate_peer(made, "rebound-whfast", h=0.01, steps=500)
    end = integrate_peer(made, "rebound-whfast", h=0.01, steps=500, save_every=0)
    assert (every.t[-1], len(end.t)) == (end.t[-1], 2)
    # The corrector of order 17 is applied and undone at each row, with a truncation error of its own.
    assert np.abs(every.q[-1] - end.q[-1]).max() < 1e-2 * error(end, made)


def test_the_extra_force_is_the_problems():
    made, bare = problem("perturbed-kepler"), problem("kepler")
    mu = made.parameters["mu"]
    Q, P = np.array([[0.3, -0.7]]), np.array([[0.1, 0.2]])
    force = [
        float((a.observe(e, Q, P) - b.observe(f, Q, P))[0])
        for a, b in ((made.system, bare.system),)
        for e, f in zip(a.dp, b.dp, strict=True)
    ]
    r = np.hypot(*Q[0])
    np.testing.assert_allclose(force, -mu * Q[0] / r**5, rtol=1e-12)
    # One short leapfrog step from rest moves the momentum by h times the force at the drifted place, which is Q.
    h = 1e-3
    kicks = []
    for strength in (mu, 0.0):
        sim, keep = particles.simulation(made, Q[0], (0.0, 0.0), "leapfrog", strength)
        sim.dt = h
        sim.steps(1)
        kicks.append(np.array([sim.particles[1].vx, sim.particles[1].vy]))
        assert (keep is None) == (strength == 0)
    np.testing.assert_allclose((kicks[0] - kicks[1]) / h, -mu * Q[0] / r**5, rtol=1e-10)


def test_initial_data_may_be_given():
    made = problem("kepler")
    circle = {"q0": [0.0, 1.0], "p0": [-1.0, 0.0]}
    for p in PEERS:
        if p.lacks(made, made.system):
            continue
        # The Euler methods leave the circle by more than the bound within a whole orbit.
        t_end = 2 * np.pi / (100 if p.order == 1 else 1)
        solution = integrate_peer(made, p.id, tol=1e-6 if p.adaptive else None, t_end=t_end, steps=400, **circle)
        if solution.status == "skipped":
            continue
        assert np.abs(np.hypot(*solution.q.T) - 1).max() < 1e-3, p.id
        exact = [-np.sin(t_end / 4), np.cos(t_end / 4)]
        assert np.abs(solution.q[100] - exact).max() < 1e-2, p.id


def test_a_blow_up_keeps_the_rows_before_it():
    runaway = Hamiltonian(q="q", p="p", H="p**2/2 - q**4/4")
    for id in ("heyoka", "scipy-dop853"):
        solution = integrate_peer(runaway, id, t_end=5.0, steps=10, q0=[1.0], p0=[1.0])
        assert solution.status == "diverged"
        assert "t = 1 of 5" in solution.reason
        assert solution.t.tolist() == [0.0, 0.5, 1.0]
        assert np.isfinite(solution.q).all()


def test_a_fall_into_the_singularity_is_not_ok():
    made = problem("kepler")
    for id in ("heyoka", "rebound-ias15", "rebound-leapfrog", "scipy-dop853"):
        steps = None if BY_ID[id].adaptive else 100
        assert integrate_peer(made, id, t_end=2.0, steps=steps, q0=[1, 0], p0=[0, 0]).status in (
            "diverged",
            "collision",
        )


@pytest.mark.parametrize("p", PEERS, ids=lambda p: p.id)
def test_a_missing_package_is_skipped(monkeypatch, p):
    monkeypatch.setitem(sys.modules, p.package, None)
    solution = integrate_peer(problem("kepler"), p.id, t_end=1.0, steps=10)
    assert solution.status == "skipped"
    assert f"pip install {p.package}" in solution.reason
    assert solution.t.tolist() == [0.0]
    assert solution.method is p
    json.dumps(solution.counts)


@pytest.mark.parametrize(
    ("id", "name", "options", "what"),
    [
        ("rebound-ias15", "double-pendulum", {"t_end": 1.0}, "alone"),
        ("rebound-whfast", "pendulum", {"t_end": 1.0, "h": 0.1}, "body to revolve around"),
        ("rebound-whfast", "kepler", {"t_end": 1.0}, "step h"),
        ("rebound-whfast", "kepler", {"t_end": 1.0, "h": 0.1, "tol": 1e-9}, "give h, not tol"),
        ("rebound-leapfrog", "kepler", {"t_end": 1.0, "h": -0.1}, "positive"),
        ("heyoka", "kepler", {}, "t_end"),
        ("heyoka", "kepler", {"t_end": float("nan")}, "t_end"),
        ("heyoka", "kepler", {"t_end": 1.0, "steps": 0}, "steps"),
        ("rebound-ias15", "kepler", {"t_end": 1.0, "tol": 0.0}, "between 0 and 1"),
        ("rebound-ias15", "kepler", {"t_end": 1.0, "tol": 1.0}, "between 0 and 1"),
        ("heyoka", "kepler", {"t_end": 1.0, "tol": float("nan")}, "tol"),
        ("heyoka", "kepler", {"t_end": 1.0, "tol": 1e-17}, "none below"),
        ("scipy-dop853", "kepler", {"t_end": 1.0, "tol": 1e-15}, "none below"),
        ("scipy-dop853", "kepler", {"t_end": 1.0, "tol": "small"}, "tol"),
        ("heyoka", "kepler", {"t_end": 1.0, "save_every": -1}, "save_every"),
        ("heyoka", "kepler", {"t_end": 1.0, "q0": [0.0, 0.0]}, "singularity"),
        ("heyoka", "kepler", {"t_end": 1.0, "q0": [1.0]}, "components"),
        ("heyoko", "kepler", {"t_end": 1.0}, "heyoka"),
    ],
)
def test_unusable_input_is_refused(id, name, options, what):
    with pytest.raises(InvalidInput, match=what):
        integrate_peer(problem(name), id, **options)


def test_a_peer_is_a_record_of_its_own():
    assert isinstance(peer("heyoka"), Peer)
    assert peer(PEERS[1]) is PEERS[1]
