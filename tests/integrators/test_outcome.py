"""The outcome "inaccurate" or "unstable" of a run, on made-up rows, on accurate orbits, and for all who integrate."""

from __future__ import annotations

import json

import numpy as np
import pytest
import sympy as sp

import phasebench as pb
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators import Hamiltonian, integrate, outcome
from phasebench.integrators.compile import codegen
from phasebench.integrators.outcome import judge, solver_failure
from phasebench.integrators.trajectory import PIECE, Pace, Trajectory
from phasebench.reference.peers.run import ending

OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
T = np.linspace(0.0, 100.0, 1001)


def circle(amplitude):
    """Rows (Q, P) of the oscillator with the given amplitude at each time of `T`."""
    return (amplitude * np.cos(T))[:, None], (-amplitude * np.sin(T))[:, None]


def verdict(energy, system=OSCILLATOR):
    """Outcome reported for a made-up circular orbit whose energy is ``energy`` times the initial one from t = 50 on."""
    return judge(system, T, *circle(np.where(T < 50.0, 1.0, energy**0.5)))


@pytest.mark.parametrize(
    ("energy", "status", "noted"),
    [(1.0, "ok", False), (1.05, "ok", False), (1.9, "ok", True), (2.1, "inaccurate", True), (1e9, "unstable", True)]
    + [(0.95, "ok", False), (0.75, "ok", True), (0.2, "inaccurate", True), (0.0, "inaccurate", True)],
)
def test_energy_may_neither_double_nor_halve(energy, status, noted):
    found = verdict(energy)
    assert found.status == status
    assert bool(found.reason) == noted
    assert ("from t = 50 on" in found.reason) == (status != "ok")


def test_the_scale_omits_constants_and_bounds_cosines():
    assert verdict(2.1, Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2 + 1000000")).status == "inaccurate"
    pendulum = problem("pendulum").system
    Q, P = np.array([[np.pi / 2], [1.0], [0.1]]), np.array([[0.0], [2.0], [3.0]])
    assert pendulum.scale(Q, P) == pytest.approx([1.0, 3.0, 5.5])
    assert Hamiltonian(q="q", p="p", H="p**2/2 - 3*q + 5").scale(Q, P) == pytest.approx([1.5 * np.pi, 5.0, 4.8])


def test_a_single_bad_row_is_seen():
    Q, P = circle(np.where(T[500] == T, 2.0, 1.0))
    assert judge(OSCILLATOR, T, Q, P).status == "inaccurate"
    keep = T[500] != T
    assert judge(OSCILLATOR, T[keep], Q[keep], P[keep]).status == "ok"


def test_a_large_scale_at_the_start_excuses_no_error():
    """The scale of H is 2e4 at the first row; the body then leaves with energy 1 in place of -1/2."""
    kepler = problem("kepler", e=0.9999).system
    r = 1.0 + np.arange(50.0)
    v = np.sqrt(2 * (1.0 + 1 / r))
    Q, P = (np.stack([x, 0 * x], axis=1) for x in (r, v))
    Q[0], P[0] = problem("kepler", e=0.9999).q0, problem("kepler", e=0.9999).p0
    assert judge(kepler, r, Q, P).status == "inaccurate"


def test_an_orbit_past_a_saddle_is_ok():
    """Control: relative to the scale at the current row alone the orbit would be judged inaccurate there."""
    well = Hamiltonian(q="q", p="p", H="p**2/2 - q**2/2 + q**4/4")
    s = integrate(well, "stormer-verlet", h=0.1, t_end=60, q0=[2**0.5], p0=[0.0])
    error, M = np.abs(well.observe(well.H, s.q, s.p)), well.scale(s.q, s.p)
    assert (error > outcome.LOST * M).any()
    assert (s.status, s.reason) == ("ok", "")


GROWTH = np.linspace(0.0, 1.0, 401)


@pytest.mark.parametrize(
    ("energy", "grown"),
    [
        (2.2**GROWTH, True),  # just doubled
        (1 + 2 * GROWTH, True),
        (1 + 2 * GROWTH**0.5, False),
        (np.where(GROWTH < 0.5, 1.0, 4.0), False),
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


@pytest.mark.parametrize("every", [1, 0])
@pytest.mark.parametrize(("h", "status"), [(1.9, 0), (1.99, 0), (1.9999, 0), (2.0001, 1), (2.001, 1), (2.01, 1)])
def test_the_stability_limit_separates_the_outcomes(h, status, every):
    s = integrate(OSCILLATOR, "stormer-verlet", h=h, steps=1500, save_every=every, q0=[1.0], p0=[0.0])
    assert s.status == ("inaccurate", "unstable")[status], s.reason


def test_decay_is_inaccurate_and_growth_unstable():
    ends = [
        integrate(OSCILLATOR, m, h=0.1, t_end=T, q0=[1.0], p0=[0.0]).status
        for m in ("explicit-euler", "implicit-euler")
        for T in (10, 100, 1000)
    ]
    assert ends == ["unstable"] * 3 + ["inaccurate"] * 3


def test_bounded_chaos_does_not_count_as_growth():
    """Amplitudes follow the logistic map at 4 from seeded starts; H changes by up to 30 times itself."""
    statuses = set()
    for x in np.random.default_rng(5).uniform(0.1, 0.9, 200):
        jumps = [x]
        for _ in T[1:]:
            jumps.append(4 * jumps[-1] * (1 - jumps[-1]))
        statuses.add(judge(OSCILLATOR, T, *circle(np.sqrt(1 + 30 * np.array(jumps)))).status)
    assert statuses == {"inaccurate"}


def test_overflow_and_underflow():
    assert verdict(1e300).status == "unstable"
    assert judge(OSCILLATOR, T, *circle(1e-170 * np.exp(T / 10))).status == "ok"  # below the normal numbers


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
    assert len(found) > 60
    assert {label.partition(" ")[0].partition(":")[0] for label in found} == set(PROBLEMS)


@pytest.mark.parametrize("every", [1, 3, 0])
def test_hand_written_systems_are_judged_too(every):
    waves = problem("klein-gordon")
    wide, narrow = (integrate(waves, "stormer-verlet", h=h, steps=6, save_every=every) for h in (0.7, 0.01))
    assert (wide.status, narrow.status) == ("unstable", "ok")
    assert len(wide.t) > 1


def test_states_between_stored_rows_are_judged():
    """Only the ends are stored; the state at the end of a piece shows an error that the last row does not."""
    states = [(1, 10.0), (2, 1.0)]

    class Run:
        counts = np.rec.array([(0,)], dtype=[("fallbacks", int)])[0]

        def __call__(self, Q, P, parameter, every):
            Q[0], P[0] = states[0][1], 0.0
            states.pop(0)
            return 1, 0

    t = Trajectory(OSCILLATOR, [1.0], [0.0], 0.1, 2 * PIECE, 2 * PIECE, "double")
    t.advance(Run(), Pace(None))
    t.conclude(None, 0)
    assert (t.status, len(t.times)) == ("inaccurate", 2)
    assert f"t = {0.1 * PIECE:.6g}" in t.reason


# -- the same for all integrators -------------------------------------------------------------------------------------


def euler(system, q, p, h):
    """Explicit Euler as a user's step function."""
    return q + h * system.dH_dp(q, p), p - h * system.dH_dq(q, p)


@pytest.mark.parametrize("every", [1, 0])
def test_a_users_step_function_is_judged(every):
    s = pb.integrate("harmonic-oscillator", euler, h=0.1, t_end=100, save_every=every)
    assert s.status == "unstable"
    assert pb.integrate("harmonic-oscillator", euler, h=1e-4, t_end=1, save_every=every).status == "ok"


def test_a_users_step_function_that_times_out_keeps_its_state():
    s = pb.integrate("harmonic-oscillator", euler, h=1e-7, steps=10**9, save_every=0, time_limit=0.1)
    assert s.status == "timeout"
    assert s.t[-1] == s.counts["steps"] * 1e-7 > 0
    assert len(s.q) == 2


def test_rows_of_a_peer_are_judged():
    good, bad = circle(np.ones(len(T))), circle(np.exp(T / 50))
    assert ending(OSCILLATOR, T, *good, None)[0] == "ok"
    status, reason, rows = ending(OSCILLATOR, T, *bad, None)
    assert (status, rows) == ("unstable", len(T))
    assert "tolerance" in reason
    lotka = problem("lotka-volterra").system
    outside = np.ones((3, 1)), np.array([[1.0], [-1.0], [1.0]])
    assert ending(lotka, T[:3], *outside, None)[::2] == ("diverged", 1)


def test_a_system_without_energy_is_not_judged():
    free = pb.integrators.systems.hamiltonian.PartitionedSystem(q="q", p="p", dq=["q"], dp=[sp.Integer(0)])
    assert integrate(free, "rk4", h=0.1, t_end=50, q0=[1.0], p0=[0.0]).status == "ok"


def test_the_report_of_an_unsolved_stage_names_its_solver():
    few, many = 2, codegen.TUPLE_LIMIT + 1
    assert solver_failure("banded", many).what.startswith("Newton's method in a band")
    assert "fixed point nor Newton's method" in solver_failure("collocation", many).what
    assert [bool(solver_failure("parametric", d).advice) for d in (few, many)] == [False, True]
    assert not solver_failure("collocation", many).advice


if __name__ == "__main__":
    print(json.dumps({"result": accurate()}))


@pytest.mark.parametrize(("sign", "status"), [("+", "ok"), ("-", "collision")])
def test_a_wall_that_repels_is_met_head_on_without_a_collision(sign, status):
    system = Hamiltonian(q="q", p="p", H=f"p**2/2 {sign} 1/q**2 + q")
    assert integrate(system, "stormer-verlet", h=1e-3, t_end=1, q0=[0.3], p0=[-1.0]).status == status
    row = np.array([0.0]), np.array([[0.9]]), np.array([[-60.0]])  # a step of 0.05 would pass the singularity
    assert (outcome.describe_crossing(system, *row, 0.05) is None) == (status == "ok")
