"""At small d a step allocates no memory: the compiler is told to refuse it, and Numba's counters confirm it."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys

from phasebench.benchmarks.measure.battery import as_problem
from phasebench.benchmarks.problems import problem
from phasebench.integrators.compile import codegen, machine
from phasebench.integrators.prepared import prepare as prepared_run
from phasebench.integrators.registry import BY_ID, METHODS
from phasebench.integrators.stepping import kernel as stepping
from phasebench.integrators.stepping.kernel import kernel, prepare
from support.one_of_each import FIRST, kinds

PROBLEMS = [problem(name) for name in ("henon-heiles", "perturbed-kepler", "magnetic-mirror")]
PROBLEMS += [as_problem(name) for name in ("on-sphere", "asymmetric-top", "many-parts")]


def build_problem(id):
    """A registered problem on which the method with this id runs."""
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


@pytest.mark.parametrize("id", sorted(m.id for m in FIRST.values()))
def test_no_step_allocates(id):
    run = prepared_run(build_problem(id), id)
    few, many = (lambda n=n: run(0.01, n) for n in (10, 1000))
    assert (few()[2], many()[2]) == (run.SOLVED, run.SOLVED), "all steps are taken"
    assert allocations(many) == allocations(few)


def grown(name, id) -> int:
    """Allocations of a thousand steps of an array-based run, minus those of ten."""
    run = prepared_run(problem(name, **LARGE[name]), id)
    few, many = (lambda n=n: run(1e-3, n) for n in (10, 1000))
    assert (few()[2], many()[2]) == (run.SOLVED, run.SOLVED), "all steps are taken"
    return allocations(many) - allocations(few)


LARGE = {"fpu": {"m": 11}, "nls": {"N": 24}, "outer-solar-system": {}}
EXPLICIT = [("fpu", "stormer-verlet"), ("fpu", "rk4"), ("nls", "rk4"), ("outer-solar-system", "stormer-verlet")]


@pytest.mark.parametrize(("name", "id"), EXPLICIT)
def test_no_explicit_step_on_arrays_allocates(name, id):
    assert grown(name, id) == 0


def test_control_an_implicit_step_on_arrays_allocates():
    assert grown("fpu", "implicit-midpoint") > 1000


def is_step(part) -> bool:
    """Whether a field of a method's step (a NamedTuple) is the step of another method, or a tuple of functions."""
    return isinstance(part, tuple)


@pytest.mark.parametrize("id", [m.id for m in kinds(METHODS).values()])
def test_kernels_are_compiled_without_the_runtime(id, monkeypatch):
    """The kernel and its functions are compiled without Numba's runtime, which would do the allocating."""
    asked = []
    system = build_problem(id).system
    prepared = prepare(BY_ID[id], system)
    with monkeypatch.context() as patch:
        patch.setattr(stepping, "_kernels", {})
        patch.setattr(machine, "load_or_compile", lambda *arguments: asked.append(arguments))
        kernel(prepared, system.d)
    assert [options["_nrt"] for _, _, options, _ in asked] == [False]
    functions = [f for part in (prepared.step, *filter(is_step, prepared.step)) for f in part if callable(f)]
    assert functions
    for f in functions:
        assert getattr(f, "dispatcher", f).targetoptions["_nrt"] is False


def test_only_arrays_are_compiled_with_the_runtime():
    for d in range(1, codegen.TUPLE_LIMIT + 1):
        assert codegen.options(d)["_nrt"] is False
    assert codegen.options(codegen.TUPLE_LIMIT + 1).get("_nrt", True) is True


def test_control_the_compiler_refuses_allocations():
    """Without Numba's runtime, code that allocates does not compile: the option is not a mere hint."""

    def allocates(n):
        return np.empty(n).sum() * 0.0

    assert numba.njit(**codegen.options(codegen.TUPLE_LIMIT + 1))(allocates)(0) == 0
    with pytest.raises(numba.core.errors.NumbaError):
        numba.njit(**codegen.options(2))(allocates)(0)
