"""A peer's run leaves the floating-point mode of the process unchanged, whatever its package does."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import pytest

from phasebench.benchmarks.problems import problem
from phasebench.reference.peers import BY_ID, floating, integrate_peer
from phasebench.reference.peers.prepared import prepare_peer
from support import flushing
from support.flushing import flush, only_there
from support.planted import control

pytestmark = only_there


@pytest.fixture(autouse=True)
def as_before():
    """Denormal numbers are on before and after each test."""
    assert floating.gradual()
    yield
    flush(False)


@pytest.mark.parametrize("bits", [flushing.BITS, 0x8000])  # the second: results are flushed, inputs are not
def test_flushing_is_detected(bits, monkeypatch):
    assert floating.LEAST.hex() == "0x0.0000000000001p-1022"
    monkeypatch.setattr(flushing, "BITS", bits)
    flush()
    assert not floating.gradual()
    flush(False)
    assert floating.gradual()


def failing(task):
    """A run that switches flushing on and fails."""
    flush()
    raise ZeroDivisionError


honest = control("stormer-verlet")
#: A peer -> whether its run changes the mode of a process that flushes already.
SWITCHING = {
    "on": replace(honest, run=lambda task: flush() or honest.run(task)),
    "off": replace(honest, run=lambda task: flush(False) or honest.run(task)),
    "fails": replace(honest, run=failing),
    "loads": replace(honest, load=lambda name: flush()),
}


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("what", SWITCHING)
def test_the_users_own_mode_is_kept(what, before):
    flush(not before)
    with contextlib.suppress(ZeroDivisionError):
        assert integrate_peer(problem("pendulum"), SWITCHING[what], h=0.1, steps=2).status == "ok"
    assert floating.gradual() == before


def test_control_without_the_c_library_nothing_takes_it_back(monkeypatch):
    monkeypatch.setattr(floating, "_library", lambda: None)
    assert integrate_peer(problem("pendulum"), SWITCHING["on"], h=0.1, steps=2).status == "ok"
    assert not floating.gradual()


@pytest.mark.parametrize("id", ["rebound-whfast512", "rebound-whfast512-corrector-17"])
def test_whfast512_restores_the_mode(id):
    made = problem("outer-solar-system")
    if lack := BY_ID[id].lacks(made, made.system):
        pytest.skip(lack)
    integrate_peer(made, id, h=100.0, steps=8)
    assert floating.gradual()
    assert prepare_peer(made, BY_ID[id])(100.0, 8)[2] == "ok"
    assert floating.gradual()
