r"""MuJoCo's integrators as peers, on three of this suite's problems: a pendulum, a double pendulum, a free rigid body.

MuJoCo takes no formula for H: each problem is rewritten as a model of bodies and joints, whose equations of motion are
the same.

- MuJoCo allows no moment of inertia of 0, so each point mass of a pendulum is an extended body with the same moment of
  inertia about its hinge.
- MuJoCo's state is positions (angles, or a quaternion for the rigid body) and velocities.  Velocities and this
  project's momenta p are converted into each other by :math:`\dot q = A(q) p`; the angular velocity of the rigid body
  is its angular momentum about its own axes, divided by the moments of inertia.
- The rigid body could also move through space, but its centre is at rest: only for a body with such a free joint do
  MuJoCo's implicit integrators treat gyroscopic forces.

MuJoCo is made for robots with contacts, friction and damping, and none of these is in the models.

Source: E. Todorov, T. Erez, Y. Tassa, MuJoCo: A physics engine for model-based control, IROS 2012, 5026-5033.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .record import Claims, Peer, Run, Task
from .run import by_rows

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem

MODEL = """
<mujoco>
  <compiler angle="radian" balanceinertia="false"/>
  <option gravity="0 0 {g}" integrator="{integrator}"><flag autoreset="disable" contact="disable"/></option>
  <worldbody>{bodies}</worldbody>
</mujoco>
"""
HINGE = '<joint type="hinge" axis="0 1 0"/>'
#: Problem -> (gravity, bodies).  A pendulum's body of mass 1, a centre of mass at 1/2 and a moment of 3/4 about it has
#: the moment 1 about the hinge; the double pendulum's have the moments 1/2 + m_2 l_1^2 = 2 and 1/3 + m_2 c_2^2 = 1.
MODELS = {
    "pendulum": (
        -2.0,
        f'<body>{HINGE}<inertial pos="0 0 -0.5" mass="1" diaginertia="0.75 0.75 0.75"/></body>',
    ),
    "double-pendulum": (
        -1.0,
        f'<body>{HINGE}<inertial pos="0 0 -0.5" mass="1" diaginertia="0.25 0.25 0.25"/>'
        f'<body pos="0 0 -1">{HINGE}<inertial pos="0 0 -{2 / 3!r}" mass="1.5" '
        f'diaginertia="{1 / 3!r} {1 / 3!r} {1 / 3!r}"/></body></body>',
    ),
    "free-rigid-body": (
        0.0,
        '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="{I1} {I2} {I3}"/></body>',
    ),
}
ROBOTS = "it takes models of bodies and joints: here " + ", ".join(MODELS)


def _lacks(problem: Any, system: PartitionedSystem) -> str | None:
    """The reason why MuJoCo's peers cannot integrate a problem; None if they can."""
    id = getattr(problem, "id", "")
    if id not in MODELS:
        return ROBOTS
    other = [k for k, v in problem.parameters.items() if v != 1 and id == "double-pendulum"]
    return f"its model of the double pendulum has {' = '.join(other)} = 1" if other else None


class _Body:
    """Converts a free rigid body's state from this project's (q, p) to MuJoCo's, and back.

    MuJoCo's state is a position, a quaternion, and velocities, the angular one about the body's axes.
    """

    def __init__(self, problem: Any) -> None:
        self.moments = np.array([problem.parameters[k] for k in ("I1", "I2", "I3")])
        self.system = problem.system

    def velocity(self, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.concatenate([np.zeros(3), q]), np.concatenate(
            [np.zeros(3), self.system.momentum(q, p) / self.moments]
        )

    def state(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        q, p = self.system.start(attitude=position[3:], momentum=self.moments * velocity[3:])
        return np.concatenate([q, p])


class _Chain:
    """Converts a (double) pendulum's state from this project's (q, p), angles from the vertical, to MuJoCo's, and back.

    MuJoCo's state is the angles between neighbouring bodies of the chain, and their velocities.
    """

    def __init__(self, problem: Any) -> None:
        self.field, self.d = problem.system.vector_field(), problem.system.d

    def _inverse_mass(self, q: np.ndarray) -> np.ndarray:
        """The matrix A of q' = A(q) p."""
        return np.array([self.field(0.0, np.concatenate([q, e]))[: self.d] for e in np.eye(self.d)]).T

    def velocity(self, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.diff(q, prepend=0.0), np.diff(self._inverse_mass(q) @ p, prepend=0.0)

    def state(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        q = np.cumsum(position)
        return np.concatenate([q, np.linalg.solve(self._inverse_mass(q), np.cumsum(velocity))])


def _build_run(integrator: str) -> Callable[[Task], Run]:
    def run(task: Task) -> Run:
        import mujoco

        problem = task.problem
        g, bodies = MODELS[problem.id]
        text = MODEL.format(g=g, integrator=integrator, bodies=bodies.format(**problem.parameters))
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.timestep = task.h
        data, way = mujoco.MjData(model), (_Body if problem.id == "free-rigid-body" else _Chain)(problem)
        data.qpos[:], data.qvel[:] = way.velocity(task.q, task.p)

        def advance(i: int, n: int) -> None:
            mujoco.mj_step(model, data, nstep=n)

        def state() -> np.ndarray:
            finite = np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
            return way.state(data.qpos.copy(), data.qvel.copy()) if finite else np.full(2 * len(task.q), np.nan)

        return by_rows(task, advance, state)

    return run


DOCUMENTED = "https://mujoco.readthedocs.io/en/stable/computation/index.html#numerical-integration"


def _peer(integrator: str, order: int, about: str, source: str, claimed: int | None = None) -> Peer:
    return Peer(
        f"mujoco-{integrator.lower()}",
        f"MuJoCo's {integrator}",
        package="mujoco",
        order=order,
        license="Apache-2.0",
        about=f"{about}; a model of bodies and joints, without contact and damping",
        source=source,
        run=_build_run(integrator),
        scope="models of bodies and joints",
        lacks=_lacks,
        claims=Claims(order=claimed, source=f"Numerical integration, {DOCUMENTED}"),
        ahead=True,
    )


SEMI = "Hairer, Lubich & Wanner 2006, I.1.2"

PEERS: tuple[Peer, ...] = (
    _peer("Euler", 1, "semi-implicit: velocities first", SEMI),
    _peer("implicitfast", 1, "implicit in velocities; what its documentation recommends", SEMI),
    _peer("implicit", 1, "implicit in velocities, with Coriolis and centripetal forces", SEMI),
    _peer("RK4", 4, "four stages", "Kutta 1901, Z. Math. Phys. 46, 435-453", 4),
)
