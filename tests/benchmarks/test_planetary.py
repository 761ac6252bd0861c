"""A planetary system from a table: beside REBOUND driven directly, from both kinds of columns and in both frames."""

from __future__ import annotations

import json
from functools import cache
from math import cos, degrees, pi

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import phasebench as pb
from phasebench.benchmarks.advice import kept as kept_
from phasebench.benchmarks.cli import app
from phasebench.benchmarks.problems import kept, planetary, problem
from phasebench.benchmarks.problems.bodies import CARTESIAN, ELEMENTS
from phasebench.benchmarks.problems.gravity import MASSLESS
from phasebench.benchmarks.problems.outer_solar_system import BODIES
from phasebench.benchmarks.problems.units import Units
from phasebench.benchmarks.problems.user import from_formula
from phasebench.integrators import driver

SEED, YEARS = 26, 30.0
G = 2.95912208286e-4
SAME, TOL = 1e-12, 2e-16


@cache
def drawn() -> tuple[dict[str, object], ...]:
    """A star, three planets and two test particles, of drawn elements, not in the order of their distances."""
    draw = np.random.default_rng(SEED)
    rows: list[dict[str, object]] = [{"name": "star", "m": 0.8}]
    for name, a, m in (("c", 9.4, 4e-4), ("b", 5.1, 1e-3), ("d", 17.0, 5e-5), ("stone", 2.7, 0.0), ("far", 31.0, 0.0)):
        angles = dict(zip(ELEMENTS[2:], (40 * draw.random(), *(360 * draw.random(3))), strict=True))
        rows.append({"name": name, "m": m, "a": a * (1 + draw.random() / 20), "e": draw.random() / 4, **angles})
    return tuple(rows)


def rebounds(rows, G=G):
    """REBOUND's simulation of rows of elements, as its own users write it."""
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
    x, v = np.empty((2, sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return x, v


def table(kind: str):
    """The drawn system as a table, with its frame: of elements, or of positions in either frame by REBOUND."""
    if kind == "elements":
        return pd.DataFrame(drawn()), None
    sim = rebounds(drawn())
    if kind == "barycentric":
        sim.move_to_com()
    x, v = states(sim)
    rows = [
        {"name": row["name"], "m": row["m"], **dict(zip(CARTESIAN, (*map(float, a), *map(float, b)), strict=True))}
        for row, a, b in zip(drawn(), x, v, strict=True)
    ]
    return rows, kind


def velocities(system, p):
    return np.reshape(p, (-1, 3)) / np.array(system.bodies.masses)[:, None]


def relative(found, expected) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@cache
def by_ias15():
    sim = rebounds(drawn())
    sim.move_to_com()
    sim.integrator = "ias15"
    sim.integrate(YEARS * 365.25)
    return states(sim)


@pytest.mark.parametrize("kind", ["elements", "heliocentric", "barycentric"])
def test_end_states_are_those_of_rebound(kind):
    rows, frame = table(kind)
    system = pb.planetary_system(rows, frame=frame)
    x, v = by_ias15()
    found = pb.integrate(system, "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3), x) < SAME
    assert relative(velocities(system, found.p[-1]), v) < SAME


@pytest.mark.parametrize(
    ("column", "change"), [("M", 1e-8), ("omega", 1e-8), ("Omega", 1e-8), ("inc", 1e-7), ("e", 1e-10)]
)
def test_control_an_element_that_is_off_shows(column, change):
    rows = [dict(row) for row in drawn()]
    rows[2][column] += change
    found = pb.integrate(pb.planetary_system(rows), "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3), by_ias15()[0]) > 3 * SAME


@pytest.mark.parametrize("units", ["AU, yr, Msun", "km, s, Msun"])
def test_units_change_numbers_and_not_the_motion(units):
    of = Units(*units.split(", "))
    length, time = {"AU": 1.0, "km": 149597870.7}[of.length], {"yr": 1 / 365.25, "s": 86400.0}[of.time]
    rows = [row | ({"a": row["a"] * length} if "a" in row else {}) for row in drawn()]
    system = pb.planetary_system(rows, units=units)
    assert pytest.approx(G * length**3 / time**2, rel=1e-15) == of.G
    found = pb.integrate(system, "heyoka", tol=TOL, t_end=f"{YEARS} yr", save_every=0)
    assert relative(found.q[-1].reshape(-1, 3) / length, by_ias15()[0]) < SAME
    assert relative(velocities(system, found.p[-1]) * time / length, by_ias15()[1]) < SAME


@pytest.mark.parametrize(("ours", "theirs"), [("wisdom-holman", {}), ("wisdom-holman-corrector", {"corrector": 17})])
def test_energy_errors_are_those_of_whfast_at_the_same_step(ours, theirs):
    """Of massive bodies in the order of their distances, as WHFast takes them."""
    rows = [drawn()[i] for i in (0, 2, 1, 3)]
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


def test_the_kepler_part_takes_bodies_from_the_centre_outwards_in_any_order_of_rows():
    rows = list(drawn())
    found = []
    for order in (range(6), (0, 4, 2, 1, 3, 5)):
        system = pb.planetary_system([rows[i] for i in order])
        end = pb.integrate(system, "wisdom-holman-corrector", h=25.0, steps=400, save_every=0)
        place = list(order)
        found.append(end.q[-1].reshape(-1, 3)[np.argsort(place)])
    assert relative(*found) < SAME


def test_control_jacobi_coordinates_in_another_order_are_another_method():
    bodies = pb.planetary_system(list(drawn())).bodies
    assert bodies.order() == [0, 4, 2, 1, 3, 5]
    from phasebench.benchmarks.problems import gravity

    sorted_, as_given = (gravity.kepler_part([1, 1, 1], 1, order) for order in ((0, 2, 1), (0, 1, 2)))
    assert sorted_.change != as_given.change
    assert sorted(sorted_.change[1]) == sorted(as_given.change[1])


def test_a_test_particle_moves_as_one_and_moves_nothing():
    with_, without = list(drawn()), [row for row in drawn() if row["m"]]
    ends = [
        pb.integrate(pb.planetary_system(rows), "gauss-6", h=20.0, steps=300, save_every=0) for rows in (with_, without)
    ]
    assert relative(ends[0].q[-1][: 3 * 4], ends[1].q[-1]) < SAME
    assert pb.planetary_system(with_).bodies.masses[-1] == MASSLESS * 0.8


def test_control_a_planet_in_its_place_moves_the_others():
    rows = [dict(row) for row in drawn()]
    rows[-1]["m"] = 1e-6
    ends = [pb.integrate(pb.planetary_system(r), "gauss-6", h=20.0, steps=300, save_every=0) for r in (rows, drawn())]
    assert relative(ends[0].q[-1][: 3 * 4], ends[1].q[-1][: 3 * 4]) > 100 * SAME


def test_invariants_hold_along_the_flow():
    system = pb.planetary_system(drawn())
    found = pb.integrate(system, "gauss-8", h=20.0, steps=300, save_every=100)
    for name in system.invariants:
        values = system.invariant(name, found.q, found.p)
        assert np.abs(values - values[0]).max() < 1e-13, name
    assert sum(name.startswith("barycentre") for name in system.invariants) == 3


def test_it_comes_from_the_cache_as_it_was(monkeypatch):
    system = pb.planetary_system(drawn())
    calls = []
    monkeypatch.setattr(planetary, "_made", lambda found: calls.append(found))
    again = pb.planetary_system(drawn())
    assert not calls
    assert (again.q0, again.p0, again.bodies) == (system.q0, system.p0, system.bodies)
    assert kept.Problem is type(system).__mro__[1]


# -- the file, the command line ----------------------------------------------------------------------------------------

FILE = "examples/planets.csv"


def run(*arguments):
    result = CliRunner().invoke(app, [*arguments, "--json"])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, json.loads(result.stdout)


def test_the_example_has_the_registered_data():
    system = problem(FILE)
    for body in system.bodies.members:
        mass, x, v = BODIES[body.name]
        assert (body.mass, tuple(map(float, body.x)), tuple(map(float, body.v))) == (mass, x, v)
    with pytest.raises(pb.InvalidInput, match="no parameter 'k'"):
        problem(FILE, k=2)


def test_times_take_units_on_the_command_line_and_in_python():
    code, found = run("integrate", FILE, "wisdom-holman", "--h", "100", "--t-end", "10 yr")
    assert (code, found["t"]) == (0, 3652.5)
    assert pb.integrate(FILE, "wisdom-holman", h=100.0, t_end="1e-2 kyr").t[-1] == 3652.5
    for wrong in ("10 fortnights", "abc", "nan", "1e400 yr"):
        assert run("integrate", FILE, "wisdom-holman", "--h", "100", "--t-end", wrong)[0] == 2
    code, found = run("integrate", "pendulum", "stormer-verlet", "--h", "0.1", "--t-end", "1 yr")
    assert code == 2
    assert "no unit of time" in found["reason"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("jupiter.longitude", lambda x, v: np.arctan2(x[1, 1] - x[0, 1], x[1, 0] - x[0, 0])),
        ("saturn.distance", lambda x, v: np.linalg.norm(x[2] - x[0])),
        ("saturn.latitude", lambda x, v: np.arcsin((x[2, 2] - x[0, 2]) / np.linalg.norm(x[2] - x[0]))),
        ("jupiter.x", lambda x, v: x[1, 0] - x[0, 0]),
        ("saturn.vz", lambda x, v: v[2, 2] - v[0, 2]),
    ],
)
def test_quantities_of_a_body_are_what_their_names_say(name, value):
    from phasebench.benchmarks.measure.quantities import quantity, values

    system = problem(FILE)
    found = pb.integrate(system, "gauss-6", h=100.0, steps=20)
    x, v = found.q[-1].reshape(-1, 3), velocities(system, found.p[-1])
    assert values(system, quantity(system, name), found) == pytest.approx([value(x, v)], rel=1e-14)
    with pytest.raises(pb.InvalidInput, match=r"did you mean .*jupiter\.longitude"):
        quantity(system, "jupiter.longitud")


def test_a_barycentric_table_has_quantities_about_the_barycentre():
    from phasebench.benchmarks.measure.quantities import quantity, values

    rows, frame = table("barycentric")
    system = pb.planetary_system(rows, frame=frame)
    found = pb.integrate(system, "gauss-6", h=20.0, steps=10)
    assert values(system, quantity(system, "star.x"), found)[0] == found.q[-1][0]
    assert values(system, quantity(system, "b.vy"), found)[0] == pytest.approx(
        velocities(system, found.p[-1])[2, 1], rel=1e-15
    )


# -- formulae ----------------------------------------------------------------------------------------------------------

THREE = (
    "(p1**2 + p2**2)/2 + (p3**2 + p4**2)/(2*m) + (p5**2 + p6**2)/(2*m) - m/sqrt((q1 - q3)**2 + (q2 - q4)**2) "
    "- m/sqrt((q1 - q5)**2 + (q2 - q6)**2) - m**2/sqrt((q3 - q5)**2 + (q4 - q6)**2)"
)
AT, AWAY = (0.0, 0.0, 2.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0007, 0.0, 0.001)


def test_a_kepler_part_is_found_in_a_formula_of_bodies():
    system = from_formula(THREE, AT, AWAY, {"m": 0.001})
    part = system.system.kepler
    assert [row[0] < 0 for row in part.change] == [False, True, True]
    assert part.change[1][1:] == (0, 1)  # the inner one of the two comes first
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
def test_a_kepler_part_about_the_origin_is_found_where_there_is_one(text, mu):
    d = 3 if "q3" in text else 2
    part = from_formula(text, [0.5] * d, [0.25] * d).system.kepler
    assert (part is None) if mu is None else ([float(x) for x in part.mu] == [mu])


def test_bodies_of_like_masses_have_no_kepler_part():
    assert from_formula(THREE, AT, AWAY, {"m": 1.0}).system.kepler is None


def test_a_circle_is_a_circle():
    """An orbit of two bodies closes after its period, and its mean anomaly is its angle."""
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
def test_methods_that_move_along_gradients_are_refused_for_test_particles(id):
    with pytest.raises(pb.InvalidInput, match="test particle"):
        pb.integrate(pb.planetary_system(drawn()), id, h=20.0, steps=1)
    assert pb.integrator(id).lacks(pb.planetary_system(drawn()))
    assert pb.integrator(id).lacks(pb.planetary_system([row for row in drawn() if row["m"]])) is None


def test_control_such_a_method_throws_a_test_particle_off():
    rows = [dict(drawn()[i]) for i in (0, 2, 4)]
    system = pb.planetary_system(rows)
    exact = pb.integrate(system, "heyoka", tol=TOL, t_end=1000.0, save_every=0).q[-1]
    errors = {}
    for id in ("gonzalez", "implicit-midpoint"):  # without its correction the one is the other
        found = driver.integrate(system, id, h=10.0, steps=100, save_every=0)
        errors[id] = np.abs(found.q[-1] - exact)[6:].max()
    assert errors["gonzalez"] > 10 * errors["implicit-midpoint"]


def test_symplecticity_is_judged_of_the_bodies_with_mass():
    rows = [dict(drawn()[i]) for i in (0, 2, 4)]
    system = pb.planetary_system(rows)
    assert kept_.symplecticity_defect(pb.integrator("wisdom-holman"), system, 20.0) < kept_.DEFECT
    assert system.massive().bodies.names == ("star", "b")
    assert system.massless("b").massive() is None
    assert kept_.symplecticity_defect(pb.integrator("wisdom-holman"), system.massless("b"), 20.0) == 0


def test_control_a_method_that_is_not_symplectic_shows():
    system = pb.planetary_system([dict(drawn()[i]) for i in (0, 2, 4)])
    assert kept_.symplecticity_defect(pb.integrator("rk4"), system, 100.0) > kept_.DEFECT
