"""The cache: what is damaged is made again, what cannot be written is done without, nothing stale is found."""

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
import numpy as np
import pytest
from numba.core.registry import cpu_target

from phasebench.integrators.engine import cache, machine, vector

SEVERAL = b"text of a function\n" * 50
SIGNATURE = numba.types.float64(numba.types.float64)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache for this process."""
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_said", [])
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


def test_what_was_written_is_read(place):
    assert cache.read("a.py") is None
    cache.write("a.py", SEVERAL)
    assert cache.read("a.py") == SEVERAL
    cache.write("a.py", b"other")
    assert cache.read("a.py") == b"other"
    assert [p.name for p in place.iterdir()] == ["a.py"]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_no_entry(place, damage):
    cache.write("a.py", SEVERAL)
    (place / "a.py").write_bytes(DAMAGES[damage]((place / "a.py").read_bytes()))
    assert cache.read("a.py") is None
    assert not (place / "a.py").exists()


def test_an_entry_under_another_name_is_no_entry(place):
    cache.write("a.py", SEVERAL)
    shutil.copy(place / "a.py", place / "b.py")
    assert cache.read("b.py") is None
    assert cache.read("a.py") == SEVERAL


# -- machine code ------------------------------------------------------------------------------------------------------


def made(name="plus|1", options=vector.TUPLES):
    """(a compiled function, whether it was loaded)."""
    function = machine.compiled(lambda x: x + 1.0, SIGNATURE, dict(options), name)
    return function, sum(function.stats.cache_hits.values()) == 1


@pytest.mark.lowest
def test_machine_code_is_loaded_and_is_of_its_name_and_options(place):
    assert not made()[1]
    function, loaded = made()
    assert loaded
    assert function(1.5) == 2.5
    assert not made("plus|2")[1]
    assert not made(options=vector.ARRAYS)[1]


@pytest.mark.parametrize(
    "damage", [pytest.param(name, marks=[pytest.mark.lowest] * (name == "one bit flipped")) for name in DAMAGES]
)
def test_damaged_machine_code_is_made_again(place, damage):
    made()
    (path,) = place.iterdir()
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    function, loaded = made()
    assert not loaded
    assert function(1.5) == 2.5
    assert made()[1]


@pytest.mark.parametrize("content", [b"", b"no pickle", b"\x80\x04K\x01.", b"cphasebench.nothing\nsuch\n."])
def test_whole_entries_that_cannot_be_used_are_made_again(place, content):
    made()
    (path,) = place.iterdir()
    cache.write(path.name, content)
    assert not made()[1]
    assert made()[1]


@pytest.mark.parametrize(
    ("function", "allocates"),
    [(lambda x: np.zeros(2)[1] + x, True), (lambda x: x + 0.0, False)],
    ids=["array", "number"],
)
def test_a_process_that_loads_what_allocates_is_made_ready_for_it(place, monkeypatch, function, allocates):
    """One that has compiled is ready; another would end at the first allocation."""
    about = SIGNATURE, dict(vector.ARRAYS), f"x|{allocates}"
    machine.compiled(function, *about)
    told = []
    monkeypatch.setattr(machine.rtsys, "initialize", told.append)
    loaded = machine.compiled(function, *about)
    assert sum(loaded.stats.cache_hits.values()) == 1
    assert loaded(1.5) == 1.5
    assert bool(told) == allocates


def test_a_part_of_another_function_can_be_called_all_the_same(place):
    """As a part it has no machine code of its own."""

    @vector.jit
    def part(x):
        return x * 2.0

    whole = machine.compiled(lambda x: part(x) + 1.0, SIGNATURE, dict(vector.TUPLES), "whole|1")
    assert whole(1.5) == 4.0
    assert part(1.5) == 3.0
    assert numba.njit(lambda x: part(x))(1.5) == 3.0
    assert not [name for name in vars(cpu_target.target_context) if name.startswith("create_")]  # as Numba left it


def test_a_part_is_optimized_once_and_has_no_entries(place):
    """Variables are values, not places in memory; and there is the function alone, which Python and C do not call."""

    @vector.jit
    def part(x):
        for k in range(3):
            x = x * x + k
        return x

    machine.compiled(lambda x: part(x) + 1.0, SIGNATURE, dict(vector.TUPLES), "whole|part")
    text = str(next(iter(part.overloads.values())).library.alone())
    assert text.count("\ndefine ") == 1
    assert "alloca" not in text


def test_parts_that_share_parts_can_be_called_and_linked_again(place):
    @vector.jit
    def shared(x):
        vector.apart()
        return x * 2.0

    @vector.jit
    def one(x):
        return shared(x) + 1.0

    @vector.jit
    def other(x):
        return shared(one(x)) + shared(x)

    first = machine.compiled(lambda x: one(x) + other(x), SIGNATURE, dict(vector.TUPLES), "whole|2")
    second = machine.compiled(lambda x: other(x) - one(x), SIGNATURE, dict(vector.TUPLES), "whole|3")
    assert (first(1.5), second(1.5)) == (4.0 + 11.0, 11.0 - 4.0)
    assert other(1.5) == numba.njit(lambda x: other(x))(1.5) == 11.0, "outside of what was compiled"


# -- nowhere to write --------------------------------------------------------------------------------------------------


def full(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(cache.os, "replace", refuse)


def no_folder(monkeypatch):
    place = Path(os.environ["PHASEBENCH_CACHE"])
    place.parent.mkdir(exist_ok=True, parents=True)
    place.write_text("a file")


def no_home(monkeypatch):
    monkeypatch.setattr(cache, "root", lambda: None)


@pytest.mark.parametrize("fault", [full, no_folder, no_home])
def test_where_nothing_can_be_written_one_line_says_so(place, monkeypatch, caplog, fault):
    fault(monkeypatch)
    with caplog.at_level(logging.WARNING, "phasebench"):
        for k in range(3):
            cache.write(f"{k}.py", SEVERAL)
            assert cache.read(f"{k}.py") is None
        assert made()[0](1.5) == 2.5
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()
    monkeypatch.undo()


def test_a_disk_that_fills_in_the_middle_leaves_nothing(place):
    cache.write("a.py", b"before")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        cache.write("a.py", bytes(100_000))
        cache.write("b.py", bytes(100_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(cache._said) == 1
    assert cache.read("a.py") == b"before"
    assert [p.name for p in place.iterdir()] == ["a.py"]


# -- several processes -------------------------------------------------------------------------------------------------

CONTENTS = [bytes([65 + k]) * (1000 + 20_000 * k) for k in range(5)]


def _write_often(times: int) -> None:
    for k in range(times):
        cache.write("a.py", CONTENTS[k % len(CONTENTS)])


def test_processes_that_write_at_once_leave_whole_entries(place):
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
    with cache.alone("a.py"):
        holds.set()
        time.sleep(seconds)
        if content is not None:
            cache.write("a.py", content)


@contextmanager
def holder(seconds: float, content: bytes | None = None):
    """A process that makes an entry for so long."""
    fork = multiprocessing.get_context("fork")
    holds = fork.Event()
    process = fork.Process(target=_hold, args=(seconds, holds, content))
    process.start()
    assert holds.wait(10)
    yield process
    process.kill()
    process.join()


def waited() -> float:
    """Seconds until this process may make the entry."""
    started = time.monotonic()
    with cache.alone("a.py"):
        return time.monotonic() - started


def test_who_comes_later_waits_and_finds_the_entry(place):
    with holder(0.5, SEVERAL), cache.alone("a.py"):
        assert cache.read("a.py") == SEVERAL
    assert [p.name for p in place.iterdir()] == ["a.py"]


def test_nobody_waits_for_an_entry_that_is_there_or_for_another(place):
    with holder(30.0):
        with cache.alone("b.py"):
            pass
        cache.write("a.py", SEVERAL)
        assert waited() < 5


def test_nobody_waits_once_the_entry_has_come(place):
    with holder(30.0):
        threading.Timer(0.2, cache.write, ("a.py", SEVERAL)).start()
        assert 0.1 < waited() < 5


def test_a_process_that_is_killed_keeps_nobody_waiting(place):
    with holder(30.0) as process:
        process.kill()
        process.join()
        assert waited() < 5
    assert not list(place.iterdir())


def test_patience_ends(place, monkeypatch):
    monkeypatch.setattr(cache, "PATIENCE", 0.2)
    with holder(30.0):
        assert 0.2 <= waited() < 5
        assert (place / "a.py.lock").exists()  # the holder's still


def test_a_lock_is_given_back_after_an_error_too(place):
    with pytest.raises(ValueError), cache.alone("a.py"):
        raise ValueError
    assert waited() < 5
    assert not list(place.iterdir())


def _make_at_once(barrier, results) -> None:
    barrier.wait()
    results.put(made("met|1")[1])


def test_of_processes_that_meet_on_a_kernel_one_compiles(place):
    fork = multiprocessing.get_context("fork")
    barrier, results = fork.Barrier(3), fork.Queue()
    workers = [fork.Process(target=_make_at_once, args=(barrier, results)) for _ in range(3)]
    for worker in workers:
        worker.start()
    loaded = sorted(results.get(timeout=60) for _ in workers)
    for worker in workers:
        worker.join()
    assert loaded == [False, True, True]


# -- what is stale, what is too much -----------------------------------------------------------------------------------


def test_the_version_is_of_the_source_and_of_the_processor(tmp_path, monkeypatch):
    package = Path(cache.__file__).parents[1]
    copy = tmp_path / "copy"
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    now = cache.version.__wrapped__
    usual = now()
    monkeypatch.setattr(cache, "__file__", str(copy / "engine" / "cache.py"))
    assert now() == usual
    source = copy / "families" / "splitting.py"
    source.write_text(source.read_text() + "\n")
    assert now() != usual
    monkeypatch.undo()
    monkeypatch.setattr(numba.config, "CPU_NAME", "generic")
    assert now() != usual
    monkeypatch.undo()
    monkeypatch.setattr(numba, "__version__", "0.0")
    assert now() != usual


def filled(name: str, size: int, age: float) -> Path:
    folder = cache.root() / name
    folder.mkdir(parents=True)
    (folder / "entry").write_bytes(bytes(size))
    os.utime(folder, (time.time() - age,) * 2)
    return folder


def test_the_longest_unused_version_goes_first(place, monkeypatch):
    monkeypatch.setattr(cache, "BOUND", 2500)
    old, newer = filled("py311-" + "0" * 16, 1000, 900), filled("py312-" + "f" * 16, 1000, 500)
    foreign = filled("photographs", 10_000, 9000)
    cache.write("a.py", bytes(1000))
    cache.evict()
    assert not old.exists()
    assert newer.exists()
    assert foreign.exists()
    assert cache.read("a.py") is not None
    monkeypatch.setattr(cache, "BOUND", 1100)
    cache.evict()
    assert not newer.exists()
    assert cache.read("a.py") is not None


def test_reading_is_use(place):
    cache.write("a.py", SEVERAL)
    for name, ago in (("a.py", 0), ("b.py", 1000)):
        cache._note_use.cache_clear()
        os.utime(place, (time.time() - 1000,) * 2)
        cache.read(name)
        assert time.time() - cache._used(place) == pytest.approx(ago, abs=100)


def test_then_the_oldest_entries_go(place, monkeypatch):
    for k in range(4):
        cache.write(f"{k}.py", bytes(1000))
        os.utime(place / f"{k}.py", (time.time() - 100 + k,) * 2)
    monkeypatch.setattr(cache, "BOUND", 2500)
    cache.evict()
    assert [cache.read(f"{k}.py") is not None for k in range(4)] == [False, False, True, True]


def test_a_folder_of_just_the_bound_stays_as_it_is(place, monkeypatch):
    other = filled("py311-" + "0" * 16, 1000, 900)
    cache.write("a.py", bytes(1000))
    whole = cache.size(place)[1] + cache.size(other)[1]
    monkeypatch.setattr(cache, "BOUND", whole)
    cache.evict()
    assert other.exists()
    monkeypatch.setattr(cache, "BOUND", whole - 1)
    cache.evict()
    assert not other.exists()
    monkeypatch.setattr(cache, "BOUND", cache.size(place)[1])
    cache.evict()
    assert cache.read("a.py") is not None


def test_what_another_process_has_removed_meanwhile_is_passed_over(place, monkeypatch):
    cache.write("a.py", bytes(1000))
    gone, old = cache.root() / ("py311-" + "0" * 16), 2 * cache.ABANDONED
    listed = [(time.time() - old, 4, place / "left.tmp"), (0.0, 1000, place / "b.py")]
    monkeypatch.setattr(cache, "versions", lambda: iter([gone]))
    monkeypatch.setattr(cache, "_entries", lambda of: listed if of == place else [(0.0, 10, gone / "c.py")])
    monkeypatch.setattr(cache, "BOUND", 0)
    cache.evict()
    assert cache.read("a.py") is not None


def test_where_there_is_no_folder_nobody_waits(place, monkeypatch):
    monkeypatch.setattr(cache, "folder", lambda: None)
    with cache.alone("a.py"):
        pass
    assert not place.exists()


def test_what_a_killed_process_left_is_removed(place):
    cache.write("a.py", SEVERAL)
    for name, age in (("old.tmp", 2 * cache.ABANDONED), ("old.lock", 2 * cache.ABANDONED), ("new.tmp", 0)):
        (place / name).write_bytes(b"part")
        os.utime(place / name, (time.time() - age,) * 2)
    cache.evict()
    assert sorted(p.name for p in place.iterdir()) == ["a.py", "new.tmp"]


def test_clearing_leaves_what_is_not_its_own(place):
    cache.write("a.py", SEVERAL)
    foreign = filled("photographs", 10, 0)
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
    """(what it prints, what it complains of)."""
    done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


def test_a_run_survives_a_cache_of_garbage_and_none(place):
    first = run_in_process()
    assert not first[1]
    for k, path in enumerate(sorted(place.iterdir())):
        path.write_bytes(list(DAMAGES.values())[k % len(DAMAGES)](path.read_bytes()))
    assert run_in_process() == first
    shutil.rmtree(cache.root())
    cache.root().write_text("a file")
    printed, complaints = run_in_process()
    assert printed == first[0]
    assert len(complaints.splitlines()) == 1
