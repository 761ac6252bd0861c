"""MuJoCo: the largest energy error of RK4 at h = 0.02 beside those of the single-step methods at h / 4.

On a double pendulum released at rest at 120 and -10 degrees, over 100 units of time, without damping.
"""

import mujoco
import numpy as np

BODIES = """<body><joint axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.25 0.25 0.25"/>
<body pos="0 0 -1"><joint axis="0 1 0"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.25 0.25 0.25"/></body></body>
"""


def error(integrator, h):
    flags = f'<option gravity="0 0 -1" integrator="{integrator}" timestep="{h}"><flag energy="enable"/></option>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{flags}<worldbody>{BODIES}</worldbody></mujoco>")
    data, found = mujoco.MjData(model), []
    data.qpos[:] = np.radians([120, -130])
    for _ in range(round(100 / h)):
        mujoco.mj_step(model, data)
        found.append(data.energy.sum())
    return np.abs(np.array(found) - found[0]).max()


for name, h in (("RK4", 0.02), ("Euler", 0.005), ("implicitfast", 0.005), ("implicit", 0.005)):
    print(f"energy error of {name} at h = {h} = {error(name, h):.1e}")
