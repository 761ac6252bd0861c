"""Whether MuJoCo's integrator implicitfast loses kinetic energy of a tumbling free body (moments of inertia 1, 2, 2.5).

Over 50000 steps of 0.02, beside Euler's method for comparison, and the power of h in the loss of one step, from h =
0.02 and 0.01.
"""

import mujoco
import numpy as np

BODY = '<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 2 2.5"/></body>'
moments, start = np.array([1, 2, 2.5]), np.array([0.0625, 1, 0.025])


def energies(integrator, h, n):
    option = f'<option gravity="0 0 0" integrator="{integrator}" timestep="{h}"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{BODY}</worldbody></mujoco>")
    data, found = mujoco.MjData(model), np.empty(n + 1)
    data.qvel[3:] = start
    for k in range(n + 1):
        found[k] = (moments * data.qvel[3:] ** 2).sum() / 2
        mujoco.mj_step(model, data)
    return found


for name in ("implicitfast", "Euler"):
    found = energies(name, 0.02, 50_000)
    print(f"steps of {name} that gain more than 1e-14 of the energy = {(np.diff(found) > 1e-14 * found[0]).sum()}")
    print(f"relative change of the energy by {name} = {found[-1] / found[0] - 1:.2f}")
lost = [-np.diff(energies("implicitfast", h, 1))[0] for h in (0.02, 0.01)]
print(f"power of h in the loss of a step = {np.log2(lost[0] / lost[1]):.2f}")
