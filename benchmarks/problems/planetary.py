r"""A user's planetary system: bodies about a central one, from a file planets.csv or from Python.

.. math:: H = \sum_i \frac{|p_i|^2}{2m_i} - \sum_{i<j} \frac{G m_i m_j}{|q_i - q_j|},\qquad p_i = m_i v_i,

about the barycentre at rest.  Jacobi's coordinates of the Kepler part take the bodies in the order of their semi-major
axes, in whatever order the table has them.

A test particle (m = 0) has no :math:`p = m v`.  It is given `MASSLESS` = 1e-20 of the central body's mass: what that
does to the others is 1e-4 of a double's rounding, its own motion is that of a test particle, and H stays one canonical
function, so that symplectic and Wisdom-Holman methods, REBOUND and the references treat it as any other body.  Methods
that move states along the gradient of H (Gonzalez's discrete gradient, projections) are refused: a massless body has no
weight in the gradient, and such a step would throw the body off its orbit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from phasebench.integrators.compile.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.systems.hamiltonian import Hamiltonian

from . import bodies_file, kept
from .base import Orbit, Pace, Problem, floats
from .bodies import HELIOCENTRIC, Bodies, Oblate, bodies
from .units import Units
from .units import units as units_of

NAME = "planetary system"
#: Families whose steps depend on the sizes of q and p, of which a test particle's are arbitrary.
GRADIENTS = ("discrete_gradient", "projection")


@dataclass(frozen=True)
class PlanetarySystem(Problem):
    """A problem of ``bodies`` that move about a central one: masses, positions and velocities."""

    bodies: Bodies | None = None

    def refuses(self, record: Any) -> str | None:
        """Return why a method that moves states along gradients is unsuitable for test particles; None if it is not."""
        particles = self.bodies.particles
        if not particles or getattr(record, "family", None) not in GRADIENTS:
            return None
        return (
            f"'{record.id}' moves states along the gradient of H, in which a test particle ({particles[0]}) has no "
            "weight: leave out the test particles, or take another method"
        )

    def massive(self) -> PlanetarySystem | None:
        """Return this system without its test particles; None if only the central body would be left."""
        particles = self.bodies.particles
        if len(particles) == len(self.bodies.members) - 1:
            return None
        return self.without(*particles) if particles else self

    def without(self, *names: str) -> PlanetarySystem:
        """Return this system without the named bodies; the others start as in the table, about their own barycentre.

        Raises InvalidInput for an unknown name, and for the central body.
        """
        self._check(names)
        return of_bodies(self.bodies.without(names), f"{self.id} without {', '.join(names)}")

    def massless(self, *names: str) -> PlanetarySystem:
        """Return this system with the named bodies as test particles; raises as `without`."""
        self._check(names)
        return of_bodies(self.bodies.massless(names), f"{self.id} with massless {', '.join(names)}")

    def _check(self, names: Iterable[str]) -> None:
        others = self.bodies.names[1:]
        for name in names:
            if name not in others:
                raise unknown_name(f"body of '{self.id}'", name, others)


def planetary_system(
    table: str | Path | Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]],
    *,
    units: str = "",
    frame: str | None = None,
    elements: str = HELIOCENTRIC,
    J2: float = 0.0,
    J4: float = 0.0,
    radius: float = 0.0,
    id: str = "planetary-system",
) -> PlanetarySystem:
    """Make the gravitational problem of a table of bodies, the central one first.

    Parameters
    ----------
    table : the path of a file such as ``planets.csv``; a DataFrame; column -> values; or a sequence of rows.  Columns
        are ``name, m`` and either ``x, y, z, vx, vy, vz`` or orbital elements under REBOUND's names: ``a`` or ``P``,
        ``e, inc, Omega``, ``omega`` or ``pomega``, and one of ``M, f, l, theta``, ``T`` (the time of the pericentre)
        and ``T0`` (that of a transit); angles in degrees, missing ones 0; m = 0 is a test particle
    units : the units of length, time and mass, for a table that is no file; by default ``"AU, day, Msun"``
    frame : of positions and velocities in a table that is no file: ``"heliocentric"`` (about the first body) or
        ``"barycentric"``
    elements : what elements in a table that is no file are about: ``"heliocentric"``, the first body, or ``"jacobi"``,
        the barycentre of the rows before
    J2, J4, radius : the flattening of the central body about the z axis, and its equatorial radius, for a table that is
        no file
    id : the problem's name; the problem of a file is named by its path

    Returns
    -------
    PlanetarySystem
        The problem about the barycentre at rest, with its Kepler part, the distances that may vanish, and the
        invariants momentum, angular momentum and barycentre.  Its times may have a unit, ``t_end="1e4 yr"``; it has
        quantities of each body, such as ``jupiter.longitude``, besides the usual ones

    Raises
    ------
    InvalidInput
        For a table that cannot be used, naming the row and the column.

    Examples
    --------
    >>> rows = [{"name": "sun", "m": 1.0}, {"name": "earth", "m": 3e-6, "a": 1.0, "e": 0.0167}]
    >>> rows[1] |= {"inc": 0.0, "Omega": 0.0, "omega": 102.9, "M": 357.5}
    >>> planetary_system(rows).system.d
    6
    """
    if isinstance(table, (str, Path)):
        if units or frame is not None or elements != HELIOCENTRIC or any((J2, J4, radius)):
            raise InvalidInput(
                f"{table} says its units, frame, elements and flattening itself; leave out units=, frame=, ..."
            )
        return from_file(table)
    rows = _rows(table)
    heads = list(dict.fromkeys(str(column) for _, row in rows for column in row))
    found_units = units_of(units, "units=") if units else Units()
    return of_bodies(bodies(rows, found_units, frame, "the table", heads, elements, Oblate(J2, J4, radius)), id)


def _rows(table: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]]) -> list[tuple[str, dict[str, Any]]]:
    if hasattr(table, "to_dict"):
        table = table.to_dict("list")
    try:
        if isinstance(table, Mapping):
            columns = {str(name): list(values) for name, values in table.items()}
            if len({len(values) for values in columns.values()}) > 1:
                raise InvalidInput("the table's columns are of different lengths; give each body a value in each")
            found = [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]
        else:
            found = [dict(row) for row in table]
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        hint = "give a path, a DataFrame, column -> values, or rows such as {'name': 'sun', 'm': 1.0}"
        raise InvalidInput(f"the table is a {type(table).__name__}; {hint}") from None
    return [(f"row {number}", row) for number, row in enumerate(found, start=1)]


def from_file(path: str | Path, **parameters: float | str) -> PlanetarySystem:
    """Make the problem of a file of bodies, planets.csv; raise InvalidInput for a parameter, since it has none."""
    if parameters:
        raise InvalidInput(f"{path} has no parameter '{next(iter(parameters))}'; change the file")
    return of_bodies(bodies_file.read(path), str(path))


def of_bodies(found: Bodies, id: str) -> PlanetarySystem:
    """Return the problem, with the given id, of a checked table of bodies, from the cache on disk if it is there."""
    made = kept.load_or_make(("planetary", *found.content), partial(build, found))
    return replace(made, id=id, bodies=found)


def build(found: Bodies) -> PlanetarySystem:
    """Build the problem of a checked table of bodies: H, start, invariants, Kepler part."""
    from . import gravity

    N, G = len(found.members), sp.Rational(found.units.G)
    masses = [sp.Rational(m) for m in found.masses]
    q, p, pairs, distances, invariants = gravity.bodies(N, "xyz", first=0)
    H = gravity.newton(p, masses, G, pairs, distances)
    if any(found.oblate):
        H += _flattening(q, masses, G, *map(sp.Rational, found.oblate))
        del invariants["angular-momentum-1"], invariants["angular-momentum-2"]
    light = {i for i, name in enumerate(found.names) if name in found.particles}
    system = Hamiltonian(
        q=q,
        p=p,
        H=H,
        singular=[r for pair, r in zip(pairs, distances, strict=True) if not light.issuperset(pair)],
        invariants=invariants.values(),
        kepler=gravity.kepler_part(masses, G, found.order()),
    )
    positions, velocities = found.start()
    start = Orbit("start", floats(positions), floats(np.transpose([found.masses]) * velocities), f"{found.frame} data")
    return PlanetarySystem(
        id=NAME,
        name=NAME,
        source="a table of bodies",
        system=system,
        orbits=(start,),
        invariants=invariants | gravity.barycentre(q, masses),
        pace=_pace(found),
        time_unit=found.units.time,
        bodies=found,
    )


def _flattening(
    q: list, masses: list, G: sp.Rational, J2: sp.Rational, J4: sp.Rational, radius: sp.Rational
) -> sp.Expr:
    """Return what H has more where the first body is flattened about the z axis.

    Source: C. D. Murray, S. F. Dermott, Solar System Dynamics (1999), section 6.11.  It is the sum over the others of
    G m_0 m_i / r (J2 (R/r)^2 P_2(z/r) + J4 (R/r)^4 P_4(z/r)), P_n Legendre's.
    """
    x = [sp.Matrix(q[i : i + 3]) for i in range(0, len(q), 3)]
    parts = []
    for m, place in zip(masses[1:], x[1:], strict=True):
        away = place - x[0]
        r = sp.sqrt(sum(s**2 for s in away))
        for n, J in ((2, J2), (4, J4)):
            parts.append(G * masses[0] * m * J * radius**n / r ** (n + 1) * sp.legendre(n, away[2] / r))
    return sp.Add(*parts)


def _pace(found: Bodies) -> Pace:
    a = min(found.semi_axes())
    period = 2 * pi * sqrt(a**3 / (found.units.G * found.masses[0])) if a < float("inf") else 1.0
    return Pace(unit=period / 10, step=period / 30, span=period / 2, later=period / 6)


__all__ = ["PlanetarySystem", "from_file", "of_bodies", "planetary_system"]
