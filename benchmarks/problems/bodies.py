"""Tables of gravitating bodies: checks of their rows, and positions and velocities about the barycentre at rest.

A row has a position and a velocity, or orbital elements (`elements`) about the central body or, in Jacobi's way, about
the barycentre of the rows before it.  All of it is computed in 40 digits and rounded once.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import NamedTuple

import mpmath

from phasebench.integrators.errors import InvalidInput, unknown_name

from . import elements
from .elements import KEYWORDS, Vector
from .gravity import MASSLESS
from .units import Units

CARTESIAN = ("x", "y", "z", "vx", "vy", "vz")
#: The elements that a message names.
ELEMENTS = ("a", "e", "inc", "Omega", "omega", "M")
HELIOCENTRIC, BARYCENTRIC = "heliocentric", "barycentric"
FRAMES = (HELIOCENTRIC, BARYCENTRIC)
#: About what elements are: the central body, or the barycentre of the bodies before.
JACOBI = "jacobi"
CENTRES = (HELIOCENTRIC, JACOBI)
#: More bodies make formulae that take minutes to derive.
MOST = 16
DIGITS = 40
#: The largest relative offset of the barycentre in a table declared barycentric with its first body at the origin.
OFF = 1e-9

#: A row of a table: where it stands ("planets.csv, line 4"), and column -> text or number.
Row = tuple[str, Mapping[str, object]]


@dataclass(frozen=True)
class Body:
    """A body: its mass, and its position and velocity in the frame of the table.

    Attributes
    ----------
    name : in lower case with dashes for spaces
    mass, massive : 0 for a test particle, and False for a body with a mass that is treated as one
    x, v : position and velocity, three multiprecision numbers each
    """

    name: str
    mass: float
    x: Vector
    v: Vector
    massive: bool = True


class Oblate(NamedTuple):
    """The flattening of the central body about the z axis: J2, J4, and the equatorial radius to which they belong."""

    J2: float = 0.0
    J4: float = 0.0
    radius: float = 0.0


ROUND = Oblate()


@dataclass(frozen=True)
class Bodies:
    """The bodies of a gravitating system, the central one first, with their units.

    Attributes
    ----------
    members, units : the bodies, in the order of the table, and the units of all numbers
    frame : heliocentric (about the first body) or barycentric
    oblate : the flattening of the central body
    """

    members: tuple[Body, ...]
    units: Units
    frame: str
    oblate: Oblate = ROUND

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the bodies, the central one first."""
        return tuple(b.name for b in self.members)

    @property
    def particles(self) -> tuple[str, ...]:
        """The names of the test particles."""
        return tuple(b.name for b in self.members if not (b.massive and b.mass))

    @property
    def masses(self) -> tuple[float, ...]:
        """The masses used in the integration: a test particle gets `MASSLESS` times the central body's mass."""
        least = MASSLESS * self.members[0].mass
        return tuple(b.mass if b.massive and b.mass else least for b in self.members)

    @property
    def content(self) -> tuple:
        """The table as nested tuples of numbers and strings, which tell it from another."""
        with mpmath.workdps(DIGITS):
            rows = tuple((b.name, b.mass, tuple(map(str, (*b.x, *b.v))), b.massive) for b in self.members)
        return rows, tuple(self.units), self.frame, tuple(self.oblate)

    def without(self, names: Iterable[str]) -> Bodies:
        """Return the table without the bodies of these names."""
        left_out = set(names)
        return replace(self, members=tuple(b for b in self.members if b.name not in left_out))

    def massless(self, names: Iterable[str]) -> Bodies:
        """Return the table with the bodies of these names as test particles."""
        light = set(names)
        return replace(self, members=tuple(replace(b, massive=False) if b.name in light else b for b in self.members))

    def start(self) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
        """Return (positions, velocities) about the barycentre at rest, lists of a triple of doubles for each body."""
        with mpmath.workdps(DIGITS):
            masses = [mpmath.mpf(b.mass) if b.massive else mpmath.mpf(0) for b in self.members]
            return _center([b.x for b in self.members], masses), _center([b.v for b in self.members], masses)

    def semi_axes(self) -> tuple[float, ...]:
        """Return the osculating semi-major axes of all bodies but the central one; infinite for an unbound body."""
        centre, G = self.members[0], self.units.G
        found = []
        with mpmath.workdps(DIGITS):
            for b in self.members[1:]:
                r, v = _length(_minus(b.x, centre.x)), _length(_minus(b.v, centre.v))
                inverse = 2 / r - v**2 / (G * (mpmath.mpf(centre.mass) + b.mass))
                found.append(float(1 / inverse) if inverse > 0 else inf)
        return tuple(found)

    def order(self) -> list[int]:
        """Return the indices of the bodies by increasing semi-major axis, the central one first: Jacobi's order."""
        size = dict(enumerate(self.semi_axes(), start=1))
        return [0, *sorted(size, key=size.__getitem__)]


def bodies(
    rows: Sequence[Row],
    units: Units,
    frame: str | None,
    where: str,
    heads: Sequence[str],
    about: str = HELIOCENTRIC,
    oblate: Oblate = ROUND,
) -> Bodies:
    """Check a table of gravitating bodies, and make the `Bodies` of it; raise InvalidInput that names row and column.

    Parameters
    ----------
    rows : pairs (where the row stands, column -> text or number), the central body first
    units, frame : the units of all numbers; "heliocentric", "barycentric", or None if columns are orbital elements
    where, heads : the name of the table in messages, such as its path, and the names of the columns
    about : what orbital elements are about, of `CENTRES`
    oblate : the flattening of the central body
    """
    if not all(map(isfinite, oblate)) or oblate.radius < 0 or (any(oblate[:2]) and not oblate.radius):
        raise InvalidInput(f"{where}: J2 and J4 take the radius of the central body, a positive number, beside them")
    if about not in CENTRES:
        raise InvalidInput(f"{where}: elements are about {unknown_name('centre', about, CENTRES)}")
    chosen = _columns(heads, where)
    if frame is None and chosen != KEYWORDS:
        raise InvalidInput(f"{where}: it does not say about what positions are; say the frame: {' or '.join(FRAMES)}")
    frame = frame or HELIOCENTRIC
    if frame not in FRAMES:
        raise InvalidInput(f"{where}: {unknown_name('frame', frame, FRAMES)}")
    if len(rows) < 2:
        raise InvalidInput(f"{where}: there are {len(rows)} bodies; give the central one first, then at least one more")
    if len(rows) > MOST:
        raise InvalidInput(f"{where}: there are {len(rows)} bodies; formulae are derived of at most {MOST}")
    names: dict[str, str] = {}
    members: list[Body] = []
    with mpmath.workdps(DIGITS):
        for place, row in rows:
            name = _name(place, row, names)
            m = _number(place, row, "m")
            if m < 0 or (m == 0 and not members):
                why = "the central body needs a mass" if m == 0 else "a mass is positive, or 0 of a test particle"
                raise InvalidInput(f"{place}, column m: the mass of {name} is {m:g}; {why}")
            if not members:
                x, v = _central(place, row, chosen, frame)
            elif chosen == KEYWORDS:
                x, v = _of_elements(place, row, m, members[:1] if about == HELIOCENTRIC else members, units.G)
            else:
                numbers = [mpmath.mpf(_number(place, row, c)) for c in CARTESIAN]
                x, v = tuple(numbers[:3]), tuple(numbers[3:])
            for other in members:
                if other.x == x:
                    stands = names[other.name]
                    raise InvalidInput(
                        f"{place}: {name} is where {other.name} ({stands}) is; move one, or leave it out"
                    )
            members.append(Body(name, m, x, v))
        found = Bodies(tuple(members), units, frame, oblate)
        _check_frame(found, chosen, where)
    return found


def _of_elements(
    place: str, row: Mapping[str, object], m: float, inner: Sequence[Body], G: float
) -> tuple[Vector, Vector]:
    """Return (position, velocity) of a body of mass m from a row of elements about the barycentre of ``inner``."""
    given = {name: _number(place, row, name) for name in KEYWORDS if not _is_empty(row.get(name))}
    masses = [mpmath.mpf(b.mass) for b in inner]
    found = elements.state(place, given, mpmath.mpf(G) * (mpmath.fsum(masses) + m))
    centres = _mean([b.x for b in inner], masses), _mean([b.v for b in inner], masses)
    return tuple(tuple(a + b for a, b in zip(*pair, strict=True)) for pair in zip(found, centres, strict=True))


def _mean(vectors: Sequence[Vector], masses: Sequence) -> Vector:
    total = mpmath.fsum(masses)
    return tuple(
        mpmath.fsum(m * x for m, x in zip(masses, axis, strict=True)) / total for axis in zip(*vectors, strict=True)
    )


def _columns(heads: Sequence[str], where: str) -> tuple[str, ...]:
    twice = [h for i, h in enumerate(heads) if h in heads[:i]]
    if twice:
        raise InvalidInput(f"{where}: the column {twice[0]} is there twice; leave one out")
    strange = [h for h in heads if h not in ("name", "m", *CARTESIAN, *KEYWORDS)]
    if strange:
        near = difflib.get_close_matches(strange[0], KEYWORDS)
        known = unknown_name("column", strange[0], near or ["name", "m", *CARTESIAN, *ELEMENTS])
        raise InvalidInput(
            f"{where}: {known} (capitals matter: Omega is the node, omega the pericentre, M the anomaly, P the period)"
        )
    given = {kind for kind in (CARTESIAN, KEYWORDS) if set(heads) & set(kind)}
    if len(given) == 2:
        raise InvalidInput(f"{where}: columns are of both kinds; give {', '.join(CARTESIAN)} or {', '.join(ELEMENTS)}")
    chosen = given.pop() if given else CARTESIAN
    sized = [c for c in elements.SIZES if c in heads] or elements.SIZES[:1]
    needed = ("name", "m", *(chosen if chosen == CARTESIAN else sized))
    missing = [c for c in needed if c not in heads]
    if missing:
        wanted = (
            f"name, m, {', '.join(CARTESIAN if chosen == CARTESIAN else ELEMENTS)}"
            if set(heads) & {*CARTESIAN, *KEYWORDS}
            else (f"name, m and {', '.join(CARTESIAN)}, or name, m and {', '.join(ELEMENTS)}")
        )
        raise InvalidInput(f"{where}: the column {missing[0]} is missing; write {wanted}")
    return chosen


def _name(place: str, row: Mapping[str, object], names: dict[str, str]) -> str:
    given = str(row.get("name", "")).strip()
    name = "-".join(given.lower().split())
    if not name or not all(c.isalnum() or c in "-_" for c in name):
        raise InvalidInput(f"{place}, column name: '{given}' is no name; write letters, digits and dashes")
    if name in names:
        raise InvalidInput(f"{place}, column name: '{given}' is the name of {names[name]}, too; change one")
    names[name] = place
    return name


def _is_empty(value: object) -> bool:
    return value is None or not str(value).strip() or value != value


def _number(place: str, row: Mapping[str, object], column: str) -> float:
    """Return the number in a column of a row; raise InvalidInput for anything else there."""
    value = row.get(column)
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = inf
    if not isfinite(number) or isinstance(value, bool):
        said = "empty" if _is_empty(value) else f"'{value}'"
        raise InvalidInput(f"{place}, column {column}: it is {said}; write a finite number, such as 0.5 or 1e-3")
    return number


def _central(place: str, row: Mapping[str, object], chosen: tuple[str, ...], frame: str) -> tuple[Vector, Vector]:
    """Return (position, velocity) of the central body from its row: zero, unless the frame is barycentric."""
    if chosen == CARTESIAN and frame == BARYCENTRIC:
        numbers = [mpmath.mpf(_number(place, row, c)) for c in CARTESIAN]
        return tuple(numbers[:3]), tuple(numbers[3:])
    for column in chosen:
        given = row.get(column)
        if not _is_empty(given) and _number(place, row, column) != 0:
            other = " or say '# frame: barycentric'" if chosen == CARTESIAN else ""
            raise InvalidInput(
                f"{place}, column {column}: it is {given}, and the first row is the central body, about which all "
                f"others are given; write 0{other}"
            )
    zero = (mpmath.mpf(0),) * 3
    return zero, zero


def _minus(a: Vector, b: Vector) -> Vector:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _length(a: Vector) -> mpmath.mpf:
    return mpmath.sqrt(mpmath.fsum(x * x for x in a))


def _center(vectors: Sequence[Vector], masses: Sequence) -> list[tuple[float, ...]]:
    centre = _mean(vectors, masses)
    return [tuple(map(float, _minus(v, centre))) for v in vectors]


def _check_frame(found: Bodies, chosen: tuple[str, ...], where: str) -> None:
    """Refuse a table that says barycentric with its central body at rest at the origin, where the barycentre is not."""
    first = found.members[0]
    if chosen == KEYWORDS or found.frame != BARYCENTRIC or any(first.x) or any(first.v):
        return
    masses = [mpmath.mpf(b.mass) for b in found.members]
    size = max(_length(b.x) for b in found.members)
    centre = [mpmath.fsum(m * b.x[k] for m, b in zip(masses, found.members, strict=True)) for k in range(3)]
    if _length(tuple(centre)) > OFF * size * mpmath.fsum(masses):
        raise InvalidInput(
            f"{where}: the frame is barycentric, but the central body rests at the origin and the barycentre does not; "
            "say '# frame: heliocentric'"
        )
