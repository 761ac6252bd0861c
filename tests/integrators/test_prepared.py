"""A prepared run is the run of `integrate`, to the last bit, however often and from wherever it is called."""

from __future__ import annotations

import time

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.integrators.engine.codegen import compiled
from phasebench.integrators.prepared import prepare

H = 0.01
#: Of small d and large, explicit and implicit, with a step that depends on H0 and one that depends on h.
RUNS = [
    ("pendulum", "stormer-verlet"),
    ("henon-heiles:box", "scheme-i"),
    ("henon-heiles:box", "rk4"),
    ("henon-heiles:box", "gautschi"),
    ("pendulum", "scheme-v"),
    ("klein-gordon", "stormer-verlet"),
]


def same(one, other) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def ends(made, id, steps, h=H, **start):
    s = integrate(made, id, h=h, steps=steps, save_every=0, **start)
    return s.q[-1], s.p[-1]


@pytest.mark.parametrize(("name", "id"), RUNS)
def test_it_is_the_same_run(name, id):
    made = problem(name)
    run = prepare(made, id)
    start = {"q0": 1.01 * np.array(made.q0), "p0": 0.01 + np.array(made.p0)}
    expected, moved, wider = ends(made, id, 50), ends(made, id, 50, **start), ends(made, id, 50, 2 * H)
    for _ in range(2):
        *end, code = run(H, 50)
        assert code == run.SOLVED
        assert same(end, expected)
        assert run.counts["steps"] == 50
        assert run.counts["gradient"] == integrate(made, id, h=H, steps=50, save_every=0).counts["gradient"]
        assert same(run(H, 50, **start)[:2], moved)
        assert same(run(2 * H, 50)[:2], wider)
    assert not same(expected, moved), "the control"
    assert not same(expected, wider)


@pytest.mark.parametrize("sizes", [(24, 64), (64, 24)])
def test_runs_of_several_sizes_of_arrays_are_each_their_own(sizes):
    """Kernels of arrays serve every d, and so does what hands them their arguments."""
    made = [problem("klein-gordon", N=n) for n in sizes]
    runs = [prepare(m, "stormer-verlet") for m in made]
    if compiled():
        assert runs[0]._functions is runs[1]._functions
    for run, one in zip(runs, made, strict=True):
        alone = integrate(one, "stormer-verlet", h=H, steps=20, save_every=0)
        q, p, code = run(H, 20)
        assert code == run.SOLVED
        assert same((q, p), (alone.q[-1], alone.p[-1]))


def test_an_explicit_method_holds_no_matrix():
    made = problem("klein-gordon", N=64)
    held = {id: prepare(made, id)._layout.orbit.work.size for id in ("rk4", "stormer-verlet", "implicit-midpoint")}
    assert held["rk4"] == held["stormer-verlet"] == 4
    assert held["implicit-midpoint"] == (made.system.d + 1) ** 2


def test_an_end_is_not_written_over():
    run = prepare(problem("pendulum"), "stormer-verlet")
    q = run(H, 10)[0]
    kept = q.copy()
    run(H, 20)
    assert q == kept


def test_what_goes_wrong_is_a_code():
    runaway = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
    start = {"q0": [1.0], "p0": [1.0]}
    made = problem("pendulum")
    explicit, implicit = (prepare(_Started(runaway), id) for id in ("stormer-verlet", "implicit-midpoint"))
    assert explicit(0.01, 1000, **start)[2] == explicit.NOT_FINITE
    q, p, code = implicit(0.01, 1000, **start)
    assert code == implicit.STALLED
    assert np.isnan([q, p]).all()
    assert implicit(0.01, 10, **start)[2] == implicit.SOLVED
    with pytest.raises(InvalidInput, match="canonical"):
        prepare(problem("lotka-volterra"), "scheme-iv")
    with pytest.raises(InvalidInput, match="give q0"):
        prepare(made.system, "stormer-verlet")


@pytest.mark.parametrize(
    ("H", "h", "p0", "finite"),
    [("p**2/2 - q", 1e120, 1e200, [False, True]), ("p**2/2 - q**4", 1.0, 1e110, [True, False])],
)
def test_an_end_of_which_either_half_is_not_finite_is_none(H, h, p0, finite):
    run = prepare(_Started(pb.Hamiltonian(q="q", p="p", H=H)), "stormer-verlet")
    q, p, code = run(h, 1, q0=[0.0], p0=[p0])
    assert [np.isfinite(q[0]), np.isfinite(p[0])] == finite
    assert code == run.NOT_FINITE


class _Started:
    """A system with initial data."""

    def __init__(self, system):
        self.system, self.q0, self.p0 = system, [1.0], [1.0]


def test_two_runs_do_not_disturb_each_other_and_a_lost_one_frees_its_memory():
    made = problem("pendulum")
    one, other = prepare(made, "scheme-i", lam=0), prepare(made, "scheme-i", lam="1/3")
    first = one(H, 30)
    for _ in range(100):
        prepare(made, "scheme-v")(H, 1)
    other(H, 77)
    assert same(first, one(H, 30))


def test_a_call_costs_microseconds():
    """The integrate of one step costs a hundred of them; the limit is wide, as machines are shared."""
    run = pb.prepare("henon-heiles:box", "stormer-verlet")
    best = np.inf
    for _ in range(50):
        began = time.perf_counter()
        for _ in range(100):
            run(H, 1)
        best = min(best, (time.perf_counter() - began) / 100)
    assert best < 10e-6
