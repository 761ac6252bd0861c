"""A peer's run leaves the floating-point mode of the process unchanged, whatever its package does."""

from __future__ import annotations

from dataclasses import replace

import pytest

from phasebench.benchmarks.problems import problem
from phasebench.reference.peers import BY_ID, floating, integrate_peer
from support import flushing
from support.flushing import flush, only_there
from support.planted import control

pytestmark = only_there
RUN = {"h": 0.1, "steps": 2}


def switching(on: bool, then=None):
    """A peer whose run switches flushing to zero on or off, and may raise."""
    honest = control("stormer-verlet")

    def run(task):
        flush(on)
        if then is not None:
            raise then
        return honest.run(task)

    return replace(honest, run=run)


@pytest.fixture(autouse=True)
def as_before():
    """Denormal numbers are on before and after each test."""
    assert floating.gradual()
    yield
    flush(False)


def test_flushing_is_detected():
    flush()
    assert not floating.gradual()
    flush(False)
    assert floating.gradual()


def test_the_least_denormal_number_is_lost_by_flushing(monkeypatch):
    assert floating.LEAST.hex() == "0x0.0000000000001p-1022"
    monkeypatch.setattr(flushing, "BITS", 0x8000)  # FTZ only: results are flushed, inputs are not
    flush()
    assert not floating.gradual()


def test_the_mode_is_restored_after_a_run():
    assert integrate_peer(problem("pendulum"), switching(True), **RUN).status == "ok"
    assert floating.gradual()


def test_the_mode_is_restored_after_an_exception():
    with pytest.raises(ZeroDivisionError):
        integrate_peer(problem("pendulum"), switching(True, ZeroDivisionError()), **RUN)
    assert floating.gradual()


def test_the_mode_is_restored_after_loading():
    peer = replace(control("stormer-verlet"), load=lambda name: flush())
    integrate_peer(problem("pendulum"), peer, **RUN)
    assert floating.gradual()


@pytest.mark.parametrize("on", [True, False])
def test_the_users_own_mode_is_kept(on):
    flush()
    integrate_peer(problem("pendulum"), switching(on), **RUN)
    assert not floating.gradual()


def test_without_the_c_library_a_run_still_works(monkeypatch):
    monkeypatch.setattr(floating, "_library", lambda: None)
    assert integrate_peer(problem("pendulum"), switching(True), **RUN).status == "ok"
    assert not floating.gradual(), "nothing took it back"


@pytest.mark.parametrize("id", ["rebound-whfast512", "rebound-whfast512-corrector-17"])
def test_whfast512_restores_the_mode(id):
    kepler = problem("kepler")
    if lack := BY_ID[id].lacks(kepler, kepler.system):
        pytest.skip(lack)
    integrate_peer(kepler, id, **RUN)
    assert floating.gradual()
