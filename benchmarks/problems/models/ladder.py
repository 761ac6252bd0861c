"""`Ladder`: a problem with a span and a quantity to compute, and simplified models of it, up to the full problem.

It serves to compare the error that a simplification makes in the quantity with the errors and times of integrations.
A model is a system with a map of its solution to the full system's (q, p).
The map gives NaN for what the model does not describe, such as bodies that it leaves out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.problems.base import Orbit, Problem
from phasebench.integrators.systems.hamiltonian import Hamiltonian

if TYPE_CHECKING:
    import sympy as sp

#: Maps (the full problem, rows t (n,), q (n, d), p (n, d) of a model) to rows (q, p) of the full one, arrays (n, D).
Lift = Callable[[Problem, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def identity(full: Problem, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Map a model's rows to the full problem's if both have the same variables: return (q, p) unchanged."""
    return q, p


@dataclass(frozen=True)
class Rung:
    """A simplified model of a problem, with the map of its solution to the full problem's.

    Attributes
    ----------
    name, make : its name in tables; function without arguments that makes the model's problem
    lift : function (full problem, t, q, p) -> (Q, P), which maps rows of the model's solution to rows of the full one
    rate : at time t of the full problem the model is at ``rate`` t
    steps : the number of steps of its coarsest run, doubled for each finer run; 0: that of the `Ladder`
    """

    name: str
    make: Callable[[], Problem]
    lift: Lift = identity
    rate: float = 1.0
    steps: int = 0


@dataclass(frozen=True)
class Ladder:
    """A full problem with a span and a quantity to compute, and its models from the simplest to the full one.

    Attributes
    ----------
    problem, parameters : of the full problem: ``id:orbit``, and pairs (name, value) of its parameters
    t_end, quantity : the end of the span, and the name of the quantity to be computed
    steps : the number of steps of the coarsest run of a model, doubled for each finer run
    """

    id: str
    problem: str
    t_end: float
    quantity: str
    steps: int
    rungs: tuple[Rung, ...]
    parameters: tuple[tuple[str, Any], ...] = ()


def model_problem(
    name: str,
    q: Sequence[sp.Symbol],
    p: Sequence[sp.Symbol],
    H: sp.Expr,
    start: tuple[tuple[float, ...], tuple[float, ...]],
) -> Problem:
    """Make a problem, not in the index of problems, of an expression H in the symbols q, p, from ``start`` = (q, p)."""
    return Problem(
        id=name,
        name=name,
        source="a model of this suite",
        system=Hamiltonian(q=q, p=p, H=H),
        orbits=(Orbit("scene", *start),),
    )


def with_start(made: Problem, q: Sequence[float], p: Sequence[float]) -> Problem:
    """Return the problem ``made`` with the state q, p as its initial state."""
    return replace(made, orbits=(Orbit("scene", tuple(q), tuple(p)),), orbit="")
