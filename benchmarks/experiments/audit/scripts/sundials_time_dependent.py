"""SPRKStep's orders where H depends on time (a pendulum whose gravity oscillates), and when the force is evaluated."""

import numpy as np
from scipy.integrate import solve_ivp
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array, END, START = core.N_VGetArrayPointer, 3.0, [1.0, 0.5]
gravity = lambda t: 1 + 0.5 * np.cos(2 * t)  # noqa: E731
speed = lambda t, y, out, _: array(out).__setitem__(0, array(y)[1]) or 0  # noqa: E731
asked = []
force = lambda t, y, out, _: asked.append(t) or array(out).__setitem__(1, -np.sin(array(y)[0]) * gravity(t)) or 0  # noqa: E731


def end(method, n):
    y = np.array(START)
    vector = core.N_VMake_Serial(2, y, context)
    integrator = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
    arkode.ARKodeSetFixedStep(integrator.get(), END / n)
    for name in ("EULER_1_1", method):  # the first one sets the memory that leapfrog reads, see sundials_memory
        y[:] = START
        arkode.SPRKStepSetMethodName(integrator.get(), f"ARKODE_SPRK_{name}")
        arkode.ARKodeReset(integrator.get(), 0.0, vector)
        for _ in range(n):
            arkode.ARKodeEvolve(integrator.get(), END, vector, arkode.ARK_ONE_STEP)
    return y


field = lambda t, y: [y[1], -np.sin(y[0]) * gravity(t)]  # noqa: E731
exact = solve_ivp(field, (0, END), START, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
for method in ("LEAPFROG_2_2", "MCLACHLAN_4_4", "YOSHIDA_6_8"):
    coarse, fine = (np.abs(end(method, n) - exact).max() for n in (100, 200))
    print(f"order of {method} = {np.log2(coarse / fine):.2f}")
end("LEAPFROG_2_2", 3)
print(f"leapfrog's first force, at q after half a step, is asked for at t/h = {asked[-3]:.2f}")
