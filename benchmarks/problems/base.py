"""`Problem`, a system with initial data, invariants, citation, time scales; `Scene`, a problem with span and steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasebench.integrators.errors import InvalidInput, unknown_name
from phasebench.integrators.request import extended
from phasebench.integrators.systems.hamiltonian import Formula, PartitionedSystem

ORDER, DRIFT = "order", "drift"


@dataclass(frozen=True)
class Orbit:
    """A named initial state of a problem.

    Attributes
    ----------
    name, about : kebab-case, and a line
    q, p : d doubles each, exactly the initial state
    times : rising times at which certified (reference) states are stored.  If the flow is chaotic or unstable, a run in
        long double no longer follows the orbit to the last of these times, but all stored digits are still right there
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
    unit, step : the unit of time, over a part of which an order is measured; a usual step, 1/30 of a revolution
    span : a time after which runs with different step sizes have clearly different errors, about half a revolution
    later : a time at which the orbit is in general position: no symmetry of the start makes errors of steps small
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
    cite : the keys of the works in the ``bibliography.bib`` of the problems or of the integrators
    system : a Hamiltonian or a partitioned system; ``system.H`` is the energy
    orbits : the named initial states; the first is the default
    invariants : name -> formula, besides the energy: text such as ``"q1*p2 - q2*p1"``, or an expression of SymPy
    orbit : the name of the chosen orbit
    parameters : name -> value of the parameters it was made with
    pace : the time scales of its motion
    time_unit : the unit of t, one of `units.TIMES`; empty if the problem has none
    """

    id: str
    name: str
    source: str
    system: PartitionedSystem
    orbits: tuple[Orbit, ...]
    invariants: Mapping[str, Formula] = field(default_factory=dict, hash=False)
    orbit: str = ""
    cite: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict, hash=False)
    pace: Pace = PACE
    time_unit: str = ""

    def __post_init__(self) -> None:
        if getattr(self.system, "driven", False):
            orbits = (
                replace(o, **{x: floats(extended(self.system, x, getattr(o, x))) for x in "qp"}) for o in self.orbits
            )
            object.__setattr__(self, "orbits", tuple(orbits))
        given = self.invariants
        if isinstance(given, dict) and getattr(self.system, "constrained", False):
            given = given | self.system.bound
            object.__setattr__(self, "invariants", given)
        if isinstance(given, dict) and any(isinstance(e, str) for e in given.values()):
            object.__setattr__(self, "invariants", {name: self._formula(name, e) for name, e in given.items()})

    def _formula(self, name: str, given: Formula) -> Formula:
        if not isinstance(given, str) or not isinstance(self.system, PartitionedSystem):
            return given
        try:
            return self.system._formula(given)
        except InvalidInput as error:
            raise InvalidInput(f"the invariant '{name}': {error}") from None

    def at(self, orbit: str) -> Problem:
        """Return this problem on the orbit with this name; raise InvalidInput if it has none of this name."""
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
        """The initial coordinates of the chosen orbit."""
        return self.start.q

    @property
    def p0(self) -> tuple[float, ...]:
        """The initial momenta of the chosen orbit."""
        return self.start.p

    def invariant(self, name: str, Q: ArrayLike, P: ArrayLike) -> NDArray[np.float64]:
        """Return the values of the invariant ``name`` along rows of Q, P, each of shape (n, d): an array (n,)."""
        return self.system.evaluate(f"invariant {name}", lambda: self.invariants[name], Q, P)

    def refuses(self, record: Any) -> str | None:
        """Return why an integrator that can run on the system is unsuitable for this problem; None if it is suitable.

        ``record`` describes the integrator; every one is suitable here, and subclasses may refuse some.
        """
        return None

    @property
    def label(self) -> str:
        """``id:orbit``, or the id alone if there is only one orbit."""
        return self.id if len(self.orbits) == 1 else f"{self.id}:{self.start.name}"


@dataclass(frozen=True)
class Scene:
    """A problem on an orbit over a time span, with the step sizes at which methods are compared on it.

    Attributes
    ----------
    id, problem, t_end : kebab-case id; ``id:orbit``; end of the span
    purpose : "order", short with steps that are halved, or "drift", long, for the errors of the invariants
    steps : the step sizes h, falling; in an order scene each is half of the one before
    relative, absolute : the band |measured - stored| <= absolute + relative * |stored| of the stored error tables:
        another processor rounds differently in the last bit, and many steps amplify that
    trajectory : the same as ``absolute`` for errors of the trajectory, in which round-off grows
    regular : whether nearby trajectories stay together; if not, trajectory errors count only to the reference's
        horizon, the last time at which a run in long double follows the orbit
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
        """Return the step sizes h of a full run or, if ``quick``, only the larger ones."""
        if not quick:
            return self.steps
        return self.steps[:4] if self.purpose == ORDER else self.steps[:1]


def check_positive(what: str, **values: float) -> None:
    """Raise InvalidInput for the first of some parameters, name -> value, of ``what`` that is not positive."""
    for name, value in values.items():
        if not value > 0:
            raise InvalidInput(f"{name} of {what} is {value}; it must be positive")


def whole(what: str, value: float, least: int, most: int) -> int:
    """Return a number as an integer; raise InvalidInput, naming ``what`` it counts, if it is none or out of bounds."""
    if int(value) != value or not least <= value <= most:
        raise InvalidInput(f"the number {what} is {value}; it must be an integer from {least} to {most}")
    return int(value)


def floats(numbers: ArrayLike) -> tuple[float, ...]:
    """Return numbers of any type, also nested, as a flat tuple of doubles: the q or p of an `Orbit`."""
    return tuple(float(x) for x in np.ravel(numbers))


def halvings(h: float, count: int) -> tuple[float, ...]:
    """Return the ``count`` step sizes h, h/2, h/4, ..."""
    return tuple(h / 2**k for k in range(count))


def decades(last: float) -> tuple[float, ...]:
    """Return four times for an orbit's stored states: last / 1000, last / 100, last / 10 and ``last``."""
    return tuple(last / 10**k for k in (3, 2, 1, 0))
