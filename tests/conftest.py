"""Fixtures and hooks of the tests; some results are computed without compilation, in a subprocess."""

from __future__ import annotations

import os

# Before NumPy is imported, and inherited by workers and subprocesses: as many workers as cores leave no core for a
# second thread of BLAS, which waits actively for its turn. Least squares took six times the processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import atexit
import ctypes
import functools
import gc
import json
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from phasebench.integrators.compile import preparation

HERE = Path(__file__).resolve().parent

if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    # None beside the sources; but hundreds of subprocesses need not compile every module again.
    os.environ["PYTHONPYCACHEPREFIX"] = tempfile.mkdtemp(prefix="bytecode-")
    atexit.register(shutil.rmtree, os.environ["PYTHONPYCACHEPREFIX"], ignore_errors=True)


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what runs in its background without interrupts, and subprocesses inherit it: some tests send one.
    signal.signal(signal.SIGINT, signal.default_int_handler)


#: The slowest files, run first so that the workers finish together. The first one compiles the kernels of every family;
#: those up to "test_studies" compile few or none, and later files load what is in the cache.
LONGEST = (
    "test_kernels",
    "test_orders",
    "test_studies",
    "test_audit",
    "test_problems",
    "test_warm",
    "test_figures",
)


#: Seconds after which a test hangs, and fails by its name.
HANGS = 900


#: Objects are allocated between two searches for cycles: with the compiler's in memory each search is a long one.
gc.set_threshold(200_000, 20, 100)


def pytest_addoption(parser):
    """Add the command-line option --thorough of ``pytest tests``."""
    parser.addoption("--thorough", action="store_true", help="run the tests that are marked thorough, too")


def pytest_collection_modifyitems(config, items):
    """Run the test files of `LONGEST` first; leave out tests marked thorough without --thorough; limit their time."""
    if not config.getoption("--thorough"):
        left = [item for item in items if item.get_closest_marker("thorough")]
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if item not in left]
    for item in items:
        if config.pluginmanager.hasplugin("timeout") and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(HANGS))
    places = {f"{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Let pytest-xdist send all tests of a file to one worker, in their order, so that no measurement is repeated."""
    from xdist.scheduler import LoadFileScheduling

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_runtest_teardown():
    """Restore the processor's floating-point mode after a test if denormal numbers are flushed to zero.

    REBOUND's WHFast512 switches them off if it is called without `integrate_peer`.
    """
    if float("2.2250738585072014e-308") * float("0.5") == 0:
        ctypes.CDLL(None).fesetenv(ctypes.c_void_p(-1))  # FE_DFL_ENV of the C libraries that run there


@functools.cache
def _run_uncompiled(script: str, *arguments: str):
    path = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])  # as for the tests themselves
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    command = [sys.executable, str(HERE / script), *arguments]
    done = subprocess.run(command, env=environment, cwd=HERE.parent, capture_output=True, text=True, check=False)
    # A failure is cached too, or hundreds of tests would each repeat the run.
    return json.loads(done.stdout.splitlines()[-1])["result"] if done.returncode == 0 else done.stderr


def _result(script: str, *arguments: str):
    """Run a script of tests/ without compilation and return the result that it prints.

    Raises AssertionError, with the script's error output, if it failed.
    """
    result = _run_uncompiled(script, *arguments)
    assert not isinstance(result, str), f"{script} {' '.join(arguments)} failed:\n{result}"
    return result


@pytest.fixture(scope="session", autouse=True)
def nothing_that_families_prepare_is_kept():
    """Let the modules of methods compute their coefficients anew, not from a cache: tests modify these modules."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preparation, "ENABLED", False)
        yield


@pytest.fixture
def importable(monkeypatch):
    """Put tests/ on PYTHONPATH so that subprocesses can import `support`."""
    monkeypatch.setenv("PYTHONPATH", str(HERE))


@pytest.fixture(scope="session")
def uncompiled():
    """A function (script, arguments) -> the result that a script of tests/ prints without compilation, run once."""
    return _result


#: Measurements that one test file uses together, taken in one subprocess.
TOGETHER = (("orders", "control_errors"), ("symplecticity", "frozen"), ("symmetry", "adjoint"))


def _measure(name: str):
    names = next((names for names in TOGETHER if name in names), (name,))
    return _result("support/exact.py", *names)[name]


@pytest.fixture(scope="session")
def measured():
    """A function that maps the name of a measurement in `measure.multiprecision` to its results, by method's label.

    The systems on which methods are measured are those of `support.exact`.
    """
    return _measure
