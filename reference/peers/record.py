"""`Peer`: a frozen record of an integrator from another package, with the claims that its package makes."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasebench.integrators.errors import InvalidInput

if TYPE_CHECKING:
    from phasebench.integrators.systems.hamiltonian import PartitionedSystem


@dataclass(frozen=True)
class Claims:
    """Properties of an integrator that its package claims; None for a property of which it claims nothing.

    Attributes
    ----------
    order : in the step h
    symplectic, reversible : of the step map at constant h
    energy : how well the energy is conserved, one of the words in `integrators.record`: "round-off", "bounded",
        "drift", ...
    source : where the package claims it (address of the page, name of the attribute)
    """

    order: int | None = None
    symplectic: bool | None = None
    reversible: bool | None = None
    energy: str | None = None
    source: str = ""


#: Reason for the end of a run with a state that is infinite or NaN.
NOT_FINITE = "the state is no longer finite"


class Task(NamedTuple):
    """The input of a peer's run, which returns the states at certain times (its rows).

    A prepared run has no rows: its step, or its end, is told when it is called.

    Attributes
    ----------
    problem, system : the problem (or the system again, if there is none), and its system
    q, p : arrays (d,), the initial state
    h : the step; for an adaptive peer the spacing of its rows
    numbers : step numbers of the rows, increasing from 0
    times : array, h times the numbers
    tol : the tolerance of an adaptive peer; None for the package's default
    """

    problem: Any
    system: Any
    q: np.ndarray
    p: np.ndarray
    h: float = 0.0
    numbers: Sequence[int] = (0,)
    times: Sequence[float] | np.ndarray = (0.0,)
    tol: float | None = None

    @property
    def state(self) -> np.ndarray:
        """(q, p) as a new array (2 d,)."""
        return np.concatenate([self.q, self.p]).astype(float)

    @property
    def steps(self) -> int:
        """The number of steps from the start to the last row."""
        return self.numbers[-1]

    def tolerances(self, *names: str) -> dict[str, float]:
        """The tolerance as keyword arguments of a package, ``names``; {} for the package's default."""
        return {} if self.tol is None else dict.fromkeys(names, self.tol)


class Run(NamedTuple):
    """A peer's result: rows (n, d) of q and p, steps, gradient evaluations (0: unknown), seconds, failure or None."""

    q: np.ndarray
    p: np.ndarray
    steps: int
    gradient: int
    seconds: float
    failure: str | None = None

    @classmethod
    def of_states(cls, rows: np.ndarray, *more: float | str | None) -> Run:
        """Make a `Run` from rows (q, p), array (n, 2 d); ``more`` are the fields after q and p."""
        d = rows.shape[1] // 2
        return cls(rows[:, :d], rows[:, d:], *more)

    @classmethod
    def stuck(cls, task: Task, *more: float | str | None) -> Run:
        """Make a `Run` that did not leave the initial state, its only row; ``more`` are the fields after q and p."""
        return cls.of_states(task.state[None], *more)


#: The codes that a package's call returns in a prepared run: the end was reached, or the package stopped before it.
SOLVED, STALLED = 0, 1


class Calls(NamedTuple):
    """The functions of a package for a prepared run.

    Attributes
    ----------
    restart : (y) -> None: set the state (q, p), array (2 d,), from which `advance` starts
    advance : (t_end), or (h, steps) with fixed steps -> status code: reset, then the package's own call
    state : () -> the state (q, p) reached, array (2 d,), a copy
    keep : objects that must live as long as these functions, such as a callback whose address the package holds
    """

    restart: Callable[[np.ndarray], None]
    advance: Callable[..., int]
    state: Callable[[], np.ndarray]
    keep: Any = None

    @classmethod
    def to_end(cls, task: Task, integrate: Callable[..., np.ndarray | None]) -> Calls:
        """Make the `Calls` of ``integrate``: (y, t_end) or (y, h, steps) -> the final state, or None if it failed."""
        begin, end = task.state, [task.state]

        def restart(y: np.ndarray) -> None:
            begin[:] = y

        def advance(*size: float) -> int:
            y = integrate(begin, *size)
            if y is None:
                return STALLED
            end[0] = y
            return SOLVED

        return cls(restart, advance, lambda: np.array(end[0]))


def anything(problem: Any, system: PartitionedSystem) -> str | None:
    """The function `Peer.lacks` of a peer that is applicable to every problem: returns None, no reason against it."""
    return None


def only(scope: str, why: str, applicable: Callable[[PartitionedSystem], bool]) -> dict[str, Any]:
    """Make the fields ``scope`` and ``lacks`` of a `Peer`; ``why`` it takes no system that is not ``applicable``."""
    return {"scope": scope, "lacks": lambda problem, system: None if applicable(system) else why}


def split_alone(why: str) -> dict[str, Any]:
    """Make the fields ``scope`` and ``lacks`` of a `Peer` for H = T(p) + V(q) alone; ``why`` it takes no other."""
    return only("H = T(p) + V(q)", why, lambda system: system.canonical and system.separable)


class NotHere(str):
    """A reason of `Peer.lacks` that holds on this machine alone, such as an instruction that its processor lacks."""


def older_python(oldest: tuple[int, int] | None) -> str | None:
    """Why a package that needs this Python (major, minor) cannot be installed here; None if it can."""
    if oldest is None or sys.version_info[:2] >= oldest:
        return None
    here, needed = (".".join(map(str, version[:2])) for version in (sys.version_info, oldest))
    return f"it needs Python {needed} or newer, and this is {here}"


@dataclass(frozen=True)
class Peer:
    """An integrator from another package.

    Attributes
    ----------
    id, name : its kebab-case name and its full one
    package : the package to install and import
    adaptive : True if it takes a tolerance ``tol``; ``h`` is then the spacing of its output
    order : in the step h, for a fixed-step peer on a nonlinear problem; None if it is not a single number
    license : of the package
    about : the meaning of its tolerance or its options, and what its time includes
    source : author, year
    run : `Task` -> `Run` with the rows of the task up to a failure; the package may be imported here, but not at the
        top of the peer's module
    prepare : `Task` without rows -> `Calls`, a run built and compiled once; None if it cannot be prepared
    scope : a description of the problems that it is applicable to
    lacks : (problem, system) -> the reason why it is not applicable to a problem, or None
    claims : the claims of its package
    load : imports the package by its name, for packages that need precautions
    tol : the default tolerance; None for the package's own
    least : the smallest tolerance that it accepts
    ahead : True if it cannot integrate backwards in time
    rows_end_steps : True if a step of the adaptive peer ends at every row of output, so that with many rows it takes
        more and shorter steps than without; False if it interpolates rows
    parameters : empty; a peer has this field because the records of this project's methods have it
    settings : options of the package that are set, by their names there
    python : the oldest Python that the package can be installed for, (major, minor); None if it is this project's
    """

    id: str
    name: str
    package: str
    license: str
    about: str
    source: str
    run: Callable[[Task], Run]
    adaptive: bool = False
    order: int | None = None
    prepare: Callable[[Task], Calls] | None = None
    scope: str = "any"
    lacks: Callable[[Any, Any], str | None] = anything
    claims: Claims = field(default_factory=Claims)
    load: Callable[[str], Any] = importlib.import_module
    tol: float | None = None
    least: float = 0.0
    ahead: bool = False
    rows_end_steps: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict, hash=False)
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    python: tuple[int, int] | None = None

    @property
    def label(self) -> str:
        """The id; a peer has a label because the records of this project's methods have one."""
        return self.id

    def tolerance(self, tol: float | None) -> float | None:
        """The tolerance of a run, by default the peer's own; raises InvalidInput if the peer does not accept it."""
        if tol is None:
            return self.tol
        if not self.adaptive:
            raise InvalidInput(f"'{self.id}' takes steps of fixed size: give h, not tol")
        if isinstance(tol, bool) or not isinstance(tol, Real) or not isfinite(tol) or not 0 < tol < 1:
            raise InvalidInput(f"tol is {tol!r}; it must be a number between 0 and 1")
        if tol < self.least:
            raise InvalidInput(f"tol is {tol!r}; '{self.id}' takes none below {self.least:.3g}")
        return float(tol)
