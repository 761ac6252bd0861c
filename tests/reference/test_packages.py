"""Packages of few integrators, in Python, C and C++: steps that are ours or that the package has stored, and traps."""

from __future__ import annotations

import re
import sys
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.cli.advise import can_be_installed
from phasebench.benchmarks.measure.integrator import integrator
from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.reference import installed, native
from phasebench.reference.peers import (
    PEERS,
    diffrax,
    integrate_peer,
    jax_loop,
    mujoco,
    pynamicalsys,
    record,
    run,
    sundials4py,
)
from phasebench.reference.peers.prepared import prepare_peer
from support.needs import need
from support.solutions import last

PENDULUM = problem("pendulum")


def apart(a, b) -> float:
    """The largest distance of the rows of two solutions."""
    return float(np.abs(np.hstack([a.q - b.q, a.p - b.p])).max())


def apart_from_ours(made, id, method, **size) -> float:
    return apart(integrate_peer(made, id, **size), integrate(made, method, **size))


@pytest.mark.parametrize(
    ("id", "method", "bound"),
    [
        ("desolver-implicit-midpoint", "implicit-midpoint", 1e-11),  # it shortens steps in between
        ("pyhamsys-verlet", "stormer-verlet", 1e-12),
        ("openmm-verlet", "stormer-verlet", 1e-12),
        ("pynamicalsys-midpoint", "implicit-midpoint", 1e-9),  # its residuals are below 1e-12, not at round-off
        ("boost-rk4", "rk4", 1e-12),
    ],
)
def test_steps_are_ours_also_of_more_rows_than_a_call_returns(id, method, bound):
    need(PEERS[id].package)
    assert apart_from_ours(PENDULUM, id, method, h=0.05, steps=600) < bound


@pytest.mark.parametrize("id", ["pyhamsys-verlet", "pyhamsys-verlet-extended", "desolver-rk4", "diffrax-euler"])
def test_a_run_prints_and_logs_nothing(id, capfd, caplog):
    need(PEERS[id].package)
    integrate_peer(PENDULUM, id, h=0.1, steps=3)
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


@pytest.mark.parametrize(
    ("id", "module", "readings"),
    [
        ("desolver-rk4", run, [7.0, 8.0, 11.0, 12.0, 20.0, 20.5]),
        ("desolver-dopri45-adaptive", run, [7.0, 8.0, 11.0, 12.0, 20.0, 20.5]),
        ("diffrax-euler", jax_loop, [7.0, 9.5]),
        ("pyhamsys-verlet", run, [7.0, 8.0, 11.0, 12.5]),  # pieces of two and one steps
    ],
)
def test_seconds_are_those_between_clock_readings(id, module, readings, monkeypatch):
    need(PEERS[id].package)
    left, again = list(readings), partial(integrate_peer, PENDULUM, id, h=0.1, steps=3)
    again()
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: left.pop(0)))
    assert again(tol=1e-6 if PEERS[id].adaptive else None).seconds == 2.5
    assert left == []


# -- diffrax, JAX-MD --------------------------------------------------------------------------------------------------


def test_a_two_step_method_continues_across_pieces():
    need("diffrax")
    h, field = 0.01, PENDULUM.system.vector_field()
    theirs = integrate_peer(PENDULUM, "diffrax-leapfrog-midpoint", h=h, steps=600)
    before = np.concatenate([PENDULUM.q0, PENDULUM.p0])
    now = before + h * field(0.0, before)
    for k in range(1, 601):
        assert np.abs([*theirs.q[k], *theirs.p[k]] - now).max() < 1e-11
        before, now = now, before + 2 * h * field(0.0, now)


def test_a_second_run_compiles_nothing_whatever_its_length(monkeypatch):
    """diffrax's loop is called at once with its own output, for which some versions of JAX compile it separately."""
    need("diffrax")
    taken, rows = [], jax_loop.Loop.rows
    monkeypatch.setattr(jax_loop.Loop, "rows", lambda self, y, h, n: taken.append(len(n)) or rows(self, y, h, n))
    with jax_loop.double_precision():
        loop = diffrax._compile.__wrapped__("Euler", diffrax.WHOLE, PENDULUM.system)
        assert min(taken) > jax_loop.ROWS
        before = loop._loop._cache_size()
        found, failed = loop.rows(np.array([1.0, 0.0]), 1e-3, np.arange(1, 2 * jax_loop.ROWS + 3))
    assert (len(found), failed, loop._loop._cache_size()) == (2 * jax_loop.ROWS + 2, -1, before)


def test_jax_md_rounds_the_step_to_single_precision():
    need("jax_md")
    for h, low, high in ((0.0625, 0.0, 1e-13), (0.05, 1e-9, 1e-6)):
        assert low <= apart_from_ours(PENDULUM, "jax-md-nve", "stormer-verlet", h=h, steps=64) <= high


# -- pynamicalsys, MuJoCo, OpenMM -------------------------------------------------------------------------------------


@pytest.mark.parametrize("p", pynamicalsys.PEERS, ids=lambda p: p.id)
def test_a_run_of_pynamicalsys_longer_than_a_piece_is_one(p):
    need("pynamicalsys")
    n = pynamicalsys.PIECE + 5
    rows = integrate_peer(PENDULUM, p, h=1e-3, steps=n, save_every=pynamicalsys.PIECE - 1)
    assert (rows.status, rows.t.tolist()) == ("ok", [0.0, *(1e-3 * k for k in (pynamicalsys.PIECE - 1, n))])
    q, v, status = prepare_peer(PENDULUM, p)(1e-3, n)
    assert (status, *q, *v) == ("ok", *rows.q[-1], *rows.p[-1])


def test_pynamicalsys_explicit_methods_take_large_systems_and_its_implicit_one_says_why_not():
    need("pynamicalsys")
    wave = problem("klein-gordon")  # 128 degrees of freedom: compiling its Hessian would take many minutes
    assert apart_from_ours(wave, "pynamicalsys-verlet", "stormer-verlet", h=0.1, steps=9) < 1e-12
    with pytest.raises(InvalidInput, match="Hessian of H, compiled up to d = 20"):
        integrate_peer(wave, "pynamicalsys-midpoint", h=0.1, steps=9)


@pytest.mark.parametrize("p", mujoco.PEERS, ids=lambda p: p.id)
def test_mujocos_models_are_those_of_the_problems(p):
    need("mujoco")
    for name in ("pendulum", "double-pendulum:regular", "free-rigid-body"):
        made = problem(name)
        exact, errors = last(integrate(made, "gauss-8", h=0.02, steps=100, save_every=0)), []
        for steps in (200, 400):
            errors.append(np.abs(last(integrate_peer(made, p, t_end=2.0, steps=steps, save_every=0)) - exact).max())
        assert abs(np.log2(errors[0] / errors[1]) - p.order) < 0.4 or errors[1] < 1e-13, name
    with pytest.raises(InvalidInput, match="has m1 = 1"):
        integrate_peer(problem("double-pendulum", m1=2), p, h=0.1, steps=1)


# -- C and C++ by the user's compiler ----------------------------------------------------------------------------------


MADE = problem("pendulum")
needs_compiler = pytest.mark.skipif(native.compiler() is None, reason="there is no C compiler")


@pytest.mark.parametrize("id", ["boost-rk4", "gsl-rk2imp"])
def test_without_compiler_or_headers_a_run_is_skipped_and_says_what_to_install(monkeypatch, id):
    peer = PEERS[id]
    library = native.LIBRARIES[peer.package]

    def told(why: str) -> None:
        s = integrate_peer(MADE, id, h=0.1, steps=3)
        assert s.status == "skipped"
        assert why in s.reason
        assert library.install in s.reason
        with pytest.raises(InvalidInput, match=re.escape(library.install)):
            prepare_peer(MADE, peer)
        assert not integrator(peer).installed
        assert installed.version_of.__wrapped__(peer.package) is None

    monkeypatch.setattr(native, "compiler", lambda language="C": None)
    told(f"there is no {library.language} compiler")
    monkeypatch.setattr(native, "compiler", lambda language="C": "/some/compiler")
    monkeypatch.setattr(native, "_version", lambda library, path: None)
    told(f"finds no {library.header}")


def test_the_users_compiler_comes_first(monkeypatch):
    monkeypatch.setattr(native.shutil, "which", lambda name: {"mine": "/mine", "cc": "/cc", "c++": "/c++"}.get(name))
    for language, variable, usual in (("C", "CC", "/cc"), ("C++", "CXX", "/c++")):
        for named, found in (("mine", "/mine"), ("gone", usual), ("", usual)):
            monkeypatch.setenv(variable, named)
            assert native.compiler(language) == found


@needs_compiler
def test_source_is_compiled_once_and_a_damaged_library_is_compiled_anew(tmp_path, monkeypatch):
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


# -- SUNDIALS ----------------------------------------------------------------------------------------------------------


#: H - H0 at t = 50 as SUNDIALS stores it in examples/arkode/C_serial/ark_kepler_*.out: method -> (h, answer).
STORED = {
    "leapfrog-2-2": (1e-3, -1.0321183419037538e-07),
    "pseudo-leapfrog-2-2": (1e-3, 3.2112992007782282e-06),
    "mclachlan-2-2": (1e-3, 7.5370554486475783e-07),
    "ruth-3-3": (0.1, 8.9150805802473698e-04),
    "mclachlan-3-3": (0.1, 8.9881034690120210e-04),
    "mclachlan-4-4": (0.1, -5.3723049984188975e-06),
    "mclachlan-5-6": (0.1, 7.5734793938408984e-06),
    "yoshida-6-8": (0.1, 1.2681182276619296e-04),
}
KEPLER, HENON = problem("kepler", e=0.6), problem("henon-heiles:box")


@pytest.fixture
def package():
    """The package; tests that need it are skipped where it is not there, as on a Python before 3.12."""
    try:
        return sundials4py.load()
    except ImportError as error:
        pytest.skip(f"sundials4py cannot be imported ({error})")


def test_without_the_package_it_is_said_which_python_it_needs(monkeypatch):
    """The hint how to install what advice left out names the package from its oldest Python on."""
    monkeypatch.setitem(sys.modules, "sundials4py", None)
    for version, old in (((3, 11, 9), True), (sundials4py.OLDEST, False)):
        monkeypatch.setattr(record.sys, "version_info", version)
        s = integrate_peer(problem("pendulum"), "sundials-leapfrog-2-2", h=0.1, steps=3)
        assert s.status == "skipped"
        assert "pip install sundials4py" in s.reason
        assert ("it needs Python 3.12 or newer, and this is 3.11" in s.reason) == old
        assert can_be_installed({"integrator": "sundials-mclachlan-4-4"}) != old
        assert can_be_installed({"integrator": "gala-leapfrog"})


@pytest.mark.parametrize("name", STORED)
def test_stored_answers_of_the_kepler_problem(package, name):
    """ark_kepler stops at t = 50, steps are h here: the last of its 50,001 steps of 0.001 is round-off."""
    h, stored = STORED[name]
    for kind, size, same in (("", h, True), ("-compensated", h, True), ("", h * (1 + 1e-4), False)):
        s = integrate_peer(KEPLER, f"sundials-{name}{kind}", h=size, steps=round(50 / h), save_every=0)
        assert s.status == "ok"
        assert (s.energy()[-1] - s.energy()[0] == pytest.approx(stored, rel=1e-6, abs=1e-12)) == same


def test_what_stood_in_memory_before_does_not_matter(package):
    for _ in range(20):
        left_behind = [np.full(4, np.nan) for _ in range(1000)]
        del left_behind
        s = integrate_peer(HENON, "sundials-leapfrog-2-2", h=0.05, steps=1)
        assert (s.status, s.counts["steps"]) == ("ok", 1)


def test_compensated_sums_lose_less_of_the_angular_momentum(package):
    lost = []
    for kind in ("", "-compensated"):
        s = integrate_peer(KEPLER, f"sundials-mclachlan-4-4{kind}", h=0.01, steps=20_000, save_every=100)
        lost.append(np.abs(s.q[:, 0] * s.p[:, 1] - s.q[:, 1] * s.p[:, 0] - 0.8).max())
    assert lost[1] < 1e-15 < 3e-15 < lost[0]
