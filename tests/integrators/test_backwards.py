"""Integration backwards in time: a step -h from (q, -p) mirrors a step h from (q, p)."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.benchmarks.measure.battery import as_problem
from phasebench.benchmarks.problems import problem
from phasebench.integrators import integrate, integrate_ensemble, prepare
from phasebench.integrators.compile.codegen import compiled
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.registry import METHODS
from phasebench.integrators.request import grid
from phasebench.integrators.section import section
from phasebench.integrators.stepping.orbit_lanes import LANES
from support.one_of_each import FIRST

EVERY = ("adaptive", "field", "wisdom_holman")
#: The first method of each family, and all of some. A magnetic field has to be turned round, too: test_magnetic.py.
CHOSEN = [m for m in METHODS if (m is FIRST[m.family] or m.family in EVERY) and "magnetic" not in m.requires]
N = LANES.n + 1
PROBLEMS = [problem(name) for name in ("henon-heiles:box", "perturbed-kepler", "fpu", "kerr")]
PROBLEMS += [as_problem(name) for name in ("rods", "asymmetric-top")]


@pytest.mark.parametrize("method", CHOSEN, ids=lambda m: m.id)
def test_a_run_back_in_time_mirrors_the_run_ahead(method):
    made = next(p for p in PROBLEMS if not method.lacks(p.system))
    ahead = integrate(made, method, h=0.02, steps=50)
    back = integrate(made, method, h=-0.02, steps=50, p0=[-x for x in made.p0])
    assert (ahead.status, back.status) == ("ok", "ok")
    assert (back.t == -ahead.t).all()
    assert back.t[-1] == -1.0
    np.testing.assert_allclose(back.q, ahead.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back.p, -ahead.p, rtol=0, atol=1e-12)
    assert np.abs(ahead.q[-1] - ahead.q[0]).max() > 1e-3


def test_a_run_forth_and_back_returns():
    made = problem("henon-heiles:box")
    there = integrate(made, "gauss-4", h=0.1, t_end=20.0)
    back = integrate(made, "gauss-4", h=0.1, t_end=0.0, t0=20.0, q0=there.q[-1], p0=there.p[-1])
    assert (back.t[0], back.t[-1], back.h) == (20.0, 0.0, -0.1)
    np.testing.assert_allclose(back.q[-1], made.q0, atol=1e-12)
    np.testing.assert_allclose(back.p[-1], made.p0, atol=1e-12)
    one_way = integrate(made, "gauss-4", h=0.1, t_end=40.0, t0=20.0, q0=there.q[-1], p0=there.p[-1])
    assert np.abs(one_way.q[-1] - made.q0).max() > 1e-3


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        ((0.1, 10.0, None, 0.0), (0.1, 100)),
        ((0.1, -10.0, None, 0.0), (-0.1, 100)),
        ((-0.1, -10.0, None, 0.0), (-0.1, 100)),
        ((0.1, 5.0, None, 15.0), (-0.1, 100)),
        ((0.1, 5.0, None, -5.0), (0.1, 100)),
        ((-0.1, None, 7, 3.0), (-0.1, 7)),
        ((None, -1.0, 4, 1.0), (-0.5, 4)),
        ((-0.25, -1.0, 8, 1.0), (-0.25, 8)),
    ],
)
def test_the_sign_of_h_follows_from_the_span(asked, found):
    """``asked`` is (h, t_end, steps, t0); ``found`` is (h with its sign, number of steps)."""
    assert grid(*asked) == pytest.approx(found)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ((-0.1, 10.0, None, 0.0), "lies ahead"),
        ((0.1, 3.0, None, float("nan")), "t0 is nan"),
        ((0.3, -1.0, None, 0.0), "divide"),
    ],
)
def test_inconsistent_grids_are_refused(asked, words):
    with pytest.raises(InvalidInput, match=words):
        grid(*asked)


def test_ensembles_sections_and_prepared_runs_go_back():
    made = problem("henon-heiles")
    Q, P = np.array([[0.0, 0.1 + 0.01 * k] for k in range(N)]), np.tile([0.3, 0.1], (N, 1))
    ahead, back = (integrate_ensemble(made, "stormer-verlet", Q, s * P, h=0.1, t_end=s * 20.0) for s in (1.0, -1.0))
    assert back.in_lanes.all() == ahead.in_lanes.all() == compiled()
    assert (back.t == -ahead.t).all()
    np.testing.assert_allclose(back.q, ahead.q, atol=1e-12)
    np.testing.assert_allclose(back.p, -ahead.p, atol=1e-12)
    one, other = (
        section(made, "stormer-verlet", Q, s * P, of="q1", rising=s > 0, h=0.1, t_end=s * 20.0) for s in (1.0, -1.0)
    )
    falling = section(made, "stormer-verlet", Q, -P, of="q1", h=0.1, t_end=-20.0, rising=True)
    np.testing.assert_allclose(falling.t, -one.t, atol=1e-9)
    mirrored = section(made, "stormer-verlet", Q, P, of="q1", h=0.1, t_end=20.0, rising=False)
    np.testing.assert_allclose(other.t, -mirrored.t, atol=1e-9)
    assert len(one) == len(falling) > 20
    assert len(other) > 20
    run = prepare(problem("pendulum"), "stormer-verlet")
    q, p, _ = run(0.1, 30)
    q, p, _ = run(-0.1, 30, q0=q, p0=p)
    np.testing.assert_allclose([*q, *p], [*problem("pendulum").q0, *problem("pendulum").p0], atol=1e-12)
