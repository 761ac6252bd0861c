"""What is said of a run at its end: made-up rows within and beyond each limit, pieces of a run, extreme inputs."""

from __future__ import annotations

import json
import time
from math import pi

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import PROBLEMS, problem
from phasebench.integrators import Hamiltonian, integrate, outcome, trajectory
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.outcome import describe_approach, describe_crossing, describe_escape, judge
from phasebench.integrators.stepping import solve
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from phasebench.integrators.trajectory import PIECE, Pace, Trajectory
from support.steps import euler

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
CENTRES = Hamiltonian(
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
    found = describe_crossing(CENTRES, T[::10], *flyby(x, H), h)
    assert (found is None) if said is None else said in found


def test_a_head_on_motion_is_reported_at_its_first_row():
    Q, P = flyby(PAST, [1, 1, 1, 1, 1])
    Q[2:4, 1] = 0.0
    assert "head-on after t = 2;" in describe_crossing(CENTRES, T[::10], Q, P, 0.2)


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


@pytest.mark.parametrize("every", [1, 0])
def test_a_users_step_function_is_judged(every):
    for options, status in (({"h": 0.1, "t_end": 100}, "unstable"), ({"h": 1e-4, "t_end": 1}, "ok")):
        assert pb.integrate("harmonic-oscillator", euler, **options, save_every=every).status == status


def test_a_system_without_an_energy_is_ok():
    free = PartitionedSystem(q="q", p="p", dq=["q"], dp=["0"])
    assert integrate(free, "rk4", h=0.1, t_end=50, q0=[1.0], p0=[0.0]).status == "ok"


# -- the pieces in which a kernel is called, with a made-up kernel -----------------------------------------------------


#: A free motion without an energy.
MOVED = PartitionedSystem(q="q", p="p", dq=["p"], dp=["0"])
ROOT = Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")


class Kernel:
    """Made-up kernel that counts steps in q; at the step ``end`` it stops with ``code`` or sets q, or p, to ``worth``.

    Each step adds ``missing`` to the count of fallbacks.
    """

    def __init__(self, end=None, code=solve.SOLVED, worth=None, part=0, missing=0.0, slept=0.0):
        self.end, self.code, self.worth, self.part, self.missing = end, code, worth, part, missing
        self.step, self.calls, self.slept = 0, [], slept

    @property
    def counts(self):
        return np.rec.array([(self.missing * self.step,)], dtype=[("fallbacks", float)])[0]

    def __call__(self, Q, P, parameter, every):
        self.calls.append((len(Q), every))
        time.sleep(self.slept)
        for row in range(len(Q)):
            for _ in range(every):
                self.step += 1
                if self.step == self.end and self.code:
                    return row, self.code
            Q[row], P[row], parameter[row] = self.step, 1.0, -self.step
            if self.worth is not None and self.end <= self.step < self.end + every:
                (Q, P)[self.part][row] = self.worth
        return len(Q), solve.SOLVED


def ran(kernel, steps=10, every=1, system=MOVED, timeout=None, missed="", piece=None):
    """The trajectory of a kernel from q = 0, p = 1 with h = 1/2, run to its end."""
    t = Trajectory(system, [0.0], [1.0], 0.5, steps, every, "double", missed)
    pace = Pace(timeout)
    pace.steps = piece or pace.steps
    while t:
        t.advance(kernel, pace)
    t.conclude(timeout, int(kernel.counts.fallbacks))
    return t


@pytest.mark.parametrize(("every", "filled"), [(1, 6), (3, 2), (10, 0), (4, 1)])
@pytest.mark.parametrize(
    ("kernel", "system", "status"),
    [
        ({"worth": np.nan}, MOVED, "diverged"),
        ({"worth": np.inf, "part": 1}, MOVED, "diverged"),
        ({"worth": -1.0}, ROOT, "diverged"),
        ({"worth": -1.0}, MOVED, "ok"),
        ({"code": solve.NOT_FINITE}, MOVED, "diverged"),
        ({"code": solve.STALLED}, MOVED, "not-converged"),
        ({"code": solve.OUT_OF_STEP}, MOVED, "not-converged"),
    ],
)
def test_rows_end_before_the_first_bad_one(kernel, system, status, every, filled):
    """That is not finite, outside the domain of H, or not reached."""
    t = ran(Kernel(end=7, **kernel), every=every, system=system)
    assert t.status == status
    if status != "ok":
        assert t.filled == filled
        assert f"after step {filled * every} of 10 (t = {0.5 * every * filled:.6g})" in t.reason


def test_the_state_reached_within_a_row_is_kept(monkeypatch):
    monkeypatch.setattr(trajectory, "PIECE", 5)
    for kernel in (Kernel(end=7, code=solve.STALLED), Kernel(end=7, worth=np.nan)):
        t = ran(kernel, steps=20, every=10, piece=5)
        assert (t.filled, t.reached, t.q[:2, 0].tolist(), t.times.tolist()) == (1, 5, [0, 5], [0, 2.5])


@pytest.mark.parametrize(("size", "status"), [(2.1e6, "diverged"), (1.9e6, "not-converged")])
def test_a_stop_after_great_growth_is_a_divergence(size, status):
    """From a state of size 1: the limit is a million times one plus that size."""
    t = Trajectory(MOVED, [0.0], [1.0], 0.5, 10, 1, "double")
    t.advance(Kernel(end=1, worth=size), Pace(None, 1))
    t._explain_stop(solve.STALLED)
    assert t.status == status


def test_a_timeout_keeps_the_state_reached():
    t = ran(Kernel(slept=0.02), steps=10**6, timeout=0.01)
    assert (t.status, t.reached, "after step 64 of 1000000 (t = 32)" in t.reason) == ("timeout", 64, True)
    assert t.seconds >= 0.02
    assert ran(Kernel(slept=0.02), steps=64, timeout=0.01).status == "ok", "it is at its end"


@pytest.mark.parametrize(("missing", "status", "noted"), [(0.0, "ok", 0), (0.1, "ok", 100), (0.2, "no-root", 200)])
def test_steps_without_a_root_are_reported(missing, status, noted):
    t = ran(Kernel(missing=missing), steps=1000, missed="lack a root")
    assert t.status == status
    assert t.reason.startswith(f"{noted} of 1000 steps lack a root" if noted else "")
    assert bool(t.reason) == bool(noted)
    assert ran(Kernel(missing=missing), steps=1000).reason == "", "nothing is promised"


@pytest.mark.parametrize(
    ("missing", "steps", "reached"),
    [(1.0, 5000, trajectory.FIRST), (0.96, 5000, trajectory.FIRST), (0.94, 5000, 5000), (1.0, 900, 900)],
)
def test_a_run_that_hardly_ever_has_a_root_is_stopped(missing, steps, reached):
    t = ran(Kernel(missing=missing), steps=steps, missed="lack a root", piece=trajectory.FIRST)
    assert (t.status, t.reached) == ("no-root", reached)


# -- extreme inputs, and the words of the reason expected of each ------------------------------------------------------


HARMONIC, PENDULUM, LOTKA = problem("harmonic-oscillator"), problem("pendulum"), problem("lotka-volterra")
KEPLER, CIRCLE = problem("kepler"), problem("kepler", e=0.0)
CLOSE = problem("kepler", e=0.9999)
CHAOTIC = problem("henon-heiles:chaotic")
FALL = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=())  # declared without singularity
FOUND = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q")  # the same, with its singularity found in the formula
RUNAWAY = Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
INVALID = "invalid"


def at(q, p, **options):
    """Options of `integrate` with the initial state (q, p) of one degree of freedom."""
    return options | {"q0": [q], "p0": [p]}


ESCAPE = {"q0": [0.0, 1.2], "p0": [0.0, 0.5]}
REST = {"q0": [1.0, 0.0], "p0": [0.0, 0.0]}
#: (problem, method, options, status, words of the reason)
TABLE = [
    (HARMONIC, "stormer-verlet", {"h": 2.1, "t_end": 1000, "save_every": 0}, "unstable", "from t = 1000"),
    (HARMONIC, "stormer-verlet", {"h": 2.1, "steps": 10**6, "save_every": 0}, "diverged", "no longer finite"),
    (HARMONIC, "stormer-verlet", {"h": 1.99, "t_end": 1000}, "inaccurate", "comes and goes"),
    (HARMONIC, "stormer-verlet", {"steps": 1, "t_end": 2.8}, "inaccurate", "not the orbit"),
    (HARMONIC, "implicit-euler", {"h": 0.1, "t_end": 100}, "inaccurate", "from t = 5 on"),
    (HARMONIC, "implicit-midpoint", {"h": 1e3, "steps": 1000}, "ok", ""),
    (PENDULUM, "implicit-midpoint", {"h": 1e3, "steps": 100}, "unstable", "not the orbit"),
    (KEPLER, "stormer-verlet", {"h": 0.01, "t_end": -5} | REST, "collision", "head-on"),
    (HARMONIC, "stormer-verlet", at(1e150, 0.0, h=0.1, steps=100), "ok", ""),
    (HARMONIC, "stormer-verlet", at(0.0, -1e-151, h=0.1, steps=100), INVALID, "choose units"),
    (LOTKA, "explicit-euler", {"h": 1.5, "steps": 1000}, "diverged", "outside H's domain after step 0"),
    (ROOT, "stormer-verlet", at(1.0, 0.0, h=0.1, steps=100), "diverged", "after step 18"),
    (PENDULUM, "implicit-midpoint", at(pi - 1e-12, 0.0, h=0.01, steps=5000), "ok", ""),
    (CIRCLE, "scheme-iv", {"h": 0.1, "steps": 10**7, "save_every": 0}, "no-root", "of the first 1000 steps"),
    (FALL, "stormer-verlet", at(1.0, 0.0, h=0.01, t_end=10), "inaccurate", "from t = 1.12 on"),
    (FOUND, "stormer-verlet", at(1.0, 0.0, h=0.01, t_end=10), "collision", "head-on after t = 1.11"),
    (CLOSE, "stormer-verlet", {"h": 0.01, "t_end": 20}, "collision", "singularity"),
    (KEPLER, "stormer-verlet", {"h": 0.01, "t_end": 5} | REST, "collision", "head-on"),
    (KEPLER, "explicit-euler", {"h": 0.01, "t_end": 100, "save_every": 0}, "inaccurate", "not the orbit"),
    (CHAOTIC, "stormer-verlet", {"h": 0.01, "t_end": 100} | ESCAPE, "diverged", "the motion itself may escape"),
    (problem("klein-gordon"), "explicit-euler", {"h": 20.0, "steps": 200}, "diverged", "no longer finite"),
    (RUNAWAY, "implicit-midpoint", at(1.0, 1.0, h=0.01, t_end=10), "not-converged", "after step 7"),
    (PENDULUM, "scheme-i", {"h": 1e-6, "steps": 10**9, "save_every": 10**6, "timeout": 0.05}, "timeout", "reached"),
]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(("made", "method", "options", "status", "words"), TABLE)
def test_an_extreme_input_has_its_status(made, method, options, status, words):
    if status == INVALID:
        with pytest.raises(InvalidInput) as refused:
            integrate(made, method, **options)
        assert words in str(refused.value)
        return
    s = integrate(made, method, **options)
    assert (s.status, words in s.reason) == (status, True), s.reason
    assert (s.reason == "") == (words == "")
    assert np.isfinite([s.q, s.p]).all()
    assert len(s.t) == len(s.q) == len(s.p) == len(s.parameter) + 1
    assert s.t[-1] == pytest.approx(s.t[0] + s.counts["steps"] * s.h)
    if status == "timeout":
        assert s.t[-1] > 0


if __name__ == "__main__":
    print(json.dumps({"result": accurate()}))
