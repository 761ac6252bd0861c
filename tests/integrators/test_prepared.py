"""A prepared run equals `integrate` bit by bit, for repeated calls and any start."""

from __future__ import annotations

import ast
import copy
import gc
import pickle
import sys
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.integrators.compile.codegen import compiled
from phasebench.integrators.prepared import prepare
from phasebench.integrators.stepping import kernel

H = 0.01
#: Small and large d, explicit and implicit methods, steps that depend on H0 or on h.
RUNS = [
    ("pendulum", "stormer-verlet"),
    ("henon-heiles:box", "scheme-i"),
    ("henon-heiles:box", "rk4"),
    ("henon-heiles:box", "gautschi"),
    ("pendulum", "scheme-v"),
    ("klein-gordon", "stormer-verlet"),
]


def same(one, other) -> bool:
    """Whether two sequences of arrays are equal."""
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def ends(made, id, steps, h=H, **start):
    """End (q, p) of a run by `integrate`, arrays (d,)."""
    s = integrate(made, id, h=h, steps=steps, save_every=0, **start)
    return s.q[-1], s.p[-1]


@pytest.mark.parametrize(("name", "id"), RUNS)
def test_a_prepared_run_equals_integrate(name, id):
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
def test_prepared_runs_of_different_sizes_are_independent(sizes):
    """Array kernels, and the functions that pass arguments to them, serve every d."""
    made = [problem("klein-gordon", N=n) for n in sizes]
    runs = [prepare(m, "stormer-verlet") for m in made]
    if compiled():
        assert runs[0]._functions is runs[1]._functions
    for run, one in zip(runs, made, strict=True):
        alone = integrate(one, "stormer-verlet", h=H, steps=20, save_every=0)
        q, p, code = run(H, 20)
        assert code == run.SOLVED
        assert same((q, p), (alone.q[-1], alone.p[-1]))


@pytest.mark.parametrize("id", ["gauss-8", "gauss-8-field", "dop853-relaxation", "scheme-v", "quinlan-tremaine-8"])
def test_memory_begins_at_a_cache_line(id):
    """Times of the same run differed by a fourth between processes where it did not."""
    runs = [prepare(problem("magnetic-mirror" if "relax" in id else "henon-heiles:box"), id) for _ in range(5)]
    for run in runs:
        held = [*run._layout.carry, *run._layout.step]
        arrays = [x for x in held if isinstance(x, np.ndarray) and x.dtype == float]
        assert len(arrays) > 2
        assert not any(x.ctypes.data % kernel.LINE for x in arrays)
        assert all(x.flags.c_contiguous for x in arrays)


@pytest.mark.parametrize("shape", [0, 7, (3, 5), (2, 0), (2, 3, 4, 8)])
def test_aligned_zeros_are_the_zeros_of_numpy(shape):
    made = kernel.aligned_zeros(shape)
    assert np.array_equal(made, np.zeros(shape))
    assert made.dtype == float
    assert made.flags.writeable


def test_explicit_methods_allocate_no_matrix():
    made = problem("klein-gordon", N=64)
    held = {id: prepare(made, id)._layout.carry.work.size for id in ("rk4", "stormer-verlet", "implicit-midpoint")}
    assert held["rk4"] == held["stormer-verlet"] == 4
    assert held["implicit-midpoint"] == (made.system.d + 1) ** 2


def test_an_end_is_not_overwritten_by_the_next_run():
    run = prepare(problem("pendulum"), "stormer-verlet")
    q = run(H, 10)[0]
    kept = q.copy()
    assert run(H, 20)[0] != kept
    assert q == kept


def test_failures_are_statuses():
    runaway = pb.Hamiltonian(q="q", p="p", H="p**2/2 - q**4")
    explicit, implicit = (prepare(runaway, id, q0=[1.0], p0=[1.0]) for id in ("stormer-verlet", "implicit-midpoint"))
    assert explicit(0.01, 1000)[2] == explicit.NOT_FINITE == "diverged"
    q, p, code = implicit(0.01, 1000)
    assert code == implicit.STALLED == "not-converged"
    assert np.isnan([q, p]).all()
    assert implicit(0.01, 10)[2] == implicit.SOLVED == "ok"


def test_a_system_without_initial_data_cannot_be_prepared():
    with pytest.raises(InvalidInput, match="give q0"):
        prepare(problem("pendulum").system, "stormer-verlet")


@pytest.mark.parametrize(
    ("H", "h", "p0", "finite"),
    [("p**2/2 - q", 1e120, 1e200, [False, True]), ("p**2/2 - q**4", 1.0, 1e110, [True, False])],
)
def test_an_end_with_an_infinite_half_is_reported(H, h, p0, finite):
    run = prepare(pb.Hamiltonian(q="q", p="p", H=H), "stormer-verlet", q0=[1.0], p0=[1.0])
    q, p, code = run(h, 1, q0=[0.0], p0=[p0])
    assert [np.isfinite(q[0]), np.isfinite(p[0])] == finite
    assert code == run.NOT_FINITE


def test_prepared_runs_are_independent():
    made = problem("pendulum")
    one, other = (prepare(made, "scheme-i", parameters={"lam": x}) for x in (0, "1/3"))
    first = one(H, 30)
    for _ in range(100):
        prepare(made, "scheme-v")(H, 1)
    other(H, 77)
    assert same(first, one(H, 30))


@pytest.mark.skipif(not compiled(), reason="what is not compiled holds nothing")
def test_memory_is_freed_with_the_run():
    run = prepare(problem("pendulum"), "stormer-verlet")
    run(H, 1)
    held = weakref.ref(run._layout.carry.state)
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
    assert not compiled() or run._address != other._address
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


def test_what_releases_memory_says_how_it_is_copied():
    for path in Path(pb.__path__[0]).resolve().parent.glob("[ibr]*/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                names = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
                names |= {getattr(t, "id", "") for n in node.body if isinstance(n, ast.Assign) for t in n.targets}
                assert "__del__" not in names or "__reduce__" in names, f"{path}: {node.name}"


def test_a_run_prints_its_method_and_its_system():
    run = prepare(problem("pendulum"), "scheme-i", parameters={"lam": "1/3"})
    assert repr(run) == "PreparedRun(scheme-i(lam=1/3) on Hamiltonian(q='q', p='p', H='p**2/2 - cos(q)'))"


def test_a_run_that_cannot_be_prepared_leaves_no_error_behind(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    with pytest.raises(InvalidInput, match="canonical"):
        prepare(problem("lotka-volterra"), "scheme-iv")
    gc.collect()
    assert told == []


def test_an_integer_step_size_is_accepted():
    run = prepare(problem("pendulum"), "scheme-v")
    assert same(run(1, 2)[:2], run(1.0, 2)[:2])


@pytest.mark.parametrize(("name", "kind"), [("pendulum", "tuple"), ("klein-gordon", "array")])
def test_values_names_the_type_of_states(name, kind):
    assert prepare(problem(name), "stormer-verlet").values == kind


def test_a_call_costs_microseconds():
    """`integrate` takes a hundred microseconds for one step; the bound is wide because machines are shared."""
    run = pb.prepare("henon-heiles:box", "stormer-verlet")
    best = np.inf
    for _ in range(50):
        began = time.perf_counter()
        for _ in range(100):
            run(H, 1)
        best = min(best, (time.perf_counter() - began) / 100)
    assert best < 10e-6
