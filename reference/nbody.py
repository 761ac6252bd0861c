r"""REBOUND on Kepler problems, through its public Python interface: a comparison, imported only when it is asked for.

:math:`H = |p|^2/2 - 1/r` is a massless particle around a body of mass 1 that rests.  The Schwarzschild term
:math:`-\mu/(3r^3)` is the extra force :math:`-\mu q/r^5`, compiled by Numba to a C callback: a Python callback would
cost far more than the step.

Sources: H. Rein, S.-F. Liu, Astron. Astrophys. 537 (2012) A128 (REBOUND); H. Rein, D. S. Spiegel, Mon. Not. R. Astron.
Soc. 446 (2015) 1424-1437 (IAS15); H. Rein, D. Tamayo, G. Brown, Mon. Not. R. Astron. Soc. 489 (2019) 4632-4640
(WHFast with correctors and the lazy kernel).
"""

from __future__ import annotations

import time
from functools import lru_cache

import numpy as np

#: WHFast's options with an extra force.  The modified kick does not see extra forces; the lazy kernel does.
PERTURBED = {"corrector": 17, "kernel": "lazy"}


@lru_cache(maxsize=64)
def schwarzschild(mu: float):
    """The compiled callback that adds -mu q / r^5 to the second particle's acceleration; keep it while REBOUND runs."""
    import ctypes

    from numba import cfunc, types
    from rebound import Particle, Simulation

    # The simulation and its particles are read as arrays of 8-byte slots, so that no structure has to be declared.
    particles, size = Simulation._particles.offset // 8, ctypes.sizeof(Particle) // 8
    x, y = Particle.x.offset // 8, Particle.y.offset // 8
    ax, ay = size + Particle.ax.offset // 8, size + Particle.ay.offset // 8
    pointer = types.CPointer(types.CPointer(types.float64))

    @cfunc(types.void(pointer), error_model="numpy")
    def force(simulation):
        body = simulation[particles]
        dx, dy = body[size + x] - body[x], body[size + y] - body[y]
        r2 = dx * dx + dy * dy
        factor = -mu / (r2 * r2 * np.sqrt(r2))
        body[ax] += factor * dx
        body[ay] += factor * dy

    return force


def simulation(problem, q0, p0, integrator: str, mu: float = 0.0, **options):
    """A REBOUND simulation of a (perturbed) Kepler problem and the callback that it needs kept alive (or None)."""
    import rebound

    sim = rebound.Simulation()
    sim.integrator = integrator  # options set before are forgotten here
    for name, value in options.items():
        setattr(sim.integrator, name, value)
    sim.add(m=1.0)
    sim.add(m=0.0, x=q0[0], y=q0[1], vx=p0[0], vy=p0[1])
    force = None
    if mu:
        force = schwarzschild(float(mu))
        sim.additional_forces = force.address
    return sim, force


def run(problem, integrator: str, q0, p0, h: float, index, tol: float | None = None):
    """Integrate to the step numbers ``index`` (increasing, from 0), each a row.

    Returns (q, p of shape (rows, 2), steps taken, seconds in REBOUND alone).  IAS15 stops at the times h times index;
    the others take that many steps of h, so that no sum of times enters.
    """
    mu = problem.parameters["mu"] if problem.id == "perturbed-kepler" else 0.0
    options = {}
    if integrator == "ias15" and tol is not None:
        options = {"epsilon": tol}
    elif integrator == "whfast":
        options = {"safe_mode": 0} | (PERTURBED if mu else {})
    sim, force = simulation(problem, q0, p0, integrator, mu, **options)
    if integrator != "ias15":
        sim.dt = h
    rows = np.empty((len(index), 4))
    rows[0] = [*q0, *p0]
    spent, at, reached = 0.0, 0, len(index)
    for row, n in enumerate(index[1:], start=1):
        started = time.perf_counter()
        if integrator == "ias15":
            sim.integrate(h * int(n))
        else:
            sim.steps(int(n) - at)
            sim.synchronize()
        spent += time.perf_counter() - started
        at = int(n)
        body = sim.particles[1]
        rows[row] = body.x, body.y, body.vx, body.vy
        if not np.isfinite(rows[row]).all():
            reached = row
            break
    del force  # not before: the simulation holds only its address
    return rows[:reached, :2], rows[:reached, 2:], int(sim.steps_done), spent
