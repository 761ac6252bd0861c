"""The quantity b.transit: against the table's own T0, and against REBOUND's orbits and a bisection."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.named_quantities import quantities, quantity
from phasebench.benchmarks.measure.transits import AFTER

YEAR = 365.25
STAR = {"name": "star", "m": 1.0}
B = {"name": "b", "m": 1e-3, "P": 10.0, "e": 0.1, "inc": 88.0, "Omega": 40.0, "omega": 77.0, "T0": 3.7}


def transit(system, name: str, q=None, p=None) -> float:
    q, p = (system.q0, system.p0) if q is None else (q, p)
    return float(quantity(system, f"{name}.transit").values(system, np.zeros(1), np.array([q]), np.array([p]))[0])


def periods_off(t: float) -> float:
    return abs((t - 3.7) / 10 - round((t - 3.7) / 10))


@pytest.mark.parametrize(("inc", "node"), [(88.0, 40.0), (104.0, 40.0), (0.0, 0.0), (180.0, 0.0)])
def test_two_bodies_return_the_time_of_their_table(inc, node):
    system = pb.planetary_system([STAR, B | {"inc": inc, "Omega": node}])
    for t_end in (0.0, 23.7, 28.7, -15.0):  # a transit, and half a period after it
        q, p = system.q0, system.p0
        if t_end:
            run = pb.integrate(system, "wisdom-holman", t_end=t_end, steps=2)
            q, p = run.q[-1], run.p[-1]
        later = transit(system, "b", q, p)
        assert 10 * AFTER < later < 10 * (1 + AFTER)
        assert periods_off(t_end + later) < 1e-10
    other = pb.planetary_system([STAR, B | {"inc": inc, "Omega": node, "T0": 3.7 + 1e-6}])
    assert periods_off(transit(other, "b")) > 5e-8, "the control"


def by_rebound(system, body: int, t_end: float, degrees: float = 90.0) -> float:
    """The first time at which f + omega is ``degrees``, `AFTER` periods after t_end or later."""
    rebound = pytest.importorskip("rebound")
    masses = np.array(system.bodies.masses)
    sim = rebound.Simulation()
    sim.G = float(system.bodies.units.G)
    for m, x, v in zip(masses, np.reshape(system.q0, (-1, 3)), np.reshape(system.p0, (-1, 3)), strict=True):
        sim.add(m=m, **dict(zip(("x", "y", "z", "vx", "vy", "vz"), (*x, *(v / m)), strict=True)))

    def before(t: float) -> bool:
        sim.integrate(t)
        orbit = sim.particles[body].orbit(primary=sim.particles[0])
        return np.cos(orbit.omega + orbit.f - np.radians(degrees - 90)) > 0

    period = sim.particles[body].orbit(primary=sim.particles[0]).P
    times = t_end + period * np.arange(AFTER, 3, 0.02)
    found = [before(t) for t in times]
    k = next(k for k in range(len(times)) if found[k] and not found[k + 1])
    low, high = times[k], times[k + 1]
    while high - low > 1e-11 * high:
        low, high = ((low + high) / 2, high) if before((low + high) / 2) else (low, (low + high) / 2)
    return high


def test_planets_transit_when_rebound_says_so():
    c = {"name": "c", "m": 3e-4, "P": 20.3, "e": 0.05, "inc": 91.5, "Omega": 43.0, "omega": 200.0, "T0": 9.0}
    system, t_end = pb.planetary_system([STAR, B, c]), YEAR / 2
    run = pb.prepare(system, "heyoka", tol=1e-15)
    q, p, status = run(t_end)
    assert status == "ok"
    for body, row in ((1, B), (2, c)):
        found = t_end + transit(system, row["name"], q, p)
        assert abs(found - by_rebound(system, body, t_end)) < 1e-8 * YEAR
        assert abs(found - by_rebound(system, body, t_end, degrees=89.0)) > 1e-5 * YEAR, "the control"
        linear = (found - row["T0"]) / row["P"]
        assert abs(linear - round(linear)) > 1e-4, "the other planet shifts it"
    q, p = np.array(q), np.array(p)
    q[6:] = np.nan
    alone = system.without("c")
    assert transit(system, "b", q, p) == pytest.approx(transit(alone, "b", q[:6], p[:6]), abs=1e-11)
    assert np.isnan(transit(system, "c", q, p))


def test_transits_are_listed_and_of_an_open_orbit_there_are_none():
    places = ("x", "y", "z", "vx", "vy", "vz")
    b = {"name": "b", "m": 0.0} | dict(zip(places, (1.0, 0.0, 0.1, 0.0, 0.1, 0.0), strict=True))
    system = pb.planetary_system([STAR | dict.fromkeys(places, 0.0), b], frame="heliocentric")
    assert np.isnan(transit(system, "b"))
    assert {"b.transit", "b.longitude"} <= {*quantities(system)}
    assert "star.transit" not in quantities(system)
    with pytest.raises(pb.InvalidInput, match=r"did you mean b\.transit"):
        quantity(system, "b.transi")
