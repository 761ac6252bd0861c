"""Nothing allocates in a step at small d: the compiler is told to refuse it, and the runtime's counters say so."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys

from phasebench.benchmarks.problems import problem
from phasebench.integrators.engine import codegen
from phasebench.integrators.engine.kernel import kernel, prepare
from phasebench.integrators.prepared import prepare as prepared_run
from phasebench.integrators.registry import METHODS

PROBLEMS = [problem(name) for name in ("henon-heiles", "perturbed-kepler")]
BY_ID = {m.id: m for m in METHODS}


def made(id):
    """A problem that has what the method requires."""
    return next(x for x in PROBLEMS if BY_ID[id].lacks(x.system) is None)


def allocations(work) -> int:
    """How many times Numba's runtime allocated while ``work`` ran."""
    rtsys.initialize(cpu_target.target_context)
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    work()
    after = rtsys.get_allocation_stats()
    return (after.alloc - before.alloc) + (after.mi_alloc - before.mi_alloc)


@numba.njit
def _allocating(steps):
    total = 0.0
    for i in range(steps):
        total += np.empty(2 + i % 2)[0] * 0.0 + np.ones(3).sum()
    return total


def test_control_an_allocation_in_a_loop_is_counted():
    _allocating(1)
    assert allocations(lambda: _allocating(1000)) - allocations(lambda: _allocating(10)) >= 990


@pytest.mark.parametrize("id", BY_ID)
def test_no_step_allocates(id):
    run = prepared_run(made(id), id)
    few, many = (lambda n=n: run(0.01, n) for n in (10, 1000))
    few(), many()
    assert allocations(many) == allocations(few)


def grown(name, id) -> int:
    """Allocations of a thousand steps on arrays beyond those of ten."""
    run = prepared_run(problem(name, **LARGE[name]), id)
    few, many = (lambda n=n: run(1e-3, n) for n in (10, 1000))
    few(), many()
    return allocations(many) - allocations(few)


LARGE = {"fpu": {"m": 11}, "nls": {"N": 24}, "outer-solar-system": {}}
EXPLICIT = [("fpu", "stormer-verlet"), ("fpu", "rk4"), ("nls", "rk4"), ("outer-solar-system", "stormer-verlet")]


@pytest.mark.parametrize(("name", "id"), EXPLICIT)
def test_no_explicit_step_on_arrays_allocates(name, id):
    assert grown(name, id) == 0


def test_control_an_implicit_step_on_arrays_allocates():
    assert grown("fpu", "implicit-midpoint") > 1000


@pytest.mark.parametrize("id", BY_ID)
def test_the_kernel_may_not_allocate(id):
    system = made(id).system
    prepared = prepare(BY_ID[id], system)
    assert kernel(prepared, system.d).targetoptions["_nrt"] is False
    functions = [f for f in prepared.step if callable(f)]
    assert functions
    for f in functions:
        assert f.targetoptions["_nrt"] is False


def test_tuples_are_compiled_without_the_runtime_and_arrays_with_it():
    for d in range(1, codegen.TUPLE_LIMIT + 1):
        assert codegen.options(d)["_nrt"] is False
    assert codegen.options(codegen.TUPLE_LIMIT + 1).get("_nrt", True) is True


def test_control_the_compiler_refuses_what_would_allocate():
    """Without the runtime there is nothing to allocate with: the option is no mere hint."""

    def allocates(n):
        return np.empty(n).sum() * 0.0

    assert numba.njit(**codegen.options(codegen.TUPLE_LIMIT + 1))(allocates)(0) == 0
    with pytest.raises(numba.core.errors.NumbaError):
        numba.njit(**codegen.options(2))(allocates)(0)
