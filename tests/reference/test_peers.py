"""Peers against the references: accuracy, status, refused input, records."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, outcome
from phasebench.reference import native
from phasebench.reference.installed import how_to_install, is_installed
from phasebench.reference.peers import BY_ID, PEERS, Peer, integrate_peer, particles, peer, registry, run
from phasebench.reference.peers import scipy as older
from phasebench.reference.peers.record import NOT_FINITE, Run, split_alone
from phasebench.reference.solvers.taylor import reference
from support.planted import control
from support.references import error

T_END = 10.0
COUNTS = {"steps", "gradient", "hessian", "iterations", "fallbacks"}


def test_the_table_of_peers():
    assert len(PEERS) == sum(len(package.PEERS) for package in registry.PACKAGES), "two records have one id"
    for p in PEERS:
        assert p.label == p.id
        assert p.parameters == {}
        assert all((p.name, p.package, p.license, p.about, p.source))
    with pytest.raises(InvalidInput, match="rebound-ias15"):
        peer("rebound-ias51")


@pytest.mark.lowest
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
def test_general_peers_run_on_other_problems(id, tol):
    for name, bound in (("henon-heiles:box", 1e-11), ("pendulum", 1e-10), ("lotka-volterra", 1e-10)):
        made = problem(name)
        solution = integrate_peer(made, id, t_end=T_END, tol=tol)
        assert solution.t.tolist() == [0.0, T_END]
        assert 0 < error(solution, made) < bound


def test_ias15_takes_fewer_steps_at_a_looser_tolerance():
    made = problem("kepler")
    tight, loose = (integrate_peer(made, "rebound-ias15", t_end=T_END, tol=tol) for tol in (1e-9, 0.5))
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


@pytest.mark.lowest
@pytest.mark.parametrize("id", ["rebound-whfast", "rebound-leapfrog"])
def test_fixed_step_peers_have_their_order(id):
    made = problem("perturbed-kepler")
    errors = []
    for n in (800, 1600, 3200):
        solution = integrate_peer(made, id, t_end=T_END, steps=n, save_every=0)
        assert solution.status == "ok"
        errors.append(error(solution, made))
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (abs(slopes - BY_ID[id].order) < 0.1).all()


def test_storing_rows_changes_whfast_by_round_off():
    made = problem("perturbed-kepler")
    every = integrate_peer(made, "rebound-whfast", h=0.01, steps=500)
    end = integrate_peer(made, "rebound-whfast", h=0.01, steps=500, save_every=0)
    assert (every.t[-1], len(end.t)) == (end.t[-1], 2)
    # At each row the corrector of order 17 is applied and undone, with an error of its own.
    assert np.abs(every.q[-1] - end.q[-1]).max() < 1e-2 * error(end, made)


def test_the_extra_force_is_that_of_the_problem():
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
    # From rest, one short leapfrog step changes the momentum by h times the force at Q.
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
    checked = set()
    for p in PEERS:
        if p.lacks(made, made.system) or p.package in native.LIBRARIES:  # those are compiled in test_peers_native
            continue
        # Within a quarter of an orbit the Euler methods leave the circle by more than the bound.
        t_end = np.pi / (50 if p.order == 1 else 2)
        solution = integrate_peer(made, p.id, tol=1e-6 if p.adaptive else None, t_end=t_end, steps=100, **circle)
        if solution.status == "skipped":
            continue
        assert np.abs(np.hypot(*solution.q.T) - 1).max() < 1e-3, p.id
        exact = [-np.sin(t_end / 4), np.cos(t_end / 4)]
        assert np.abs(solution.q[25] - exact).max() < 1e-2, p.id
        checked.add(p.package)
    assert checked >= {"heyoka", "rebound", "scipy"}


def test_a_fall_into_the_singularity_has_a_status():
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
    monkeypatch.setattr(native, "compiler", lambda language: None)
    made = problem("pendulum" if p.package == "mujoco" else "kepler")
    solution = integrate_peer(made, p.id, t_end=1.0, steps=10)
    assert solution.status == "skipped"
    assert how_to_install(p.package) in solution.reason
    assert solution.t.tolist() == [0.0]
    assert solution.method is p
    json.dumps(solution.counts)


@pytest.mark.parametrize(
    ("id", "name", "options", "what"),
    [
        ("rebound-whfast", "kepler", {"t_end": 1.0}, "step h"),
        ("rebound-whfast", "kepler", {"t_end": 1.0, "h": 0.1, "tol": 1e-9}, "give h, not tol"),
        ("rebound-leapfrog", "kepler", {"t_end": 1.0, "h": -0.1}, "lies ahead"),
        ("heyoka", "kepler", {}, "t_end"),
        ("heyoka", "kepler", {"t_end": float("nan")}, "t_end"),
        ("heyoka", "kepler", {"t_end": 1.0, "steps": 0}, "steps"),
        ("rebound-ias15", "kepler", {"t_end": 1.0, "tol": 0.0}, "between 0 and 1"),
        ("rebound-ias15", "kepler", {"t_end": 1.0, "tol": 1.0}, "between 0 and 1"),
        ("heyoka", "kepler", {"t_end": 1.0, "tol": float("nan")}, "tol"),
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


def test_a_peer_is_found_by_id_or_record():
    assert peer("heyoka").id == "heyoka"
    assert peer(PEERS[1]) is PEERS[1]


# -- records
# -----------------------------------------------------------------------------------------------------------


def test_the_texts_of_records_are_complete():
    assert len({p.name for p in PEERS}) == len(PEERS)
    for p in PEERS:
        for words in (p.name, p.about, p.source, p.scope, p.claims.source):
            assert words == words.strip(" ;,")
            assert not any(wrong in words for wrong in ("  ", "; ;", ";;", "None", "{", "}")), words
        several = p.package in (
            "desolver",
            "gala",
            "galpy",
            "pyhamsys",
            "sundials4py",
            "pynamicalsys",
            "blackjax",
            "openmm",
        )
        assert p.about.count(";") >= several
        assert p.name.endswith(", adaptive") == p.id.endswith("-adaptive")


def test_the_scope_in_words_agrees_with_lacks():
    """For a canonical, non-separable H `lacks` admits exactly the peers whose scope is any system."""
    made = problem("double-pendulum")
    peers = [p for p in PEERS if not p.id.endswith("-numba")]  # these need compilation
    able = {p.id for p in peers if p.lacks(made, made.system) is None}
    assert able == {p.id for p in peers if p.scope.startswith(("any", "models"))}
    assert {BY_ID[id].package for id in able} == {
        "heyoka",
        "scipy",
        "gala",
        "desolver",
        "pyhamsys",
        "diffrax",
        "boost",
        "gsl",
        "pynamicalsys",
        "blackjax",
        "mujoco",
    }


#: Peer -> (least tolerance, default tolerance where the package has none).
TOLERANCES = {
    "heyoka": (2.0**-53, 2.0**-52),
    "heyoka-high-accuracy": (2.0**-53, 2.0**-52),
    "heyoka-batch": (2.0**-53, 2.0**-52),
    "rebound-ias15": (1e-16, None),
    "rebound-bs": (1e-14, None),
    "scipy-dop853": (100 * 2.0**-52, None),
    "gala-dopri853": (1e-14, None),
    "gala-dopri853-cython": (1e-14, None),
    "galpy-dopr54-c": (1e-14, None),
    "galpy-dop853": (1e-14, None),
    "galpy-dop853-c": (1e-14, None),
    "galpy-odeint": (1e-13, None),
    "desolver-dopri45-adaptive": (1e-14, 1e-10),
}


@pytest.mark.parametrize("id", TOLERANCES)
def test_the_least_tolerance_is_accepted_and_none_below(id):
    least, default = TOLERANCES[id]
    assert BY_ID[id].tol == default
    with pytest.raises(InvalidInput, match=f"none below {least:.3g}"):
        integrate_peer(problem("kepler"), id, t_end=0.1, tol=least * (1 - 1e-9))
    assert integrate_peer(problem("kepler"), id, t_end=1e-3, tol=least).status in ("ok", "skipped")


def test_a_record_without_least_tolerance_accepts_any():
    (default,) = (f.default for f in fields(Peer) if f.name == "least")
    taken = []
    honest = control("stormer-verlet")
    any_tolerance = replace(honest, adaptive=True, least=default, run=lambda t: taken.append(t.tol) or honest.run(t))
    for tol in (1e-300, 0.99):
        assert integrate_peer(problem("pendulum"), any_tolerance, t_end=0.1, tol=tol).status == "ok"
    assert taken == [1e-300, 0.99]


# -- runs
# --------------------------------------------------------------------------------------------------------------

#: One peer of each interface, and whether it reports its evaluations.
WAYS = {
    "heyoka": False,
    "heyoka-batch": False,
    "rebound-whfast": False,
    "rebound-ias15": False,
    "scipy-dop853": True,
    "gala-leapfrog": True,
    "gala-leapfrog-cython": False,
    "galpy-leapfrog-c": False,
    "galpy-dop853-c": False,
    "desolver-rk4": True,
    "desolver-dopri45-adaptive": True,
    "pyhamsys-verlet": False,
    "diffrax-euler": False,
    "blackjax-velocity-verlet": True,
    "openmm-verlet": True,
    "openmm-custom-velocity-verlet": True,
    "openmm-variable-verlet-adaptive": False,
    "ase-velocity-verlet": True,
    "jax-md-nve": True,
    "pynamicalsys-verlet": True,
    "pynamicalsys-midpoint": False,
}


@pytest.mark.parametrize("id", WAYS)
def test_seconds_and_unknown_counts(id):
    made, chosen = problem("kepler"), BY_ID[id]
    size = {"t_end": 0.01, "steps": 4, "tol": 1e-6 if chosen.adaptive else None}
    began = time.perf_counter()
    solution = integrate_peer(made, chosen, **size)
    spent = time.perf_counter() - began
    if solution.status == "skipped":
        pytest.skip(solution.reason)
    assert solution.status == "ok"
    assert 0 < solution.seconds < spent
    counts = solution.counts
    assert (counts["hessian"], counts["iterations"], counts["fallbacks"]) == (0, 0, 0)
    assert (counts["gradient"] >= 4) if WAYS[id] else (counts["gradient"] == 0)
    assert np.isnan(solution.parameter).all()
    assert len(solution.parameter) == len(solution.t) - 1
    assert (solution.q.shape, solution.p.shape) == ((5, 2), (5, 2))
    exact = reference(made, solution.t, certify=False)
    assert np.abs(solution.q - exact.q).max() < 1e-3


@pytest.mark.parametrize("solver", ["ode", "odeint"])
def test_older_scipy_interfaces_count_evaluations(solver, monkeypatch):
    made, calls = problem("kepler"), [0]
    inner = made.system.vector_field()

    def field(t, y):
        calls[0] += 1
        return inner(t, y)

    monkeypatch.setattr(older, "compiled_field", lambda system: field)
    began = time.perf_counter()
    solution = integrate_peer(made, older.fast(solver), t_end=1.0, steps=5)
    assert 0 < solution.seconds < time.perf_counter() - began
    assert error(solution, made) < 1e-5
    counted = (solution.counts["steps"], solution.counts["gradient"])
    assert counted[1] == (calls[0] - 1 if solver == "odeint" else 0)  # one call before the clock starts
    assert 5 <= counted[0] < counted[1] if solver == "odeint" else counted[0] == 0
    monkeypatch.setattr(older, "STEP_LIMIT", 2)
    stopped = integrate_peer(made, older.fast(solver), t_end=100.0, steps=2)
    assert (stopped.status, len(stopped.t)) == ("diverged", 1)
    if solver == "ode":
        assert (stopped.counts["steps"], stopped.counts["gradient"]) == (0, 0)


@pytest.mark.parametrize("where", [("q", 2, 0), ("q", 2, 1), ("p", 2, 0), ("p", 2, 1)])
def test_a_single_nan_ends_the_rows(where):
    """A NaN in any component of a row ends the rows, even if later ones are finite."""
    name, row, component = where
    rows = {"q": np.ones((4, 2)), "p": np.ones((4, 2))}
    rows[name][row, component] = np.nan
    system, times = problem("henon-heiles").system, np.array([0.0, 0.5, 1.0, 7.0])
    status, reason, good = run.ending(system, times, rows["q"], rows["p"], "it says why.")
    assert (status, good) == ("diverged", 2)
    assert reason == "it says why; the rows end at t = 0.5 of 7"
    assert run.ending(system, times, rows["q"], rows["p"], None)[1].startswith(NOT_FINITE)


class FakeSystem(SimpleNamespace):
    """Stand-in for a system whose energies are given as H."""

    def observe(self, H, q, p):
        return np.asarray(H)


@pytest.mark.parametrize(
    ("energies", "status", "rows"),
    [
        ((1.0, -9.0, 1.0), "judged", 3),  # exactly ten times its size
        ((1.0, 11.5, 1.0), "collision", 3),
        ((1.0, -9.5, 1.0), "collision", 3),
        ((1.0, np.nan, 1.0), "diverged", 1),
        ((1.0, 1.0, np.inf), "diverged", 2),
    ],
)
def test_energy_errors_mean_collision_or_divergence(energies, status, rows, monkeypatch):
    monkeypatch.setattr(outcome, "energy_unit", lambda *_: 1.0)
    monkeypatch.setattr(outcome, "judge", lambda *_: ("judged", ""))
    system, times, states = FakeSystem(H=energies, singular=True), np.array([0.0, 1.0, 2.0]), np.zeros((3, 1))
    found, reason, good = run.ending(system, times, states, states, None)
    assert (found, good) == (status, rows)
    if status == "diverged":
        assert f"domain; the rows end at t = {rows - 1}" in reason
    regular = run.ending(FakeSystem(H=energies, singular=False), times, states, states, None)
    assert regular[0] == ("diverged" if status == "diverged" else "judged")


@pytest.mark.parametrize("canonical", [True, False])
@pytest.mark.parametrize("separable", [True, False])
def test_splittings_need_canonical_separable_systems(canonical, separable):
    lack = split_alone("it is not")(None, SimpleNamespace(canonical=canonical, separable=separable))
    assert lack == (None if canonical and separable else "it is not")


def test_runs_are_made_from_rows_of_states():
    states = np.arange(12.0).reshape(3, 4)
    found = Run.of_states(states, 5, 6, 0.25, "a reason")
    assert found.q.tolist() == [[0, 1], [4, 5], [8, 9]]
    assert found.p.tolist() == [[2, 3], [6, 7], [10, 11]]
    assert found[2:] == (5, 6, 0.25, "a reason")


@pytest.mark.parametrize("id", [p.id for p in PEERS if p.adaptive and is_installed(p.package)])
def test_rows_end_steps_where_the_record_says_so(id):
    """With many rows such a peer takes as many steps at least; the others interpolate them."""
    made, p = problem("pendulum"), BY_ID[id]
    if p.lacks(made, made.system):
        pytest.skip(p.lacks(made, made.system))
    tol, rows = max(1e-3, p.least), 500
    bare = integrate_peer(made, p, tol=tol, t_end=10.0, save_every=0).counts["steps"]
    if not bare:
        pytest.skip("it does not count its steps")
    with_rows = integrate_peer(made, p, tol=tol, t_end=10.0, steps=rows, save_every=1).counts["steps"]
    assert bare < rows / 2
    assert (with_rows >= rows - 1) == p.rows_end_steps == (with_rows != bare)
