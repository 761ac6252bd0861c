"""Fixtures of the suite: measurements of a process in which nothing is compiled; where that is this one, made here."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import io
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from phasebench.benchmarks.measure import multiprecision
from phasebench.integrators.engine import codegen, preparation
from support import lazily

HERE = Path(__file__).resolve().parent


#: The files that take longest, first: else one process would be at them when the other has ended.  The first compiles
#: the kernels of every family; those beside it, to "test_perturbed", compile none or few, and what follows loads them.
LONGEST = (
    "test_allocation",
    "test_orders",
    "test_pages",
    "test_symplectic",
    "test_properties",
    "test_adjoint",
    "test_scaling",
    "test_perturbed",
    "test_nojit",
    "test_audit",
    "test_problem_literature",
    "test_warm",
    "test_figures",
)


def pytest_collection_modifyitems(items):
    """Run the files of `LONGEST` first."""
    places = {f"{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A file's tests go to one worker, so that none measures again what another has measured, in the order of items."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_runtest_teardown():
    """Take back what WHFast512 leaves where a test calls it without `integrate_peer`: small numbers become zero."""
    if float("2.2250738585072014e-308") * float("0.5") == 0:
        ctypes.CDLL(None).fesetenv(ctypes.c_void_p(-1))  # FE_DFL_ENV of the C libraries that run there


@functools.cache
def _uncompiled(script: str, *arguments: str):
    path = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])  # as for the tests themselves
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    command = [sys.executable, str(HERE / script), *arguments]
    done = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, check=False)
    # The failure is kept as well: hundreds of tests would wait for it again.
    return json.loads(done.stdout.splitlines()[-1])["result"] if done.returncode == 0 else done.stderr


@functools.cache
def _here(script: str, *arguments: str):
    """The same in this process, which compiles nothing."""
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as printed:
        patch.setattr(sys, "argv", [script, *arguments])
        runpy.run_path(str(HERE / script), run_name="__main__")
    return json.loads(printed.getvalue().splitlines()[-1])["result"]


def _result(script: str, *arguments: str):
    result = _uncompiled(script, *arguments) if codegen.compiled() else _here(script, *arguments)
    assert not isinstance(result, str), f"{script} {' '.join(arguments)} failed:\n{result}"
    return result


@pytest.fixture(scope="session", autouse=True)
def nothing_that_families_prepare_is_kept():
    """Tests change families: what they prepare is prepared, never read from the cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preparation, "KEPT", False)
        yield


@pytest.fixture(scope="session")
def uncompiled():
    """(script, arguments) -> the result that it prints, measured once a session with NUMBA_DISABLE_JIT=1."""
    return _result


@pytest.fixture(scope="session")
def of_each(uncompiled):
    """A module of `support` that prints {label: what its ``of`` finds} -> the function of the label.

    Where this process compiles nothing a label is measured when it is asked for, so that a test reaches its own alone.
    """

    def function(module):
        script = f"support/{Path(module.__file__).name}"
        return uncompiled(script).get if codegen.compiled() else module.of

    return function


@functools.cache
def _elsewhere(name: str):
    try:
        return multiprecision.elsewhere(name)
    except RuntimeError as error:  # kept as well: hundreds of tests would wait for it again
        return str(error)


#: What the tests of one file want is measured in one process.
TOGETHER = (("orders", "spoiled"), ("symplecticity", "frozen"), ("symmetry", "adjoint"))


def _measured(name: str):
    for names in TOGETHER:
        if name in names:
            return _result("support/exact.py", *names)[name]
    result = _elsewhere(name)
    assert not isinstance(result, str), result
    return result


@pytest.fixture(scope="session")
def measured():
    """Name -> the measurement of that name in `measure.multiprecision`, on the systems of `support.exact`."""
    return _measured if codegen.compiled() else functools.cache(lazily.measured)
