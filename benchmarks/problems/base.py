"""`Problem`, a system with initial data, invariants, citation and time scales; `Scene`, a problem with its steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.systems.hamiltonian import Formula, PartitionedSystem

ORDER, DRIFT = "order", "drift"


@dataclass(frozen=True)
class Orbit:
    """A named initial state.

    Attributes
    ----------
    name : kebab-case
    q, p : d doubles each, exactly the initial state
    about : a description
    times : rising times at which certified states are stored.  Where the flow is chaotic or unstable the last is late
        enough for long double's horizon to fall before it, and early enough for the stored digits to hold
    """

    name: str
    q: tuple[float, ...]
    p: tuple[float, ...]
    about: str = ""
    times: tuple[float, ...] = ()


class Pace(NamedTuple):
    """The time scales of a problem's motion.

    Attributes
    ----------
    unit : the unit of time: a method's order is measured over a part of it
    step : a usual step, about a thirtieth of a revolution
    span : a time over which the errors of two steps can be told apart, about half a revolution
    later : a time at which the orbit, which may start on an axis or at a turning point, is in general position
    """

    unit: float = 1.0
    step: float = 0.2
    span: float = 4.0
    later: float = 1.1


PACE = Pace()


@dataclass(frozen=True)
class Problem:
    """A system with initial states, invariants and its citation.

    Attributes
    ----------
    id, name, source : kebab-case id, full name, citation
    cite : the keys of the works in ``bibliography.bib``, here or among the integrators
    system : a Hamiltonian or a partitioned system; ``system.H`` is the energy
    orbits : the first is the default
    invariants : name -> formula, besides the energy: text such as ``"q1*p2 - q2*p1"``, or an expression of SymPy
    orbit : the name of the chosen orbit
    parameters : the values it was made with
    pace : the time scales of its motion
    time_unit : the unit of t, one of `units.TIMES`; empty if the problem has none
    """

    id: str
    name: str
    source: str
    system: PartitionedSystem
    orbits: tuple[Orbit, ...]
    invariants: Mapping[str, Formula] = field(default_factory=dict)
    orbit: str = ""
    cite: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    pace: Pace = PACE
    time_unit: str = ""

    def __post_init__(self):
        given = self.invariants
        if isinstance(given, dict) and getattr(self.system, "constrained", False):
            given = given | self.system.bound
            object.__setattr__(self, "invariants", given)
        if isinstance(given, dict) and any(isinstance(e, str) for e in given.values()):
            object.__setattr__(self, "invariants", {name: self._formula(name, e) for name, e in given.items()})

    def _formula(self, name: str, given: Formula) -> Formula:
        """The formula of an invariant as an expression; raises InvalidInput for text that is none."""
        if not isinstance(given, str) or not isinstance(self.system, PartitionedSystem):
            return given
        try:
            return self.system._formula(given)
        except InvalidInput as error:
            raise InvalidInput(f"the invariant '{name}': {error}") from None

    def at(self, orbit: str) -> Problem:
        """This problem on another of its orbits; raises InvalidInput for an unknown one."""
        if orbit not in {o.name for o in self.orbits}:
            if "=" in orbit:
                raise InvalidInput(f"'{orbit}' sets a parameter; say --set {orbit}, in Python problem(..., {orbit})")
            raise unknown_name(f"orbit of '{self.id}'", orbit, [o.name for o in self.orbits])
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

    def invariant(self, name: str, Q: ArrayLike, P: ArrayLike) -> NDArray[np.float64]:
        """The values of an invariant along rows of Q, P, each of shape (n, d); an array of shape (n,)."""
        return self.system.evaluate(f"invariant {name}", lambda: self.invariants[name], Q, P)

    def refuses(self, record: Any) -> str | None:
        """Why an integrator that can run on the system is unsuitable for this problem; None if it is not."""
        return None

    @property
    def label(self) -> str:
        """``id:orbit``, or the id alone if there is only one orbit."""
        return self.id if len(self.orbits) == 1 else f"{self.id}:{self.start.name}"


@dataclass(frozen=True)
class Scene:
    """A problem on an orbit over a time span with a ladder of steps.

    An *order* scene ends soon and halves its step; a *drift* scene is long and watches the invariants.

    Attributes
    ----------
    id, problem : the scene's name and ``id:orbit`` of its problem
    purpose : "order" or "drift"
    t_end : the end of the time span
    steps : the step sizes h, falling; in an order scene each is half of the one before
    relative, absolute : the band |measured - stored| <= absolute + relative * |stored| of the stored error tables:
        another processor rounds elementary functions and fused operations differently in the last bit, and many steps
        amplify that
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

    def ladder(self, quick: bool) -> tuple[float, ...]:
        """The step sizes of a full run, or the coarser ones of a quick one."""
        if not quick:
            return self.steps
        return self.steps[:4] if self.purpose == ORDER else self.steps[:1]


def halvings(h: float, count: int) -> tuple[float, ...]:
    """The ``count`` steps h, h/2, h/4, ..."""
    return tuple(h / 2**k for k in range(count))


def decades(last: float) -> tuple[float, ...]:
    """The four times last / 1000, last / 100, last / 10 and ``last``."""
    return tuple(last / 10**k for k in (3, 2, 1, 0))
