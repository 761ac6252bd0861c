"""Ensembles: each orbit equals that of `integrate`, a failure affects its own orbit only; sections of their orbits."""

import signal
import threading
import time
import tracemalloc
from functools import partial

import numpy as np
import pytest
from llvmlite import binding
from llvmlite.binding import ffi

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, batches, driver, trajectory
from phasebench.integrators import section as sections
from phasebench.integrators.crossings import GROWTH
from phasebench.integrators.driver import COLLISION, DIVERGED, INVALID, OK, integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import method
from phasebench.integrators.section import section
from phasebench.integrators.stepping import orbit_lanes
from phasebench.integrators.stepping.orbit_lanes import LANES
from phasebench.integrators.systems.hamiltonian import PartitionedSystem

#: One more than a block of lanes, so that the last block is incomplete.
N = LANES.n + 1
BOX = "henon-heiles:box"
OSCILLATOR = Hamiltonian(q="q", p="p", H="p**2/2 + q**2/2")


def starts(name, n=N, spread=0.02):
    """(problem, Q, P) with n initial states around the problem's own."""
    made, random = problem(name), np.random.default_rng(0)
    Q, P = (np.array(x) + spread * random.uniform(-1, 1, (n, made.system.d)) for x in (made.q0, made.p0))
    return made, Q, P


def check(made, id, Q, P, orbits=None, parameters=None, **options):
    """Assert that orbits of an ensemble have rows, end, status and, if all are looked at, counts of `integrate` alone.

    Returns the ensemble and the solutions.
    """
    found, alone = integrate_ensemble(made, id, Q, P, parameters=parameters, **options), []
    for i in range(len(Q)) if orbits is None else orbits:
        mine = {k: v[i] if np.ndim(v) else v for k, v in options.items() if k not in ("lanes", "threads")}
        values = {k: v[i] if np.ndim(v) else v for k, v in (parameters or {}).items()} or None
        s = integrate(made, id, q0=Q[i], p0=P[i], parameters=values, **{"save_every": 0} | mine)
        alone.append(s)
        for rows, wanted in ((found.Q[i], s.q), (found.P[i], s.p)):
            np.testing.assert_array_equal(rows[: len(wanted)], wanted)
            assert np.isnan(rows[len(wanted) :]).all()
        np.testing.assert_array_equal(found.times[i][: len(s.t)], s.t)
        np.testing.assert_array_equal(found.q[i], s.q[-1])
        assert (found.t[i], found.status[i], found.reason[i]) == (s.t[-1], s.status, s.reason)
    if orbits is None and set(found.status) == {OK}:
        for kind in ("steps", "gradient", "iterations", "hessian", "newton"):
            assert found.counts[kind] == sum(s.counts[kind] for s in alone), kind
    return found, alone


CASES = [
    (BOX, "stormer-verlet", None),
    (BOX, "scheme-iii", {"lam": 1 / 3}),
    ("kepler", "scheme-i", {"lam": 0.3}),
    ("lotka-volterra", "implicit-midpoint", None),
    (BOX, "rk4", None),
    ("kepler", "sofroniou-spaletta-10-adaptive", None),
]


@pytest.mark.processor
@pytest.mark.parametrize(("name", "id", "parameters"), CASES)
def test_a_lane_equals_the_scalar_kernel_bit_by_bit(name, id, parameters):
    made, Q, P = starts(name)
    found, _ = check(made, id, Q, P, None, parameters, h=0.05, steps=205, save_every=50)
    assert found.in_lanes.all()


def test_functions_without_lanes_are_called_one_by_one():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + (q**2 + 1)**1.3 - log(q**2 + 2) + tan(q/4)")
    Q = np.linspace(-1, 1, 2 * LANES.n)[:, None]
    assert check(system, "stormer-verlet", Q, 0 * Q, h=0.05, steps=100)[0].in_lanes.all()


@pytest.mark.parametrize("lanes", [None, False])
def test_every_orbit_has_its_own_step_and_lambda(lanes):
    h, lam = 1 / np.linspace(5, 100, N).round(), np.linspace(0.1, 0.9, N)
    made, Q, P = starts(BOX)
    found, _ = check(made, "scheme-i", Q, P, parameters={"lam": lam}, h=h, t_end=1.0, lanes=lanes)
    assert found.in_lanes.all() == (lanes is None)
    np.testing.assert_allclose(found.t, 1.0, rtol=1e-12)


@pytest.mark.parametrize(("steps", "every"), [(57, 7), (57, 25), (60, 1)])
def test_rows_are_computed_in_the_pieces_of_the_driver(monkeypatch, steps, every):
    """Kicks at the ends of a piece are split, which rounds differently; ensemble and driver must split alike."""
    for module in (driver, trajectory, batches):
        monkeypatch.setattr(module, "PIECE", 10)
    made, Q, P = starts(BOX)
    found, _ = check(made, "stormer-verlet", Q, P, (0, N - 1), h=0.1, steps=steps, save_every=every)
    assert found.in_lanes.all(), "none had to be integrated again"


@pytest.mark.parametrize("id", ["avf", "dop853-relaxation"])
def test_stopped_orbits_have_the_status_of_integrate(id):
    """One orbit escapes, one starts where no step can be solved."""
    made, Q, P = starts(BOX, 4)
    Q[1], P[2] = (3.0, -3.0), (1e80, 1e80)
    found, _ = check(made, id, Q, P, h=0.1, steps=300, save_every=70, lanes=False)
    assert found.status[0] == OK != found.status[2]


@pytest.mark.processor
def test_a_failure_affects_its_own_orbit_only():
    n = max(N, 8)  # more than one block, however few lanes a register holds
    made, Q, P = starts(BOX, n)
    Q[1], P[3, 0], Q[5], Q[6] = np.nan, np.inf, (30.0, 30.0), (3.0, 3.0)
    found, _ = check(made, "stormer-verlet", Q, P, (0, 5, 6, n - 1), h=0.1, steps=100, save_every=1)
    expected = {1: INVALID, 3: INVALID, 5: DIVERGED, 6: DIVERGED}
    assert found.status.tolist() == [expected.get(i, OK) for i in range(n)]
    assert np.isfinite(found.q[[5, 6]]).all()  # the last finite row


def test_a_collision_is_detected_in_lanes():
    made, Q, P = starts("kepler", N, 1e-3)
    Q[2], P[2] = (1.0, 0.0), (-0.5, 0.0)
    found, _ = check(made, "stormer-verlet", Q, P, (2,), h=0.05, steps=100, save_every=1)
    assert found.status.tolist() == [COLLISION if i == 2 else OK for i in range(N)]


def test_lanes_wait_for_the_orbit_with_most_steps():
    """Neither states nor counts depend on the neighbours; every second orbit is far out and takes few steps."""
    made, Q, P = starts("kepler", N, 1e-3)
    Q[1::2], P[1::2] = 9 * Q[1::2], P[1::2] / 3
    found, alone = check(made, "sofroniou-spaletta-10-adaptive", Q, P, h=0.3, steps=40, save_every=20)
    assert found.in_lanes.all()
    assert alone[0].counts["gradient"] > 5 * alone[1].counts["gradient"]


def test_a_lane_that_does_not_contract_is_solved_alone():
    h = np.full(N, 0.1)
    h[[2, N - 1]] = 4.0  # needs Newton's method
    made, Q, P = starts("pendulum")
    found, alone = check(made, "implicit-midpoint", Q, P, (2, N - 1), h=h, steps=10)
    assert found.counts["newton"] == sum(s.counts["newton"] for s in alone) > 0
    assert found.in_lanes.tolist() == [i not in (2, N - 1) for i in range(N)]


def test_an_initial_state_outside_the_domain_is_invalid():
    Q, root = np.array([[1.0], [-1.0], [np.nan], [2.0]]), Hamiltonian(q="q", p="p", H="p**2/2 + sqrt(q)")
    found = integrate_ensemble(root, "stormer-verlet", Q, 0 * Q + 1, h=0.1, steps=2)
    assert found.status.tolist() == ["ok", "invalid", "invalid", "ok"]
    assert found.t.tolist() == pytest.approx([0.2, 0, 0, 0.2])
    free = PartitionedSystem(q="q", p="p", dq=["p"], dp=["-q"])
    assert integrate_ensemble(free, "rk4", [[1.0]], [[0.0]], h=0.1, steps=2).status.tolist() == ["ok"]


def test_orbits_go_in_lanes_if_they_can_and_are_enough():
    for n, lanes, expected in ((batches.ENOUGH, None, True), (batches.ENOUGH - 1, None, False), (1, True, True)):
        Q = np.ones((n, 1))
        assert integrate_ensemble(OSCILLATOR, "rk4", Q, Q, h=0.1, steps=1, lanes=lanes).in_lanes.all() == expected
    small = Hamiltonian(q="x y", p="u v", H="u**2/2 + v**2/2 + x**2*y**2 + x**2 + y**2")
    laned = ("stormer-verlet", "scheme-i", "rk4", "sofroniou-spaletta-10-adaptive")
    for id in (*laned, "gauss-2", "avf", "gauss-4-adaptive"):
        assert orbit_lanes.runs_in_lanes(small, method(id)) == (id in laned)


def test_kernels_release_the_interpreter_lock():
    one_call = driver.warm(problem(BOX), "stormer-verlet", h=0.01, steps=20_000_000)
    thread = threading.Thread(target=one_call)
    thread.start()
    turns = 0
    while thread.is_alive():
        time.sleep(1e-3)
        turns += 1
    assert turns > 20  # with the lock held it would be two or three


def test_progress_ends_at_the_number_of_orbits():
    made, Q, P = starts(BOX, 3 * N)
    Q[4] = np.nan
    told = []
    integrate_ensemble(made, "stormer-verlet", Q, P, h=0.1, steps=5, progress=told.append)
    assert (told[-1], told) == (3 * N, sorted(told))


BAD = [
    ({"Q": [[0.0]]}, r"Q has the shape \(1, 1\)"),
    ({"P": np.zeros((3, 2))}, f"Q has {N} rows and P has 3"),
    ({"Q": "many"}, "Q must be numbers"),
    ({"Q": np.zeros((0, 2)), "P": np.zeros((0, 2))}, r"Q has the shape \(0, 2\)"),
    ({"h": [0.1, 0.1]}, "h has the shape"),
    ({"h": np.linspace(0, 0.1, N)}, "h is 0; it must be another number"),
    ({"h": 1 / np.arange(10, 10 + N), "steps": None, "t_end": 1.0, "save_every": 1}, "different numbers of steps"),
    ({"parameters": {"mu": 1.0}}, "no parameter 'mu'"),
    ({"parameters": {"lam": np.zeros(3)}}, r"the parameter lam has the shape \(3,\)"),
    ({"threads": 0}, "threads is 0"),
    ({"method": "avf", "parameters": None, "lanes": True}, "'avf' does not run in lanes"),
]


@pytest.mark.parametrize(("changed", "message"), BAD)
def test_invalid_arguments_are_refused(changed, message):
    made, Q, P = starts(BOX)
    good = {"problem": made, "method": "scheme-i", "Q": Q, "P": P, "h": 0.1, "steps": 2, "parameters": {"lam": 0.3}}
    with pytest.raises(InvalidInput, match=message):
        integrate_ensemble(**good | changed)


@pytest.mark.parametrize(("id", "n", "lanes"), [("stormer-verlet", 1000, True), ("gauss-6", 100, False)])
def test_a_warm_ensemble_does_not_ask_llvm(id, n, lanes):
    """An interrupt may leave LLVM's lock closed, at which the helpers of the next ensemble would wait for ever."""
    made, asked = problem(BOX), []
    q, p = (np.tile(x, (n, 1)) for x in (made.q0, made.p0))
    run = partial(integrate_ensemble, made, id, q, p, h=1e-3, steps=200, lanes=lanes, threads=2)
    run()
    callbacks = (lambda: asked.append(1)), (lambda: None)
    ffi.register_lock_callback(*callbacks)
    try:
        run()
        assert not asked
        binding.get_host_cpu_name()
        assert asked, "the control"
    finally:
        ffi.unregister_lock_callback(*callbacks)


# Of Scheme V, whose steps may fall back, orbits run one by one.
@pytest.mark.parametrize(
    ("id", "n", "lanes"), [("stormer-verlet", 50_000, True), ("gauss-6", 2000, False), ("scheme-v", 200, False)]
)
def test_an_ensemble_of_years_is_interrupted(id, n, lanes):
    """Its orbits are whole in the next run."""
    made = problem(BOX)
    q, p = (np.tile(x, (n, 1)) for x in (made.q0, made.p0))
    run = partial(integrate_ensemble, made, id, q, p, h=1e-3, lanes=lanes, threads=2)
    end = run(steps=20).q
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a test may have called a package that took it
    threading.Timer(0.3, signal.raise_signal, (signal.SIGINT,)).start()
    with pytest.raises(KeyboardInterrupt):
        run(steps=10**11)
    assert np.array_equal(run(steps=20).q, end)


# -- Poincare sections: every crossing of the plane is found once, at its place ----------------------------------------


def test_a_row_on_the_plane_is_one_crossing():
    free = Hamiltonian(q="q", p="p", H="p**2/2")
    for q, p, rising, times in (
        (-2.0, 1.0, True, [2]),
        (2.0, -1.0, False, [2]),
        (2.0, -1.0, True, []),
        (0.0, 1.0, True, []),
    ):
        found = section(free, "rk4", [[q]], [[p]], of="q", h=1.0, steps=4, rising=rising)
        assert found.t.tolist() == pytest.approx(times)


SPRING = Hamiltonian(q="x", p="v", H="v**2/2 + x**2/2")


def test_crossings_of_the_oscillator():
    r = np.array([1.0, 2.0])
    found = section(SPRING, "gauss-4", [[1.0], [0.0]], [[0.0], [2.0]], of="x", at=0.5, h=0.1, t_end=20.0)
    assert found.counts().tolist() == [3, 4]
    np.testing.assert_array_equal(found.q[:, 0], 0.5)
    np.testing.assert_allclose(found.p[:, 0], np.sqrt(r[found.orbit] ** 2 - 0.25), rtol=1e-9)
    turn = 2 * np.pi * np.array([1, 2, 3, 0, 1, 2, 3])
    np.testing.assert_allclose(found.t, turn + np.array([-np.pi / 3] * 3 + [np.arcsin(0.25)] * 4), rtol=1e-9)
    momentum = section(SPRING, "gauss-4", [[1.0]], [[0.0]], of="v", h=0.1, t_end=20.0)
    np.testing.assert_allclose(momentum.t, np.pi * (2 * np.arange(3) + 1), rtol=1e-9)


def test_a_stopped_orbit_keeps_its_crossings():
    made = problem("henon-heiles:box")
    Q, P = np.array([made.q0, (0.0, 1.5)]), np.array([made.p0, (0.5, 0.1)])
    found = section(made, "stormer-verlet", Q, P, of="q1", h=0.01, t_end=50.0)
    assert found.status.tolist() == [OK, DIVERGED]
    assert (found.counts() > 0).all()
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize(("changed", "message"), [({"of": "z"}, "none of the variables"), ({"every": 0}, "every")])
def test_invalid_arguments_of_a_section_are_refused(changed, message):
    with pytest.raises(InvalidInput, match=message):
        section(SPRING, "gauss-4", [[1.0]], [[0.0]], **{"of": "x", "h": 0.1, "steps": 1} | changed)


def box(n, **options):
    """The section of n Henon-Heiles orbits."""
    Q = np.column_stack([np.zeros(n), np.linspace(-0.3, 0.3, n)])
    P = np.column_stack([np.full(n, 0.3), np.linspace(0.1, -0.1, n)])
    options = {"of": "q1", "h": 0.1, "t_end": 200.0} | options
    return section(problem("henon-heiles"), options.pop("method", "pefrl"), Q, P, **options)


@pytest.mark.parametrize("method", ["pefrl", "gauss-4", "scheme-v"])
def test_crossings_do_not_depend_on_lanes_threads_or_pieces(monkeypatch, method):
    """In lanes, one by one, by `integrate` (Scheme V), and in calls of two rows or of many."""
    found = [box(20, method=method, threads=k) for k in (1, 2)]
    monkeypatch.setattr(sections, "ROOM", 1)
    monkeypatch.setattr(sections.SectionOrbits, "group", 8)
    found += [box(20, method=method, lanes=False), box(20, method=method)]
    assert len(found[0]) > 500
    assert (np.diff(found[0].orbit) >= 0).all()
    assert (np.diff(found[0].t)[np.diff(found[0].orbit) == 0] > 0).all()
    for other in found[1:]:
        np.testing.assert_array_equal(other.orbit, found[0].orbit)
        np.testing.assert_allclose(other.t, found[0].t, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.hstack([other.q, other.p]), np.hstack([found[0].q, found[0].p]), atol=1e-9)


def test_a_section_takes_little_memory(monkeypatch):
    """8 (2 d + 2) bytes per crossing plus fixed buffers; storing the rows would take 50 times as much."""
    box(20, t_end=10.0)
    bound = 8 * (sections.ROOM + 40 * sections.LOOKS) + 8 * 6 * GROWTH
    tracemalloc.start()
    found = box(20, t_end=20000.0, threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    m, d = len(found), 2
    assert m > 50_000
    assert sum(x.nbytes for x in (found.orbit, found.t, found.q, found.p)) == 8 * (2 * d + 2) * m
    assert peak < 8 * (2 * d + 3) * m + 4 * bound
    rows = 20 * 200_000 * 8 * (2 * d + 1)
    assert rows > 10 * peak


def test_a_collision_between_stored_rows_is_seen():
    """A fall passes the centre within one step; only checking every step shows it."""
    fall = problem("kepler").system
    found = section(
        fall, "stormer-verlet", [[1.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], of="q2", h=0.01, t_end=10
    )
    assert found.status.tolist() == [COLLISION, OK]
    assert found.counts().tolist() == [0, 1]
