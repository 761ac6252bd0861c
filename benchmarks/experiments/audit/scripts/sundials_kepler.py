"""SUNDIALS's example ark_kepler (e = 0.6) run again: H - H0 at t = 50 with its step, beside the answer it stores."""

import numpy as np
from sundials4py import arkode, core

#: From examples/arkode/C_serial/ark_kepler_--stepper_SPRK_--step-mode_fixed_--method_*_--tf_50_--check-order_*.out
STORED = {
    "EULER_1_1": (1e-3, "-1.2973337429578180e-03"),
    "LEAPFROG_2_2": (1e-3, "-1.0321183419037538e-07"),
    "PSEUDO_LEAPFROG_2_2": (1e-3, "3.2112992007782282e-06"),
    "MCLACHLAN_2_2": (1e-3, "7.5370554486475783e-07"),
    "RUTH_3_3": (0.1, "8.9150805802473698e-04"),
    "MCLACHLAN_3_3": (0.1, "8.9881034690120210e-04"),
    "MCLACHLAN_4_4": (0.1, "-5.3723049984188975e-06"),
    "MCLACHLAN_5_6": (0.1, "7.5734793938408984e-06"),
    "YOSHIDA_6_8": (0.1, "1.2681182276619296e-04"),
}
_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array, root = core.N_VGetArrayPointer, np.sqrt
radius = lambda q: root(q[0] * q[0] + q[1] * q[1])  # noqa: E731
H = lambda y: 0.5 * (y[2] * y[2] + y[3] * y[3]) - 1.0 / radius(y)  # noqa: E731
force = lambda t, y, out, _: array(out).__setitem__(slice(2, 4), -array(y)[:2] / pow(radius(array(y)), 3.0)) or 0  # noqa: E731
speed = lambda t, y, out, _: array(out).__setitem__(slice(2), array(y)[2:]) or 0  # noqa: E731
START = [0.4, 0.0, 0.0, root(1.6 / 0.4)]
for method, (h, stored) in STORED.items():
    y = np.array(START)
    vector = core.N_VMake_Serial(4, y, context)
    integrator = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
    memory, start = integrator.get(), H(y)
    for name in ("EULER_1_1", method):  # the first one sets the memory that leapfrog reads, see sundials_memory
        y[:] = START
        codes = [arkode.SPRKStepSetMethodName(memory, f"ARKODE_SPRK_{name}"), arkode.ARKodeSetFixedStep(memory, h)]
        codes += [arkode.ARKodeReset(memory, 0.0, vector), arkode.ARKodeSetStopTime(memory, 50.0)]
        codes += [arkode.ARKodeSetMaxNumSteps(memory, 100_000)]
        arkode.ARKodeEvolve(memory, 50.0, vector, arkode.ARK_NORMAL)
    print(f"{method}: stored {stored}, here {H(y) - start:.16e}, difference = {abs(H(y) - start - float(stored)):.1e}")
