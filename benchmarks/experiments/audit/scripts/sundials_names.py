"""Whether the numbers in the names of SPRKStep's methods are their stages, counted as force evaluations."""

import numpy as np
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array = core.N_VGetArrayPointer
force = lambda t, y, out, _: array(out).__setitem__(1, -np.sin(array(y)[0])) or 0  # noqa: E731
speed = lambda t, y, out, _: array(out).__setitem__(0, array(y)[1]) or 0  # noqa: E731
for method in ("MCLACHLAN_5_6", "SOFRONIOU_10_36"):
    vector = core.N_VMake_Serial(2, np.array([1.0, 0.5]), context)
    memory = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
    arkode.SPRKStepSetMethodName(memory.get(), f"ARKODE_SPRK_{method}")
    arkode.ARKodeSetFixedStep(memory.get(), 0.1)
    arkode.ARKodeEvolve(memory.get(), 1.0, vector, arkode.ARK_ONE_STEP)
    print(f"the first number of {method} = {method.split('_')[-2]}")
    print(f"stages of {method} = {arkode.ARKodeGetNumRhsEvals(memory.get(), 0)[1]}")
