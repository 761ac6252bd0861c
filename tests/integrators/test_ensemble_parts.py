"""Parts of an ensemble: which orbits go in SIMD lanes, threads, the calls of kernels, progress."""

from __future__ import annotations

import os
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import (
    Hamiltonian,
    batches,
    ensemble,
    integrate,
    integrate_ensemble,
    prepare,
    scalar_fallback,
    section,
    trajectory,
)
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.outcome import describe_crossing
from phasebench.integrators.registry import BY_ID, method
from phasebench.integrators.systems.hamiltonian import PartitionedSystem
from support.marks import compiled

OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")
ROOT = Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")
NO_ENERGY = PartitionedSystem(q="q", p="p", dq=["p"], dp=["-q"])


def of(n, system=OSCILLATOR, id="stormer-verlet", **options):
    """The ensemble of n orbits of a system from q = 1, 2, ..., n, p = 0."""
    Q = np.arange(1.0, n + 1)[:, None]
    return integrate_ensemble(system, id, Q, 0 * Q, **{"h": 0.1, "steps": 3} | options)


# -- lanes ------------------------------------------------------------------------------------------------------------


def test_orbits_go_in_lanes_if_enough_or_if_requested(monkeypatch):
    monkeypatch.setattr(batches, "runs_in_lanes", lambda system, record: record.id == "stormer-verlet")
    orbits = ensemble.begin(OSCILLATOR, "stormer-verlet", np.ones((9, 1)), np.ones((9, 1)), 0.1, None, 3, None, 0)
    for asked, enough, expected in (
        (None, 9, True),
        (None, 10, False),
        (True, 10, True),
        (False, 9, False),
        (False, 1, False),
    ):
        monkeypatch.setattr(batches, "ENOUGH", enough)
        wide = ensemble._goes_in_lanes(orbits, np.arange(9), asked)
        assert wide.tolist() == [expected] * 9, (asked, enough)
    other = ensemble.begin(OSCILLATOR, "rk4", np.ones((9, 1)), np.ones((9, 1)), 0.1, None, 3, None, 0)
    assert not ensemble._goes_in_lanes(other, np.arange(9), None).any()
    with pytest.raises(InvalidInput, match="'rk4' does not run in lanes"):
        ensemble._goes_in_lanes(other, np.arange(9), True)


@pytest.mark.parametrize(("steps", "every"), [(10, 1), (23, 2), (23, 7), (10, 10), (4, 4), (1, 1), (15, 5), (12, 6)])
@pytest.mark.parametrize("most", [1, 4, 5, 1000])
def test_a_batch_is_computed_in_the_pieces_of_a_trajectory(monkeypatch, steps, every, most):
    for module in (batches, trajectory):
        monkeypatch.setattr(module, "PIECE", most)
    calls = []

    class Kernel:
        counts = np.rec.array([(0,)], dtype=[("fallbacks", int)])[0]

        def __call__(self, Q, P, parameter, every):
            calls.append((len(Q), every))
            Q[:], P[:] = 1.0, 0.0
            return len(Q), 0

    t = trajectory.Trajectory(OSCILLATOR, [1.0], [0.0], 0.1, steps, every, "double")
    while t:
        t.advance(Kernel(), trajectory.Pace(None, most))
    made = list(batches.pieces(steps, every))
    assert [(rows, size) for _, rows, size in made] == calls
    assert sum(rows * size for _, rows, size in made) == steps
    firsts = [first for first, _, _ in made]
    assert firsts == sorted(firsts)
    assert firsts[0] == 0
    assert firsts[-1] + made[-1][1] == -(-steps // every)


def test_no_call_follows_the_last_step():
    """Ten rows of a million steps each take fifty calls of the kernel; no empty call follows the last step."""
    assert len(list(batches.pieces(10**7, 10**6))) == 50
    assert list(batches.pieces(2, 3)) == [(0, 1, 2)]


def test_orbits_that_ended_badly_are_redone():
    n = np.arange(4)
    Q, P = np.ones((4, 3, 1)), np.zeros((4, 3, 1))
    Q[1, 1], P[2, 2], Q[3, 2] = np.nan, np.inf, 2.0
    state = (
        np.ones((4, 1)),
        np.zeros((4, 1)),
        np.full(4, 0.1),
        np.full(4, 2),
        np.ones(4, int),
        [method("rk4")],
        0 * n,
        3,
    )
    for system, doubtful in ((OSCILLATOR, [1, 2, 3]), (NO_ENERGY, [1, 2])):
        orbits = batches.Orbits.create(system, *state)
        orbits.Q, orbits.P = Q, P
        assert batches.find_doubtful(orbits, n).tolist() == doubtful
        assert batches.find_doubtful(orbits, n[2:]).tolist() == [i for i in doubtful if i >= 2]
    assert batches.find_doubtful(orbits, n[:0]).tolist() == []


def test_orbits_near_a_singularity_are_redone():
    well = Hamiltonian(q="q", p="p", H="p**2/2 - 1/q", singular=["q"])
    Q = np.array([[[1.0], [0.5]], [[1.0], [0.01]]])
    P = np.sqrt(2 / Q)
    state = (Q[:, 0], P[:, 0], np.full(2, 0.01), np.ones(2, int), np.ones(2, int), [method("rk4")], np.zeros(2, int), 2)
    orbits = batches.Orbits.create(well, *state)
    orbits.Q, orbits.P = Q, P
    assert batches.find_doubtful(orbits, np.arange(2)).tolist() == [1]
    orbits.h[:] = 1e-5
    assert batches.find_doubtful(orbits, np.arange(2)).tolist() == []


def test_encounters_that_lose_energy_are_redone():
    """Four orbits pass a singularity nearer than one step. Two lose energy there, one lost it before.

    The loss is relative to the first row; the last orbit has more energy in its second row.
    """
    plane = Hamiltonian(q="x y", p="u v", H="u**2/2 + v**2/2 - 1/sqrt(x**2 + y**2)", singular=["sqrt(x**2 + y**2)"])
    Q = np.zeros((4, 4, 2))
    Q[:, :, 0] = (2.0, 1.0, 0.5, 2.0)
    P = np.zeros((4, 4, 2))
    P[:, :, 1] = np.sqrt(2 / Q[:, :, 0] - 0.2)  # so that H = -0.1
    P[0, 3, 1] = np.sqrt(2 / 2.0 - 0.2 + 0.04)
    P[1, 1, 1] = np.sqrt(2 / 1.0 - 0.2 + 0.04)
    P[3, 1, 1], P[3, 3, 1] = np.sqrt(2 / 1.0 - 0.5), P[0, 3, 1]
    h, whole = np.full(4, 0.3), np.ones(4, int)
    orbits = batches.Orbits.create(plane, Q[:, 0], P[:, 0], h, 3 * whole, whole, [method("rk4")], 0 * whole, 4)
    orbits.Q, orbits.P = Q, P
    assert batches.find_doubtful(orbits, np.arange(4)).tolist() == [0, 3]
    for i in range(4):
        said = describe_crossing(plane, 0.3 * np.arange(4), Q[i], P[i], 0.3)
        assert (said is not None) == (i in (0, 3)), "what `integrate` would say"
    assert batches.find_doubtful(orbits, np.array([1, 2])).tolist() == []
    orbits.h[:] = 0.1
    assert batches.find_doubtful(orbits, np.arange(4)).tolist() == []


# -- orbits one by one ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("piece", [2, 1000])
@pytest.mark.parametrize("threads", [1, 2])
def test_orbits_one_by_one_equal_those_of_integrate(monkeypatch, piece, threads):
    """Orbits that stop early, and all of methods that may miss what they promise, are left to `integrate`."""
    for module in (batches, trajectory):
        monkeypatch.setattr(module, "PIECE", piece)
    kinds = [method("implicit-midpoint"), method("rk4"), method("rk4-relaxation")]
    kind = np.array([0, 1, 0, 0, 2, 1])
    q, h = np.array([[0.1], [0.2], [5.0], [0.4], [0.5], [0.6]]), np.array([0.1, 0.2, 0.3, 0.05, 0.1, 0.15])
    steps, every = np.full(6, 7), np.full(6, 3)
    cliff = Hamiltonian(q="q", p="p", H="p**2/2 - exp(q)")  # a step from q = 5 has no solution
    orbits = batches.Orbits.create(cliff, q, 0 * q, h, steps, every, kinds, kind, 4)
    told = []
    assert sorted(scalar_fallback.run(orbits, np.arange(5), threads, told.append).tolist()) == [2, 4]
    assert sum(told) == 3
    assert orbits.filled[[0, 1, 3]].tolist() == [4] * 3
    assert orbits.filled[[2, 4, 5]].tolist() == [1] * 3
    assert np.isnan(orbits.Q[[4, 5], 1:]).all(), "nobody touched them"
    alone = {i: integrate(cliff, kinds[kind[i]], h=h[i], steps=7, save_every=3, q0=q[i], p0=[0.0]) for i in (0, 1, 3)}
    for i, s in alone.items():
        assert np.array_equal(orbits.Q[i], s.q)
        assert np.array_equal(orbits.P[i], s.p)
    assert orbits.counts == {name: sum(s.counts[name] for s in alone.values()) for name in orbits.counts}
    assert orbits.counts["gradient"] > orbits.counts["steps"] == 21


# -- progress and status ----------------------------------------------------------------------------------------------


def test_progress_reports_the_running_total():
    """Only increments are added and reported."""
    told = []
    tell = ensemble._Progress(told.append)
    for more in (0, 2, 3, -1, 0, 1):
        tell(more)
    assert told == [2, 5, 5]
    assert ensemble._Progress(None)(1) is None


def test_the_number_of_threads(monkeypatch):
    assert ensemble._threads(1) == 1
    assert ensemble._threads(None) == ensemble.cores() >= 1
    for wrong in (0, -1, 1.0, True, "2"):
        with pytest.raises(InvalidInput, match="threads is"):
            ensemble._threads(wrong)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    for known, cores in ((3, 3), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda known=known: known)
        assert ensemble.cores() == cores


def test_ends_and_times_equal_those_of_integrate():
    for lanes in (False, None):
        found = of(2, lanes=lanes, save_every=2)
        for i in range(2):
            s = integrate(OSCILLATOR, "stormer-verlet", h=0.1, steps=3, save_every=2, q0=[i + 1], p0=[0])
            assert np.array_equal(found.Q[i], s.q)
            assert np.array_equal(found.times[i], s.t)
            assert found.t[i] == s.t[-1]
        assert found.counts["steps"] == 6
        assert len(found) == 2


def test_an_initial_state_outside_the_domain_is_invalid():
    Q = np.array([[1.0], [-1.0], [np.nan], [2.0]])
    found = integrate_ensemble(ROOT, "stormer-verlet", Q, 0 * Q + 1, h=0.1, steps=2)
    assert found.status.tolist() == ["ok", "invalid", "invalid", "ok"]
    assert "the energy of the initial state is nan" in found.reason[1]
    assert "every component" in found.reason[2]
    assert found.t.tolist() == pytest.approx([0.2, 0, 0, 0.2])
    assert integrate_ensemble(NO_ENERGY, "rk4", [[1.0]], [[0.0]], h=0.1, steps=2).status.tolist() == ["ok"]


def test_a_method_that_does_not_fit_the_system_is_refused():
    with pytest.raises(InvalidInput, match="'gautschi' requires a system with the trait"):
        of(2, id="gautschi")
    with pytest.raises(InvalidInput, match="'scheme-i' requires a system with the trait 'canonical'"):
        of(batches.ENOUGH, id="scheme-i", system=problem("lotka-volterra").system)


# -- names and records ------------------------------------------------------------------------------------------------


def test_a_record_may_be_passed_for_its_id():
    record = BY_ID["scheme-i"]
    assert method(record) is record
    assert method(record, lam=3) == method("scheme-i", lam=3) != record


def test_whole_numbers_of_any_type_are_shown_as_integers():
    for value in (2, 2.0, np.float64(2), "2", Fraction(4, 2)):
        assert method("scheme-i", lam=value).label == "scheme-i(lam=2)"
    assert method("scheme-i", lam=0.1).label == "scheme-i(lam=0.1)"


def test_an_unknown_parameter_lists_the_known_ones():
    for id, words in (("scheme-i", "it has lam$"), ("rk4", "it has none$"), ("generating-function", "it has .*, ")):
        with pytest.raises(InvalidInput, match=words):
            method(id, mu=1)


def test_at_most_twenty_names_are_listed():
    names = [f"n{k:02}" for k in range(23)]
    for known, more in ((20, ""), (21, " and 1 more "), (23, " and 3 more ")):
        said = str(unknown_name("number", "qqqqqq", names[:known]))
        assert said.count(", n") == 19
        assert more in said
        assert (" more " in said) == bool(more)


# -- sections ---------------------------------------------------------------------------------------------------------


def crossings(x, v=None, at=0.0, sign=1.0):
    """(times, momenta) at which a free motion with rows x at the times 0, 1, ... crosses the plane q = at."""
    x = np.array(x, dtype=float)
    v = np.gradient(x) if v is None else np.array(v, dtype=float)
    free, steps = Hamiltonian(q="q", p="p", H="p**2/2"), len(x) - 1
    asked = ensemble.request(free, "rk4", [x[:1]], [v[:1]], 1.0, None, steps, None, 1)
    orbits = section.prepare_orbits(asked, 0, at, sign > 0)
    q, p = (np.ascontiguousarray(y[None, 1:, None, None]) for y in (x, v))
    search = section.Search(orbits, np.zeros(1, int), 1)
    for first in range(0, steps, 2):  # in pieces of two rows
        search(first, *(np.ascontiguousarray(y[:, first : first + 2]) for y in (q, p)))
    made = section.build_section(orbits, 0.0)
    assert (made.q == at).all()
    assert len(made.orbit) == len(made.t) == len(made.p)
    return made.t.tolist(), made.p[:, 0].tolist()


def test_a_row_on_the_plane_is_one_crossing():
    assert crossings([-2, -1, 0, 1, 2])[0] == pytest.approx([2])
    assert crossings([2, 1, 0, -1], sign=-1.0)[0] == pytest.approx([2])
    assert crossings([2, 1, 0, -1]) == ([], [])
    assert crossings([0, 1, 2]) == ([], []), "it begins there"
    assert crossings([-1, np.nan, 1]) == ([], []), "it has stopped"


def test_a_crossing_is_computed_from_the_nearer_row():
    """The free motion has a jump of its momentum between two rows."""
    assert crossings([-3, -0.5, 2, 4.5], v=[5, 2, 3, 3]) == (pytest.approx([1.25]), pytest.approx([2]))
    assert crossings([-4.5, -2, 0.5, 3], v=[3, 2, 4, 3]) == (pytest.approx([1.875]), pytest.approx([4]))
    assert crossings([-3, -0.5, 2, 4.5], v=[5, 2, 3, 3], at=-1.0)[0] == pytest.approx([0.75])


def test_a_section_checks_every_step():
    asked = {"of": "q", "h": 0.5, "t_end": 60.0}
    found, again, seldom = (
        section.section(OSCILLATOR, "rk4", [[1.0]], [[0.0]], **asked | more)
        for more in ({}, {"every": 1}, {"every": 7})
    )
    assert np.array_equal(found.t, again.t)
    named = section.section(problem=OSCILLATOR, method="rk4", Q=[[1.0]], P=[[0.0]], **asked)
    assert np.array_equal(found.t, named.t)
    assert len(found.t) == 9
    assert len(seldom.t) < 9


# -- prepared runs ----------------------------------------------------------------------------------------------------


def test_a_prepared_run_takes_q0_or_p0_or_both():
    made = problem("pendulum")
    run = prepare(made, "stormer-verlet")
    for start in ({"q0": [0.3]}, {"p0": [0.7]}, {"q0": [0.3], "p0": [0.7]}, {}):
        *end, code = run(0.1, 4, **start)
        s = integrate(made, "stormer-verlet", h=0.1, steps=4, **start)
        assert (code, *np.array(end)[:, 0]) == (run.SOLVED, s.q[-1, 0], s.p[-1, 0]), start


#: Two uncoupled degrees of freedom, one of which escapes in finite time.
APART = Hamiltonian(q="x y", p="u v", H="(u**2 + v**2)/2 + x**2/2 - y**4")


@pytest.mark.parametrize("away", [0, 1])
def test_an_end_with_an_infinite_part_is_reported(away):
    run = prepare(APART, "stormer-verlet", q0=[0.5, 0.0], p0=[0.0, 0.0])
    q, p, code = run(0.1, 100, q0=[0.5, away])
    assert code == (run.NOT_FINITE if away else run.SOLVED)
    assert np.isfinite([q[0], p[0]]).all()
    assert np.isfinite([q[1], p[1]]).all() == (not away)


@compiled
def test_packed_memory_is_released_once():
    run = prepare(problem("pendulum"), "stormer-verlet")
    packed, released, functions = [1], [], run._functions

    def pack(*arguments):
        packed.append(1)
        functions.pack(*arguments)

    def release(address):
        released.append(1)
        functions.release(address)

    run._functions = SimpleNamespace(run=functions.run, pack=pack, release=release)
    run._pack()
    assert (len(packed), len(released)) == (2, 1)
    run.__del__()
    run.__del__()
    assert len(released) == 2
