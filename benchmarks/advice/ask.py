"""What is asked for: a problem, how far, which quantity, how accurately or in what time, and what has to be kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any

from phasebench.benchmarks.measure.quantities import Quantity, quantity
from phasebench.benchmarks.problems.units import span
from phasebench.integrators.errors import InvalidInput

from . import kept, prior


@dataclass(frozen=True)
class Ask:
    """A question that can be answered.

    Attributes
    ----------
    problem, t_end : the problem on one of its orbits, and the end of the span
    quantity : what is wanted
    accuracy : the largest error of it, or None where a time is given
    budget : seconds that a run may take, or None
    conserve : what has to be kept, names of `kept.known`
    limit : seconds that the search may take
    progress : called with a line for each thing that is tried
    """

    problem: Any
    t_end: float
    quantity: Quantity
    accuracy: float | None
    budget: float | None
    conserve: tuple[str, ...]
    limit: float
    progress: Callable[[str], None]


#: Seconds of a search for a problem of which rows are stored, and for any other; to start the program takes two more.
STORED, NEW = 3.0, 50.0


def ask(
    problem,
    *,
    t_end,
    accuracy=None,
    quantity_name: str = "end-state",
    conserve=(),
    budget=None,
    limit=None,
    progress: Callable[[str], None] = lambda line: None,
) -> Ask:
    """The checked question; raises InvalidInput for what cannot be asked."""
    t_end = _positive("t_end", span(t_end, getattr(problem, "time_unit", "")))
    limit = None if limit is None else _positive("limit", limit)
    if (accuracy is None) == (budget is None):
        raise InvalidInput("give either the accuracy that is needed or a budget of seconds")
    accuracy = None if accuracy is None else _positive("accuracy", accuracy)
    budget = None if budget is None else _positive("budget", budget)
    wanted = tuple(dict.fromkeys([conserve] if isinstance(conserve, str) else conserve))
    for name in wanted:
        kept.check(problem, name)
    return Ask(
        problem,
        t_end,
        quantity(problem, quantity_name),
        accuracy,
        budget,
        wanted,
        limit or (STORED if prior.is_stored(problem.id) else NEW),
        progress,
    )


def _positive(name: str, value) -> float:
    """A positive finite number."""
    if not isinstance(value, Real) or isinstance(value, bool) or not isfinite(value) or value <= 0:
        raise InvalidInput(f"{name} is {value!r}; it must be a positive finite number")
    return float(value)
