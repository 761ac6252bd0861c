"""Rigid bodies in quaternions: the equations, and the methods beside steps of rotation matrices in 30 digits."""

from __future__ import annotations

import numpy as np
import pytest

from phasebench.integrators import InvalidInput, RigidBody, integrate
from phasebench.integrators.registry import BY_ID, METHODS

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


def test_a_symmetric_top_is_the_flow_of_a_symmetric_body():
    body = RigidBody(moments=(2, 1, 2))
    q, p = body.start(attitude=ATTITUDE, momentum=MOMENTUM)
    one, many = (integrate(body, "rigid-reich", h=4 / n, steps=n, q0=q, p0=p) for n in (1, 64))
    assert one.q[-1] == pytest.approx(many.q[-1], abs=2e-15)
    other = [integrate(body, "rigid-dlm", h=4 / n, steps=n, q0=q, p0=p).q[-1] for n in (1, 64)]
    assert np.abs(other[0] - other[1]).max() > 1e-2, "the control"
