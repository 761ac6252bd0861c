"""Work shared between threads: every piece is done once, and nothing waits for a busy thread."""

from __future__ import annotations

import os
import threading
import time

import pytest

from phasebench.integrators import threads
from phasebench.integrators.threads import MANY, Slices, map_slices


def numbers(parts) -> list[int]:
    """All indices in some slices, sorted."""
    return sorted(i for part in parts for i in range(part.start, part.stop))


@pytest.mark.parametrize("n", [0, 1, 2, 7, MANY - 1, MANY, 1000])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_every_piece_is_done_once(n, count):
    assert numbers(map_slices(lambda part: part, n, count)) == list(range(n))


def test_short_work_is_not_split_into_tiny_slices():
    slices = Slices(1000, 2)
    slices.adapt(slice(40, 50), threads.LEAST / 10)
    assert [part.stop - part.start for part in slices] == [250, 188, 141, 106, 100, 100, 100, 15]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_child_does_not_inherit_threads():
    assert numbers(part for part, _ in map_slices(slow, 4, 2)) == [0, 1, 2, 3]
    assert threads._helpers.cache_info().currsize > 0
    child = os.fork()
    if child == 0:
        os._exit(threads._helpers.cache_info().currsize)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def slow(part: slice):
    """Work of 3 ms per piece; returns its thread."""
    time.sleep(0.003 * (part.stop - part.start))
    return part, threading.get_ident()


def test_long_work_is_shared_and_short_work_is_not(monkeypatch):
    assert len({who for _, who in map_slices(slow, MANY, 2)}) == 2
    monkeypatch.setattr(threads, "_helpers", None)  # would fail if called
    assert numbers(map_slices(lambda part: part, MANY, 2)) == list(range(MANY))
    with pytest.raises(TypeError, match="not callable"):
        list(map_slices(slow, MANY, 2))


def test_a_busy_thread_is_not_waited_for():
    blocked, pool = threading.Event(), threads._helpers(1)
    running = pool.submit(blocked.wait, 8)
    began = time.monotonic()
    try:
        found = list(map_slices(slow, 8, 2))
        assert time.monotonic() - began < 6
    finally:
        blocked.set()
        running.result()
    assert numbers(part for part, _ in found) == list(range(8))
    assert {who for _, who in found} == {threading.get_ident()}


@pytest.mark.parametrize("here", [True, False])
def test_an_exception_on_any_thread_ends_the_work(here):
    done, begun, raised = [], threading.Event(), threading.Event()

    def work(part):
        if (threading.current_thread() is threading.main_thread()) == here:
            begun.wait(5)
            raised.set()
            raise ZeroDivisionError
        begun.set()
        raised.wait(5)
        time.sleep(0.05)
        done.append(part)

    n = MANY - 1
    with pytest.raises(ZeroDivisionError):
        list(map_slices(work, n, 2))
    assert len(done) == 1


def test_interrupted_work_is_halted_on_all_threads():
    """The calling thread is interrupted in its first slice; the others, which would never end, look at the event."""
    halt, caller = threading.Event(), threading.get_ident()

    def work(part):
        while threading.get_ident() != caller:
            if halt.wait(0.01):
                raise threads.Halted
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        list(map_slices(work, 8, 2, halt))
    assert halt.is_set()
