"""A run on a cluster: the rows of one machine, and a worker that dies loses nothing."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest

from phasebench.benchmarks.rows import cells as kinds
from phasebench.benchmarks.rows import run
from phasebench.benchmarks.rows.cluster import Cluster
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


def told(outcome) -> list:
    return sorted((r["n"], r["x"], r["name"]) for r in outcome.rows("toys"))


def test_a_worker_that_dies_loses_nothing(local, tmp_path):
    toys = [toy_cells.cell(n, 0.3, where=kinds.POOL) for n in range(12)]
    pid = next(iter(local.workers.values())).pid
    done = threading.Event()

    def kill():
        done.wait(60)
        os.kill(pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    progress = lambda experiment, finished, *_: done.set() if finished == 3 else None  # noqa: E731
    cluster = Cluster(local.scheduler_address)
    outcome = run.execute(
        toys, tmp_path / "there", count=1, seed=0, progress=progress, cluster=cluster, everything=True
    )
    killer.join()
    cluster.close()
    here = run.execute(toys, tmp_path / "here", count=0, seed=0, everything=True)
    assert not outcome.failed
    assert told(outcome) == told(here)
    assert len(cluster.machines) == len(toys)


def test_what_is_timed_is_measured_here_and_what_fails_says_why(local, tmp_path):
    toys = [toy_cells.cell(0, where=kinds.POOL), toy_cells.cell(1, where=kinds.ALONE)]
    toys += [toy_cells.cell(2, function=toy_cells.fail), toy_cells.cell(4, function=toy_cells.die)]
    cluster = Cluster(local.scheduler_address)
    outcome = run.execute(toys, tmp_path, count=1, seed=0, cluster=cluster, everything=True)
    cluster.close()
    assert toys[1].id in outcome.entries
    assert toys[1].id not in cluster.machines
    assert toys[0].id in cluster.machines
    assert "there is no 2" in outcome.failed[toys[2].id]
    assert "died" in outcome.failed[toys[3].id]


def test_a_deadline_ends_the_wait(local):
    cluster = Cluster(local.scheduler_address)
    began = time.monotonic()
    found = list(cluster.measured([toy_cells.cell(0, 20.0, where=kinds.POOL)], kinds.POOL, began + 1.0))
    cluster.close()
    assert found == []
    assert time.monotonic() - began < 10


def test_an_address_where_nobody_answers_is_refused(monkeypatch):
    monkeypatch.setattr("phasebench.benchmarks.rows.cluster.PATIENCE", 0.5)
    with pytest.raises(InvalidInput, match="no scheduler answers"):
        Cluster("tcp://127.0.0.1:1")
