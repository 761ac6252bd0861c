"""Round-off of SUNDIALS's SPRKStep, plain and compensated, in a Kepler orbit's angular momentum over 40,000 steps."""

import numpy as np
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array = core.N_VGetArrayPointer


def force(t, y, out, _):
    q1, q2 = map(float, array(y)[:2])
    r3 = (q1 * q1 + q2 * q2) ** 1.5
    array(out)[2:] = (-q1 / r3, -q2 / r3)
    return 0


def speed(t, y, out, _):
    array(out)[:2] = array(y)[2:]
    return 0


for name, compensated in (("plain", 0), ("compensated", 1)):
    y, worst = np.array([0.4, 0.0, 0.0, 2.0]), 0.0
    vector = core.N_VMake_Serial(4, y, context)
    integrator = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
    arkode.SPRKStepSetMethodName(integrator.get(), "ARKODE_SPRK_MCLACHLAN_4_4")
    arkode.ARKodeSetUseCompensatedSums(integrator.get(), compensated)
    arkode.ARKodeSetFixedStep(integrator.get(), 0.01)
    for _ in range(40_000):
        arkode.ARKodeEvolve(integrator.get(), 400.0, vector, arkode.ARK_ONE_STEP)
        worst = max(worst, abs(y[0] * y[3] - y[1] * y[2] - 0.8))
    print(f"largest error of the angular momentum, {name} = {worst:.1e}")
