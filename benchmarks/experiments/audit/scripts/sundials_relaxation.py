"""Whether SUNDIALS's ERKStep with relaxation can call a Python function for H, tried in three forms on a pendulum."""

import numpy as np
from sundials4py import arkode, core

_, context = core.SUNContext_Create(core.SUN_COMM_NULL)
array = core.N_VGetArrayPointer
H = lambda y: float(array(y)[1] ** 2 / 2 - np.cos(array(y)[0]))  # noqa: E731
CALLABLES = {
    "(y, H, data) -> 0": lambda y, value, data: 0,
    "(y, data) -> (0, H)": lambda y, data: (0, H(y)),
    "(y, data) -> H": lambda y, data: H(y),
}


def rate(t, y, out, _):
    array(out)[:] = [array(y)[1], -np.sin(array(y)[0])]
    return 0


def slope(y, out, _):
    array(out)[:] = [np.sin(array(y)[0]), array(y)[1]]
    return 0


for form, function in CALLABLES.items():
    vector = core.N_VMake_Serial(2, np.array([1.0, 0.5]), context)
    integrator = arkode.ERKStepCreate(rate, 0.0, vector, context)
    arkode.ARKodeSStolerances(integrator.get(), 1e-6, 1e-6)
    accepted = arkode.ARKodeSetRelaxFn(integrator.get(), function, slope)
    try:
        told = arkode.ARKodeEvolve(integrator.get(), 1.0, vector, arkode.ARK_ONE_STEP)[0]
    except Exception as error:
        told = f"{type(error).__name__}, {error}"
    print(f"{form}: ARKodeSetRelaxFn {accepted}, then ARKodeEvolve = {told}")
