"""A peer's run leaves the process's floating-point mode as it was, whatever its package does to it."""

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
    """A peer whose run switches flushing on or off, and may raise."""
    honest = control("stormer-verlet")

    def run(task):
        flush(on)
        if then is not None:
            raise then
        return honest.run(task)

    return replace(honest, run=run)


@pytest.fixture(autouse=True)
def as_before():
    """The mode of the tests is their own, before and after."""
    assert floating.gradual()
    yield
    flush(False)


def test_the_switch_is_seen():
    flush()
    assert not floating.gradual()
    flush(False)
    assert floating.gradual()


def test_the_least_number_is_what_is_lost(monkeypatch):
    assert floating.LEAST.hex() == "0x0.0000000000001p-1022"
    monkeypatch.setattr(flushing, "BITS", 0x8000)  # results alone, not what enters
    flush()
    assert not floating.gradual()


def test_a_run_that_switches_is_taken_back():
    assert integrate_peer(problem("pendulum"), switching(True), **RUN).status == "ok"
    assert floating.gradual()


def test_so_is_one_that_raises():
    with pytest.raises(ZeroDivisionError):
        integrate_peer(problem("pendulum"), switching(True, ZeroDivisionError()), **RUN)
    assert floating.gradual()


def test_so_is_loading():
    peer = replace(control("stormer-verlet"), load=lambda name: flush())
    integrate_peer(problem("pendulum"), peer, **RUN)
    assert floating.gradual()


@pytest.mark.parametrize("on", [True, False])
def test_a_mode_of_the_users_own_is_kept(on):
    flush()
    integrate_peer(problem("pendulum"), switching(on), **RUN)
    assert not floating.gradual()


def test_without_the_c_library_a_run_goes_on(monkeypatch):
    monkeypatch.setattr(floating, "_library", lambda: None)
    assert integrate_peer(problem("pendulum"), switching(True), **RUN).status == "ok"
    assert not floating.gradual(), "nothing took it back"


@pytest.mark.parametrize("id", ["rebound-whfast512", "rebound-whfast512-corrector-17"])
def test_whfast512(id):
    kepler = problem("kepler")
    if lack := BY_ID[id].lacks(kepler, kepler.system):
        pytest.skip(lack)
    integrate_peer(kepler, id, **RUN)
    assert floating.gradual()
