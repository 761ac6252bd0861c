"""Scripts on REBOUND."""

import numpy as np
import rebound
from shared import order


def _simulation(integrator, bodies, **options):
    sim = rebound.Simulation()
    sim.integrator = integrator
    for name, value in options.items():
        setattr(sim.integrator, name, value)
    for body in bodies:
        sim.add(**body)
    return sim


def _end(integrator, bodies, steps, span=6.0, **options):
    sim = _simulation(integrator, bodies, **options)
    sim.dt = span / steps
    sim.integrate(span) if integrator == "ias15" else sim.steps(steps)
    sim.synchronize()
    return np.array([p.xyz for p in sim.particles])


def _planets(eps, e=0.1):
    return {"m": 1.0}, {"m": eps, "a": 1.0, "e": e}, {"m": eps, "a": 1.9, "e": e, "f": 1.0}


def rebound_correctors():
    """The order in h of WHFast with correctors 0, 3 and 5, said to be "the order of the symplectic corrector".

    It is measured on a star and two planets of mass eps = 1e-6.
    """
    planets = _planets(1e-6, 0.05)
    exact = _end("ias15", planets, 100)
    for corrector in (0, 3, 5):
        ends = [_end("whfast", planets, n, corrector=corrector, safe_mode=0) for n in (24, 40)]
        coarse, fine = (np.abs(end - exact)[1:].max() for end in ends)
        yield f"order in h with corrector {corrector}", f"{np.log(coarse / fine) / np.log(40 / 24):.2f}"


def rebound_janus_reversible():
    """Whether JANUS is "bit-wise time-reversible" at every order: three bodies, 1000 steps out and back."""

    def state(sim):
        x, v = np.empty((2, sim.N, 3))
        sim.serialize_particle_data(xyz=x, vxvyvz=v)
        return np.concatenate([x, v])

    bodies = {"m": 1.0}, *({"m": 1e-3, "a": a, "e": 0.1, "f": 0.3} for a in (1.0, 2.0))
    for q in (2, 4, 6, 8, 10):
        sim = _simulation("janus", bodies, order=q)
        sim.dt = 0.01
        sim.steps(1)  # the start becomes one of its integers
        start = state(sim)
        sim.steps(1000)
        sim.dt = -sim.dt
        sim.steps(1000)
        differ = int((state(sim) != start).sum())
        yield f"numbers that differ after 1000 steps out and back, order {q}", differ


def rebound_leapfrog_order_4():
    """The orders measured of leapfrog with its option order set to 2, 4, 6 and 8.

    The documentation says: "Default is 2.  Other allowed values are 6 and 8".
    """
    bodies = {"m": 1.0}, {"m": 1e-2, "a": 1.0, "e": 0.2, "f": 0.5}
    exact = _end("ias15", bodies, 100)
    for q, steps in {2: 120, 4: 120, 6: 120, 8: 50}.items():
        found = order(lambda n, q=q: _end("leapfrog", bodies, n, order=q), steps, exact)
        yield f"order measured for order = {q}", found


def rebound_whfast_bitwise():
    """Whether output on the way changes an orbit of WHFast: keep_unsynchronized, "bit-wise reproducibility"."""

    def end(outputs, keep):
        sim = _simulation("whfast", _planets(1e-3), safe_mode=0, corrector=11, keep_unsynchronized=keep)
        sim.dt = 0.05
        for _ in range(outputs):
            sim.steps(1000 // outputs)
            sim.synchronize()
        return np.array([p.xyz + p.vxyz for p in sim.particles])

    for keep in (0, 1):
        differ = int((end(1, keep) != end(10, keep)).sum())
        yield f"numbers of 18 that ten outputs change, keep_unsynchronized {keep}", differ


def rebound_whfast_orders():
    """WHFast on a star and two planets of mass eps: how the error falls with h, and how with eps."""
    for kernel in ("default", "modifiedkick", "composition", "lazy"):
        error = {}
        for eps in (1e-2, 1e-3):
            exact = _end("ias15", _planets(eps), 100)
            for n in (100, 200):
                end = _end("whfast", _planets(eps), n, kernel=kernel, corrector=17, safe_mode=0)
                error[eps, n] = np.abs(end - exact)[1:].max()
        yield f"order in h, {kernel} kernel", f"{np.log2(error[1e-2, 100] / error[1e-2, 200]):.2f}"
        yield f"order in eps, {kernel} kernel", f"{np.log10(error[1e-2, 200] / error[1e-3, 200]):.2f}"
