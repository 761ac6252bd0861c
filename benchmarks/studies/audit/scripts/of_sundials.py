"""Scripts on SUNDIALS, through sundials4py."""

import numpy as np
from scipy.integrate import solve_ivp
from shared import order
from sundials4py import arkode, core

_, CONTEXT = core.SUNContext_Create(core.SUN_COMM_NULL)
array = core.N_VGetArrayPointer


def _fill(part, of):
    """A function for SUNDIALS that sets a part of a derivative to ``of(t, y)``."""
    return lambda t, y, out, _: array(out).__setitem__(part, of(t, array(y))) or 0


def _sprk(y, force, speed):
    vector = core.N_VMake_Serial(len(y), y, CONTEXT)
    return arkode.SPRKStepCreate(force, speed, 0.0, vector, CONTEXT), vector


def _walk(start, force, speed, method, n, span):
    """The start and the states after each of n steps, from clean memory: see sundials_memory."""
    integrator, vector = _sprk(y := np.array(start), force, speed)
    arkode.ARKodeSetFixedStep(integrator.get(), span / n)
    for name in ("EULER_1_1", method):  # the first one sets the memory that leapfrog reads
        y[:] = start
        states = [y.copy()]
        arkode.SPRKStepSetMethodName(integrator.get(), f"ARKODE_SPRK_{name}")
        arkode.ARKodeReset(integrator.get(), 0.0, vector)
        for _ in range(n):
            arkode.ARKodeEvolve(integrator.get(), span, vector, arkode.ARK_ONE_STEP)
            states.append(y.copy())
    return np.array(states)


def sundials_compensated():
    """Round-off of SPRKStep, plain and compensated, in a Kepler orbit's angular momentum over 40,000 steps."""

    def force(t, y):
        q1, q2 = map(float, y[:2])
        r3 = (q1 * q1 + q2 * q2) ** 1.5
        return -q1 / r3, -q2 / r3

    for name, compensated in (("plain", 0), ("compensated", 1)):
        y, worst = np.array([0.4, 0.0, 0.0, 2.0]), 0.0
        callbacks = _fill(slice(2, 4), force), _fill(slice(2), lambda t, y: y[2:])
        integrator, vector = _sprk(y, *callbacks)
        arkode.SPRKStepSetMethodName(integrator.get(), "ARKODE_SPRK_MCLACHLAN_4_4")
        arkode.ARKodeSetUseCompensatedSums(integrator.get(), compensated)
        arkode.ARKodeSetFixedStep(integrator.get(), 0.01)
        for _ in range(40_000):
            arkode.ARKodeEvolve(integrator.get(), 400.0, vector, arkode.ARK_ONE_STEP)
            worst = max(worst, abs(y[0] * y[3] - y[1] * y[2] - 0.8))
        yield f"largest error of the angular momentum, {name}", f"{worst:.1e}"


#: H - H0 at t = 50 with a step.
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


def sundials_kepler():
    """The example ark_kepler (e = 0.6) run again: H - H0 at t = 50 with its step, beside the answer it stores."""

    def radius(q):
        return np.sqrt(q[0] * q[0] + q[1] * q[1])

    def H(y):
        return 0.5 * (y[2] * y[2] + y[3] * y[3]) - 1.0 / radius(y)

    start = [0.4, 0.0, 0.0, np.sqrt(1.6 / 0.4)]
    force = _fill(slice(2, 4), lambda t, y: -y[:2] / pow(radius(y), 3.0))
    for method, (h, stored) in STORED.items():
        y = np.array(start)
        integrator, vector = _sprk(y, force, _fill(slice(2), lambda t, y: y[2:]))
        memory, before = integrator.get(), H(y)
        for name in ("EULER_1_1", method):  # the first one sets the memory that leapfrog reads, see sundials_memory
            y[:] = start
            codes = [arkode.SPRKStepSetMethodName(memory, f"ARKODE_SPRK_{name}"), arkode.ARKodeSetFixedStep(memory, h)]
            codes += [arkode.ARKodeReset(memory, 0.0, vector), arkode.ARKodeSetStopTime(memory, 50.0)]
            codes += [arkode.ARKodeSetMaxNumSteps(memory, 100_000)]
            arkode.ARKodeEvolve(memory, 50.0, vector, arkode.ARK_NORMAL)
        here = H(y) - before
        yield f"{method}: stored {stored}, here {here:.16e}, difference", f"{abs(here - float(stored)):.1e}"


def sundials_memory():
    """Whether leapfrog depends on what memory held before: 100 runs of one step after freeing arrays of NaN."""
    force, speed = _fill(slice(2, 4), lambda t, y: -y[:2]), _fill(slice(2), lambda t, y: y[2:])
    for method in ("LEAPFROG_2_2", "PSEUDO_LEAPFROG_2_2"):
        lost = 0
        for _ in range(100):
            left_behind = [np.full(4, np.nan) for _ in range(1000)]
            del left_behind
            y = np.array([1.0, 0.0, 0.0, 1.0])
            integrator, vector = _sprk(y, force, speed)
            arkode.SPRKStepSetMethodName(integrator.get(), f"ARKODE_SPRK_{method}")
            arkode.ARKodeSetFixedStep(integrator.get(), 0.1)
            arkode.ARKodeEvolve(integrator.get(), 0.1, vector, arkode.ARK_ONE_STEP)
            lost += not np.isfinite(y).all()
        yield f"runs of {method} that ended with NaN", lost


def sundials_names():
    """Whether the numbers in the names of SPRKStep's methods are their stages, counted as force evaluations."""
    force, speed = _fill(1, lambda t, y: -np.sin(y[0])), _fill(0, lambda t, y: y[1])
    for method in ("MCLACHLAN_5_6", "SOFRONIOU_10_36"):
        y = np.array([1.0, 0.5])
        memory, vector = _sprk(y, force, speed)
        arkode.SPRKStepSetMethodName(memory.get(), f"ARKODE_SPRK_{method}")
        arkode.ARKodeSetFixedStep(memory.get(), 0.1)
        arkode.ARKodeEvolve(memory.get(), 1.0, vector, arkode.ARK_ONE_STEP)
        yield f"the first number of {method}", method.split("_")[-2]
        yield f"stages of {method}", arkode.ARKodeGetNumRhsEvals(memory.get(), 0)[1]


def sundials_orders():
    """Orders of SPRKStep's methods in state and energy, for H = T(p) + exp(q) - q with T = exp(p) - p or p^2/2."""
    steps = {1: 400, 2: 100, 3: 40, 4: 40, 5: 20, 6: 16, 8: 10}
    nystrom = ("MCLACHLAN_4_4", "MCLACHLAN_5_6")
    methods = ["EULER_1_1", "LEAPFROG_2_2", "PSEUDO_LEAPFROG_2_2", "MCLACHLAN_2_2", "RUTH_3_3", "MCLACHLAN_3_3"]
    methods += ["CANDY_ROZMUS_4_4", "YOSHIDA_6_8", "SUZUKI_UMENO_8_16", *nystrom]  # order 10 is soon at round-off
    general = ("", lambda p: np.exp(p) - p, lambda p: np.exp(p) - 1)
    quadratic = (", T quadratic", lambda p: p * p / 2, lambda p: p)
    span, start = 3.0, [0.5, 0.3]
    for of, T, rate in (general, quadratic):
        field = lambda t, y, rate=rate: [rate(y[1]), 1 - np.exp(y[0])]  # noqa: E731
        exact = solve_ivp(field, (0, span), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        force, speed = _fill(1, lambda t, y: 1 - np.exp(y[0])), _fill(0, lambda t, y, rate=rate: rate(y[1]))
        for method in nystrom if of else methods:
            n, errors = steps[int(method.split("_")[-2])], []
            for k in (n, 2 * n):
                states = _walk(start, force, speed, method, k, span)
                q, p = states[:-1].T
                errors.append([np.abs(states[-1] - exact).max(), np.ptp(T(p) + np.exp(q) - q)])
            for what, found in zip("qH", np.log2(np.array(errors[0]) / errors[1]), strict=True):
                yield f"order of {what}, {method}{of}", f"{found:.2f}"


def sundials_relaxation():
    """Whether ERKStep with relaxation can call a Python function for H, tried in three forms on a pendulum."""
    H = lambda y: float(array(y)[1] ** 2 / 2 - np.cos(array(y)[0]))  # noqa: E731
    callables = {
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

    for form, function in callables.items():
        vector = core.N_VMake_Serial(2, np.array([1.0, 0.5]), CONTEXT)
        integrator = arkode.ERKStepCreate(rate, 0.0, vector, CONTEXT)
        arkode.ARKodeSStolerances(integrator.get(), 1e-6, 1e-6)
        accepted = arkode.ARKodeSetRelaxFn(integrator.get(), function, slope)
        try:
            told = arkode.ARKodeEvolve(integrator.get(), 1.0, vector, arkode.ARK_ONE_STEP)[0]
        except Exception as error:
            told = f"{type(error).__name__}, {error}"
        yield f"{form}: ARKodeSetRelaxFn {accepted}, then ARKodeEvolve", told


def sundials_time_dependent():
    """SPRKStep's orders where H depends on time (a pendulum whose gravity oscillates), and when its force is asked."""
    span, start, asked = 3.0, [1.0, 0.5], []

    def bend(t, y):
        asked.append(t)
        return -np.sin(y[0]) * (1 + 0.5 * np.cos(2 * t))

    def end(method, n):
        return _walk(start, _fill(1, bend), _fill(0, lambda t, y: y[1]), method, n, span)[-1]

    exact = solve_ivp(lambda t, y: [y[1], bend(t, y)], (0, span), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    for method in ("LEAPFROG_2_2", "MCLACHLAN_4_4", "YOSHIDA_6_8"):
        yield f"order of {method}", order(lambda n, method=method: end(method, n), 100, exact)
    end("LEAPFROG_2_2", 3)
    yield "leapfrog's first force, at q after half a step, is asked for at t/h", f"{asked[-3]:.2f}"
