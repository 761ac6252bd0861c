"""Orders of SPRKStep's methods in state and energy, for H = T(p) + exp(q) - q with T = exp(p) - p or p^2/2."""

import numpy as np
from scipy.integrate import solve_ivp
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array, END, START = core.N_VGetArrayPointer, 3.0, [0.5, 0.3]
STEPS = {1: 400, 2: 100, 3: 40, 4: 40, 5: 20, 6: 16, 8: 10}
NYSTROM = ("MCLACHLAN_4_4", "MCLACHLAN_5_6")
METHODS = ["EULER_1_1", "LEAPFROG_2_2", "PSEUDO_LEAPFROG_2_2", "MCLACHLAN_2_2", "RUTH_3_3", "MCLACHLAN_3_3"]
METHODS += ["CANDY_ROZMUS_4_4", "YOSHIDA_6_8", "SUZUKI_UMENO_8_16", *NYSTROM]  # order 10 is soon at round-off
GENERAL, QUADRATIC = (lambda p: np.exp(p) - p, lambda p: np.exp(p) - 1), (lambda p: p * p / 2, lambda p: p)


def errors(method, n, T, rate):
    force = lambda t, y, out, _: array(out).__setitem__(1, 1 - np.exp(array(y)[0])) or 0  # noqa: E731
    speed = lambda t, y, out, _: array(out).__setitem__(0, rate(array(y)[1])) or 0  # noqa: E731
    vector = core.N_VMake_Serial(2, y := np.array(START), context)
    integrator = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
    arkode.ARKodeSetFixedStep(integrator.get(), END / n)
    for name in ("EULER_1_1", method):  # the first one sets the memory that leapfrog reads, see sundials_memory
        y[:], energy = START, []
        arkode.SPRKStepSetMethodName(integrator.get(), f"ARKODE_SPRK_{name}")
        arkode.ARKodeReset(integrator.get(), 0.0, vector)
        for _ in range(n):
            energy.append(T(y[1]) + np.exp(y[0]) - y[0])
            arkode.ARKodeEvolve(integrator.get(), END, vector, arkode.ARK_ONE_STEP)
    exact = solve_ivp(lambda t, y: [rate(y[1]), 1 - np.exp(y[0])], (0, END), START, "DOP853", rtol=1e-13, atol=1e-14)
    return np.array([np.abs(y - exact.y[:, -1]).max(), np.ptp(energy)])


for method, kinetic, of in [(m, GENERAL, "") for m in METHODS] + [(m, QUADRATIC, ", T quadratic") for m in NYSTROM]:
    n = STEPS[int(method.split("_")[-2])]
    for what, order in zip("qH", np.log2(errors(method, n, *kinetic) / errors(method, 2 * n, *kinetic)), strict=True):
        print(f"order of {what}, {method}{of} = {order:.2f}")
