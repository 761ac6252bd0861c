"""Planetary systems from tables of elements or states, in both frames, against REBOUND."""

from __future__ import annotations

from functools import cache
from math import cos, degrees, pi

import numpy as np
import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.conservation_claims import DEFECT, symplecticity_defect
from phasebench.benchmarks.measure.energy import energy_error
from phasebench.benchmarks.measure.named_quantities import quantities, quantity
from phasebench.benchmarks.measure.quantities import values
from phasebench.benchmarks.problems import gravity, kept, planetary, problem
from phasebench.benchmarks.problems.bodies import CARTESIAN, ELEMENTS
from phasebench.benchmarks.problems.gravity import MASSLESS
from phasebench.benchmarks.problems.outer_solar_system import BODIES
from phasebench.benchmarks.problems.solar_system import PLANETS
from phasebench.benchmarks.problems.units import Units
from phasebench.benchmarks.problems.user import from_formula
from phasebench.benchmarks.studies.said.planets import longitudes
from phasebench.integrators import driver
from support.commands import run_json
from support.orbits import true_longitude

SEED, YEARS = 26, 30.0
G = 2.95912208286e-4
SAME, TOL = 1e-12, 2e-16


@cache
def random_bodies() -> tuple[dict[str, object], ...]:
    """A star, three planets and two test particles with random elements, not sorted by distance."""
    draw = np.random.default_rng(SEED)
    rows: list[dict[str, object]] = [{"name": "star", "m": 0.8}]
    for name, a, m in (("c", 9.4, 4e-4), ("b", 5.1, 1e-3), ("d", 17.0, 5e-5), ("stone", 2.7, 0.0), ("far", 31.0, 0.0)):
        angles = dict(zip(ELEMENTS[2:], (40 * draw.random(), *(360 * draw.random(3))), strict=True))
        rows.append({"name": name, "m": m, "a": a * (1 + draw.random() / 20), "e": draw.random() / 4, **angles})
    return tuple(rows)


def rebounds(rows, G=G):
    """REBOUND's simulation of the rows of elements, built directly with its interface."""
    rebound = pytest.importorskip("rebound")
    sim = rebound.Simulation()
    sim.G = G
    for row in rows:
        if "a" not in row:
            sim.add(m=row["m"])
        else:
            inc, Omega, omega, M = (np.radians(row[k]) for k in ELEMENTS[2:])
            sim.add(
                m=row["m"], a=row["a"], e=row["e"], inc=inc, Omega=Omega, omega=omega, M=M, primary=sim.particles[0]
            )
    return sim


def states(sim) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of a simulation, arrays (n, 3)."""
    x, v = np.empty((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return x, v


def table(kind: str):
    """(random system as a table of elements or of states in a frame, name of the frame or None)."""
    if kind == "elements":
        return pd.DataFrame(random_bodies()), None
    sim = rebounds(random_bodies())
    if kind == "barycentric":
        sim.move_to_com()
    x, v = states(sim)
    rows = [
        {"name": row["name"], "m": row["m"], **dict(zip(CARTESIAN, (*map(float, a), *map(float, b)), strict=True))}
        for row, a, b in zip(random_bodies(), x, v, strict=True)
    ]
    return rows, kind


def velocities(system, p):
    return np.reshape(p, (-1, 3)) / np.array(system.bodies.masses)[:, None]


def relative(found, expected) -> float:
    """The largest difference relative to the largest component."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@cache
def by_ias15():
    """(positions, velocities) of the random planetary system after `YEARS`, by REBOUND's IAS15."""
    sim = rebounds(random_bodies())
    sim.move_to_com()
    sim.integrator = "ias15"
    sim.integrate(YEARS * 365.25)
    return states(sim)


@pytest.mark.parametrize("kind", ["elements", "heliocentric", "barycentric"])
def test_end_states_agree_with_rebound(kind):
    rows, frame = table(kind)
    system = pb.planetary_system(rows, frame=frame)
    x, v = by_ias15()
    found = pb.integrate(system, "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3), x) < SAME
    assert relative(velocities(system, found.p[-1]), v) < SAME


@pytest.mark.parametrize(
    ("column", "change"), [("M", 1e-8), ("omega", 1e-8), ("Omega", 1e-8), ("inc", 1e-7), ("e", 1e-10)]
)
def test_control_changed_element_is_detected(column, change):
    rows = [dict(row) for row in random_bodies()]
    rows[2][column] += change
    found = pb.integrate(pb.planetary_system(rows), "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3), by_ias15()[0]) > 3 * SAME


@pytest.mark.parametrize("units", ["AU, yr, Msun", "km, s, Msun"])
def test_units_do_not_change_the_motion(units):
    of = Units(*units.split(", "))
    length, time = {"AU": 1.0, "km": 149597870.7}[of.length], {"yr": 1 / 365.25, "s": 86400.0}[of.time]
    rows = [row | ({"a": row["a"] * length} if "a" in row else {}) for row in random_bodies()]
    system = pb.planetary_system(rows, units=units)
    assert pytest.approx(G * length**3 / time**2, rel=1e-15) == of.G
    found = pb.integrate(system, "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3) / length, by_ias15()[0]) < SAME
    assert relative(velocities(system, found.p[-1]) * time / length, by_ias15()[1]) < SAME


@pytest.mark.parametrize(("ours", "theirs"), [("wisdom-holman", {}), ("wisdom-holman-corrector", {"corrector": 17})])
def test_energy_errors_agree_with_whfast(ours, theirs):
    """Massive bodies only, sorted by distance, as WHFast needs them."""
    rows = [random_bodies()[i] for i in (0, 2, 1, 3)]
    h, steps = 100.0, 400
    sim = rebounds(rows)
    sim.move_to_com()
    sim.integrator = "whfast"
    for name, value in ({"safe_mode": 0} | theirs).items():
        setattr(sim.integrator, name, value)
    sim.dt, energies = h, [sim.energy()]
    for _ in range(steps):
        sim.steps(1)
        sim.synchronize()
        energies.append(sim.energy())
    system = pb.planetary_system(rows)
    found = pb.integrate(system, ours, h=h, steps=steps)
    own = system.system.energies(found.q, found.p)
    error, other = (float(np.abs(np.array(E) - E[0]).max()) for E in (own, energies))
    assert error == pytest.approx(other, rel=0.05)
    assert relative(found.q[-1].reshape(-1, 3), states(sim)[0]) < SAME


def test_order_of_rows_does_not_matter_to_wisdom_holman():
    rows = list(random_bodies())
    found = []
    for order in (range(6), (0, 4, 2, 1, 3, 5)):
        system = pb.planetary_system([rows[i] for i in order])
        end = pb.integrate(system, "wisdom-holman-corrector", h=25.0, steps=400, save_every=0)
        place = list(order)
        found.append(end.q[-1].reshape(-1, 3)[np.argsort(place)])
    assert relative(*found) < SAME


def test_control_order_of_jacobi_coordinates_matters():
    bodies = pb.planetary_system(list(random_bodies())).bodies
    assert bodies.order() == [0, 4, 2, 1, 3, 5]
    sorted_, as_given = (gravity.kepler_part([1, 1, 1], 1, order) for order in ((0, 2, 1), (0, 1, 2)))
    assert sorted_.change != as_given.change
    assert sorted(sorted_.change[1]) == sorted(as_given.change[1])


def test_test_particle_does_not_move_other_bodies():
    with_, without = list(random_bodies()), [row for row in random_bodies() if row["m"]]
    ends = [
        pb.integrate(pb.planetary_system(rows), "pefrl", h=20.0, steps=300, save_every=0) for rows in (with_, without)
    ]
    assert relative(ends[0].q[-1][: 3 * 4], ends[1].q[-1]) < SAME
    assert pb.planetary_system(with_).bodies.masses[-1] == MASSLESS * 0.8


def test_control_planet_moves_the_other_bodies():
    rows = [dict(row) for row in random_bodies()]
    rows[-1]["m"] = 1e-6
    ends = [
        pb.integrate(pb.planetary_system(r), "pefrl", h=20.0, steps=300, save_every=0) for r in (rows, random_bodies())
    ]
    assert relative(ends[0].q[-1][: 3 * 4], ends[1].q[-1][: 3 * 4]) > 100 * SAME


def test_invariants_hold_along_the_flow():
    system = pb.planetary_system(random_bodies())
    found = pb.integrate(system, "gauss-8", h=20.0, steps=300, save_every=100)
    for name in system.invariants:
        along = system.invariant(name, found.q, found.p)
        assert np.abs(along - along[0]).max() < 1e-13, name
    assert sum(name.startswith("barycentre") for name in system.invariants) == 3


def test_system_is_loaded_from_the_cache(monkeypatch):
    system = pb.planetary_system(random_bodies())
    calls = []
    monkeypatch.setattr(planetary, "_build", lambda found: calls.append(found))
    again = pb.planetary_system(random_bodies())
    assert not calls
    assert (again.q0, again.p0, again.bodies) == (system.q0, system.p0, system.bodies)
    assert kept.Problem is type(system).__mro__[1]


# -- the file, the command line ----------------------------------------------------------------------------------------

FILE = "examples/planets.csv"


def test_example_file_has_the_registered_data():
    system = problem(FILE)
    for body in system.bodies.members:
        mass, x, v = BODIES[body.name]
        assert (body.mass, tuple(map(float, body.x)), tuple(map(float, body.v))) == (mass, x, v)
    with pytest.raises(pb.InvalidInput, match="no parameter 'k'"):
        problem(FILE, k=2)


def test_times_accept_units():
    code, found = run_json(FILE, "wisdom-holman", "--h", "100", "--t-end", "10 yr")
    assert (code, found["t"]) == (0, 3652.5)
    assert pb.integrate(FILE, "wisdom-holman", h=100.0, t_end="1e-2 kyr").t[-1] == 3652.5
    for wrong in ("10 fortnights", "abc", "nan", "1e400 yr"):
        assert run_json(FILE, "wisdom-holman", "--h", "100", "--t-end", wrong)[0] == 2
    code, found = run_json("pendulum", "stormer-verlet", "--h", "0.1", "--t-end", "1 yr")
    assert code == 2
    assert "no unit of time" in found["reason"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("jupiter.longitude", lambda x, v: true_longitude(x[1] - x[0], v[1] - v[0])),
        ("saturn.distance", lambda x, v: np.linalg.norm(x[2] - x[0])),
        ("saturn.latitude", lambda x, v: np.arcsin((x[2, 2] - x[0, 2]) / np.linalg.norm(x[2] - x[0]))),
        ("jupiter.x", lambda x, v: x[1, 0] - x[0, 0]),
        ("saturn.vz", lambda x, v: v[2, 2] - v[0, 2]),
    ],
)
def test_quantities_of_a_body(name, value):
    system = problem(FILE)
    found = pb.integrate(system, "gauss-6", h=100.0, steps=20)
    x, v = found.q[-1].reshape(-1, 3), velocities(system, found.p[-1])
    assert values(system, quantity(system, name), found) == pytest.approx([value(x, v)], rel=1e-14)
    with pytest.raises(pb.InvalidInput, match=r"did you mean .*jupiter\.longitude"):
        quantity(system, "jupiter.longitud")


def test_quantities_of_a_barycentric_table():
    rows, frame = table("barycentric")
    system = pb.planetary_system(rows, frame=frame)
    found = pb.integrate(system, "gauss-6", h=20.0, steps=10)
    assert values(system, quantity(system, "star.x"), found)[0] == found.q[-1][0]
    assert values(system, quantity(system, "b.vy"), found)[0] == pytest.approx(
        velocities(system, found.p[-1])[2, 1], rel=1e-15
    )


@pytest.mark.parametrize("inc", [0.0, 1e-9, 37.0, 90.0, 90.0 - 1e-13, 143.0, 180.0])
def test_longitude_is_the_angle_in_the_orbit(inc):
    """Of a circular orbit it grows as the time, or falls if the orbit is retrograde, whatever the inclination."""
    row = {"name": "b", "m": 1e-6, "a": 1.0, "inc": inc, "Omega": 20.0, "M": 10.0}
    system = pb.planetary_system([{"name": "star", "m": 1.0}, row])
    period = 2 * pi / (G * (1 + 1e-6)) ** 0.5
    found = pb.integrate(system, "wisdom-holman", t_end=0.3 * period, steps=3)
    sense = -1 if inc > 90 else 1
    expected = np.radians(20 + sense * (10 + 0.3 * 360))
    assert values(system, quantity(system, "b.longitude"), found) == pytest.approx([expected], abs=1e-13)
    if inc == 90.0:
        x = found.q[-1].reshape(-1, 3)
        assert abs(np.arctan2(*(x[1] - x[0])[1::-1]) - expected) > 0.1, "control: the angle in the plane x, y"


@pytest.fixture
def edge_on(tmp_path):
    """The path of a file of two planets whose orbits contain the line of sight, z."""
    path = tmp_path / "edge_on.csv"
    path.write_text(
        "# units: AU, day, Msun\nname, m, a, e, inc, omega, M\nstar, 0.09, , , , ,\n"
        "b, 4.0856e-6, 0.0115470, 0.0034, 90, 135, 0\nc, 3.8947e-6, 0.0158140, 0.00055, 90, 1, 60\n"
    )
    return path


def test_longitude_of_an_edge_on_orbit_is_seen_to_be_wrong(edge_on):
    run = (edge_on, "wisdom-holman-aba-10-6-4", "--steps", "1", "--t-end", "100", "--quantity", "c.longitude")
    _, found = run_json(*run)
    assert found["quantity_error"]["error"] == pytest.approx(0.949, abs=1e-3)
    assert found["global_error"] is None, "not asked for"


def test_error_of_many_revolutions_is_told_past_the_horizon(edge_on):
    """The end state of c is that of a run with 80 bits."""
    run = (edge_on, "wisdom-holman-corrector", "--param", "corrector=17", "--steps", "1298", "--t-end", "100")
    _, found = run_json(*run, "--error")
    off = max(abs(found["q"][6] + 0.0157476362403623), abs(found["q"][8] - 0.0015025412324745))
    assert found["reference"]["horizon"] < 100
    assert found["reference"]["uncertainty"] < 1e-12
    assert found["global_error"] == pytest.approx(off, rel=1e-3)


def test_central_body_has_no_angles():
    rows, frame = table("barycentric")
    assert "star.x" in quantities(pb.planetary_system(rows, frame=frame))
    assert not {"star.longitude", "star.distance"} & set(quantities(pb.planetary_system(rows, frame=frame)))


# -- formulae ----------------------------------------------------------------------------------------------------------

THREE = (
    "(p1**2 + p2**2)/2 + (p3**2 + p4**2)/(2*m) + (p5**2 + p6**2)/(2*m) - m/sqrt((q1 - q3)**2 + (q2 - q4)**2) "
    "- m/sqrt((q1 - q5)**2 + (q2 - q6)**2) - m**2/sqrt((q3 - q5)**2 + (q4 - q6)**2)"
)
AT, AWAY = (0.0, 0.0, 2.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0007, 0.0, 0.001)


def test_kepler_part_of_a_formula_with_bodies():
    system = from_formula(THREE, AT, AWAY, {"m": 0.001})
    part = system.system.kepler
    assert [row[0] < 0 for row in part.change] == [False, True, True]
    assert part.change[1][1:] == (0, 1)  # the inner one of the two is first
    split, other = (pb.integrate(system, id, h=0.05, t_end=10.0, save_every=0) for id in ("wisdom-holman", "gauss-6"))
    assert relative(split.q[-1], other.q[-1]) < 1e-4


@pytest.mark.parametrize(
    ("text", "mu"),
    [
        ("(p1**2 + p2**2)/2 - 3/sqrt(q1**2 + q2**2)", 3),
        ("(p1**2 + p2**2 + p3**2)/2 - (q1**2 + q2**2 + q3**2)**(-1/2) + q1**2/100", 1),
        ("(p1**2 + p2**2)/4 - 3/sqrt(q1**2 + q2**2) - 1/(q1**2 + q2**2)**(3/2)", 1.5),
        ("(p1**2 + p2**2)/2 + 3/sqrt(q1**2 + q2**2)", None),
        ("(p1**2 + 2*p2**2)/2 - 3/sqrt(q1**2 + q2**2)", None),
        ("(p1**2 + p2**2)/2 - 3/sqrt((q1 - 1)**2 + q2**2)", None),
        ("(p1**2 + p2**2)/2 - 3/sqrt(q1**2 + 2*q2**2)", None),
        ("(p1**2 + p2**2)/2 + q1**2/2 + q1**2*q2", None),
    ],
)
def test_kepler_part_about_the_origin(text, mu):
    d = 3 if "q3" in text else 2
    part = from_formula(text, [0.5] * d, [0.25] * d).system.kepler
    assert (part is None) if mu is None else ([float(x) for x in part.mu] == [mu])


def test_similar_masses_have_no_kepler_part():
    assert from_formula(THREE, AT, AWAY, {"m": 1.0}).system.kepler is None


def test_circular_orbit_of_two_bodies():
    """It closes after its period, and its mean anomaly is its polar angle."""
    m, a = 1e-3, 2.0
    row = dict.fromkeys(ELEMENTS, 0.0) | {"name": "planet", "m": m, "a": a, "M": 60.0}
    system = pb.planetary_system([{"name": "star", "m": 1.0}, row])
    x = np.reshape(system.q0, (-1, 3))
    assert degrees(np.arctan2(*(x[1] - x[0])[1::-1])) == pytest.approx(60.0, rel=1e-15)
    assert (x[1] - x[0])[0] == pytest.approx(a * cos(pi / 3), rel=1e-15)
    period = 2 * pi * (a**3 / (G * (1 + m))) ** 0.5
    end = pb.integrate(system, "wisdom-holman", t_end=period, steps=3, save_every=0)
    assert relative(end.q[-1], np.array(system.q0)) < SAME


@pytest.mark.parametrize("id", ["gonzalez", "rk4-projected-energy", "stormer-verlet-symmetric-projection"])
def test_gradient_methods_are_refused_for_test_particles(id):
    with pytest.raises(pb.InvalidInput, match="test particle"):
        pb.integrate(pb.planetary_system(random_bodies()), id, h=20.0, steps=1)
    assert pb.integrator(id).lacks(pb.planetary_system(random_bodies()))
    assert pb.integrator(id).lacks(pb.planetary_system([row for row in random_bodies() if row["m"]])) is None


def test_control_gradient_method_ejects_a_test_particle():
    rows = [dict(random_bodies()[i]) for i in (0, 2, 4)]
    system = pb.planetary_system(rows)
    exact = pb.integrate(system, "heyoka", tol=TOL, t_end=1000.0, save_every=0).q[-1]
    errors = {}
    for id in ("gonzalez", "implicit-midpoint"):  # gonzalez without its correction is implicit-midpoint
        found = driver.integrate(system, id, h=10.0, steps=100, save_every=0)
        errors[id] = np.abs(found.q[-1] - exact)[6:].max()
    assert errors["gonzalez"] > 10 * errors["implicit-midpoint"]


def test_symplecticity_is_judged_without_test_particles():
    rows = [dict(random_bodies()[i]) for i in (0, 2, 4)]
    system = pb.planetary_system(rows)
    assert symplecticity_defect(pb.integrator("wisdom-holman"), system, 20.0) < DEFECT
    assert system.massive().bodies.names == ("star", "b")
    assert system.massless("b").massive() is None
    assert symplecticity_defect(pb.integrator("wisdom-holman"), system.massless("b"), 20.0) == 0


def test_control_nonsymplectic_method_is_detected():
    system = pb.planetary_system([dict(random_bodies()[i]) for i in (0, 2, 4)])
    assert symplecticity_defect(pb.integrator("rk4"), system, 100.0) > DEFECT


# -- the solar system --------------------------------------------------------------------------------------------------
SOLAR = problem("solar-system")


def start():
    """The initial state, arrays (1, 27)."""
    return np.array([SOLAR.q0]), np.array([SOLAR.p0])


def test_the_solar_system_has_the_published_elements():
    given = [float(row[1]) for row in PLANETS.values()]
    np.testing.assert_allclose(SOLAR.bodies.semi_axes(), given, rtol=1e-14)
    perihelia = np.degrees(longitudes(SOLAR, *start())[:, 0])
    off = (perihelia - [float(row[5]) for row in PLANETS.values()] + 180) % 360 - 180
    assert np.abs(off).max() < 0.25  # projected into the ecliptic: inc^2 / 4
    assert np.abs(off[2]) < 1e-6, "the Earth's orbit lies in the ecliptic"


#: The rates of the mean longitudes that JPL publishes beside the elements, degrees a century; not used in the problem.
RATES = (149472.67411175, 58517.81538729, 35999.37244981, 19140.30268499, 3034.74612775, 1222.49362201, 428.48202785)
RATES += (218.45945325,)


def test_published_rates_of_longitudes_are_the_orbits_mean_motions():
    """Kepler's third law gives JPL's rates from its semi-major axes: a wrong digit of an axis shows."""
    G, masses = SOLAR.bodies.units.G, np.array(SOLAR.bodies.masses)
    a = np.array(SOLAR.bodies.semi_axes())
    motions = np.degrees(np.sqrt(G * (1 + masses[1:]) / a**3)) * 36525
    np.testing.assert_allclose(motions[:4], RATES[:4], rtol=2e-5)
    np.testing.assert_allclose(motions[4:], RATES[4:], rtol=3e-3)


def test_the_earth_is_where_it_was_at_j2000():
    """The Astronomical Almanac: longitude 100.38 degrees, 0.98333 AU from the Sun, shortly before the perihelion."""
    earth = np.array(SOLAR.q0[9:12]) - SOLAR.q0[:3]
    assert np.degrees(np.arctan2(earth[1], earth[0])) == pytest.approx(100.38, abs=0.02)
    assert np.linalg.norm(earth) == pytest.approx(0.98333, abs=2e-4)


def test_the_barycentre_of_the_solar_system_rests():
    masses = np.repeat(SOLAR.bodies.masses, 3)
    assert np.abs(np.sum((masses * SOLAR.q0).reshape(-1, 3), axis=0)).max() < 1e-17
    assert np.abs(np.sum(np.reshape(SOLAR.p0, (-1, 3)), axis=0)).max() < 1e-19
    assert np.abs(np.sum(np.reshape(SOLAR.q0, (-1, 3)), axis=0)).max() > 1e-3, "the control: unweighted"


def test_wisdom_holman_keeps_the_planets_for_a_decade():
    s = driver.integrate(SOLAR, "wisdom-holman", h=6.0, steps=600, save_every=60)
    assert s.status == "ok"
    assert 1e-11 < energy_error(SOLAR, s.q, s.p) < 1e-8
