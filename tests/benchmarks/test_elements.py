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
    moved = (at(1e-4) - at(-1e-4))[:3] / 2e-4
    assert np.abs(moved - at(0.0)[3:]).max() < 1e-6, "later times are later on the orbit"
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
    assert pytest.approx(day.G * 149597870.7**3 / 86400**2, rel=1e-14) == units("km, s, Msun", "here").G
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


def test_a_flattened_body_has_its_potential_and_turns_the_node_and_the_pericentre():
    rows = [{"name": "saturn", "m": 1.0}]
    rows += [{"name": "moon", "m": 0.0, "a": 1.0, "e": 0.05, "inc": 30.0, "Omega": 40.0, "omega": 60.0, "M": 10.0}]
    round_, flat = (pb.planetary_system(rows, J2=J2, J4=J4, radius=0.2) for J2, J4 in ((0.0, 0.0), (0.01, -0.003)))
    q = np.array([[0.1, 0.0, 0.2, 0.6, -0.3, 0.9]])
    away = q[0, 3:] - q[0, :3]
    r = np.linalg.norm(away)
    legendre = [np.polynomial.Legendre.basis(n)(away[2] / r) for n in (2, 4)]
    more = float(G) / r * (0.01 * (0.2 / r) ** 2 * legendre[0] - 0.003 * (0.2 / r) ** 4 * legendre[1])
    mass = round_.bodies.masses[1]
    H = [float(s.system.observe(s.system.H, q, 0 * q)[0]) for s in (round_, flat)]
    assert (H[1] - H[0]) / mass == pytest.approx(more, rel=1e-4)
    assert "angular-momentum-1" not in flat.invariants
    # The rates to the first order in J2.
    made = pb.planetary_system(rows, J2=2e-5, radius=0.2)
    n, c = float(G) ** 0.5, np.cos(np.radians(30))
    s = pb.integrate(made, "wisdom-holman", h=2 * np.pi / n / 50, t_end=400 * np.pi / n, save_every=5)
    assert s.status == "ok"
    first = -1.5 * n * 2e-5 * (0.2 / (1 - 0.05**2)) ** 2
    for name, rate in (("Omega", first * c), ("pomega", first * c - first / 2 * (5 * c**2 - 1))):
        values = quantity(made, f"moon.{name}").values
        places = [slice(k, k + 1) for k in range(len(s.t))]
        angle = np.unwrap([float(values(made, s.t[k], s.q[k], s.p[k])[0]) for k in places])
        assert np.polyfit(s.t, angle, 1)[0] == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize("wrong", ["J2: 1e-2", "J2: much, radius: 1", "J2: 1e-2, size: 1", "J2: 1e-2, radius: -1"])
def test_the_flattening_stands_in_a_comment_of_the_file(wrong):
    text = "# units: AU, day, Msun\n# {}\nname,m,a\nsaturn,1,\nmoon,0,1\n"
    found = bodies_file.parse(text.format("J2: 1.6e-2, radius: 4e-4, J4: -1e-3"), "p.csv")
    assert found.oblate == (1.6e-2, -1e-3, 4e-4)
    with pytest.raises(pb.InvalidInput, match=r"J2|radius"):
        bodies_file.parse(text.format(wrong), "p.csv")
