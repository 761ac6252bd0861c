"""Runs on a cluster: the rows equal those of one machine, and the death of a worker loses nothing."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from phasebench.benchmarks.store import cells as kinds
from phasebench.benchmarks.store import run
from phasebench.benchmarks.store.cluster import Cluster
from phasebench.integrators.errors import InvalidInput
from support import toy_cells

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def local():
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "memory_limit": 0}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(toy_cells.__file__).parents[1]))
        with distributed.LocalCluster(**options) as cluster:
            yield cluster


def sorted_rows(outcome) -> list:
    """The rows measured in a run, sorted, as tuples."""
    return sorted((r["n"], r["x"], r["name"]) for r in outcome.rows("toys"))


@contextmanager
def killing(local):
    """A progress callback that has a worker of the cluster killed after the third cell."""
    pid = next(iter(local.workers.values())).pid
    done = threading.Event()

    def kill():
        done.wait(60)
        os.kill(pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    yield lambda what, finished, *_: done.set() if finished == 3 else None
    killer.join()


def test_death_of_a_worker_loses_nothing(local, tmp_path):
    toys = [toy_cells.cell(n, 0.3, where=kinds.POOL) for n in range(12)]
    cluster = Cluster(local.scheduler_address)
    with killing(local) as progress:
        outcome = run.execute(
            toys, tmp_path / "there", count=1, seed=0, progress=progress, cluster=cluster, everything=True
        )
    cluster.close()
    here = run.execute(toys, tmp_path / "here", count=0, seed=0, everything=True)
    assert not outcome.failed
    assert sorted_rows(outcome) == sorted_rows(here)
    assert len(outcome.entries) == len(toys)


def test_timed_cells_stay_local_and_failures_are_reported(local, tmp_path):
    toys = [toy_cells.cell(0, where=kinds.POOL), toy_cells.cell(1, where=kinds.ALONE)]
    toys += [toy_cells.cell(2, function=toy_cells.fail), toy_cells.cell(4, function=toy_cells.die)]
    cluster = Cluster(local.scheduler_address)
    there, measure = [], cluster.measure
    cluster.measure = lambda cells, *more: (there.extend(c.id for c in cells), measure(cells, *more))[1]
    outcome = run.execute(toys, tmp_path, count=1, seed=0, cluster=cluster, everything=True)
    cluster.close()
    assert there == [toys[k].id for k in (0, 2, 3)], "what is timed is measured here"
    assert {cell.id for cell in toys[:2]} == set(outcome.entries)
    assert "there is no 2" in outcome.failed[toys[2].id]
    assert "died" in outcome.failed[toys[3].id]


def test_address_without_a_scheduler_is_refused(monkeypatch):
    monkeypatch.setattr("phasebench.benchmarks.store.cluster.PATIENCE", 0.5)
    with pytest.raises(InvalidInput, match="no scheduler answers"):
        Cluster("tcp://127.0.0.1:1")
