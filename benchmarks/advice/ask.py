"""The question put to `advise`: problem, span, quantity, accuracy or time budget, and what must be conserved."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import inf
from typing import Any

from phasebench.benchmarks.measure import conservation_claims
from phasebench.benchmarks.measure.named_quantities import quantity
from phasebench.benchmarks.measure.quantities import Quantity
from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.units import span
from phasebench.integrators.errors import InvalidInput
from phasebench.integrators.request import is_finite, shown

from . import prior


@dataclass(frozen=True)
class Ask:
    """A checked question: which integrator solves a problem to an accuracy, or best within a time budget.

    Attributes
    ----------
    problem, t_end, quantity : the problem on one of its orbits, the end of the span, what is computed
    accuracy, budget : the largest error allowed, or the seconds that a run may take; the other is None
    conserve : names of `conservation_claims.claim_names`
    limit, first_use : seconds that the search may take, and if promising integrators must first be compiled
    progress : called with a line of text for each integrator that is tried
    since : the clock (time.perf_counter) when the user began to wait; None if the limits are of processor time, which
        other processes do not shorten
    """

    problem: Any
    t_end: float
    quantity: Quantity
    accuracy: float | None
    budget: float | None
    conserve: tuple[str, ...]
    limit: float
    first_use: float
    progress: Callable[[str], None]
    since: float | None = None
    _began: float = field(default_factory=time.process_time, compare=False)

    @property
    def spent(self) -> float:
        """Seconds since the beginning: of the clock, or of processor time."""
        return time.process_time() - self._began if self.since is None else time.perf_counter() - self.since

    @property
    def left(self) -> float:
        """Seconds of the clock that are left until the answer is due; infinite without a limit of the clock."""
        return inf if self.since is None else self.limit - self.spent


#: Default seconds of a search for a problem with stored measurements, and for any other; startup takes two more.
STORED, NEW = 3.0, 50.0
#: Default seconds where promising kernels have to be compiled, which happens once on a machine.
COMPILING = 50.0


def ask(
    problem: Problem,
    *,
    t_end: float | str | None,
    accuracy: float | None = None,
    quantity_name: str = "end-state",
    conserve: str | Iterable[str] = (),
    budget: float | None = None,
    limit: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
    since: float | None = None,
) -> Ask:
    """Check the arguments of `advise` and build the question (see `Ask`); raise InvalidInput for an unusable one."""
    t_end = span(t_end, getattr(problem, "time_unit", ""))
    if not is_finite(t_end) or t_end == 0:
        raise InvalidInput(f"t_end is {shown(t_end)}; it must be a finite number other than 0")
    t_end = float(t_end)
    given = None if limit is None else _positive("time_limit", limit)
    limit = given or (STORED if prior.is_stored(problem.id) else NEW)
    if (accuracy is None) == (budget is None):
        raise InvalidInput("give either the accuracy that is needed or a budget of seconds")
    accuracy = None if accuracy is None else _positive("accuracy", accuracy)
    budget = None if budget is None else _positive("budget", budget)
    wanted = tuple(dict.fromkeys([conserve] if isinstance(conserve, str) else conserve))
    for name in wanted:
        conservation_claims.check(problem, name)
    return Ask(
        problem,
        t_end,
        quantity(problem, quantity_name),
        accuracy,
        budget,
        wanted,
        limit,
        given or max(limit, COMPILING),
        progress,
        since if given else None,
    )


def _positive(name: str, value: object) -> float:
    if not is_finite(value) or value <= 0:
        raise InvalidInput(f"{name} is {shown(value)}; it must be a positive finite number")
    return float(value)
