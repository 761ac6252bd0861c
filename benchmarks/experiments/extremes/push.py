"""Search the largest step at which runs survive, by bisection on a geometric grid, and how the next larger one fails.

A run survives if `cases` finds nothing wrong with it.  Survival is not monotone in the step: the result is the end of
the first interval of surviving steps seen when the step is doubled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

from phasebench.benchmarks.problems import problem
from phasebench.benchmarks.store.cells import Cell, ProblemKey, Rows, content
from phasebench.integrators.driver import OK
from phasebench.integrators.registry import BY_ID

from . import cases
from .methods import REPRESENTATIVE, record

#: Steps of a run, steps of a shorter run before it, and grid points in a factor of two of the step.
STEPS, FIRST, PARTS = 100_000, 300, 8
#: Largest number of halvings and of doublings of the problem's own step.
DOWN, UP = 8, 14
#: The lambdas at which Schemes I to III are run, and the steps of these runs.
LAMBDAS = ("-1000", "-100", "-10", "-3", "-1", "0", "1/3", "1/2", "2/3", "1", "2", "4", "11", "101", "1000")
SWEPT, SWEPT_STEPS = ("scheme-i", "scheme-ii", "scheme-iii"), 10_000
ON = ("pendulum", "Henon-Heiles, box")
TABLES = ("extremes_steps", "extremes_lambda")


def cells(quick: bool = False) -> list[Cell]:
    """List the measurements (`Cell`) of the largest step that a method survives; none if ``quick``.

    There is one for each method, and, for each of the parametric Schemes I to III on each of two orbits, one over many
    values of their parameter lambda.
    """
    return [] if quick else [*(_cell(id) for id in REPRESENTATIVE), *(_swept(id, on) for id in SWEPT for on in ON)]


def _cell(id: str) -> Cell:
    needs = content("push", record(id), *(ProblemKey(c.problem) for c in cases.CASES), code=[__name__])
    return Cell("extremes", TABLES[:1], {"method": id}, measure_rows, (id,), needs, frozenset({id}))


def _swept(id: str, on: str) -> Cell:
    needs = content("push-lambda", record(id), ProblemKey(cases.BY_ID[on].problem), LAMBDAS, code=[__name__])
    return Cell("extremes", TABLES[1:], {"method": id, "orbit": on}, swept, (id, on), needs, frozenset({id}))


def largest(survives: Callable[[float], str], first: float) -> tuple[float, str]:
    """Search the largest step that survives: (step, how the next larger one fails); 0 if none survives, inf if all do.

    Parameters
    ----------
    survives : function from h to `OK`, or to the way in which the run fails
    first : the step at which the search begins
    """
    k, failure = 0, ""
    while k > -DOWN * PARTS and (failure := survives(first * 2 ** (k / PARTS))) != OK:
        k -= PARTS
    if k <= -DOWN * PARTS:
        return 0.0, failure
    good, bad = k, None
    while bad is None and good < UP * PARTS:
        found = survives(first * 2 ** ((good + PARTS) / PARTS))
        good, bad, failure = (good + PARTS, None, "") if found == OK else (good, good + PARTS, found)
    while bad is not None and bad - good > 1:
        middle = (good + bad) // 2
        found = survives(first * 2 ** (middle / PARTS))
        good, bad, failure = (middle, bad, failure) if found == OK else (good, middle, found)
    return (math.inf if bad is None else first * 2 ** (good / PARTS)), failure


def _survives(case: cases.Case, id: str, steps: int, parameters: dict | None = None) -> Callable[[float], str]:
    """Make a function from h to the judgement of a run of the method ``id`` over ``steps`` steps on the case.

    A shorter run comes first, to save time if it fails.
    """

    def survives(h: float) -> str:
        found = cases.judge_run(case, id, h, FIRST, parameters)
        return cases.judge_run(case, id, h, steps, parameters) if found == OK else found

    return survives


def measure_rows(id: str) -> Rows:
    """Search a method's largest surviving step on each orbit that it can integrate: a row for each, by table name.

    A row has this step, and how the next larger one fails.
    """
    rows = []
    for case in cases.CASES:
        made = problem(case.problem)
        if BY_ID[id].lacks(made.system):
            continue
        h, fails = largest(_survives(case, id, STEPS), made.pace.step)
        rows.append({"method": id, "orbit": case.id, "largest h": h, "fails": fails, "steps": STEPS})
    return {TABLES[0]: rows}


def swept(id: str, on: str) -> Rows:
    """Search a scheme's largest surviving step at each value of its parameter lambda in `LAMBDAS`: a row for each.

    ``id`` is the scheme, ``on`` the orbit; the rows are by table name.
    """
    rows, case = [], cases.BY_ID[on]
    for value in LAMBDAS:
        lam = float(Fraction(value))
        # Far from lambda = 1/2 the first stable interval ends at 2 / |1 - 2 lambda|; some have another one beyond.
        first = problem(case.problem).pace.step / (1 + abs(1 - 2 * lam))
        h, fails = largest(_survives(case, id, SWEPT_STEPS, {"lam": value}), first)
        rows.append({"method": id, "orbit": on, "lam": lam, "largest h": h, "fails": fails, "steps": SWEPT_STEPS})
    return {TABLES[1]: rows}
