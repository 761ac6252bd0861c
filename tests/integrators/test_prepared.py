"""A prepared run equals `integrate` bit by bit, for repeated calls, any start, and copies; it frees what it holds."""

from __future__ import annotations

import copy
import gc
import pickle
import sys
import weakref
from types import SimpleNamespace

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.integrators.prepared import prepare

H = 0.01
#: Small and large d, explicit and implicit methods, steps that depend on H0 or on h.
RUNS = [
    ("pendulum", "stormer-verlet"),
    ("henon-heiles:box", "scheme-i"),
    ("henon-heiles:box", "gautschi"),
    ("pendulum", "scheme-v"),
    ("klein-gordon", "rk4"),
]


def same(one, other) -> bool:
    """Whether two sequences of arrays are equal."""
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def solution(made, id, steps, h=H, **start):
    return integrate(made, id, h=h, steps=steps, save_every=0, **start)


def ends(*arguments, **start):
    s = solution(*arguments, **start)
    return s.q[-1], s.p[-1]


@pytest.mark.parametrize(("name", "id"), RUNS)
def test_a_prepared_run_equals_integrate(name, id):
    made = problem(name)
    run = prepare(made, id)
    assert run.values == ("array" if made.system.d > 20 else "tuple")
    start = {"q0": 1.01 * np.array(made.q0), "p0": 0.01 + np.array(made.p0)}
    expected, moved, wider = ends(made, id, 50), ends(made, id, 50, **start), ends(made, id, 50, 2 * H)
    for _ in range(2):
        *end, code = run(H, 50)
        kept = [x.copy() for x in end]
        assert (code, run.counts["steps"]) == (run.SOLVED, 50)
        assert same(end, expected)
        assert run.counts["gradient"] == solution(made, id, 50).counts["gradient"]
        assert same(run(H, 50, **start)[:2], moved)
        assert same(run(2 * H, 50)[:2], wider)
        assert same(end, kept), "an end is not overwritten by the next run"
    assert not same(expected, moved), "the control"
    assert not same(expected, wider)
    for half in ("q0", "p0"):
        assert same(run(H, 4, **{half: start[half]})[:2], ends(made, id, 4, **{half: start[half]}))
    assert same(run(1, 1)[:2], run(1.0, 1)[:2]), "an integer step"


def test_prepared_runs_are_independent():
    """Array kernels, and the functions that pass arguments to them, serve every d."""
    made = [problem("klein-gordon", N=n) for n in (24, 64)]
    for order in (made, made[::-1]):
        runs = [prepare(m, "stormer-verlet") for m in order]
        assert runs[0]._functions is runs[1]._functions
        for run, one in zip(runs, order, strict=True):
            assert same(run(H, 20)[:2], ends(one, "stormer-verlet", 20))


def test_failures_are_statuses():
    runaway = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
    explicit, implicit = (prepare(runaway, id, q0=[1.0], p0=[1.0]) for id in ("stormer-verlet", "implicit-midpoint"))
    assert explicit(0.01, 1000)[2] == explicit.NOT_FINITE == "diverged"
    q, p, code = implicit(0.01, 1000)
    assert code == implicit.STALLED == "not-converged"
    assert np.isnan([q, p]).all()
    assert implicit(0.01, 10)[2] == implicit.SOLVED == "ok"


def test_a_run_that_cannot_be_prepared_leaves_no_error_behind(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    for made, id, words in (
        (problem("lotka-volterra"), "scheme-iv", "canonical"),
        (problem("pendulum").system, "rk4", "give q0"),
    ):
        with pytest.raises(InvalidInput, match=words):
            prepare(made, id)
    gc.collect()
    assert told == []


def test_memory_is_freed_with_the_run_and_once():
    run = prepare(problem("pendulum"), "stormer-verlet")
    run(H, 1)
    held, released, functions = weakref.ref(run._layout.carry.state), [], run._functions

    def release(address):
        released.append(1)
        functions.release(address)

    run._functions = SimpleNamespace(run=functions.run, pack=functions.pack, release=release)
    run._pack()
    assert len(released) == 1
    run.__del__()
    run.__del__()
    assert len(released) == 2
    assert held() is not None
    del run
    gc.collect()
    assert held() is None


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda run: pickle.loads(pickle.dumps(run))])
@pytest.mark.parametrize("id", ["stormer-verlet", "scheme-v"])
def test_a_copy_of_a_run_is_another_run(id, copied):
    """A copy has memory of its own, goes on alone, and outlives the original; it starts where the original does."""
    run = prepare(problem("pendulum"), id)
    run.restart([0.3], [0.2])
    first, other = run(H, 20), copied(run)
    assert not np.shares_memory(run._end, other._end)
    assert run._address != other._address
    assert same(other(H, 20), first)
    other(H, 3, q0=[1.0])
    assert same(run(H, 20), first)
    del run
    gc.collect()
    assert same(prepare(problem("pendulum"), id, q0=[1.0])(H, 3)[:2], other(H, 3, q0=[1.0])[:2])


def test_a_copy_of_a_prepared_peer_has_a_state_of_its_own():
    run = pb.prepare("pendulum", "heyoka")
    end, other = run(1.0), copy.copy(run)
    other.restart([0.5], [0.0])
    assert not same(other(1.0)[:2], end[:2])
    assert same(copy.deepcopy(other)(1.0)[:2], other(1.0)[:2])
    assert same(run(1.0)[:2], end[:2])
