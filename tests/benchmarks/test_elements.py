"""Orbital elements under all of REBOUND's names, about the first body and in Jacobi's way, against REBOUND."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.problems import bodies_file, elements
from phasebench.benchmarks.problems.units import G, units

rebound = pytest.importorskip("rebound")
ANGLES = {"inc", "Omega", "omega", "pomega", "M", "f", "l", "theta"}


def drawn(seed: int, bodies: int, times: bool = True) -> list[dict]:
    """A star and bodies with random elements, each under names drawn for it."""
    draw = np.random.default_rng(seed)
    rows = [{"name": "star", "m": 0.9}]
    for k in range(bodies):
        size = {draw.choice(elements.SIZES): 1.7 ** (k + 1) * (1 + 0.1 * draw.random())}
        row = {"name": f"b{k}", "m": float(draw.choice([0.0, 1e-5, 1e-3])), **size, "e": 0.9 * draw.random()}
        row |= {"inc": 180 * draw.random(), "Omega": 360 * draw.random()}
        row[draw.choice(elements.PERICENTRES)] = 360 * draw.random()
        place = draw.choice(elements.PLACES[:5] if times else elements.PLACES[:4])
        rows.append(row | {place: 360 * draw.random()})
    return rows


def of_rebound(rows: list[dict], about: str) -> np.ndarray:
    """Positions and velocities by REBOUND, array (n, 6), in units in which G = 1."""
    sim = rebound.Simulation()
    for row in rows:
        given = {k: np.radians(x) if k in ANGLES else x for k, x in row.items() if k != "name"}
        primary = {"primary": sim.particles[0]} if len(given) > 1 and about == "heliocentric" else {}
        sim.add(**given, **primary)
    return np.array([[*p.xyz, *p.vxyz] for p in sim.particles])


def of_suite(rows: list[dict], about: str) -> np.ndarray:
    # AU, and a unit of time in which G is 1.
    unit = float(G) ** -0.5
    rows = [{k: x * unit if k in ("P", "T", "T0") else x for k, x in row.items()} for row in rows]
    found = pb.planetary_system(rows, elements=about).bodies.members
    return np.array([[*map(float, b.x), *(float(v) * unit for v in b.v)] for b in found])


@pytest.mark.parametrize("about", ["heliocentric", "jacobi"])
def test_a_thousand_drawn_bodies_are_where_rebound_puts_them(about, monkeypatch):
    # No formulae are derived of the tables that are drawn.
    monkeypatch.setattr("phasebench.benchmarks.problems.planetary.of_bodies", lambda found, id: Table(found))
    worst, apart = 0.0, 0.0
    for seed in range(100):
        rows = drawn(seed, 5)
        ours, theirs = of_suite(rows, about), of_rebound(rows, about)
        size = np.abs(theirs).max(axis=1, keepdims=True) + 1e-300
        worst = max(worst, float((np.abs(ours - theirs) / size).max()))
        other = of_suite(rows, "jacobi" if about == "heliocentric" else "heliocentric")
        apart = max(apart, float((np.abs(other - theirs) / size).max()))
    assert worst < 2e-12
    assert apart > 1e-4, "the control"


class Table:
    """Stands in for a problem, of which the test takes the bodies alone."""

    def __init__(self, bodies):
        self.bodies = bodies


def test_at_the_time_of_transit_a_body_is_nearest_on_the_line_of_sight():
    given = {"P": 12.5, "e": 0.31, "inc": 89.0, "Omega": 70.0, "omega": 133.0, "T0": 3.7}
    mu = mpmath.mpf(2)
    n = 2 * mpmath.pi / 12.5

    def at(t: float) -> np.ndarray:
        moved = {k: x for k, x in given.items() if k != "T0"} | {"T0": given["T0"] - t}
        x, v = elements.state("here", moved, mu)
        return np.array([*map(float, x), *map(float, v)])

    x, y, z, vx, vy, _ = at(3.7)
    assert z > 0
    assert abs(x * vx + y * vy) < 2e-3 * np.hypot(x, y) * np.hypot(vx, vy) + 1e-3, "across the sky, to the tilt"
    assert np.hypot(x, y) < 0.02 * z
    assert np.hypot(*at(3.7 + 3.0)[:2]) > 0.5 * float(mpmath.cbrt(mu / n**2)), "the control"


def test_the_comment_of_a_file_says_what_elements_are_about():
    text = "# units: AU, day, Msun\n{}name,m,P,e\nsun,1,,\ninner,1e-3,300,0.1\nouter,1e-3,900,0.2\n"
    first, jacobi = (bodies_file.parse(text.format(x), "p.csv") for x in ("", "# elements: jacobi\n"))
    assert first.members[1] == jacobi.members[1]
    assert first.members[2] != jacobi.members[2]


@pytest.mark.parametrize(
    ("unit", "in_kg", "source"),
    [("Msun", 1.98841e30, 1e-4), ("Mjup", 1.89813e27, 1e-4), ("Mearth", 5.97217e24, 1e-4), ("kg", 1.0, 1e-12)],
)
def test_masses_and_times_have_their_units(unit, in_kg, source):
    here, day = units(f"km, s, {unit}", "here"), units("AU, day, Msun", "here")
    assert pytest.approx(6.6743e-20 * in_kg, rel=source) == here.G
    assert pytest.approx(day.G / 24**2, rel=1e-14) == units("AU, h, Msun", "here").G
    assert pytest.approx(day.G / 1440**2, rel=1e-14) == units("AU, min, Msun", "here").G


def test_elements_of_the_osculating_orbit_are_those_of_the_table():
    for seed in range(5):
        rows = drawn(seed, 3)
        made = pb.planetary_system(rows)
        sim = rebound.Simulation()
        sim.G = float(made.bodies.units.G)
        for row in rows:
            given = {k: np.radians(x) if k in ANGLES else x for k, x in row.items() if k != "name"}
            sim.add(**given, **({"primary": sim.particles[0]} if len(given) > 1 else {}))
        for k, row in enumerate(rows[1:], start=1):
            orbit = sim.particles[k].orbit(primary=sim.particles[0])
            for name in ("a", "e", "inc", "Omega", "pomega"):
                found = quantity(made, f"{row['name']}.{name}")
                here = float(found.values(made, np.zeros(1), np.array([made.q0]), np.array([made.p0]))[0])
                apart = here - getattr(orbit, name)
                apart = (apart + np.pi) % (2 * np.pi) - np.pi if found.angle else apart
                assert abs(apart) < 1e-9 * max(1.0, abs(here)), (seed, row, name)
