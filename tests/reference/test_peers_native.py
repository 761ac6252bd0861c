"""Boost.odeint's and GSL's steppers as peers: orders, rows, prepared runs, and what is told without them."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.reference import installed, native
from phasebench.reference.peers import boost, gsl, integrate_peer
from phasebench.reference.peers.prepared import prepare_peer
from support import needs
from support.solutions import end

PEERS = {p.id: p for p in (*boost.PEERS, *gsl.PEERS)}
FIXED = [id for id, p in PEERS.items() if not p.adaptive]
ADAPTIVE = [id for id, p in PEERS.items() if p.adaptive]
MADE = problem("pendulum")
#: Order -> steps of the runs to t = 3, for which errors are asymptotic and above round-off.
END = 3.0
STEPS = {1: (400, 800), 2: (60, 120), 4: (60, 120), 5: (40, 80), 8: (10, 20)}


def need(id: str):
    """The peer; the test is skipped where its headers or a compiler are missing."""
    needs.need(PEERS[id].package)
    return PEERS[id]


def exact(t: float) -> np.ndarray:
    """The pendulum's state (q, p) at t."""
    return end(integrate(MADE, "gauss-8", h=t / 200, steps=200, save_every=0))


@pytest.mark.parametrize("id", FIXED)
def test_fixed_steps_have_their_order_go_back_and_equal_prepared_ones(id):
    peer, truth = need(id), exact(END)
    errors = []
    for n in STEPS[peer.order]:
        s = integrate_peer(MADE, id, t_end=END, steps=n, save_every=0)
        errors.append(np.abs(end(s) - truth).max())
        assert s.counts["steps"] == n
        assert s.counts["gradient"] >= n * peer.order / 2
    assert abs(np.log2(errors[0] / errors[1]) - peer.order) < (0.3 if peer.order < 8 else 0.6)
    rows = integrate_peer(MADE, id, t_end=END, steps=n, save_every=7)
    assert np.abs(end(rows) - end(s)).max() < 1e-12
    call = prepare_peer(MADE, peer)
    q, p, status = call(END / n, n)
    assert (status, *q, *p) == ("ok", *s.q[-1], *s.p[-1])
    back = integrate_peer(MADE, id, t_end=-END, steps=n, save_every=0)
    assert np.abs(end(back) - exact(-END)).max() < 3 * max(errors[1], 1e-12)


@pytest.mark.parametrize("id", ADAPTIVE)
def test_tolerances_are_met_rows_lie_on_the_orbit_and_prepared_runs_agree(id):
    peer = need(id)
    errors = [
        np.abs(end(integrate_peer(MADE, id, t_end=END, steps=1, tol=tol)) - exact(END)).max() for tol in (1e-5, 1e-9)
    ]
    assert errors[1] < 1e-6 < 1e-3 > errors[0] > 10 * errors[1]
    s = integrate_peer(MADE, id, t_end=-END, steps=3, tol=1e-9)
    assert np.abs(end(s) - exact(-END)).max() < 1e-6
    assert np.abs(np.concatenate([s.q[1], s.p[1]]) - exact(-END / 3)).max() < 1e-6
    assert s.counts["gradient"] > s.counts["steps"] > 0
    q, p, status = prepare_peer(MADE, peer, tol=1e-9)(END)
    assert status == "ok"
    assert np.abs(np.concatenate([q, p]) - exact(END)).max() < 1e-6


@pytest.mark.parametrize(("id", "ours"), [("boost-rk4", "rk4"), ("boost-symplectic-euler", "symplectic-euler-q")])
def test_steps_equal_those_of_this_project(id, ours):
    need(id)
    theirs = integrate_peer(MADE, id, h=0.05, steps=40)
    s = integrate(MADE, ours, h=0.05, steps=40)
    assert np.abs(theirs.q - s.q).max() < 1e-13


def test_gsl_takes_two_implicit_midpoint_steps_of_half_the_size():
    need("gsl-rk2imp")
    theirs = integrate_peer(MADE, "gsl-rk2imp", h=0.1, steps=20)
    for ours, same in (("implicit-midpoint", True), ("gauss-2", False)):
        s = integrate(MADE, ours, h=0.05, steps=40, save_every=2)
        assert (np.abs(theirs.q - s.q).max() < 1e-12) == same


def test_symplectic_steppers_need_a_separable_system():
    with pytest.raises(InvalidInput, match=r"T\(p\) \+ V\(q\)"):
        integrate_peer(problem("double-pendulum"), "boost-rkn-sb3a-mclachlan", h=0.1, steps=3)


@pytest.mark.parametrize("id", ["boost-rk4", "gsl-rk2imp"])
def test_without_compiler_or_headers_a_run_is_skipped_and_says_what_to_install(monkeypatch, id):
    peer = PEERS[id]
    command = native.LIBRARIES[peer.package].install

    def told(why: str) -> None:
        s = integrate_peer(MADE, id, h=0.1, steps=3)
        assert s.status == "skipped"
        assert why in s.reason
        assert command in s.reason
        with pytest.raises(InvalidInput, match=re.escape(command)):
            prepare_peer(MADE, peer)
        assert not integrator(peer).installed
        assert installed.version_of.__wrapped__(peer.package) is None

    monkeypatch.setattr(native, "compiler", lambda language="C": None)
    told(f"there is no {native.LIBRARIES[peer.package].language} compiler")
    monkeypatch.setattr(native, "compiler", lambda language="C": "/some/compiler")
    monkeypatch.setattr(native, "_version", lambda library, path: None)
    told(f"finds no {native.LIBRARIES[peer.package].header}")


def test_a_header_that_is_not_there_has_no_version():
    path = native.compiler("C")
    if path is None:
        pytest.skip("there is no C compiler")
    assert native._version(native.Library("C", "no/such/header.h", "VERSION", ""), path) is None


def test_records_compile_nothing():
    code = "import subprocess; subprocess.run = None; from phasebench.reference.peers import boost, gsl"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_source_is_compiled_once_and_a_damaged_library_is_compiled_anew(tmp_path, monkeypatch):
    if native.compiler() is None:
        pytest.skip("there is no C compiler")
    monkeypatch.setenv("PHASEBENCH_CACHE", str(tmp_path))
    made, compile_it = [], native._compile
    monkeypatch.setattr(native, "_compile", lambda *all: made.append(1) or compile_it(*all))
    text = "double three(void) { return 3; }"

    def answer(source: str) -> float:
        function = native.load_source(source).three
        function.restype = native.ctypes.c_double
        return function()

    assert [answer(text), answer(text), len(made)] == [3.0, 3.0, 1]
    assert [answer(text.replace("3;", "4;")), len(made)] == [4.0, 2]
    for kept in tmp_path.glob("*/c-*.so"):
        kept.write_bytes(kept.read_bytes()[:-1] + b"x")
    assert [answer(text), len(made)] == [3.0, 3]
