"""`Ladder`: a scene with its models; a model is a system with a map of its solution to the full system's (q, p).

The map gives NaN for what the model does not describe, such as bodies that it leaves out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.systems.hamiltonian import Hamiltonian

#: Maps (the full problem, rows t (n,), q (n, d), p (n, d) of a model) to rows (q, p) of the full one, arrays (n, D).
Lift = Callable[[Problem, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def identity(full, t, q, p):
    """Map a model's rows to the full problem's (``full``) if both have the same variables: return (q, p)."""
    return q, p


@dataclass(frozen=True)
class Rung:
    """A model of a scene, with the map of its solution to the full problem's.

    Attributes
    ----------
    name : its name in tables
    make : makes its problem
    lift : maps rows of its solution to rows of the full problem's
    rate : the model's time over that of the full problem
    steps : its coarsest number of steps; 0: that of the ladder
    """

    name: str
    make: Callable[[], Problem]
    lift: Lift = identity
    rate: float = 1.0
    steps: int = 0


@dataclass(frozen=True)
class Ladder:
    """A scene (problem, span and quantity) with its models.

    Attributes
    ----------
    id : kebab-case name
    problem, parameters : of the full problem: ``id:orbit`` and its parameters
    t_end, quantity : the end of the span, and the name of the quantity to be computed
    steps : the coarsest number of steps
    rungs : from the simplest to the full model
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    steps: int
    rungs: tuple[Rung, ...]
    parameters: tuple[tuple[str, Any], ...] = ()


def model_problem(name: str, q, p, H, start) -> Problem:
    """An unregistered problem of a formula H in q, p, from a start (q, p)."""
    return Problem(
        id=name,
        name=name,
        source="a model of this suite",
        system=Hamiltonian(q=q, p=p, H=H),
        orbits=(Orbit("scene", *start),),
    )


def with_start(made: Problem, q, p) -> Problem:
    """The problem ``made``, started from the state q, p."""
    return replace(made, orbits=(Orbit("scene", tuple(q), tuple(p)),), orbit="")
