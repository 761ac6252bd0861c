"""The cache of code and of what methods prepare: damaged or stale entries are made anew, and processes share it.

Of two compiled functions of one name neither is taken for the other.
"""

from __future__ import annotations

import ctypes
import errno
import io
import logging
import multiprocessing
import os
import pickle
import re
import resource
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from pathlib import Path

import numba
import numpy as np
import pytest
import sympy as sp
from numba import types

from phasebench.benchmarks.problems import problem
from phasebench.integrators import Hamiltonian, integrate, method
from phasebench.integrators.compile import cache, machine, options, preparation, printing, progress
from phasebench.integrators.families import splitting
from phasebench.integrators.stepping import kernel, newton
from phasebench.integrators.systems import deferred
from phasebench.integrators.values import vector

SEVERAL = b"text of a function\n" * 50
SIGNATURE = types.float64(types.float64)
fork = multiprocessing.get_context("fork")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache folder for this process."""
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_logged", [])
    cache._evict_once.cache_clear()
    return cache.folder()


DAMAGES = {
    "empty": lambda b: b"",
    "cut": lambda b: b[: len(b) // 2],
    "one byte more": lambda b: b + b"x",
    "one bit flipped": lambda b: b[:-5] + bytes([b[-5] ^ 1]) + b[-4:],
    "zeros, as after a power cut": lambda b: bytes(len(b)),
}


def test_entries_are_read_as_written_under_their_name(place):
    assert cache.read("a.py") is None
    for content in (SEVERAL, b"other"):
        cache.write("a.py", content)
        assert cache.read("a.py") == content
    shutil.copy(place / "a.py", place / "b.py")
    assert cache.read("b.py") is None
    assert [p.name for p in place.iterdir()] == ["a.py"]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_ignored_and_removed(place, damage):
    cache.write("a.py", SEVERAL)
    (place / "a.py").write_bytes(DAMAGES[damage]((place / "a.py").read_bytes()))
    assert cache.read("a.py") is None
    assert not (place / "a.py").exists()


def test_the_folder_may_be_in_the_home(monkeypatch):
    monkeypatch.setenv("PHASEBENCH_CACHE", "~/kept")
    assert cache.root() == Path.home() / "kept"


def compile_or_load(name="plus|1", options=vector.TUPLES):
    """(compiled function, whether it was loaded from the cache)."""
    function = machine.load_or_compile(lambda x: x + 1.0, SIGNATURE, dict(options), name)
    assert function(1.5) == 2.5
    return function, sum(function.stats.cache_hits.values()) == 1


@pytest.mark.lowest
def test_machine_code_is_keyed_by_name_and_options(place):
    assert not compile_or_load()[1]
    assert compile_or_load()[1]
    assert not compile_or_load("plus|2")[1]
    assert not compile_or_load(options=vector.ARRAYS)[1]


HARM = [(suffix, "missing") for suffix in ("seal", ".nbi", ".nbc", ".py")]
HARM += [(suffix, "cut") for suffix in ("seal", ".nbi", ".nbc")]
HARM += [pytest.param(suffix, "one bit flipped", marks=pytest.mark.lowest) for suffix in ("seal", ".nbi", ".nbc")]


@pytest.mark.parametrize(("suffix", "damage"), HARM)
def test_damaged_machine_code_is_compiled_again(place, suffix, damage):
    compile_or_load()
    (path,) = (p for p in place.glob("*/**/*") if p.name.endswith(suffix))
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    assert [compile_or_load()[1] for _ in range(2)] == [False, True]


def test_the_version_depends_on_overloads(place, tmp_path, monkeypatch):
    """No kernel names them, so that its own digest does not hold them; a docstring is no part of them."""
    usual = cache.version.__wrapped__()
    monkeypatch.setattr(cache, "VALUES", Path(shutil.copytree(cache.VALUES, tmp_path / "values")))
    masks = tmp_path / "values" / "masks.py"
    text = masks.read_text(encoding="utf-8")
    masks.write_text(text.replace('"""', '"""In other words, ', 1), encoding="utf-8")
    assert [cache.version.__wrapped__() for _ in range(2)] == [usual, usual], "read again, it is the same"
    masks.write_text(text.replace("for i in range(width)", "for i in range(width - 1)"), encoding="utf-8")
    assert cache.version.__wrapped__() != usual


def test_the_version_depends_on_compilers_and_processor(monkeypatch):
    usual = cache.version.__wrapped__()
    for owner, name, other in ((numba.config, "CPU_NAME", "generic"), (metadata, "version", lambda name: "0")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, other)
            assert cache.version.__wrapped__() != usual


def test_machine_code_is_keyed_by_the_code_of_what_it_calls(place, monkeypatch):
    """A kernel's modules count with all that they import; others do not."""
    inner = machine.with_functions(lambda x: part(x), {"part": splitting.step})  # noqa: F821
    closed = (lambda part: lambda x: part(x))(splitting.step)
    for f in (splitting.run, inner, closed):
        modules = {x.rpartition(".")[2] for x in machine.modules_of(f)}
        assert "splitting" in modules
        assert "rigid" not in modules
    compile_or_load()
    asked = []
    monkeypatch.setattr(machine, "digest_of", lambda modules: asked.append(modules) or "another")
    assert [compile_or_load()[1] for _ in range(2)] == [False, True]
    assert all(__name__ in modules for modules in asked)


def test_a_function_for_all_kernels_is_keyed_by_its_own_code(place, monkeypatch):
    """Its machine code is made in an intrinsic, which names nothing of it: a changed solver was taken for the old."""
    make = partial(machine.Function, newton.newton, newton.SIGNATURE, vector.TUPLES, "newton")
    entries = []
    for digest in ("one", "one", "another"):
        monkeypatch.setattr(machine, "digest_of", lambda modules, d=digest: d if newton.__name__ in modules else "")
        make()
        entries.append(len([p for p in place.iterdir() if p.name.startswith("newton")]))
    assert entries == [1, 1, 2]


def times(k):
    return lambda x: k * x


def test_functions_with_different_content_have_other_symbols():
    def symbol(k):
        made = machine.load_or_compile(times(k), SIGNATURE, vector.TUPLES, f"times|{k}")
        assert made.nopython_signatures == [SIGNATURE]
        with pytest.raises(TypeError, match="No matching definition"):
            made(1.0 + 1j)
        return re.sub(r"B\dv\d+", "", next(iter(made.overloads.values())).fndesc.mangled_name)

    for name_of in (symbol, lambda k: vector.jit(times(k)).py_func.__qualname__):
        assert name_of(2.0) != name_of(3.0)
        assert name_of(2.0) == name_of(2.0), "the control"


def full(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cache.os, "replace", refuse)


def no_folder(monkeypatch):
    Path(os.environ["PHASEBENCH_CACHE"]).write_text("a file")


def no_home(monkeypatch):
    monkeypatch.setattr(cache, "root", lambda: None)


@pytest.mark.parametrize("fault", [full, no_folder, no_home])
def test_an_unwritable_cache_warns_once(place, monkeypatch, caplog, fault):
    fault(monkeypatch)
    with caplog.at_level(logging.WARNING, "phasebench"):
        for k in range(3):
            cache.write(f"{k}.py", SEVERAL)
            assert cache.read(f"{k}.py") is None
        compile_or_load()
        with cache.hold_lock("a.py"):
            pass
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()


def test_a_disk_that_fills_up_leaves_no_partial_entry(place):
    cache.write("a.py", b"before")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        cache.write("a.py", bytes(100_000))
        cache.write("b.py", bytes(100_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert cache.read("a.py") == b"before"
    assert [p.name for p in place.iterdir()] == ["a.py"]


def _hold(holds, release) -> None:
    with cache.hold_lock("a.py"):
        holds.set()
        release.wait()
        cache.write("a.py", SEVERAL)


@contextmanager
def holder():
    """Context in which another process holds the lock of entry a.py until told to write and release it.

    Yields (process, event that tells it).
    """
    holds, release = fork.Event(), fork.Event()
    process = fork.Process(target=_hold, args=(holds, release))
    process.start()
    try:
        assert holds.wait(60)
        yield process, release
    finally:
        process.kill()
        process.join()


def test_nobody_waits_for_a_killed_process_or_an_entry_that_is_there(place, monkeypatch):
    with holder():
        cache.write("a.py", SEVERAL)
        with cache.hold_lock("a.py"):
            pass
    (place / "a.py").unlink()
    with holder() as (process, _):
        process.kill()
        process.join()
        with cache.hold_lock("a.py"):
            pass
    monkeypatch.setattr(cache, "LOCK_TIMEOUT", 0.05)
    with holder(), cache.hold_lock("a.py"):
        assert (place / "a.py.lock").exists(), "still held by the other process"
    with pytest.raises(ValueError), cache.hold_lock("b.py"):
        raise ValueError
    assert not (place / "b.py.lock").exists()


def compile_at_once(barrier, results) -> None:
    barrier.wait()
    results.put(compile_or_load("met|1")[1])


def test_of_concurrent_processes_one_compiles(place):
    barrier, results = fork.Barrier(3), fork.Queue()
    workers = [fork.Process(target=compile_at_once, args=(barrier, results)) for _ in range(3)]
    for worker in workers:
        worker.start()
    assert sorted(results.get(timeout=60) for _ in workers) == [False, True, True]
    for worker in workers:
        worker.join()


#: A run, and code that allocates, for which Numba's runtime has to be there though nothing is compiled.
RUN = """
import numba, numpy as np
from phasebench.integrators import Hamiltonian, integrate
from phasebench.integrators.compile import machine
from phasebench.integrators.values import vector
number = numba.types.float64(numba.types.float64)
made = machine.load_or_compile(lambda x: np.zeros(2)[1] + x, number, dict(vector.ARRAYS), "x|allocates")
pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
print(integrate(pendulum, "stormer-verlet", h=0.1, steps=10, q0=[1.0], p0=[0.2]).q[-1, 0], made(1.5))
print(sum(made.stats.cache_hits.values()))
"""


def run_in_process() -> tuple[list[str], int]:
    """(what the script `RUN` prints, number of lines of its error output)."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True)
    return done.stdout.splitlines(), len(done.stderr.splitlines())


def test_processes_agree_with_a_cache_and_without_one(place):
    (result, loaded), complaints = run_in_process()
    assert (loaded, complaints) == ("0", 0)
    assert run_in_process() == ([result, "1"], 0)
    shutil.rmtree(cache.root())
    cache.root().write_text("a file")
    assert run_in_process() == ([result, "0"], 1)


def fill_folder(name: str, size: int, age: float) -> Path:
    """Create a folder of the cache with an entry of that size, last used `age` seconds ago."""
    folder = cache.root() / name
    folder.mkdir(parents=True)
    (folder / "entry").write_bytes(bytes(size))
    os.utime(folder, (time.time() - age,) * 2)
    return folder


def test_what_was_longest_unused_is_evicted_first(place, monkeypatch):
    old, newer = fill_folder("py311-" + "0" * 16, 1000, 900), fill_folder("py312-" + "f" * 16, 1000, 500)
    foreign = fill_folder("photographs", 10_000, 9000)
    for k in range(4):
        cache.write(f"{k}.py", bytes(1000))
        os.utime(place / f"{k}.py", (time.time() - 100 + k,) * 2)
    whole = sum(cache.size(folder)[1] for folder in (place, old, newer))
    for most, left in ((whole, 6), (whole - 1, 5), (4500, 4), (2500, 2)):
        monkeypatch.setattr(cache, "MAX_BYTES", most)
        cache.evict()
        entries = [old.exists(), newer.exists(), *((place / f"{k}.py").exists() for k in range(4))]
        assert entries == [False] * (6 - left) + [True] * left
    assert foreign.exists()
    cache.clear()
    assert (place.exists(), foreign.exists()) == (False, True)


def test_reading_counts_as_use(place):
    cache.write("a.py", SEVERAL)
    for name, ago in (("a.py", 0), ("b.py", 1000)):
        cache._note_use.cache_clear()
        os.utime(place, (time.time() - 1000,) * 2)
        cache.read(name)
        assert time.time() - cache._last_used(place) == pytest.approx(ago, abs=100)


def test_leftovers_of_a_killed_process_are_removed(place):
    cache.write("a.py", SEVERAL)
    for name, age in (("old.tmp", 2 * cache.STALE_AFTER), ("old.lock", 2 * cache.STALE_AFTER), ("new.tmp", 0)):
        (place / name).write_bytes(b"part")
        os.utime(place / name, (time.time() - age,) * 2)
    cache.evict()
    assert sorted(p.name for p in place.iterdir()) == ["a.py", "new.tmp"]


PENDULUM = {"q": "q", "p": "p", "H": "p**2/2 - cos(q)"}


def test_equal_formulas_share_their_functions(monkeypatch):
    def end(**given):
        return integrate(Hamiltonian(**given), "scheme-i", h=0.1, steps=5, q0=[1.0], p0=[0.2]).q[-1]

    end(**PENDULUM)
    monkeypatch.setattr(printing, "source", None)  # would fail if called
    end(**PENDULUM)
    with pytest.raises(TypeError, match="not callable"):
        end(q="q", p="p", H="p**2/2 - cos(q) + q**6/7919")
    assert problem("kepler", e=0.2).system is problem("kepler", e=0.2).system
    assert problem("kepler", e=0.2).q0 != problem("kepler", e=0.3).q0


@pytest.mark.parametrize("name", ["pendulum", "lotka-volterra", "nls"])
def test_systems_can_be_pickled(name):
    made = problem(name)
    options = {"h": 0.01, "steps": 3, "q0": made.q0, "p0": made.p0}
    before = integrate(made.system, "implicit-midpoint", **options)
    after = integrate(pickle.loads(pickle.dumps(made.system)), "implicit-midpoint", **options)
    assert np.array_equal([before.q, before.p], [after.q, after.p])


def test_a_deferred_system_is_made_when_its_formula_is_needed():
    made = []
    whole = Hamiltonian(**PENDULUM)
    assert whole.H is not None  # evaluates a deferred formula
    shell = deferred.shell(whole, "a key", lambda: made.append(1) or whole)
    assert (shell.d, shell.has_energy, shell.singularities, hasattr(shell, "q0")) == (1, True, 0, False)
    assert made == []
    assert (shell.H, shell.traits, shell.content) == (whole.H, whole.traits, whole.content)
    assert made
    q, p = np.array([[0.3], [1.2]]), np.array([[0.1], [-0.7]])
    for name in ("energies", "scale", "speed", "rates", "distances"):
        assert np.array_equal(getattr(whole, name)(q, p), getattr(shell, name)(q, p))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = shell.nothing


@pytest.fixture
def keeping(place, monkeypatch):
    """Switch on the cache of what methods prepare."""
    monkeypatch.setattr(preparation, "ENABLED", True)
    preparation._read.cache_clear()
    yield
    preparation._read.cache_clear()


@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize("id", ["scheme-v", "gauss-8", "gauss-equip-3"])
def test_a_prepared_step_is_read_as_it_was_written(id):
    system, record = problem("pendulum").system, method(id)
    made = kernel.prepare(record, system)
    preparation._read.cache_clear()
    read = kernel.prepare(record, system)
    assert read is not made
    assert read is kernel.prepare(record, system)
    assert (read.run, kernel._type(read.step), str(read.step)) == (made.run, kernel._type(made.step), str(made.step))


@pytest.mark.usefixtures("keeping")
def test_an_entry_depends_on_method_values_and_system(monkeypatch):
    kepler = [problem("kepler", e=e).system for e in (0.2, 0.3)]
    given = [(method("scheme-i", lam=lam), system) for lam in (0, 1) for system in kepler]
    names = [preparation.entry(*of) for of in given]
    assert len({*names, preparation.entry(method("rk4"), kepler[0])}) == 5
    assert names == [preparation.entry(*of) for of in given]
    q, p = sp.symbols("q p", real=True)
    assert preparation.entry(method("scheme-i"), Hamiltonian(q=[q], p=[p], H=p**2 / 2 - sp.cos(q))) is None
    preparation.write(names[0], (x for x in "ab"))  # cannot be written
    cache.write(names[1], b"no pickle")
    assert [preparation.read(name) for name in (None, *names[:2])] == [None] * 3
    monkeypatch.setattr(preparation, "ENABLED", False)
    assert preparation.entry(*given[0]) is None


class Terminal(io.StringIO):
    def isatty(self):
        return True


#: What a notebook puts in the place of stderr.
Notebook = type("OutStream", (io.StringIO,), {"__module__": "ipykernel.iostream"})


@pytest.mark.parametrize(
    ("stream", "shown"), [(Terminal, "compiling ...\r\033[K"), (Notebook, "compiling ...\n"), (io.StringIO, "")]
)
def test_long_compilations_are_announced_where_somebody_looks(stream, shown, monkeypatch):
    monkeypatch.delenv(progress.QUIET, raising=False)
    for patience, written in ((0.0, shown), (60.0, "")):
        monkeypatch.setattr(progress, "PATIENCE", patience)
        monkeypatch.setattr("sys.stderr", stream())
        with progress.on_stderr("compiling ..."), progress.on_stderr("compiling another ..."):
            time.sleep(0.1)
        assert sys.stderr.getvalue() == written


# -- what kernels rarely call -----------------------------------------------------------------------------------------


def twice(x):
    return 2.0 * x


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_rare_function_is_compiled_when_it_is_first_called(monkeypatch, interrupted):
    """Ctrl-C at that time is raised in Python, once the call is over."""
    made, compiles = machine.Function._compile, []

    def compile_(function):
        compiles.append(function)
        if interrupted and len(compiles) == 1:
            raise KeyboardInterrupt
        return made(function)

    monkeypatch.setattr(machine.Function, "_compile", compile_)
    rare = machine.Function(twice, types.float64(types.float64), options.TUPLES, "twice", rare=True)
    call = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(rare.__wrapper_address__())
    assert not compiles
    before = machine.waited()
    assert [call(3.0), call(4.0)] == [6.0, 8.0]
    assert len(compiles) == 1 + interrupted
    assert machine.waited() > before
    if interrupted:
        with pytest.raises(KeyboardInterrupt):
            time.sleep(10)
