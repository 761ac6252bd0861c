"""What is said of a run at its end, on made-up rows within and beyond each limit, and for all who integrate."""

from __future__ import annotations

import json

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators import Hamiltonian, integrate, outcome
from phasebench.integrators.outcome import describe_approach, describe_crossing, describe_escape, judge
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.trajectory import PIECE, Pace, Trajectory
from phasebench.reference.peers.run import ending

OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
NO_ENERGY = PartitionedSystem(q="q", p="p", dq=["p"], dp=["-q"])
T = np.linspace(0.0, 100.0, 1001)


def circle(energy):
    """Rows (Q, P) of the oscillator with ``energy`` times the initial one at each time of `T`."""
    amplitude = np.sqrt(energy)
    return (amplitude * np.cos(T))[:, None], (-amplitude * np.sin(T))[:, None]


@pytest.mark.parametrize(
    ("energy", "status", "noted"),
    [(1.0, "ok", False), (1.05, "ok", False), (1.99, "ok", True), (2.01, "inaccurate", True), (1e9, "unstable", True)]
    + [(0.95, "ok", False), (0.75, "ok", True), (0.2, "inaccurate", True), (1e300, "unstable", True)],
)
def test_energy_may_neither_double_nor_halve(energy, status, noted):
    """It is so many times the initial one from t = 50 on."""
    found = judge(OSCILLATOR, T, *circle(np.where(T < 50.0, 1.0, energy)))
    assert (found.status, bool(found.reason)) == (status, noted)
    assert ("from t = 50 on" in found.reason) == (status != "ok")


def test_the_scale_omits_constants_and_bounds_cosines():
    shifted = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + 1000000")
    assert judge(shifted, T, *circle(np.where(T < 50.0, 1.0, 2.1))).status == "inaccurate"
    Q, P = np.array([[np.pi / 2], [1.0], [0.1]]), np.array([[0.0], [2.0], [3.0]])
    assert problem("pendulum").system.scale(Q, P) == pytest.approx([1.0, 3.0, 5.5])
    assert Hamiltonian(q="q", p="p", H="p**2/2 - 3*q + 5").scale(Q, P) == pytest.approx([1.5 * np.pi, 5.0, 4.8])


def test_a_single_bad_row_is_seen_and_dated():
    """A large scale of H at the first row excuses no error later."""
    Q, P = circle(np.where(T[500] == T, 4.0, 1.0))
    found, keep = judge(OSCILLATOR, T, Q, P), T[500] != T
    assert (found.status, "from t = 50 on" in found.reason) == ("inaccurate", True)
    assert judge(OSCILLATOR, T[keep], Q[keep], P[keep]).status == "ok"
    kepler = problem("kepler", e=0.9999)
    r = 1.0 + np.arange(50.0)
    Q, P = (np.stack([x, 0 * x], axis=1) for x in (r, np.sqrt(2 * (1.0 + 1 / r))))
    Q[0], P[0] = kepler.q0, kepler.p0
    assert judge(kepler.system, r, Q, P).status == "inaccurate"


GROWTH = np.linspace(0.0, 1.0, 401)


@pytest.mark.parametrize(
    ("energy", "grown"),
    [
        (2.2**GROWTH, True),  # just doubled
        (1 + 2 * GROWTH**0.5, False),
        (np.where(GROWTH < 0.9, 1.0, 4.0), False),
        (4.0**-GROWTH, False),
        (1 + 30 * np.sin(40 * GROWTH) ** 2, False),
        (np.append(1 + GROWTH[:-1], 1e7), True),
        (1 + 30 * np.sin(40 * GROWTH) ** 2 * 20**GROWTH, True),
    ],
)
def test_growing_and_bounded_errors_are_told_apart(energy, grown):
    assert outcome.grows(np.abs(energy - energy[0]), 1.0) == grown


def test_random_walks_rarely_and_drifts_nearly_always_grow():
    walks = np.random.default_rng(7).standard_normal((400, 2000)).cumsum(axis=1)
    bounded = np.abs(np.random.default_rng(8).standard_normal((400, 2000)))
    drift = bounded + np.linspace(0, 20, 2000)
    share = [np.mean([outcome.grows(np.append(0.0, np.abs(w)), 1e9) for w in rows]) for rows in (walks, bounded, drift)]
    assert share[0] < 0.4
    assert share[1:] == [0.0, 1.0]


def test_growth_with_conserved_energy_is_reported():
    """That a fall along y grows to 200 times the initial size is told, unless its energy was lost before that."""
    plane, t = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 - y"), np.linspace(0, 20, 41)
    Q, P = np.stack([1 + 0 * t, t**2 / 2], 1), np.stack([0 * t, t], 1)
    assert "grown to 200:" in describe_escape(plane, Q, P)
    assert "grown to 200:" in describe_escape(plane, 0 * Q + [0.001, 1] * Q, P), "what is small beside it has no say"
    lost = np.where(t[:, None] > 3, 3 * P, P)
    for rows in ((plane, Q[:6], P[:6]), (plane, Q[:1], P[:1]), (plane, Q, lost)):
        assert describe_escape(*rows) == ""
    free = np.array([[1.0], [1000.0]])
    assert describe_escape(NO_ENERGY, free, 0 * free) == ""
    assert describe_approach(NO_ENERGY, free, 0 * free, 0.1) is None


def test_a_last_step_longer_than_the_distance_is_reported():
    well = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=["q"])
    for q, said in (([0.5, 0.5, 0.01], True), ([0.01], True), ([0.01, 0.01, 0.5], False)):
        Q = np.array(q)[:, None]
        found = describe_approach(well, Q, -np.sqrt(2 * (1 / Q - 1)), 0.1)
        assert (found is not None) == said
        assert not said or "the step 1.41" in found


#: Two singularities; the rows pass the first one along x, at the distance 0.1.
KEPLER = Hamiltonian(
    q="x y",
    p="u v",
    H="(u**2 + v**2)/2 - 1/sqrt(x**2 + y**2) - 1e-9/sqrt((x - 40)**2 + (y - 9)**2)",
    singular=["sqrt(x**2 + y**2)", "sqrt((x - 40)**2 + (y - 9)**2)"],
)
PAST = [-5, -0.3, -0.1, 0.1, 5]


def flyby(x, H):
    """(Q, P) of a motion along the line y = 0.1 with energies H."""
    Q = np.stack([np.array(x, dtype=float), np.full(5, 0.1)], 1)
    return Q, np.stack([np.sqrt(2 * (np.array(H) + 1 / np.hypot(*Q.T))), np.zeros(5)], 1)


@pytest.mark.parametrize(
    ("x", "H", "h", "said"),
    [
        (PAST, [1, 1, 1, 1, 1], 0.2, None),  # kept
        (PAST, [1, 1, 1, 1, 0.95], 0.2, None),  # less than a tenth
        (PAST, [1, 1, 1, 1, 0.8], 0.2, "at distance 0.316 "),  # the first of several
        (PAST, [1, 0.8, 0.8, 0.8, 0.8], 0.2, "near t = 1 "),  # lost against the start
        ([-5, -4, -4, -0.1, 0.1], [1, 5, 5, 1, 1], 0.2, None),  # elsewhere
        (PAST, [1, 1, 1, 1, 0.8], 0.01, None),  # short steps
    ],
)
def test_an_encounter_is_reported_where_energy_is_lost(x, H, h, said):
    found = describe_crossing(KEPLER, T[::10], *flyby(x, H), h)
    assert (found is None) if said is None else said in found


def test_a_head_on_motion_is_reported_at_its_first_row():
    Q, P = flyby(PAST, [1, 1, 1, 1, 1])
    Q[2:4, 1] = 0.0
    assert "head-on after t = 2;" in describe_crossing(KEPLER, T[::10], Q, P, 0.2)


@pytest.mark.parametrize(("sign", "status"), [("+", "ok"), ("-", "collision")])
def test_a_wall_that_repels_is_met_head_on_without_a_collision(sign, status):
    system = Hamiltonian(q="q", p="p", H=f"p**2/2 {sign} 1/q**2 + q")
    assert integrate(system, "stormer-verlet", h=1e-3, t_end=1, q0=[0.3], p0=[-1.0]).status == status
    row = np.array([0.0]), np.array([[0.9]]), np.array([[-60.0]])  # a step of 0.05 would pass the singularity
    assert (describe_crossing(system, *row, 0.05) is None) == (status == "ok")


def accurate() -> dict[str, list]:
    """{orbit and spacing of rows: [status, reason]} of short accurate runs on every orbit of every problem."""
    ends = {}
    for made in (problem(name).at(orbit.name) for name in PROBLEMS for orbit in problem(name).orbits):
        for every in (1, 0):
            s = integrate(made, "rk4", h=made.pace.step / 10, steps=60, save_every=every)
            ends[f"{made.label} {every}"] = [s.status, s.reason]
    return ends


def test_accurate_orbits_are_ok(uncompiled):
    """Run without compilation, which reaches the same states."""
    found = uncompiled("integrators/test_outcome.py")
    assert {label: end for label, end in found.items() if end != ["ok", ""]} == {}
    assert {label.partition(" ")[0].partition(":")[0] for label in found} == set(PROBLEMS)


@pytest.mark.parametrize("every", [1, 3, 0])
def test_hand_written_systems_are_judged_too(every):
    waves = problem("klein-gordon")
    wide, narrow = (integrate(waves, "stormer-verlet", h=h, steps=6, save_every=every) for h in (0.7, 0.01))
    assert (wide.status, narrow.status) == ("unstable", "ok")


def test_states_between_stored_rows_are_judged():
    """Only the ends are stored; the state at the end of a piece shows an error that the last row does not."""
    states = [1.0, 10.0]

    class Run:
        counts = np.rec.array([(0,)], dtype=[("fallbacks", int)])[0]

        def __call__(self, Q, P, parameter, every):
            Q[0], P[0] = states.pop(), 0.0
            return 1, 0

    t = Trajectory(OSCILLATOR, [1.0], [0.0], 0.1, 2 * PIECE, 2 * PIECE, "double")
    t.advance(Run(), Pace(None))
    t.conclude(None, 0)
    assert (t.status, len(t.times), f"t = {0.1 * PIECE:.6g}" in t.reason) == ("inaccurate", 2, True)


def euler(system, q, p, h):
    return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)


@pytest.mark.parametrize("every", [1, 0])
def test_a_users_step_function_is_judged(every):
    for options, status in (({"h": 0.1, "t_end": 100}, "unstable"), ({"h": 1e-4, "t_end": 1}, "ok")):
        assert pb.integrate("harmonic-oscillator", euler, **options, save_every=every).status == status


def test_rows_of_a_peer_are_judged():
    assert ending(OSCILLATOR, T, *circle(np.ones(len(T))), None)[0] == "ok"
    status, _, rows = ending(OSCILLATOR, T, *circle(np.exp(T / 25)), None)
    assert (status, rows) == ("unstable", len(T))
    outside = np.ones((3, 1)), np.array([[1.0], [-1.0], [1.0]])
    assert ending(problem("lotka-volterra").system, T[:3], *outside, None)[::2] == ("diverged", 1)
    free = PartitionedSystem(q="q", p="p", dq=["q"], dp=["0"])
    assert integrate(free, "rk4", h=0.1, t_end=50, q0=[1.0], p0=[0.0]).status == "ok", "without energy"


if __name__ == "__main__":
    print(json.dumps({"result": accurate()}))
