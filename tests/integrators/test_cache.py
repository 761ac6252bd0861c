"""The cache: damaged entries are remade, an unwritable folder is tolerated, stale entries are never found."""

from __future__ import annotations

import errno
import logging
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numba
import pytest

from phasebench.integrators.compile import cache, machine
from phasebench.integrators.families import splitting
from phasebench.integrators.values import vector

SEVERAL = b"text of a function\n" * 50
PACKAGE = "phasebench.integrators"
SIGNATURE = numba.types.float64(numba.types.float64)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache folder for this process."""
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_logged", [])
    cache._evict_once.cache_clear()
    return cache.folder()


DAMAGES = {
    "empty": lambda b: b"",
    "cut in the seal": lambda b: b[:20],
    "cut": lambda b: b[: len(b) // 2],
    "one byte less": lambda b: b[:-1],
    "one byte more": lambda b: b + b"x",
    "one bit flipped": lambda b: b[:-5] + bytes([b[-5] ^ 1]) + b[-4:],
    "zeros, as after a power cut": lambda b: bytes(len(b)),
    "garbage": lambda b: os.urandom(len(b)),
}


def test_written_entries_are_read(place):
    assert cache.read("a.py") is None
    cache.write("a.py", SEVERAL)
    assert cache.read("a.py") == SEVERAL
    cache.write("a.py", b"other")
    assert cache.read("a.py") == b"other"
    assert [p.name for p in place.iterdir()] == ["a.py"]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_ignored_and_removed(place, damage):
    cache.write("a.py", SEVERAL)
    (place / "a.py").write_bytes(DAMAGES[damage]((place / "a.py").read_bytes()))
    assert cache.read("a.py") is None
    assert not (place / "a.py").exists()


def test_an_entry_copied_to_another_name_is_ignored(place):
    cache.write("a.py", SEVERAL)
    shutil.copy(place / "a.py", place / "b.py")
    assert cache.read("b.py") is None
    assert cache.read("a.py") == SEVERAL


# -- machine code ------------------------------------------------------------------------------------------------------


def compile_or_load(name="plus|1", options=vector.TUPLES):
    """(compiled function, whether it was loaded from the cache)."""
    function = machine.load_or_compile(lambda x: x + 1.0, SIGNATURE, dict(options), name)
    return function, sum(function.stats.cache_hits.values()) == 1


def files(place) -> list[Path]:
    """The files of the only folder of machine code: source, seal, index and code."""
    (home,) = place.iterdir()
    return sorted(p for p in home.glob("**/*") if p.is_file())


@pytest.mark.lowest
def test_machine_code_is_keyed_by_name_and_options(place):
    assert not compile_or_load()[1]
    function, loaded = compile_or_load()
    assert loaded
    assert function(1.5) == 2.5
    assert not compile_or_load("plus|2")[1]
    assert not compile_or_load(options=vector.ARRAYS)[1]


@pytest.mark.parametrize("suffix", ["seal", ".nbi", ".nbc"])
@pytest.mark.parametrize(
    "damage", [pytest.param(name, marks=[pytest.mark.lowest] * (name == "one bit flipped")) for name in DAMAGES]
)
def test_damaged_machine_code_is_compiled_again(place, damage, suffix):
    compile_or_load()
    (path,) = (p for p in files(place) if p.name.endswith(suffix))
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    function, loaded = compile_or_load()
    assert not loaded
    assert function(1.5) == 2.5
    assert compile_or_load()[1]


@pytest.mark.parametrize("suffix", ["seal", ".nbi", ".nbc", ".py"])
def test_machine_code_with_a_missing_file_is_compiled_again(place, suffix):
    compile_or_load()
    (path,) = (p for p in files(place) if p.name.endswith(suffix))
    path.unlink()
    function, loaded = compile_or_load()
    assert not loaded
    assert function(1.5) == 2.5
    assert compile_or_load()[1]


@pytest.mark.parametrize("content", [b"", b"no pickle", b"\x80\x04K\x01.", b"cphasebench.nothing\nsuch\n."])
def test_unusable_content_is_compiled_again(place, content):
    """An entry whose content cannot be loaded, though its seal is valid, is compiled again."""
    compile_or_load()
    (home,) = place.iterdir()
    for path in files(place):
        if path.suffix == ".nbc":
            path.write_bytes(content)
    (home / cache.SEAL).unlink()
    cache.seal(home.name)
    assert not compile_or_load()[1]
    assert compile_or_load()[1]


def test_code_that_allocates_runs_where_nothing_is_compiled(place):
    """Numba's runtime must be initialized before loaded code allocates, or the process would crash."""
    script = """
from phasebench.integrators.compile import machine
from phasebench.integrators.values import vector
import numba, numpy as np
number = numba.types.float64(numba.types.float64)
made = machine.load_or_compile(lambda x: np.zeros(2)[1] + x, number, dict(vector.ARRAYS), "x|allocates")
print(made(1.5), sum(made.stats.cache_hits.values()))
"""
    run = [subprocess.run([sys.executable, "-c", script], capture_output=True, text=True) for _ in range(2)]
    assert [done.stdout.split() for done in run] == [["1.5", "0"], ["1.5", "1"]]


def test_a_part_can_be_called_on_its_own(place):
    """A function that was compiled as a part of another one can still be called from Python."""

    @vector.jit
    def part(x):
        return x * 2.0

    whole = machine.load_or_compile(lambda x: part(x) + 1.0, SIGNATURE, dict(vector.TUPLES), "whole|1")
    assert whole(1.5) == 4.0
    assert part(1.5) == 3.0
    assert numba.njit(lambda x: part(x))(1.5) == 3.0


# -- nowhere to write --------------------------------------------------------------------------------------------------


def full(monkeypatch):
    """Make writing fail as on a full disk."""

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cache.os, "replace", refuse)


def no_folder(monkeypatch):
    """Put a file in the place of the cache folder."""
    place = Path(os.environ["PHASEBENCH_CACHE"])
    place.parent.mkdir(exist_ok=True, parents=True)
    place.write_text("a file")


def no_home(monkeypatch):
    """Leave no place for a cache."""
    monkeypatch.setattr(cache, "root", lambda: None)


@pytest.mark.parametrize("fault", [full, no_folder, no_home])
def test_an_unwritable_cache_warns_once(place, monkeypatch, caplog, fault):
    fault(monkeypatch)
    with caplog.at_level(logging.WARNING, "phasebench"):
        for k in range(3):
            cache.write(f"{k}.py", SEVERAL)
            assert cache.read(f"{k}.py") is None
        assert compile_or_load()[0](1.5) == 2.5
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()
    monkeypatch.undo()


def test_a_disk_that_fills_up_leaves_no_partial_entry(place):
    cache.write("a.py", b"before")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        cache.write("a.py", bytes(100_000))
        cache.write("b.py", bytes(100_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(cache._logged) == 1
    assert cache.read("a.py") == b"before"
    assert [p.name for p in place.iterdir()] == ["a.py"]


# -- several processes -------------------------------------------------------------------------------------------------

CONTENTS = [bytes([65 + k]) * (1000 + 20_000 * k) for k in range(5)]


def _write_often(times: int) -> None:
    """Write entry a.py repeatedly, with varying content."""
    for k in range(times):
        cache.write("a.py", CONTENTS[k % len(CONTENTS)])


def test_concurrent_writers_leave_complete_entries(place):
    cache.write("a.py", CONTENTS[0])
    workers = [multiprocessing.get_context("fork").Process(target=_write_often, args=(100,)) for _ in range(3)]
    for worker in workers:
        worker.start()
    seen = []
    while any(worker.is_alive() for worker in workers):
        seen.append(cache.read("a.py"))
    for worker in workers:
        worker.join()
    assert all(worker.exitcode == 0 for worker in workers)
    assert seen
    assert all(content in CONTENTS for content in seen)
    assert [p.name for p in place.iterdir()] == ["a.py"]


def _hold(seconds: float, holds, content: bytes | None) -> None:
    """Hold the lock of entry a.py for some seconds, then write it if there is content."""
    with cache.hold_lock("a.py"):
        holds.set()
        time.sleep(seconds)
        if content is not None:
            cache.write("a.py", content)


@contextmanager
def holder(seconds: float, content: bytes | None = None):
    """Context in which another process holds the lock of entry a.py for ``seconds``, then writes ``content``, if any.

    Yields the process.
    """
    fork = multiprocessing.get_context("fork")
    holds = fork.Event()
    process = fork.Process(target=_hold, args=(seconds, holds, content))
    process.start()
    try:
        assert holds.wait(10)
        yield process
    finally:
        process.kill()
        process.join()


def seconds_to_lock(name: str = "a.py") -> float:
    """Seconds until this process gets the lock of an entry."""
    started = time.monotonic()
    with cache.hold_lock(name):
        return time.monotonic() - started


def test_a_second_process_waits_and_finds_the_entry(place):
    with holder(0.5, SEVERAL), cache.hold_lock("a.py"):
        assert cache.read("a.py") == SEVERAL
    assert [p.name for p in place.iterdir()] == ["a.py"]


def test_existing_or_other_entries_are_not_waited_for(place):
    with holder(30.0):
        assert seconds_to_lock("b.py") < 5
        cache.write("a.py", SEVERAL)
        assert seconds_to_lock() < 5


def test_waiting_ends_when_the_entry_appears(place):
    with holder(30.0):
        threading.Timer(0.2, cache.write, ("a.py", SEVERAL)).start()
        assert 0.1 < seconds_to_lock() < 5


def test_a_killed_process_releases_its_lock(place):
    with holder(30.0) as process:
        process.kill()
        process.join()
        assert seconds_to_lock() < 5
    assert not list(place.iterdir())


def test_waiting_ends_after_patience(place, monkeypatch):
    monkeypatch.setattr(cache, "LOCK_TIMEOUT", 0.2)
    with holder(30.0):
        assert 0.2 <= seconds_to_lock() < 5
        assert (place / "a.py.lock").exists()  # still held by the other process


def test_a_lock_is_released_after_an_error(place):
    with pytest.raises(ValueError), cache.hold_lock("a.py"):
        raise ValueError
    assert seconds_to_lock() < 5
    assert not list(place.iterdir())


def _make_at_once(barrier, results) -> None:
    """Compile the same function at the same time as the other processes; report whether it was loaded."""
    barrier.wait()
    results.put(compile_or_load("met|1")[1])


def test_of_concurrent_processes_one_compiles(place):
    fork = multiprocessing.get_context("fork")
    barrier, results = fork.Barrier(3), fork.Queue()
    workers = [fork.Process(target=_make_at_once, args=(barrier, results)) for _ in range(3)]
    for worker in workers:
        worker.start()
    loaded = sorted(results.get(timeout=60) for _ in workers)
    for worker in workers:
        worker.join()
    assert loaded == [False, True, True]


# -- stale entries and size
# --------------------------------------------------------------------------------------------


def test_the_version_depends_on_compilers_and_processor(monkeypatch):
    now = cache.version.__wrapped__
    usual = now()
    monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    assert now() != usual
    monkeypatch.undo()
    monkeypatch.setattr(numba, "__version__", "0.0")
    assert now() != usual


def test_machine_code_is_keyed_by_the_code_of_what_it_calls(place, monkeypatch):
    """A kernel's modules count with all that they import; others do not."""
    assert f"{PACKAGE}.families.splitting" in machine.modules_of(splitting.run)
    assert f"{PACKAGE}.families.rigid" not in machine.modules_of(splitting.run)
    inner = machine.with_functions(lambda x: part(x), {"part": splitting.step})  # noqa: F821
    assert f"{PACKAGE}.families.splitting" in machine.modules_of(inner)
    compile_or_load()
    asked = []
    monkeypatch.setattr(machine, "digest_of", lambda modules: asked.append(modules) or "another")
    assert not compile_or_load()[1]
    assert compile_or_load()[1]
    assert all(__name__ in modules for modules in asked)


def fill_folder(name: str, size: int, age: float) -> Path:
    """Create a folder of the cache with an entry of that size, last used `age` seconds ago."""
    folder = cache.root() / name
    folder.mkdir(parents=True)
    (folder / "entry").write_bytes(bytes(size))
    os.utime(folder, (time.time() - age,) * 2)
    return folder


def test_the_longest_unused_version_is_evicted_first(place, monkeypatch):
    monkeypatch.setattr(cache, "MAX_BYTES", 2500)
    old, newer = fill_folder("py311-" + "0" * 16, 1000, 900), fill_folder("py312-" + "f" * 16, 1000, 500)
    foreign = fill_folder("photographs", 10_000, 9000)
    cache.write("a.py", bytes(1000))
    cache.evict()
    assert not old.exists()
    assert newer.exists()
    assert foreign.exists()
    assert cache.read("a.py") is not None
    monkeypatch.setattr(cache, "MAX_BYTES", 1100)
    cache.evict()
    assert not newer.exists()
    assert cache.read("a.py") is not None


def test_reading_counts_as_use(place):
    cache.write("a.py", SEVERAL)
    for name, ago in (("a.py", 0), ("b.py", 1000)):
        cache._note_use.cache_clear()
        os.utime(place, (time.time() - 1000,) * 2)
        cache.read(name)
        assert time.time() - cache._last_used(place) == pytest.approx(ago, abs=100)


def test_the_oldest_entries_are_evicted_next(place, monkeypatch):
    for k in range(4):
        cache.write(f"{k}.py", bytes(1000))
        os.utime(place / f"{k}.py", (time.time() - 100 + k,) * 2)
    monkeypatch.setattr(cache, "MAX_BYTES", 2500)
    cache.evict()
    assert [cache.read(f"{k}.py") is not None for k in range(4)] == [False, False, True, True]


def test_a_cache_at_its_bound_is_left_alone(place, monkeypatch):
    other = fill_folder("py311-" + "0" * 16, 1000, 900)
    cache.write("a.py", bytes(1000))
    whole = cache.size(place)[1] + cache.size(other)[1]
    monkeypatch.setattr(cache, "MAX_BYTES", whole)
    cache.evict()
    assert other.exists()
    monkeypatch.setattr(cache, "MAX_BYTES", whole - 1)
    cache.evict()
    assert not other.exists()
    monkeypatch.setattr(cache, "MAX_BYTES", cache.size(place)[1])
    cache.evict()
    assert cache.read("a.py") is not None


def test_files_removed_by_another_process_are_skipped(place, monkeypatch):
    cache.write("a.py", bytes(1000))
    gone, old = cache.root() / ("py311-" + "0" * 16), 2 * cache.STALE_AFTER
    listed = [(time.time() - old, 4, place / "left.tmp"), (0.0, 1000, place / "b.py")]
    monkeypatch.setattr(cache, "versions", lambda: iter([gone]))
    monkeypatch.setattr(cache, "_entries", lambda of: listed if of == place else [(0.0, 10, gone / "c.py")])
    monkeypatch.setattr(cache, "MAX_BYTES", 0)
    cache.evict()
    assert cache.read("a.py") is not None


def test_without_a_folder_nothing_waits(place, monkeypatch):
    monkeypatch.setattr(cache, "folder", lambda: None)
    with cache.hold_lock("a.py"):
        pass
    assert not place.exists()


def test_leftovers_of_a_killed_process_are_removed(place):
    cache.write("a.py", SEVERAL)
    for name, age in (("old.tmp", 2 * cache.STALE_AFTER), ("old.lock", 2 * cache.STALE_AFTER), ("new.tmp", 0)):
        (place / name).write_bytes(b"part")
        os.utime(place / name, (time.time() - age,) * 2)
    cache.evict()
    assert sorted(p.name for p in place.iterdir()) == ["a.py", "new.tmp"]


def test_clearing_leaves_foreign_files(place):
    cache.write("a.py", SEVERAL)
    foreign = fill_folder("photographs", 10, 0)
    cache.clear()
    assert not place.exists()
    assert foreign.exists()


# -- in a new process --------------------------------------------------------------------------------------------------

RUN = """
from phasebench.integrators import Hamiltonian, integrate
pendulum = Hamiltonian(q="q", p="p", H="p**2/2 - cos(q)")
print(integrate(pendulum, "stormer-verlet", h=0.1, steps=10, q0=[1.0], p0=[0.2]).q[-1, 0])
"""


def run_in_process() -> tuple[str, str]:
    """(stdout, stderr) of the script `RUN`."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


def test_runs_agree_with_a_damaged_cache_and_without_one(place):
    first = run_in_process()
    assert not first[1]
    for k, path in enumerate(sorted(p for p in place.glob("**/*") if p.is_file())):
        path.write_bytes(list(DAMAGES.values())[k % len(DAMAGES)](path.read_bytes()))
    assert run_in_process() == first
    shutil.rmtree(cache.root())
    cache.root().write_text("a file")
    printed, complaints = run_in_process()
    assert printed == first[0]
    assert len(complaints.splitlines()) == 1
