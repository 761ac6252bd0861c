"""What a problem is: a system with published initial data, invariants, a citation, and its own times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from phasebench.integrators.engine.lazy import sympy as sp
from phasebench.integrators.errors import InvalidInput, unknown
from phasebench.integrators.systems.hamiltonian import PartitionedSystem

ORDER, DRIFT = "order", "drift"


@dataclass(frozen=True)
class Orbit:
    """Initial data.

    Attributes
    ----------
    name : kebab-case
    q, p : d doubles each; the data are the doubles
    about : what they are
    times : at which its certified states are stored, rising.  Where the flow is chaotic or unstable the last is late
        enough for long double's horizon to fall before it, and early enough for the stored digits to hold
    """

    name: str
    q: tuple[float, ...]
    p: tuple[float, ...]
    about: str = ""
    times: tuple[float, ...] = ()


class Pace(NamedTuple):
    """In what times a problem moves.

    Attributes
    ----------
    unit : of time: a method's order is measured over a part of it
    step : some thirty to a revolution
    span : over which the errors of two steps can be told apart; about half a revolution
    later : when the orbit, which may start on an axis or at a turning point, is in general position
    """

    unit: float = 1.0
    step: float = 0.2
    span: float = 4.0
    later: float = 1.1


PACE = Pace()


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
    pace : the times in which it moves
    time_unit : of t, one of `units.TIMES`; empty where the problem has none
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
    pace: Pace = PACE
    time_unit: str = ""

    def at(self, orbit: str) -> Problem:
        """This problem on another of its orbits; raises InvalidInput for an unknown one."""
        if orbit not in {o.name for o in self.orbits}:
            if "=" in orbit:
                raise InvalidInput(f"'{orbit}' sets a parameter; say --set {orbit}, in Python problem(..., {orbit})")
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

    def invariant(self, name: str, Q, P):
        """The values of an invariant along rows of Q, P, each of shape (n, d); an array of shape (n,)."""
        return self.system.observed(f"invariant {name}", lambda: self.invariants[name], Q, P)

    def refuses(self, record) -> str | None:
        """Why an integrator that can do the system is not for this problem; None where it is."""
        return None

    @property
    def label(self) -> str:
        """``id:orbit``, or the id alone where there is one orbit."""
        return self.id if len(self.orbits) == 1 else f"{self.id}:{self.start.name}"


@dataclass(frozen=True)
class Scene:
    """A problem on an orbit over a time span with a ladder of steps.

    An *order* scene ends soon and halves its step; a *drift* scene is long and watches the invariants.

    Attributes
    ----------
    id, problem : the scene's name and ``id:orbit`` of its problem
    purpose : "order" or "drift"
    t_end : where it ends
    steps : the step sizes h, falling; in an order scene each is half of the one before
    relative, absolute : the band |measured - stored| <= absolute + relative * |stored| of the stored error tables:
        another processor rounds elementary functions and fused operations otherwise in the last bit, and the band is
        for what many steps make of it
    trajectory : the same as ``absolute`` for errors of the trajectory, in which round-off grows
    regular : whether nearby trajectories stay together (else trajectory errors count only to the reference's horizon)
    """

    id: str
    problem: str
    purpose: str
    t_end: float
    steps: tuple[float, ...]
    relative: float = 1e-3
    absolute: float = 2e-13
    trajectory: float = 2e-12
    regular: bool = True

    def made(self) -> Problem:
        """The scene's problem."""
        from . import problem

        return problem(self.problem)

    def ladder(self, quick: bool) -> tuple[float, ...]:
        """The step sizes of a full run, or the coarser ones of a quick one."""
        if not quick:
            return self.steps
        return self.steps[:4] if self.purpose == ORDER else self.steps[:1]


def halved(h: float, count: int) -> tuple[float, ...]:
    """The steps h, h/2, h/4, ..., so many of them."""
    return tuple(h / 2**k for k in range(count))


def decades(last: float) -> tuple[float, ...]:
    """Four times, each ten times the one before, of which ``last`` is the last."""
    return tuple(last / 10**k for k in (3, 2, 1, 0))
