"""Ensembles: each orbit equals that of `integrate`, in SIMD lanes or not; a failure affects its own orbit only."""

import signal
import threading
import time
from functools import partial

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, batches, driver, trajectory
from phasebench.integrators.driver import COLLISION, DIVERGED, INVALID, NOT_CONVERGED, OK, integrate
from phasebench.integrators.ensemble import integrate_ensemble
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.stepping.orbit_lanes import LANES

#: One more than a block of lanes, so that the last block is incomplete.
N = LANES.n + 1
BOX = "henon-heiles:box"


def starts(name, n=N, spread=0.02):
    """(problem, Q, P) with n initial states around the problem's own."""
    made, random = problem(name), np.random.default_rng(0)
    Q, P = (np.array(x) + spread * random.uniform(-1, 1, (n, made.system.d)) for x in (made.q0, made.p0))
    return made, Q, P


def alone(made, id, Q, P, i, parameters=None, **options):
    """The solution of `integrate` for the i-th orbit alone."""
    return integrate(made, id, q0=Q[i], p0=P[i], parameters=parameters, **options)


def assert_same(ensemble, i, solution):
    """Assert that the i-th orbit of an ensemble has the rows, end and status of a solution."""
    rows = len(solution.q)
    np.testing.assert_array_equal(ensemble.Q[i, :rows], solution.q)
    np.testing.assert_array_equal(ensemble.P[i, :rows], solution.p)
    assert np.isnan(ensemble.Q[i, rows:]).all()
    np.testing.assert_array_equal(ensemble.q[i], solution.q[-1])
    assert ensemble.t[i] == solution.t[-1]
    assert (ensemble.status[i], ensemble.reason[i]) == (solution.status, solution.reason)


CASES = [
    (BOX, "stormer-verlet", None),
    (BOX, "blanes-moan-s6", None),
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
    options = {"h": 0.05, "steps": 205, "save_every": 50, "parameters": parameters}
    ensemble = integrate_ensemble(made, id, Q, P, **options)
    assert ensemble.in_lanes.all()
    solutions = [alone(made, id, Q, P, i, **options) for i in range(N)]
    for i, solution in enumerate(solutions):
        assert_same(ensemble, i, solution)
    for kind in ("steps", "gradient", "iterations", "hessian", "newton"):
        assert ensemble.counts[kind] == sum(s.counts[kind] for s in solutions), kind


@pytest.mark.processor
@pytest.mark.parametrize("name", ["pendulum", "lotka-volterra-log"])
def test_lanes_have_their_own_elementary_functions(name):
    """Sine, cosine and exponential differ in the last places, which a regular motion does not amplify."""
    made, Q, P = starts(name)
    options = {"h": 0.05, "steps": 200, "save_every": 50}
    ensemble = integrate_ensemble(made, "stormer-verlet", Q, P, **options)
    assert ensemble.in_lanes.all()
    for i in range(N):
        solution = alone(made, "stormer-verlet", Q, P, i, **options)
        np.testing.assert_allclose(ensemble.Q[i], solution.q, rtol=0, atol=2e-13)
        np.testing.assert_allclose(ensemble.P[i], solution.p, rtol=0, atol=2e-13)


def test_functions_without_lanes_are_called_one_by_one():
    system = Hamiltonian(q="q", p="p", H="p**2/2 + (q**2 + 1)**1.3 - log(q**2 + 2) + tan(q/4)")
    Q, P = np.linspace(-1, 1, N)[:, None], np.zeros((N, 1))
    ensemble = integrate_ensemble(system, "stormer-verlet", Q, P, h=0.05, steps=100)
    assert ensemble.in_lanes.all()
    for i in (0, 3, N - 1):
        assert_same(ensemble, i, alone(system, "stormer-verlet", Q, P, i, h=0.05, steps=100, save_every=0))


def test_every_orbit_has_its_own_step_and_lambda():
    made, Q, P = starts(BOX)
    h, lam = 1 / np.linspace(5, 100, N).round(), np.linspace(0.1, 0.9, N)
    ensemble = integrate_ensemble(made, "scheme-i", Q, P, h=h, t_end=1.0, parameters={"lam": lam})
    assert ensemble.in_lanes.all()
    np.testing.assert_allclose(ensemble.t, 1.0, rtol=1e-12)
    for i in range(N):
        assert_same(ensemble, i, alone(made, "scheme-i", Q, P, i, {"lam": lam[i]}, h=h[i], t_end=1.0, save_every=0))


@pytest.mark.parametrize(("steps", "every"), [(57, 7), (57, 25), (57, 57), (60, 1), (45, 10)])
def test_rows_are_computed_in_the_pieces_of_the_driver(monkeypatch, steps, every):
    """Kicks at the ends of a piece are split, which rounds differently; ensemble and driver must split alike."""
    for module in (driver, trajectory, batches):
        monkeypatch.setattr(module, "PIECE", 10)
    made, Q, P = starts(BOX)
    options = {"h": 0.1, "steps": steps, "save_every": every}
    ensemble = integrate_ensemble(made, "stormer-verlet", Q, P, **options)
    assert ensemble.in_lanes.all(), "none had to be integrated again"
    for i in (0, N - 1):
        assert_same(ensemble, i, alone(made, "stormer-verlet", Q, P, i, **options))


def test_a_method_of_any_family_runs_on_threads():
    made, Q, P = starts("pendulum", 5)
    ensemble = integrate_ensemble(made, "avf", Q, P, h=0.1, steps=20, save_every=5, threads=2)
    assert not ensemble.in_lanes.any()
    solutions = [alone(made, "avf", Q, P, i, h=0.1, steps=20, save_every=5) for i in range(5)]
    for i, solution in enumerate(solutions):
        assert_same(ensemble, i, solution)
    assert ensemble.counts["iterations"] == sum(s.counts["iterations"] for s in solutions)


@pytest.mark.parametrize("id", ["avf", "scheme-v", "dop853-relaxation"])
def test_stopped_orbits_have_the_status_of_integrate(id):
    """One orbit escapes, one starts where no step can be solved; the others end as they would alone."""
    made, Q, P = starts(BOX, 4)
    Q[1], P[2] = (3.0, -3.0), (1e80, 1e80)
    options = {"h": 0.1, "steps": 300, "save_every": 70}
    ensemble = integrate_ensemble(made, id, Q, P, lanes=False, **options)
    solutions = [alone(made, id, Q, P, i, **options) for i in range(4)]
    assert solutions[0].status == OK != solutions[2].status
    for i, solution in enumerate(solutions):
        assert_same(ensemble, i, solution)


@pytest.mark.processor
def test_a_failure_affects_its_own_orbit_only():
    n = max(N, 8)  # more than one block, however few lanes a register holds
    made, Q, P = starts(BOX, n)
    Q[1], P[3, 0], Q[5], Q[6] = np.nan, np.inf, (30.0, 30.0), (3.0, 3.0)
    ensemble = integrate_ensemble(made, "stormer-verlet", Q, P, h=0.1, steps=100, save_every=1)
    expected = np.full(n, OK, dtype=object)
    expected[[1, 3]], expected[[5, 6]] = INVALID, DIVERGED
    assert ensemble.status.tolist() == expected.tolist()
    assert "finite" in ensemble.reason[1]
    assert np.isfinite(ensemble.q[[5, 6]]).all()  # the last finite row
    for i in (0, 5, 6, n - 1):
        assert_same(ensemble, i, alone(made, "stormer-verlet", Q, P, i, h=0.1, steps=100))


def test_a_collision_is_detected_in_lanes():
    made, Q, P = starts("kepler", N, 1e-3)
    Q[2], P[2] = (1.0, 0.0), (-0.5, 0.0)
    ensemble = integrate_ensemble(made, "stormer-verlet", Q, P, h=0.05, steps=100, save_every=1)
    assert ensemble.status[2] == COLLISION
    assert set(np.delete(ensemble.status, 2)) == {OK}
    assert_same(ensemble, 2, alone(made, "stormer-verlet", Q, P, 2, h=0.05, steps=100))


def test_an_orbit_that_loses_its_step_density_is_redone_alone():
    made, Q, P = starts("kepler", N, 1e-3)
    Q[2], P[2] = (1.0, 0.0), (0.0, 0.0)  # falls into the centre
    options = {"h": 0.1, "steps": 100, "save_every": 10}
    ensemble = integrate_ensemble(made, "stormer-verlet-adaptive", Q, P, **options)
    assert ensemble.status[2] == NOT_CONVERGED
    assert ensemble.in_lanes.tolist() == [i != 2 for i in range(N)]
    for i in (0, 2, N - 1):
        assert_same(ensemble, i, alone(made, "stormer-verlet-adaptive", Q, P, i, **options))


def test_lanes_wait_for_the_orbit_with_most_steps():
    """Neither states nor counts depend on the neighbours; every second orbit is far out and takes few steps."""
    made, Q, P = starts("kepler", N, 1e-3)
    Q[1::2], P[1::2] = 9 * Q[1::2], P[1::2] / 3
    options = {"h": 0.3, "steps": 40, "save_every": 20}
    ensemble = integrate_ensemble(made, "sofroniou-spaletta-10-adaptive", Q, P, **options)
    solutions = [alone(made, "sofroniou-spaletta-10-adaptive", Q, P, i, **options) for i in range(N)]
    assert ensemble.in_lanes.all()
    assert solutions[0].counts["gradient"] > 5 * solutions[1].counts["gradient"]
    assert ensemble.counts["gradient"] == sum(s.counts["gradient"] for s in solutions)
    for i, solution in enumerate(solutions):
        assert_same(ensemble, i, solution)


def test_a_lane_that_does_not_contract_is_solved_alone():
    made, Q, P = starts("pendulum")
    h = np.full(N, 0.1)
    h[[2, N - 1]] = 4.0  # needs Newton's method
    ensemble = integrate_ensemble(made, "implicit-midpoint", Q, P, h=h, steps=10)
    solutions = [alone(made, "implicit-midpoint", Q, P, i, h=h[i], steps=10, save_every=0) for i in range(N)]
    assert solutions[2].counts["newton"] > 0
    assert ensemble.in_lanes.tolist() == [i not in (2, N - 1) for i in range(N)]
    assert ensemble.counts["newton"] == sum(s.counts["newton"] for s in solutions)
    for i in (2, N - 1):
        assert_same(ensemble, i, solutions[i])


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
    assert told[-1] == 3 * N
    assert told == sorted(told)


BAD = [
    ({"Q": [[0.0]]}, r"Q has the shape \(1, 1\)"),
    ({"P": np.zeros((3, 2))}, f"Q has {N} rows and P has 3"),
    ({"Q": "many"}, "Q must be numbers"),
    ({"Q": np.zeros((0, 2)), "P": np.zeros((0, 2))}, r"Q has the shape \(0, 2\)"),
    ({"h": [0.1, 0.1]}, "h has the shape"),
    ({"h": np.linspace(0, 0.1, N)}, "h is 0; it must be another number"),
    ({"h": None}, "give the step"),
    ({"steps": None}, "where does"),
    ({"h": 1 / np.arange(10, 10 + N), "steps": None, "t_end": 1.0, "save_every": 1}, "different numbers of steps"),
    ({"parameters": {"mu": 1.0}}, "no parameter 'mu'"),
    ({"parameters": {"lam": np.zeros(3)}}, r"the parameter lam has the shape \(3,\)"),
    ({"threads": 0}, "threads is 0"),
    ({"method": "scheme-i-i"}, "no method"),
    ({"method": "avf", "parameters": None, "lanes": True}, "'avf' does not run in lanes"),
    ({"save_every": -1}, "save_every is -1"),
    ({"problem": 3}, "the problem is 3"),
]


@pytest.mark.parametrize(("changed", "message"), BAD)
def test_invalid_arguments_are_refused(changed, message):
    made, Q, P = starts(BOX)
    good = {"problem": made, "method": "scheme-i", "Q": Q, "P": P, "h": 0.1, "steps": 2, "parameters": {"lam": 0.3}}
    with pytest.raises(InvalidInput, match=message):
        integrate_ensemble(**good | changed)


@pytest.mark.parametrize(("id", "n", "lanes"), [("stormer-verlet", 50_000, True), ("gauss-6", 2000, False)])
def test_an_ensemble_is_interrupted_whatever_its_steps(id, n, lanes):
    """Ctrl-C ends a run of years within seconds; the orbits are whole in the next."""
    made = problem("henon-heiles:box")
    q, p = (np.tile(x, (n, 1)) for x in (made.q0, made.p0))
    run = partial(integrate_ensemble, made, id, q, p, h=1e-3, lanes=lanes, threads=2)
    end = run(steps=20).q
    sent = []

    def interrupt() -> None:
        sent.append(time.monotonic())
        signal.raise_signal(signal.SIGINT)

    timer = threading.Timer(1.0, interrupt)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        run(steps=10**11)
    assert time.monotonic() - sent[0] < 10, "two seconds where nothing else runs"
    assert np.array_equal(run(steps=20).q, end)
