"""Scripts on gala."""

from fractions import Fraction as F

import numpy as np
from gala.integrate import DOPRI853Integrator, LeapfrogIntegrator, RK5Integrator, Ruth4Integrator
from gala.integrate.pyintegrators import rk5
from scipy.integrate import RK45  # Dormand & Prince's pair
from shared import order, pendulum


def gala_dopri853_defaults():
    """Whether DOPRI853 uses "The default tolerances (atol=1.49e-8, rtol=1.49e-8)" of its documentation.

    The error by default is compared with that at these tolerances and at rtol = 1e-6, atol = 1e-12.
    """

    def ends(**options):
        return DOPRI853Integrator(pendulum, **options)(w0=[1.0, 0.5], t=np.array([0.0, 100.0])).w()[:, -1].ravel()

    default, exact = ends(), ends(atol=1e-13, rtol=1e-13, nsteps=10_000)
    yield "error by default", f"{np.abs(default - exact).max():.2e}"
    yield "error at atol = rtol = 1.49e-8", f"{np.abs(ends(atol=1.49e-8, rtol=1.49e-8) - exact).max():.2e}"
    apart = np.abs(default - ends(rtol=1e-6, atol=1e-12)).max()
    yield "default less rtol = 1e-6 and atol = 1e-12", f"{apart:.2e}"


def gala_dopri853_order():
    """The order of the formula with which DOPRI853 advances, measured with a row each step and loose tolerances."""

    def end(n, span=6.0):
        h = span / n
        loose = {"atol": 1e9, "rtol": 1e9, "first_step": h, "max_step": h}
        return DOPRI853Integrator(pendulum, **loose)(w0=[1.0, 0.5], t1=0.0, dt=h, n_steps=n).w()[:, -1].ravel()

    yield "order", order(end, 20, end(400))


def gala_leapfrog_energy():
    """The energy error of the leapfrog on an oscillator: "It conserves energy exactly for linear systems"."""
    for dt in (0.1, 0.5):  # its docstring's example
        orbit = LeapfrogIntegrator(lambda t, w: np.array([w[1], -w[0]]))(w0=[1.0, 0.0], dt=dt, n_steps=1000)
        q, p = orbit.w()[:, :, 0] if orbit.w().ndim == 3 else orbit.w()
        yield f"relative energy error at dt = {dt}", f"{np.abs(q**2 + p**2 - 1).max():.2e}"


def gala_rk5_coefficients():
    """Whose weights RK5 has, "the Dormand-Prince coefficients": Dormand and Prince's, or Cash and Karp's."""
    cash_karp = np.array([F(37, 378), 0, F(250, 621), F(125, 594), 0, F(512, 1771)], dtype=float)
    for whose, weights in (("Cash and Karp's", cash_karp), ("Dormand and Prince's", RK45.B)):
        yield f"largest difference of the weights from {whose}", f"{np.abs(rk5.C - weights).max():.1e}"


def gala_time_dependent():
    """The orders of integrators where the force depends on time: q'' = -q + cos(2 t), whose solution is known."""

    def end(integrator, n, t=2.0):  # q(0) = 2/3, q'(0) = 0: q = cos t - cos(2 t) / 3
        forced = integrator(lambda t, w: np.array([w[1], -w[0] + np.cos(2 * t)]))
        return np.ravel(forced(w0=[2 / 3, 0.0], t1=0.0, dt=t / n, n_steps=n).w()[0])[-1]

    for one in (LeapfrogIntegrator, Ruth4Integrator, RK5Integrator):
        yield f"order of {one.__name__}", order(lambda n, one=one: end(one, n), 200, np.cos(2.0) - np.cos(4.0) / 3)
