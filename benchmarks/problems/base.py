"""What a problem is: a system with published initial data, invariants and a citation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import sympy as sp

from phasebench.integrators.errors import unknown
from phasebench.integrators.systems.hamiltonian import PartitionedSystem


@dataclass(frozen=True)
class Orbit:
    """Initial data: a name, q and p as doubles (the data are the doubles), and what they are."""

    name: str
    q: tuple[float, ...]
    p: tuple[float, ...]
    about: str = ""


@dataclass(frozen=True)
class Problem:
    """A system with orbits.

    Attributes
    ----------
    id, name, source : kebab-case id, full name, citation
    cite : the keys of the works in ``bibliography.bib``, here or among the integrators
    system : a Hamiltonian or a partitioned system; ``system.H`` is the energy
    orbits : the first is the default
    invariants : name -> expression, besides the energy
    orbit : the name of the chosen orbit
    parameters : the values it was made with
    """

    id: str
    name: str
    source: str
    system: PartitionedSystem
    orbits: tuple[Orbit, ...]
    invariants: Mapping[str, sp.Expr] = field(default_factory=dict)
    orbit: str = ""
    cite: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)

    def at(self, orbit: str) -> Problem:
        """This problem on another of its orbits; raises InvalidInput for an unknown one."""
        if orbit not in {o.name for o in self.orbits}:
            raise unknown(f"orbit of '{self.id}'", orbit, [o.name for o in self.orbits])
        return replace(self, orbit=orbit)

    @property
    def start(self) -> Orbit:
        """The chosen orbit."""
        return next((o for o in self.orbits if o.name == self.orbit), self.orbits[0])

    @property
    def q0(self) -> tuple[float, ...]:
        """The initial coordinates."""
        return self.start.q

    @property
    def p0(self) -> tuple[float, ...]:
        """The initial momenta."""
        return self.start.p

    @property
    def label(self) -> str:
        """``id:orbit``, or the id alone where there is one orbit."""
        return self.id if len(self.orbits) == 1 else f"{self.id}:{self.start.name}"
