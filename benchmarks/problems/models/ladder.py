"""What a model of a scene is: a system of its own, with a map of its solution to rows of the full system's (q, p).

Where a model has nothing to say (of the bodies that are left out), the map gives NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: (the full problem, t (n,), q (n, d), p (n, d)) of a rung -> (q, p) of the full problem's, arrays (n, D).
Lift = Callable[[Problem, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def unchanged(full, t, q, p):
    """The rung's state is the full one's."""
    return q, p


@dataclass(frozen=True)
class Rung:
    """A model of a scene.

    Attributes
    ----------
    name : what it is, for a table
    make : its problem
    lift : its rows -> the full problem's
    rate : its own time to the scene's
    steps : its coarsest number of steps where not the ladder's
    """

    name: str
    make: Callable[[], Problem]
    lift: Lift = unchanged
    rate: float = 1.0
    steps: int = 0


@dataclass(frozen=True)
class Ladder:
    """A scene with its models.

    Attributes
    ----------
    id : kebab-case name
    problem, parameters : of the full problem: ``id:orbit`` and its parameters
    t_end, quantity : how far, and the name of what is wanted
    steps : the coarsest number of steps
    rungs : from the least to the full model
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    steps: int
    rungs: tuple[Rung, ...]
    parameters: tuple[tuple[str, Any], ...] = ()


def modelled(name: str, q, p, H, start) -> Problem:
    """The problem of a formula and a start (q, p) that is registered nowhere."""
    return Problem(
        id=name,
        name=name,
        source="a model of this suite",
        system=Hamiltonian(q=q, p=p, H=H),
        orbits=(Orbit("scene", *start),),
    )


def started(made: Problem, q, p) -> Problem:
    """A problem from another state."""
    return replace(made, orbits=(Orbit("scene", tuple(q), tuple(p)),), orbit="")
