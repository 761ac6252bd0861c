"""The audit of floating-point modes: peers that change the mode are found; a changed process judges no peer."""

from __future__ import annotations

from dataclasses import replace

import pytest

from phasebench.benchmarks.audit import cases
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.store import workers
from phasebench.benchmarks.studies.audit import modes
from phasebench.reference.peers import BY_ID, Run, floating
from support import toy_cells
from support.flushing import flush, only_there
from support.planted import control


def peer(run=None, **more) -> Integrator:
    """A made-up peer whose run returns its initial state, or is ``run``."""
    still = run or (lambda task: Run.stuck(task, 0, 0, 0.0))
    return Integrator(replace(control("stormer-verlet"), run=still, lacks=lambda problem, system: None, **more))


def raising(error, after=lambda: None):
    """A run that calls ``after`` and raises the error."""

    def run(*_):
        after()
        raise error

    return run


def flushing(task):
    """A run that sets the processor to flush subnormal numbers to zero."""
    flush()
    return Run.stuck(task, 0, 0, 0.0)


@only_there
@pytest.mark.parametrize(
    ("chosen", "mode", "status"),
    [
        (peer(), modes.KEPT, "ok"),
        (peer(flushing), modes.BY_RUN, "ok"),
        (peer(raising(ValueError("broken"), flush)), modes.BY_RUN, "ok"),
        (peer(raising(ValueError("broken"))), None, "invalid"),
        (peer(load=lambda name: flush()), modes.BY_LOADING, "ok"),
        (peer(load=raising(ImportError("gone"))), None, "skipped"),
    ],
    ids=["kept", "run", "raises-later", "raises", "loading", "gone"],
)
def test_mode_change_by_a_run_is_found(chosen, mode, status):
    try:
        found = modes.row(chosen)
    finally:
        flush(False)
    assert (found["mode"], found["status"]) == (mode, status)
    assert found["problem"] == "kepler"


@only_there
def test_process_with_a_changed_mode_judges_nobody():
    flush()
    try:
        found = modes.row(peer())
    finally:
        flush(False)
    assert (found["mode"], found["status"]) == (None, "invalid")
    assert modes.row(peer())["mode"] == modes.KEPT


def test_peer_without_a_problem_is_skipped():
    nothing = Integrator(replace(control("rk4"), lacks=lambda problem, system: "it cannot"))
    assert modes.row(nothing)["status"] == "skipped"


IDS = ("rk4", "gauss-2", "rebound-leapfrog")


@pytest.mark.parametrize(("good", "processes"), [(True, 1), (False, 3)])
def test_process_is_replaced_after_a_mode_change(monkeypatch, importable, good, processes):
    monkeypatch.setattr(modes, "judge", toy_cells.judge_well if good else toy_cells.judge_badly)
    rows = modes.judge_all(IDS)
    assert [r["peer"] for r in rows] == list(IDS)
    assert len({r["in"] for r in rows}) == processes


def test_dead_process_gives_a_row_and_the_next_continues(monkeypatch, importable):
    monkeypatch.setattr(modes, "judge", toy_cells.judge_dying_of_rk4)
    died, *others = modes.judge_all(IDS)
    assert (died["peer"], died["status"], died["mode"]) == ("rk4", "invalid", None)
    assert died["reason"] == workers.DIED
    assert [r["peer"] for r in others] == ["gauss-2", "rebound-leapfrog"]


def test_peer_that_died_after_others_is_judged_alone(monkeypatch, importable):
    monkeypatch.setattr(modes, "judge", toy_cells.judge_dying_second)
    rows = modes.judge_all(IDS)
    assert [r["peer"] for r in rows] == list(IDS)
    assert len({r["in"] for r in rows}) == 3, "each was the first of its process"


def test_whfast512_changes_the_mode_in_a_fresh_process():
    whfast = BY_ID["rebound-whfast512"]
    if whfast.lacks(None, cases.problem(cases.BY_NAME["kepler"]).system):
        pytest.skip("no AVX512")
    found = {r["peer"]: r for r in modes.judge_all([whfast.id, "rebound-whfast-plain"])}
    assert {r["status"] for r in found.values()} == {"ok"}
    assert found["rebound-whfast-plain"]["mode"] == modes.KEPT
    assert floating.gradual()
    if found[whfast.id]["version"] != "5.2.2":
        pytest.skip("what other versions do is not known")
    assert found[whfast.id]["mode"] == modes.BY_RUN
