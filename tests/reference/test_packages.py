"""desolver, pyhamsys, diffrax, pynamicalsys, BlackJAX, OpenMM, ASE, JAX-MD, MuJoCo: steps that are ours, and traps."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from phasebench.benchmarks.problems import problem
from phasebench.integrators import InvalidInput, integrate
from phasebench.reference.peers import (
    PEERS,
    diffrax,
    integrate_peer,
    jax_loop,
    mujoco,
    pynamicalsys,
    run,
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
