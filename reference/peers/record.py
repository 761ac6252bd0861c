"""What a peer is: a frozen record of an integrator from elsewhere, with what its package says of it."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np


@dataclass(frozen=True)
class Claims:
    """What a package's own documentation or attributes say of an integrator; None where they say nothing.

    Attributes
    ----------
    order : in the step h
    symplectic, reversible : of the step map at constant h
    energy : how the energy is kept, one of the classes of `integrators.record`
    source : where the package says so (address of the page, name of the attribute)
    """

    order: int | None = None
    symplectic: bool | None = None
    reversible: bool | None = None
    energy: str | None = None
    source: str = ""


#: Why a run ends that has left the numbers.
NOT_FINITE = "the state is no longer finite"


class Start(NamedTuple):
    """What a peer is prepared for.

    Attributes
    ----------
    problem, system : the problem (or again the system, where there is no other), and its system
    q, p : arrays (d,), the initial state
    tol : the tolerance of an adaptive peer; None: the package's own
    """

    problem: Any
    system: Any
    q: np.ndarray
    p: np.ndarray
    tol: float | None

    @property
    def state(self) -> np.ndarray:
        """(q, p), a new array (2 d,)."""
        return np.concatenate([self.q, self.p]).astype(float)


class Task(NamedTuple):
    """What a peer is to integrate.

    Attributes
    ----------
    problem, system : the problem (or again the system, where there is no other), and its system
    q, p : arrays (d,), the initial state
    h : the step, of an adaptive peer the spacing of its rows
    numbers : the numbers of the steps after which a row is wanted, increasing from 0
    times : array, h times each of them
    tol : the tolerance of an adaptive peer; None: the package's own
    """

    problem: Any
    system: Any
    q: np.ndarray
    p: np.ndarray
    h: float
    numbers: list[int]
    times: np.ndarray
    tol: float | None

    @property
    def state(self) -> np.ndarray:
        """(q, p), a new array (2 d,)."""
        return np.concatenate([self.q, self.p]).astype(float)

    @property
    def steps(self) -> int:
        """The number of steps to the end."""
        return self.numbers[-1]


class Run(NamedTuple):
    """What a peer did: rows (n, d) of q and p reached, steps, evaluations (0: not told), seconds, what failed."""

    q: np.ndarray
    p: np.ndarray
    steps: int
    gradient: int
    seconds: float
    failure: str | None = None

    @classmethod
    def of_states(cls, rows, *more) -> Run:
        """The run whose rows are of states (q, p), of shape (n, 2 d)."""
        d = rows.shape[1] // 2
        return cls(rows[:, :d], rows[:, d:], *more)

    @classmethod
    def stuck(cls, task: Task, *more) -> Run:
        """The run that came no further than its start."""
        return cls.of_states(task.state[None], *more)


def anything(problem, system) -> str | None:
    """The peer can do every problem."""
    return None


def split_alone(why: str) -> Callable[[Any, Any], str | None]:
    """The ``lacks`` of a peer that can do canonical H = T(p) + V(q) alone, for the reason ``why``."""

    def lacks(problem, system) -> str | None:
        return None if system.canonical and system.separable else why

    return lacks


@dataclass(frozen=True)
class Peer:
    """An integrator from elsewhere.

    Attributes
    ----------
    id, name : its kebab-case name and its full one
    package : what to install, and to import
    adaptive : takes a tolerance ``tol``; ``h`` is then the spacing of its output
    order : in the step h, of a fixed-step peer on a nonlinear problem; None where it is not one number
    license : of the package
    about : what its tolerance or its options mean, and what its time includes
    source : author, year
    run : `Task` -> `Run` with a row for each step number of the task up to where it failed; it may import the package,
        its module may not
    prepare : `Start` -> `prepared.Calls`, its run built and compiled once; None where it has none
    scope : in words, what it can integrate
    lacks : (problem, system) -> why it cannot do a problem, or None
    claims : what its package says of it
    load : imports the package by its name, where that needs care
    tol : the default tolerance; None: the package's own
    least : the smallest tolerance it takes
    ahead : it goes ahead in time alone
    settings : the options of the package that are set, by their names there
    """

    id: str
    name: str
    package: str
    adaptive: bool
    order: int | None
    license: str
    about: str
    source: str
    run: Callable[[Task], Run]
    prepare: Callable[[Start], Any] | None = None
    scope: str = "any"
    lacks: Callable[[Any, Any], str | None] = anything
    claims: Claims = field(default_factory=Claims)
    load: Callable[[str], Any] = importlib.import_module
    tol: float | None = None
    least: float = 0.0
    ahead: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The id, as a method's label without parameters."""
        return self.id
