"""Scripts on MuJoCo."""

import mujoco
import numpy as np


def _model(bodies, integrator, h, gravity, flags=""):
    option = f'<option gravity="0 0 {gravity}" integrator="{integrator}" timestep="{h}">{flags}</option>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{bodies}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def mujoco_free_body():
    """Whether implicitfast loses kinetic energy of a tumbling free body (moments of inertia 1, 2, 2.5).

    Over 50000 steps of 0.02, beside Euler's method for comparison, and the power of h in the loss of one step, from h =
    0.02 and 0.01.
    """
    body = '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 2 2.5"/></body>'

    def energies(integrator, h, n):
        (model, data), found = _model(body, integrator, h, 0), np.empty(n + 1)
        data.qvel[3:] = [0.0625, 1, 0.025]
        for k in range(n + 1):
            found[k] = (np.array([1, 2, 2.5]) * data.qvel[3:] ** 2).sum() / 2
            mujoco.mj_step(model, data)
        return found

    for name in ("implicitfast", "Euler"):
        found = energies(name, 0.02, 50_000)
        gained = (np.diff(found) > 1e-14 * found[0]).sum()
        yield f"steps of {name} that gain more than 1e-14 of the energy", gained
        yield f"relative change of the energy by {name}", f"{found[-1] / found[0] - 1:.2f}"
    lost = [-np.diff(energies("implicitfast", h, 1))[0] for h in (0.02, 0.01)]
    yield "power of h in the loss of a step", f"{np.log2(lost[0] / lost[1]):.2f}"


def mujoco_rk4():
    """The largest energy error of RK4 at h = 0.02 beside those of the single-step methods at h / 4.

    On a double pendulum released at rest at 120 and -10 degrees, over 100 units of time, without damping.
    """
    rod = '<joint axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.25 0.25 0.25"/>'
    bodies = f'<body>{rod}<body pos="0 0 -1">{rod}</body></body>'
    for name, h in (("RK4", 0.02), ("Euler", 0.005), ("implicitfast", 0.005), ("implicit", 0.005)):
        (model, data), found = _model(bodies, name, h, -1, '<flag energy="enable"/>'), []
        data.qpos[:] = np.radians([120, -130])
        for _ in range(round(100 / h)):
            mujoco.mj_step(model, data)
            found.append(data.energy.sum())
        yield f"energy error of {name} at h = {h}", f"{np.abs(np.array(found) - found[0]).max():.1e}"
