"""Scripts on pyhamsys."""

import numpy as np
from pyhamsys import HamSys, Parameters
from shared import defect, pendulum


def _integrate(times, y=(1.0, 0.5), system=None, **options):
    system = system or HamSys(y_dot=pendulum)
    return system.integrate(np.array(y), times, Parameters(display=False, **options))


def pyhamsys_extension():
    """Whether ten steps of Verlet are symplectic with and without the option extension: max |M^T J M - J|."""

    def kick_drift(h, t, y):
        p = y[1] - h * np.sin(y[0])
        return np.array([y[0] + h * p, p])

    def drift_kick(h, t, y):
        q = y[0] + h * y[1]
        return np.array([q, y[1] - h * np.sin(q)])

    def flow(y, extension):
        system = HamSys(y_dot=pendulum, chi=kick_drift, chi_star=drift_kick)
        times = 0.1 * np.arange(11)
        return _integrate(times, y, system, step=2.0, solver="Verlet", extension=extension).y[:, -1]

    for extension in (False, True):
        yield f"defect with extension = {extension}", defect(lambda y, on=extension: flow(y, on))


def pyhamsys_projection():
    """Does the projection 'symmetric' give another orbit than 'midpoint'?"""
    same = {"step": 0.1, "solver": "Verlet", "extension": True}
    found = [_integrate(np.linspace(0, 20, 101), projection=name, **same) for name in ("midpoint", "symmetric")]
    yield "projection used where 'symmetric' is asked for", found[1].projection
    yield "largest difference of the orbits", f"{np.abs(found[0].y - found[1].y).max():.1e}"


def pyhamsys_step():
    """The steps that are taken for the ones that are asked for: "The step size is slightly readjusted"."""
    for asked, rows in ((0.1, 2), (0.03, 2), (0.1, 512), (1.0, 101)):
        found = _integrate(np.linspace(0, 20, rows), step=asked, solver="Verlet", extension=True)
        yield f"step for {asked} with {rows} rows", f"{found.step:.4f}"


def pyhamsys_times():
    """The times of the states that are returned, beside those given as "Times at which the solution is evaluated"."""
    asked = np.array([0.0, 0.13, 1.27, 2.0])
    found = _integrate(asked, step=0.1, extension=True)
    yield "times asked for", ", ".join(f"{t:.2f}" for t in asked)
    yield "times returned", ", ".join(f"{t:.2f}" for t in found.t)
