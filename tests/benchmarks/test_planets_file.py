"""Invalid tables of bodies: the message names line and column, and what is expected there."""

from __future__ import annotations

import numpy as np
import pytest

import phasebench as pb
from phasebench.benchmarks.problems import bodies_file, problem
from phasebench.benchmarks.problems.units import Units, span, units

HEAD = "# units: AU, day, Msun\n# frame: heliocentric\n"
PLACES = "name,m,x,y,z,vx,vy,vz\nsun,1,0,0,0,0,0,0\nearth,3e-6,1,0,0,0,0.0172,0\n"
ORBITS = "name,m,a,e,inc,Omega,omega,M\nsun,1,,,,,,\nearth,3e-6,1,0.0167,0,0,102.9,357.5\n"
GOOD = HEAD + PLACES


def parse(text):
    return bodies_file.parse(text, "planets.csv")


def numbers(found):
    """A tuple of numbers for each body read from a file: its name, mass, position and velocity."""
    return [(b.name, b.mass, *map(float, (*b.x, *b.v))) for b in found.members]


@pytest.mark.parametrize(
    "text",
    [
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.replace(",", " , ").replace("units: AU , day , Msun", "units: Msun day AU"),
        "\n" + GOOD.replace("\n", "\n\n") + "# the end\n\n",
        GOOD.replace("\nsun", '\n"sun"').replace("earth", "Earth"),
        HEAD + "name,m,vx,vy,vz,x,y,z\nsun,1,0,0,0,0,0,0\nearth,3e-6,0,0.0172,0,1,0,0\n",
        PLACES + HEAD,
    ],
)
def test_equivalent_spellings_give_the_same_table(text):
    assert numbers(parse(text)) == numbers(parse(GOOD))


def test_byte_order_mark_and_crlf_are_accepted(tmp_path):
    path = tmp_path / "planets.csv"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert numbers(problem(path).bodies) == numbers(parse(GOOD))


def test_central_row_of_elements_is_empty_or_zero():
    assert numbers(parse(HEAD + ORBITS)) == numbers(parse(HEAD + ORBITS.replace("sun,1,,,,,,", "sun,1,0,0,0,0,0,0")))


@pytest.mark.parametrize("columns", [("M",), ("e", "inc"), ("e", "inc", "Omega", "omega", "M")])
def test_missing_elements_are_zero(columns):
    row = {"name": "earth", "m": 3e-6, "a": 1.0, "e": 0.1, "inc": 30.0, "Omega": 40.0, "omega": 50.0, "M": 60.0}
    whole = pb.planetary_system([ROWS[0], row | dict.fromkeys(columns, 0.0)])
    for missing in ({k: x for k, x in row.items() if k not in columns}, row | dict.fromkeys(columns)):
        found = pb.planetary_system([ROWS[0], missing])
        assert (found.q0, found.p0) == (whole.q0, whole.p0)
    assert whole.q0 != pb.planetary_system([ROWS[0], row]).q0, "control"
    assert parse(f"{HEAD}name,m,a,M\nsun,1,,\nearth,3e-6,1,\n").members[1].x == (1, 0, 0)


#: (text of the table of positions, its replacement, words of the message).
PLACED = [
    ("AU, day, Msun", "AU, day, Mearth", ["line 1", "'Mearth'", "Msun"]),
    ("AU, day, Msun", "AU, parsec, Msun", ["line 1", "'parsec'"]),
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
    ("earth,3e-6,1", "earth,3e-6,inf", ["line 5", "column x", "'inf'"]),
    ("earth,3e-6,1", "earth,3e-6,1e999", ["line 5", "column x"]),
    ("earth,3e-6,1", "earth,3e-6,one", ["line 5", "column x", "'one'"]),
    ("earth,3e-6,1", "earth,3e-6,0", ["line 5", "where sun", "line 4"]),
    ("earth,3e-6,1", "sun,3e-6,1", ["line 5", "column name", "line 4"]),
    ("earth,3e-6,1", "Sun ,3e-6,1", ["line 5", "column name", "line 4"]),
    ("earth,3e-6,1", ",3e-6,1", ["line 5", "column name"]),
    ("earth,3e-6,1", "ear.th,3e-6,1", ["line 5", "column name", "letters"]),
    ("sun,1,", "sun,0,", ["line 4", "column m", "central"]),
    ("sun,1,", "sun,-1,", ["line 4", "column m"]),
    ("sun,1,0,0,0,0", "sun,1,0,0,0,1e-5", ["line 4", "column vx", "# frame: barycentric"]),
    ("earth,3e-6,1,0,0,0,0.0172,0\n", "", ["1 bodies"]),
    ("earth,3e-6,1,0,0,0,0.0172,0", "earth,3e-6,1,0,0,0,0.0172", ["line 5", "7 cells"]),
    ("earth,3e-6,1", 'ea"rth,3e-6,"1', ["line 5"]),
    (GOOD, "", ["empty", "# units: AU, day, Msun"]),
    (GOOD, HEAD, ["empty"]),
    (PLACES, "name,m\nsun,1\nearth,3e-6\n", ["line 3", "missing", "x, y, z", "a, e"]),
    (",vz", ",radius", ["line 3", "'radius'"]),
]
#: The same for the table of elements.
ORBITING = [
    ("1,0.0167", "1,1", ["line 5", "column e", "below 1", "x, y, z"]),
    ("1,0.0167", "1,1.5", ["line 5", "column e"]),
    ("1,0.0167", "1,-0.1", ["line 5", "column e"]),
    ("1,0.0167", "0,0.0167", ["line 5", "column a", "positive"]),
    ("1,0.0167", "-1,0.0167", ["line 5", "column a", "positive"]),
    ("3e-6,1,0.0167", "3e-6,,0.0167", ["line 5", "column a", "empty"]),
    ("a,e,inc", "e,inc", ["line 4", "8 cells"]),
    ("sun,1,,", "sun,1,1,", ["line 4", "column a", "write 0"]),
    ("Omega,omega", "omega,omega", ["line 3", "omega", "twice"]),
    ("Omega,omega", "Node,omega", ["line 3", "'Node'", "capitals"]),
    (",M\n", "\n", ["line 4", "8 cells"]),
    ("name,m,", "name,", ["line 4", "8 cells"]),
]


@pytest.mark.parametrize(("text", "case"), [(GOOD, c) for c in PLACED] + [(HEAD + ORBITS, c) for c in ORBITING])
def test_error_is_named_with_its_line_and_column(text, case):
    old, new, wanted = case
    assert old in text
    with pytest.raises(pb.InvalidInput) as error:
        parse(text.replace(old, new, 1))
    for word in wanted:
        assert word in str(error.value)


@pytest.mark.parametrize("content", [b"\xff\xfe# units", b"\x00\x01\x02", b""])
def test_unreadable_file_is_refused(content, tmp_path):
    path = tmp_path / "planets.csv"
    path.write_bytes(content)
    with pytest.raises(pb.InvalidInput, match=r"planets\.csv"):
        problem(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(pb.InvalidInput, match="there is no file"):
        problem(tmp_path / "planets.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(pb.InvalidInput, match="is a directory"):
        problem(tmp_path / "folder.csv")


ROWS = [{"name": "sun", "m": 1.0}, {"name": "earth", "m": 3e-6, "a": 1.0, "e": 0.0, "inc": 0, "Omega": 0, "omega": 0}]


@pytest.mark.parametrize(
    ("table", "options", "words"),
    [
        (3, {}, "the table is a int"),
        ([1, 2], {}, "the table is a list"),
        ([ROWS[0], {"name": "earth", "m": 3e-6, "e": 0.1}], {}, "the column a is missing"),
        ([*ROWS, ROWS[1]], {}, "row 3, column name"),
        ([ROWS[0], ROWS[1] | {"M": True}], {}, "row 2, column M: it is 'True'"),
        ([ROWS[0], ROWS[1] | {"a": None}], {}, "row 2, column a: it is empty"),
        ([ROWS[0], ROWS[1] | {"M": 0}], {"units": "AU"}, "no unit of time"),
        ([ROWS[0], ROWS[1] | {"M": 0}], {"frame": "solar"}, "no frame 'solar'"),
        ({"name": ["sun"], "m": [1.0, 2.0]}, {}, "different lengths"),
        ("examples/planets.csv", {"units": "AU, day, Msun"}, "leave out units="),
    ],
)
def test_error_of_a_table_in_python_is_named(table, options, words):
    with pytest.raises(pb.InvalidInput, match=words):
        pb.planetary_system(table, **options)


def test_unknown_body_cannot_be_left_out():
    system = problem("examples/planets.csv")
    assert system.without("saturn").bodies.names == ("sun", "jupiter")
    assert system.massless("saturn").bodies.particles == ("saturn",)
    for name in ("pluto", "sun"):
        with pytest.raises(pb.InvalidInput, match=f"'{name}'"):
            system.without(name)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [("1e4 yr", "day", 3652500.0), ("1e4yr", "day", 3652500.0), ("2 days", "s", 172800.0), ("-3", "", -3.0),
     ("86400 s", "day", 1.0), ("1 Myr", "yr", 1e6), (7, "", 7), (None, "", None), (" 5 ", "yr", 5.0),
     ("0.1 yr", "day", 36.525)],
)  # fmt: skip
def test_times_with_a_unit(value, unit, expected):
    assert span(value, unit) == expected


@pytest.mark.parametrize("value", ["1e4 fortnights", "yr", "", "1e999 yr", "1 yr 2", "inf", "1..2 yr", "1e308 yr"])
def test_control_invalid_times(value):
    with pytest.raises(pb.InvalidInput):
        span(value, "day")


def test_steps_and_starts_have_units_as_ends_have():
    plain = pb.integrate("examples/planets.csv", "wisdom-holman", h=10.0, t_end=730.5, t0=365.25)
    dated = pb.integrate("examples/planets.csv", "wisdom-holman", h="10 d", t_end="2 yr", t0="1 yr")
    assert np.array_equal(plain.q, dated.q)
    with pytest.raises(pb.InvalidInput, match="no unit of time"):
        pb.integrate("pendulum", "rk4", h="1 d", steps=3)


def test_units_in_any_order():
    assert units("Msun, s km", "here") == Units("km", "s", "Msun")
