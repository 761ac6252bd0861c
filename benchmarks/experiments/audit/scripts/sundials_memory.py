"""Whether SPRKStep's leapfrog depends on what memory held before: 100 runs of one step after freeing arrays of NaN."""

import numpy as np
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array = core.N_VGetArrayPointer
force = lambda t, y, out, _: array(out).__setitem__(slice(2, 4), -array(y)[:2]) or 0  # noqa: E731
speed = lambda t, y, out, _: array(out).__setitem__(slice(2), array(y)[2:]) or 0  # noqa: E731
for method in ("LEAPFROG_2_2", "PSEUDO_LEAPFROG_2_2"):
    lost = 0
    for _ in range(100):
        left_behind = [np.full(4, np.nan) for _ in range(1000)]
        del left_behind
        y = np.array([1.0, 0.0, 0.0, 1.0])
        vector = core.N_VMake_Serial(4, y, context)
        integrator = arkode.SPRKStepCreate(force, speed, 0.0, vector, context)
        arkode.SPRKStepSetMethodName(integrator.get(), f"ARKODE_SPRK_{method}")
        arkode.ARKodeSetFixedStep(integrator.get(), 0.1)
        arkode.ARKodeEvolve(integrator.get(), 0.1, vector, arkode.ARK_ONE_STEP)
        lost += not np.isfinite(y).all()
    print(f"runs of {method} that ended with NaN = {lost}")
