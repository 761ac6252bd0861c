"""Planetary systems from tables of elements or states, in both frames, against REBOUND; invalid tables are named."""

from __future__ import annotations

from functools import cache
from math import pi

import numpy as np
import pandas as pd
import pytest

import phasebench as pb
from phasebench.benchmarks.measure.conservation_claims import DEFECT, symplecticity_defect
from phasebench.benchmarks.measure.named_quantities import quantities, quantity
from phasebench.benchmarks.measure.quantities import values
from phasebench.benchmarks.problems import bodies_file, gravity, problem
from phasebench.benchmarks.problems.bodies import CARTESIAN, ELEMENTS
from phasebench.benchmarks.problems.gravity import MASSLESS
from phasebench.benchmarks.problems.outer_solar_system import BODIES
from phasebench.benchmarks.problems.units import span
from support.commands import run_json
from support.orbits import true_longitude

SEED, YEARS = 26, 30.0
G = 2.95912208286e-4
SAME, TOL = 1e-12, 2e-16
FILE = "examples/planets.csv"


@cache
def random_bodies() -> tuple[dict[str, object], ...]:
    """A star, three planets and two test particles with random elements, not sorted by distance."""
    draw = np.random.default_rng(SEED)
    rows: list[dict[str, object]] = [{"name": "star", "m": 0.8}]
    for name, a, m in (("c", 9.4, 4e-4), ("b", 5.1, 1e-3), ("d", 17.0, 5e-5), ("stone", 2.7, 0.0), ("far", 31.0, 0.0)):
        angles = dict(zip(ELEMENTS[2:], (40 * draw.random(), *(360 * draw.random(3))), strict=True))
        rows.append({"name": name, "m": m, "a": a * (1 + draw.random() / 20), "e": draw.random() / 4, **angles})
    return tuple(rows)


def rebounds(rows):
    """REBOUND's simulation of the rows of elements, built directly with its interface."""
    rebound = pytest.importorskip("rebound")
    sim = rebound.Simulation()
    sim.G = G
    for row in rows:
        if "a" not in row:
            sim.add(m=row["m"])
        else:
            inc, Omega, omega, M = (np.radians(row[k]) for k in ELEMENTS[2:])
            angles = {"inc": inc, "Omega": Omega, "omega": omega, "M": M}
            sim.add(m=row["m"], a=row["a"], e=row["e"], **angles, primary=sim.particles[0])
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


def test_order_of_rows_does_not_matter_to_wisdom_holman():
    rows, found = list(random_bodies()), []
    for order in (range(6), (0, 4, 2, 1, 3, 5)):
        system = pb.planetary_system([rows[i] for i in order])
        end = pb.integrate(system, "wisdom-holman-corrector", h=25.0, steps=400, save_every=0)
        found.append(end.q[-1].reshape(-1, 3)[np.argsort(list(order))])
    assert relative(*found) < SAME
    assert pb.planetary_system(rows).bodies.order() == [0, 4, 2, 1, 3, 5]
    one, other = (gravity.kepler_part([1, 1, 1], 1, order) for order in ((0, 2, 1), (0, 1, 2)))
    assert one.change != other.change, "the control: the order of Jacobi coordinates matters"


def test_test_particle_does_not_move_other_bodies():
    planet = [dict(row) for row in random_bodies()]
    planet[-1]["m"] = 1e-6
    cases = random_bodies(), [row for row in random_bodies() if row["m"]], planet
    ends = [pb.integrate(pb.planetary_system(rows), "pefrl", h=20.0, steps=300, save_every=0).q[-1] for rows in cases]
    assert relative(ends[0][:12], ends[1]) < SAME
    assert relative(ends[2][:12], ends[1]) > 100 * SAME, "the control: a planet does"
    assert pb.planetary_system(random_bodies()).bodies.masses[-1] == MASSLESS * 0.8


def test_test_particles_and_the_structure_of_methods():
    """Methods with gradients of H are refused for test particles; symplecticity is judged without them."""
    rows = [dict(random_bodies()[i]) for i in (0, 2, 4)]
    system = pb.planetary_system(rows)
    with pytest.raises(pb.InvalidInput, match="test particle"):
        pb.integrate(system, "gonzalez", h=20.0, steps=1)
    assert pb.integrator("gonzalez").lacks(pb.planetary_system(rows[:2])) is None
    assert symplecticity_defect(pb.integrator("wisdom-holman"), system, 20.0) < DEFECT
    assert symplecticity_defect(pb.integrator("rk4"), system, 100.0) > DEFECT, "the control"
    assert system.massive().bodies.names == ("star", "b")
    assert system.massless("b").massive() is None


# -- the solar system --------------------------------------------------------------------------------------------------


def test_the_earth_is_where_it_was_at_j2000_and_the_barycentre_rests():
    """The Astronomical Almanac: longitude 100.38 degrees, 0.98333 AU from the Sun, shortly before the perihelion."""
    made = problem("solar-system")
    earth = np.array(made.q0[9:12]) - made.q0[:3]
    assert np.degrees(np.arctan2(earth[1], earth[0])) == pytest.approx(100.38, abs=0.02)
    assert np.linalg.norm(earth) == pytest.approx(0.98333, abs=2e-4)
    masses = np.repeat(made.bodies.masses, 3)
    assert np.abs(np.sum((masses * made.q0).reshape(-1, 3), axis=0)).max() < 1e-17
    assert np.abs(np.sum(np.reshape(made.p0, (-1, 3)), axis=0)).max() < 1e-19


# -- quantities of bodies ----------------------------------------------------------------------------------------------


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
    assert not {"sun.x", "sun.longitude", "sun.distance"} & {*quantities(system)}


@pytest.mark.parametrize("inc", [0.0, 37.0, 90.0, 90.0 - 1e-13, 143.0, 180.0])
def test_longitude_is_the_angle_in_the_orbit(inc):
    """Of a circular orbit it grows as the time, or falls if the orbit is retrograde, whatever the inclination."""
    row = {"name": "b", "m": 1e-6, "a": 1.0, "inc": inc, "Omega": 20.0, "M": 10.0}
    system = pb.planetary_system([{"name": "star", "m": 1.0}, row])
    period = 2 * pi / (G * (1 + 1e-6)) ** 0.5
    found = pb.integrate(system, "wisdom-holman", t_end=0.3 * period, steps=3)
    expected = np.radians(20 + (-1 if inc > 90 else 1) * (10 + 0.3 * 360))
    assert values(system, quantity(system, "b.longitude"), found) == pytest.approx([expected], abs=1e-13)
    if inc == 90.0:
        x = found.q[-1].reshape(-1, 3)
        assert abs(np.arctan2(*(x[1] - x[0])[1::-1]) - expected) > 0.1, "the control: the angle in the plane x, y"


# -- the file ----------------------------------------------------------------------------------------------------------

HEAD = "# units: AU, day, Msun\n# frame: heliocentric\n"
PLACES = "name,m,x,y,z,vx,vy,vz\nsun,1,0,0,0,0,0,0\nearth,3e-6,1,0,0,0,0.0172,0\n"
ORBITS = "name,m,a,e,inc,Omega,omega,M\nsun,1,,,,,,\nearth,3e-6,1,0.0167,0,0,102.9,357.5\n"
GOOD = HEAD + PLACES


def parse(text):
    return bodies_file.parse(text, "planets.csv")


def numbers(found):
    """A tuple of numbers for each body read from a file: its name, mass, position and velocity."""
    return [(b.name, b.mass, *map(float, (*b.x, *b.v))) for b in found.members]


def test_example_file_has_the_registered_data():
    for body in problem(FILE).bodies.members:
        mass, x, v = BODIES[body.name]
        assert (body.mass, tuple(map(float, body.x)), tuple(map(float, body.v))) == (mass, x, v)
    with pytest.raises(pb.InvalidInput, match="no parameter 'k'"):
        problem(FILE, k=2)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + GOOD.replace("\n", "\r\n"),
        GOOD.replace(",", " , ").replace("units: AU , day , Msun", "units: Msun day AU"),
        "\n" + GOOD.replace("\n", "\n\n") + "# the end\n\n",
        GOOD.replace("\nsun", '\n"sun"').replace("earth", "Earth"),
        HEAD + "name,m,vx,vy,vz,x,y,z\nsun,1,0,0,0,0,0,0\nearth,3e-6,0,0.0172,0,1,0,0\n",
        PLACES + HEAD,
    ],
)
def test_equivalent_spellings_give_the_same_table(text, tmp_path):
    path = tmp_path / "planets.csv"
    path.write_bytes(text.encode())
    assert numbers(problem(path).bodies) == numbers(parse(GOOD))


def test_missing_elements_are_zero():
    assert numbers(parse(HEAD + ORBITS)) == numbers(parse(HEAD + ORBITS.replace("sun,1,,,,,,", "sun,1,0,0,0,0,0,0")))
    row = {"name": "earth", "m": 3e-6, "a": 1.0, "e": 0.1, "inc": 30.0, "Omega": 40.0, "omega": 50.0, "M": 60.0}
    for columns in (("M",), ("e", "inc", "Omega", "omega", "M")):
        whole = pb.planetary_system([ROWS[0], row | dict.fromkeys(columns, 0.0)])
        for missing in ({k: x for k, x in row.items() if k not in columns}, row | dict.fromkeys(columns)):
            found = pb.planetary_system([ROWS[0], missing])
            assert (found.q0, found.p0) == (whole.q0, whole.p0)
        assert whole.q0 != pb.planetary_system([ROWS[0], row]).q0, "the control"


#: (text of the table of positions, its replacement, words of the message).
PLACED = [
    ("AU, day, Msun", "AU, day, Mmoon", ["line 1", "'Mmoon'", "Msun"]),
    ("AU, day, Msun", "AU, day", ["line 1", "no unit of mass"]),
    ("AU, day, Msun", "AU, km, day, Msun", ["line 1", "AU and km"]),
    ("# units: AU, day, Msun\n", "", ["planets.csv", "units"]),
    ("# frame: heliocentric\n", "", ["frame", "heliocentric or barycentric"]),
    ("heliocentric", "geocentric", ["line 2", "'geocentric'", "heliocentric"]),
    ("# frame: heliocentric\n", "# frame: heliocentric\n# frame: barycentric\n", ["line 3", "line 2"]),
    ("heliocentric", "barycentric", ["line 3", "barycentre", "# frame: heliocentric"]),
    ("vy,vz", "vy,vy", ["line 3", "vy", "twice"]),
    (",vz", "", ["line 4", "8 cells", "7 columns"]),
    ("name,m,x", "name,mass,x", ["line 3", "'mass'", "inc, m, name"]),
    ("name,m,x", "name,a,x", ["line 3", "both kinds"]),
    ("earth,3e-6", "earth,nan", ["line 5", "column m", "'nan'"]),
    ("earth,3e-6", "earth,", ["line 5", "column m", "empty"]),
    ("earth,3e-6", "earth,-3e-6", ["line 5", "column m", "-3e-06"]),
    ("earth,3e-6,1", "earth,3e-6,1e999", ["line 5", "column x"]),
    ("earth,3e-6,1", "earth,3e-6,one", ["line 5", "column x", "'one'"]),
    ("earth,3e-6,1", "earth,3e-6,0", ["line 5", "where sun", "line 4"]),
    ("earth,3e-6,1", "Sun ,3e-6,1", ["line 5", "column name", "line 4"]),
    ("earth,3e-6,1", "ear.th,3e-6,1", ["line 5", "column name", "letters"]),
    ("sun,1,", "sun,0,", ["line 4", "column m", "central"]),
    ("sun,1,0,0,0,0", "sun,1,0,0,0,1e-5", ["line 4", "column vx", "# frame: barycentric"]),
    ("earth,3e-6,1,0,0,0,0.0172,0\n", "", ["1 bodies"]),
    ("earth,3e-6,1", 'ea"rth,3e-6,"1', ["line 5"]),
    (GOOD, "", ["empty", "# units: AU, day, Msun"]),
    (PLACES, "name,m\nsun,1\nearth,3e-6\n", ["line 3", "missing", "x, y, z", "a, e"]),
]
#: The same for the table of elements.
ORBITING = [
    ("1,0.0167", "1,1", ["line 5", "column e", "below 1", "x, y, z"]),
    ("1,0.0167", "1,-0.1", ["line 5", "column e"]),
    ("1,0.0167", "0,0.0167", ["line 5", "column a", "positive"]),
    ("3e-6,1,0.0167", "3e-6,,0.0167", ["line 5", "column a", "empty"]),
    ("sun,1,,", "sun,1,1,", ["line 4", "column a", "write 0"]),
    ("Omega,omega", "Node,omega", ["line 3", "'Node'", "capitals"]),
    ("Omega,omega", "Omega,pomga", ["line 3", "'pomga'", "pomega"]),
    ("e,inc", "P,inc", ["line 5", "columns a and P", "one of them"]),
    ("# units", "# elements: barycentric\n# units", ["line 1", "'barycentric'", "heliocentric"]),
]


@pytest.mark.parametrize(("text", "case"), [(GOOD, c) for c in PLACED] + [(HEAD + ORBITS, c) for c in ORBITING])
def test_error_is_named_with_its_line_and_column(text, case):
    old, new, wanted = case
    assert old in text
    with pytest.raises(pb.InvalidInput) as error:
        parse(text.replace(old, new, 1))
    for word in wanted:
        assert word in str(error.value)


def test_files_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe# units")
    for name, said in (("none", "there is no file"), ("folder", "is a directory"), ("binary", r"binary\.csv")):
        with pytest.raises(pb.InvalidInput, match=said):
            problem(tmp_path / f"{name}.csv")


ROWS = [{"name": "sun", "m": 1.0}, {"name": "earth", "m": 3e-6, "a": 1.0, "e": 0.0, "inc": 0, "Omega": 0, "omega": 0}]


@pytest.mark.parametrize(
    ("table", "options", "words"),
    [
        (3, {}, "the table is a int"),
        ([ROWS[0], {"name": "earth", "m": 3e-6, "e": 0.1}], {}, "the column a is missing"),
        ([*ROWS, ROWS[1]], {}, "row 3, column name"),
        ([ROWS[0], ROWS[1] | {"M": True}], {}, "row 2, column M: it is 'True'"),
        ([ROWS[0], ROWS[1] | {"M": 0}], {"units": "AU"}, "no unit of time"),
        ([ROWS[0], ROWS[1] | {"M": 0}], {"frame": "solar"}, "no frame 'solar'"),
        ({"name": ["sun"], "m": [1.0, 2.0]}, {}, "different lengths"),
        (FILE, {"units": "AU, day, Msun"}, "leave out units="),
    ],
)
def test_error_of_a_table_in_python_is_named(table, options, words):
    with pytest.raises(pb.InvalidInput, match=words):
        pb.planetary_system(table, **options)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [("1e4 yr", "day", 3652500.0), ("1e4yr", "day", 3652500.0), ("2 days", "s", 172800.0), ("-3", "", -3.0),
     ("86400 s", "day", 1.0), ("1 Myr", "yr", 1e6), (7, "", 7), (None, "", None), ("0.1 yr", "day", 36.525)],
)  # fmt: skip
def test_times_with_a_unit(value, unit, expected):
    assert span(value, unit) == expected
    for wrong in ("1e4 fortnights", "yr", "", "1e999 yr", "1 yr 2", "inf", "1..2 yr"):
        with pytest.raises(pb.InvalidInput):
            span(wrong, "day")


def test_steps_starts_and_ends_have_units():
    plain = pb.integrate(FILE, "wisdom-holman", h=10.0, t_end=730.5, t0=365.25)
    dated = pb.integrate(FILE, "wisdom-holman", h="10 d", t_end="2 yr", t0="1 yr")
    assert np.array_equal(plain.q, dated.q)
    code, found = run_json("pendulum", "stormer-verlet", "--h", "0.1", "--t-end", "1 yr")
    assert code == 2
    assert "no unit of time" in found["reason"]
