"""Climbs: runs from a coarse size to ever finer ones, until a rule gives a reason to end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import inf
from typing import TypeVar

#: A rung is an improvement if its error is below this share of the least error before it.
FLOOR = 0.7
#: Lower bound of all tolerances.
TIGHTEST = 1e-16

Size = TypeVar("Size")
Rung = TypeVar("Rung")


def climb(
    sizes: Iterable[Size], run: Callable[[Size], Rung], ended: Callable[[list[Rung]], str]
) -> tuple[list[Rung], str]:
    """Run an integrator at size after size, the coarsest first, until ``ended`` gives a reason; return (runs, reason).

    ``ended`` is called with the list of the runs so far, which it may change; the reason is "" if the sizes ran out.
    """
    rungs: list[Rung] = []
    for size in sizes:
        rungs.append(run(size))
        why = ended(rungs)
        if why:
            return rungs, why
    return rungs, ""


def numbers_of_steps(
    first: float, factor: float, whole: Callable[[float], int] = round, most: float = inf
) -> Iterator[int]:
    """Numbers of steps from ``first`` to ``most``, each ``factor`` times the last; ``whole`` rounds to an integer."""
    size, last = first, 0
    while size <= most:
        steps = whole(size)
        if steps > last:
            yield steps
        size, last = factor * max(size, 1), steps


def tolerances(loosest: float, least: float) -> Iterator[float]:
    """Tolerances, each a tenth of the one before; the last is ``least``, the smallest that an integrator accepts."""
    tol, least = loosest, max(least, TIGHTEST)
    while tol > least:
        yield tol
        tol = float(f"{tol / 10:.0e}")
    yield least


def idle(errors: Iterable[float]) -> int:
    """How many runs at the end of a ladder failed to bring the error below `FLOOR` times the least one before."""
    least, count = inf, 0
    for error in errors:
        count = count + 1 if least < inf and not error < FLOOR * least else 0
        least = min(least, error)
    return count
