"""Systems with constraints g(q) = 0 and rigid bodies, and the methods that stay on their manifolds."""

from __future__ import annotations

import re

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.battery import SYSTEMS, as_problem
from phasebench.integrators import ConstrainedHamiltonian, InvalidInput, RigidBody, integrate
from phasebench.integrators.compile.codegen import TUPLE_LIMIT
from phasebench.integrators.registry import BY_ID, METHODS

SPHERE = {"q": "x y z", "p": "u v w", "H": "(u**2 + v**2 + w**2)/2 + z"}
Q0, P0 = [0.6, 0.0, -0.8], [0.2, 1.0, 0.15]


def on_sphere(*constraints, **more) -> ConstrainedHamiltonian:
    return ConstrainedHamiltonian(**SPHERE | more, constraints=constraints or ("x**2 + y**2 + z**2 = 1",))


# -- structure ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id", "name"),
    [
        *((id, name) for id in ("rattle", "shake", "rattle-yoshida-4") for name in ("rods", "on-ellipsoid")),
        ("lobatto-iiia-iiib-constrained-4", "on-ellipsoid"),
    ],
)
def test_constraints_hold_to_round_off(id, name):
    problem = as_problem(name)
    system = problem.system
    if BY_ID[id].lacks(system):
        with pytest.raises(InvalidInput, match="constant mass matrix"):
            integrate(problem, id, h=0.02, steps=1)
        return
    s = integrate(problem, id, h=0.02, steps=200)
    assert s.status == "ok"
    g, hidden = system.defects(s.q, s.p)
    assert np.abs(g).max() < 5e-15
    if BY_ID[id].tangent:
        assert np.abs(hidden).max() < 2e-14
    else:
        assert np.abs(hidden).max() > 1e-5


# -- the index-reduced system ------------------------------------------------------------------------------------------


def test_multipliers_are_those_of_the_twice_differentiated_constraint():
    system, *_ = SYSTEMS["on-ellipsoid"]()
    y = np.array([0.5, 0.3, 0.4, 0.2, -0.6, 0.3])
    f, h = system.vector_field(), 1e-3
    g = [system.defects(*((y + k * h * f(0, y)).reshape(2, 1, 3)))[1][0, 0] for k in (1, -1)]
    assert abs(g[0] - g[1]) / (2 * h) < 1e-6, "the hidden constraint has no slope along the field"
    free = system.free.vector_field()
    g = [system.defects(*((y + k * h * free(0, y)).reshape(2, 1, 3)))[1][0, 0] for k in (1, -1)]
    assert abs(g[0] - g[1]) / (2 * h) > 0.1, "the control: without multipliers it has"
    assert np.allclose(system.rates(y[None, :3], y[None, 3:])[:, 0], f(0, y), rtol=1e-14, atol=0)


def test_ordinary_methods_and_peers_run_and_leave_the_manifold():
    problem = as_problem("rods")
    rough = integrate(problem, "rk4", h=0.05, t_end=5.0)
    assert rough.status == "ok"
    assert 1e-9 < np.abs(problem.system.defects(rough.q, rough.p)[0]).max() < 1e-2
    fine = integrate(problem, "lobatto-iiia-iiib-constrained-6", h=0.01, t_end=2.0)
    peer = pb.integrate(problem, "heyoka", t_end=2.0)
    assert np.abs(fine.q[-1] - peer.q[-1]).max() < 1e-11
    for id in ("scheme-iv", "rk4-projected-energy", "avf"):
        with pytest.raises(InvalidInput, match="canonical"):
            integrate(problem, id, h=0.05, t_end=1.0)
    with pytest.raises(InvalidInput, match="constrained"):
        integrate(pb.problem("pendulum"), "rattle", h=0.1, t_end=1.0)


def test_states_that_are_arrays():
    q, p = ([f"{x}{i}" for i in range(TUPLE_LIMIT + 2)] for x in "qp")
    H, sphere = " + ".join(f"{x}**2/2" for x in p) + " + q0 + q1*q2", " + ".join(f"{x}**2" for x in q) + " = 1"
    system = ConstrainedHamiltonian(q=q, p=p, H=H, constraints=[sphere])
    start = np.eye(len(q))
    s = integrate(system, "rattle", h=0.01, steps=200, q0=start[0], p0=start[1])
    assert s.status == "ok"
    assert np.abs(system.defects(s.q, s.p)).max() < 5e-14
    assert np.ptp(system.energies(s.q, s.p)) < 1e-3


def test_a_step_without_multipliers_says_so():
    s = integrate(on_sphere(), "rattle", h=3.0, steps=10, q0=Q0, p0=[0.0, 5.0, 0.0])
    assert s.status == "not-converged"
    assert "multipliers" in s.reason


# -- bad input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("q", "p", "worst"),
    [
        ([0.6, 0.1, -0.8], [0.8, 0.0, 0.6], r"the constraint x\*\*2 .* is 0\.01 there"),
        (Q0, [0.1, 1.0, 0.0], r"the hidden constraint 2\*.* is 0\.12 there"),
        ([3.0, 0.0, 0.1], P0, r"the hidden constraint 2\*.* is 1\.23 there"),
    ],
)
def test_a_start_off_the_manifold_is_refused_with_one_on_it(q, p, worst):
    """The message names the constraint that is missed by most, relative to its round-off."""
    with pytest.raises(InvalidInput) as told:
        integrate(on_sphere(), "rattle", h=0.1, steps=1, q0=q, p0=p)
    text = str(told.value)
    assert re.search(worst, text)
    assert pb.integrate_ensemble(on_sphere(), "rattle", [q], [p], h=0.1, steps=1).status == ["invalid"]
    near = [[float(x) for x in m.split(",")] for m in re.findall(r"\[([^\]]*)\]", text)]
    assert integrate(on_sphere(), "rattle", h=0.1, steps=1, q0=near[0], p0=near[1]).status == "ok"
    exact = np.array(q) / np.linalg.norm(q)
    assert np.abs(near[0] - exact).max() < 1e-14
    assert np.abs(near[1] - (np.array(p) - exact * (exact @ p))).max() < 1e-14


def test_redundant_constraints_are_named():
    system = on_sphere("x**2 + y**2 + z**2 = 1", "2*x**2 + 2*y**2 + 2*z**2 = 2")
    with pytest.raises(InvalidInput, match=r"redundant.*2\*x\*\*2"):
        integrate(system, "rattle", h=0.1, steps=1, q0=Q0, p0=[0.0, 1.0, 0.0])
    with pytest.raises(InvalidInput, match="no slope"):
        integrate(on_sphere("x**2*y"), "rattle", h=0.1, steps=1, q0=[0.0, 0.0, 1.0], p0=P0)
    flat = ConstrainedHamiltonian(q="x y", p="u v", H="u**2/2 + x*v", constraints=["y"])
    with pytest.raises(InvalidInput, match="not determined"):
        integrate(flat, "rk4", h=0.1, steps=1, q0=[0.0, 0.0], p0=[0.0, 0.0])


# -- rigid bodies in quaternions ---------------------------------------------------------------------------------------


IDS = [m.id for m in METHODS if m.family == "rigid"]
MOMENTS = (1, "3/2", 2)
FREE, HEAVY = RigidBody(moments=MOMENTS), RigidBody(moments=MOMENTS, V="r33 + r13/2")
#: V of `HEAVY` is the sum of WEIGHTS[i][j] R[i][j].
WEIGHTS = [[0, 0, 0.5], [0, 0, 0], [0, 0, 1]]
ATTITUDE, MOMENTUM = (0.8, 0.48, 0.0, -0.36), (0.4, -0.9, 0.6)


def hat(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


# -- the system --------------------------------------------------------------------------------------------------------


def test_the_equations_are_eulers():
    """By differences of H alone: L' = L x I^-1 L - torque, R' = R hat(I^-1 L)."""
    q, p = HEAVY.start(attitude=ATTITUDE, momentum=MOMENTUM)
    h = 1e-4
    s = integrate(HEAVY, "gauss-8", h=h, steps=2, q0=q, p0=p)
    L, R = HEAVY.momentum(s.q, s.p), HEAVY.matrix(s.q)
    velocity = L[1] / np.array([1, 1.5, 2])
    torque = [np.sum(np.array(WEIGHTS) * (R[1] @ hat(np.eye(3)[k]))) for k in range(3)]
    assert (L[2] - L[0]) / (2 * h) == pytest.approx(np.cross(L[1], velocity) - torque, abs=1e-8)
    spin = R[1] @ hat(velocity)
    assert (R[2] - R[0]) / (2 * h) == pytest.approx(spin, abs=1e-8)


@pytest.mark.parametrize(
    ("body", "kept"),
    [
        (FREE, {"momentum-1", "momentum-2", "momentum-3"}),
        (HEAVY, set()),
        (RigidBody(moments=(1, 2, 2), V="r31"), {"momentum-3", "axis-momentum-1"}),
        (RigidBody(moments=(1, 2, 2), V="r33"), {"momentum-3"}),
        (RigidBody(moments=(2, 2, 1), V="r31**2 + r32**2"), {"momentum-3", "axis-momentum-3"}),
        (RigidBody(moments=(1, 1, 1)), {f"{x}momentum-{k}" for x in ("", "axis-") for k in (1, 2, 3)}),
    ],
)
def test_what_is_kept_is_found(body, kept):
    assert set(body.kept) == kept | {"length", "radial-momentum"}
    q, p = body.start(attitude=ATTITUDE, momentum=MOMENTUM)
    s = integrate(body, "rigid-reich-kahan-li-6", h=0.05, steps=200, q0=q, p0=p)
    moving = body.momentum(s.q, s.p)
    in_space = np.einsum("nij,nj->ni", body.matrix(s.q), moving)
    for k in range(3):
        for name, values in ((f"momentum-{k + 1}", in_space[:, k]), (f"axis-momentum-{k + 1}", moving[:, k])):
            change = np.ptp(values)
            assert change < 1e-13 if name in kept else change > 1e-3, name


def test_a_potential_in_quaternions_is_that_of_the_matrix():
    one = RigidBody(moments=MOMENTS, V="2*r31 + r22")
    other = RigidBody(moments=MOMENTS, V="4*(q1*q3 - q0*q2) + q0**2 - q1**2 + q2**2 - q3**2")
    q, p = one.start(attitude=ATTITUDE, momentum=MOMENTUM)
    ends = [integrate(b, "gauss-8", h=0.1, steps=20, q0=q, p0=p).q[-1] for b in (one, other)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-14)


@pytest.mark.parametrize(
    ("attitude", "momentum"), [((1, 0, 0), (1, 0, 0)), ((0, 0, 0, 0), (1, 0, 0)), ((1, 0, 0, 0), 1), ("x", (1, 0, 0))]
)
def test_bad_starts(attitude, momentum):
    with pytest.raises(InvalidInput, match="an attitude is a quaternion"):
        FREE.start(attitude=attitude, momentum=momentum)


# -- structure ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("id", IDS)
def test_a_free_body_keeps_its_momentum_in_space_and_a_rotation_matrix(id):
    q, p = FREE.start(attitude=ATTITUDE, momentum=MOMENTUM)
    s = integrate(FREE, id, h=0.2, steps=20_000, q0=q, p0=p, save_every=1000)
    R, L = FREE.matrix(s.q), FREE.momentum(s.q, s.p)
    substeps = len(BY_ID[id].data[1])
    assert np.abs(np.einsum("nij,nj->ni", R, L) - R[0] @ L[0]).max() < 5e-15 * substeps
    assert np.abs((s.q**2).sum(axis=1) - 1).max() < 2e-15 * substeps
    assert np.abs(np.einsum("nij,nkj->nik", R, R) - np.eye(3)).max() < 4e-15
    energy = s.energy()
    assert np.ptp(energy) < (2e-15 if id == "lie-midpoint" else 0.02)
    other = integrate(FREE, "rk4", h=0.2, steps=20_000, q0=q, p0=p, save_every=1000)
    assert np.abs((other.q**2).sum(axis=1) - 1).max() > 1e-6, "the control"
