"""Scripts on SciPy."""

from scipy.integrate import solve_ivp
from shared import order, pendulum


def scipy_orders():
    """The orders of explicit methods on the pendulum, at steps held constant by max_step and loose tolerances."""

    def end(method, **options):
        return solve_ivp(pendulum, (0, 6), [1.0, 0.5], method=method, **options).y[:, -1]

    def loose(method, n):
        return end(method, first_step=6 / n, max_step=6 / n, rtol=1e-3, atol=1e9)

    exact = end("DOP853", rtol=1e-13, atol=1e-13)
    for method, n in {"RK23": 200, "RK45": 100, "DOP853": 20}.items():
        yield f"order of {method}", order(lambda n, method=method: loose(method, n), n, exact)
