"""Modelling errors of simplified models of a problem, and the times and errors of their integrations.

A scene is a full problem with a time span and a quantity; it has several models, the last of which is the full problem.
A model's reference is the finest run of the last of `METHODS`; its uncertainty is `SAFETY` times the distance to a run
with half as many steps.  The modelling error is the distance of the reference, mapped to the full problem's state, from
the true solution of the full problem (`measure.truths`): certified, or in long double.  Integration errors are against
the model's own reference, those of the full model against the true solution.  The runs of a scene are timed in turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasebench.benchmarks.measure import named_quantities, quantities
from phasebench.benchmarks.measure.quantities import Quantity, distance
from phasebench.benchmarks.measure.timing import clock, columns, in_turns, median
from phasebench.benchmarks.measure.truths import truth
from phasebench.benchmarks.problems.models.ladder import Ladder, Rung
from phasebench.benchmarks.problems.models.ladders import BY_ID
from phasebench.benchmarks.store.cells import ProblemKey, states
from phasebench.integrators.prepared import PreparedRun, prepare
from phasebench.integrators.registry import method

if TYPE_CHECKING:
    from phasebench.benchmarks.problems.base import Problem

MODELS, RUNS = "models", "models_runs"
#: Methods of orders 4, 6 and 8 from one family, so that they share kernels.
METHODS = ("blanes-moan-srkn6b", "blanes-moan-srkn14a", "blanes-casas-escorihuela-srkn17")
#: How often the number of steps is doubled; the reference takes twice the largest number.
DOUBLINGS = 6
SAFETY = 3.0
#: Rounds in which all runs are timed in turns; seconds for which a short run is repeated in each.
ROUNDS, LONG = 3, 5e-4
SLOW = Quantity(
    "slow-positions",
    "the positions of the soft chain at the end, max norm",
    "as q",
    lambda problem, t, q, p: q[-1, : problem.system.d // 2],
)


def needs(scene: str) -> tuple:
    """What the rows of a scene depend on."""
    ladder = BY_ID[scene]
    full = ProblemKey(ladder.problem, ladder.parameters)
    what = (ladder.t_end, ladder.quantity, ladder.steps, [(r.name, r.rate, r.steps) for r in ladder.rungs])
    return what, states(full.id), *map(method, METHODS), full


def quantity_of(full: Problem, name: str) -> Quantity:
    """Return the quantity with this name: the positions of the soft chain (`SLOW`), or one of the problem ``full``."""
    return SLOW if name == SLOW.name else named_quantities.quantity(full, name)


@dataclass
class Model:
    """A simplified problem with a map of its solution to the full problem's, prepared to run.

    Attributes
    ----------
    ladder : the scene: the full problem with a time span, a quantity and all models
    rung : the model: name, map of its solution to the full problem's, ratio of its time to the full problem's
    full : the full problem
    quantity : the function of the full problem's solution whose error is measured
    made : the model's own problem
    runs : method id -> the prepared run of the model
    """

    ladder: Ladder
    rung: Rung
    full: Any
    quantity: Quantity
    made: Any
    runs: dict[str, PreparedRun]

    @property
    def steps(self) -> list[int]:
        """Return the numbers of steps of the model's runs, ascending."""
        return [(self.rung.steps or self.ladder.steps) * 2**k for k in range(DOUBLINGS)]

    def h(self, steps: int) -> float:
        """Return the step size, in the model's own unit of time, of a run with this number of steps."""
        return self.rung.rate * self.ladder.t_end / steps

    def values(self, id: str, steps: int) -> np.ndarray | None:
        """Compute the full problem's quantity from a run of this model in ``steps`` steps; None if the run fails.

        ``id`` is the method's.
        """
        run = self.runs[id]
        q, p, code = run(self.h(steps), steps)
        if code != run.SOLVED:
            return None
        t = np.array([0.0, self.ladder.t_end])
        rows = self.rung.lift(self.full, t, np.array([self.made.q0, q]), np.array([self.made.p0, p]))
        return quantities.values(self.full, self.quantity, SimpleNamespace(t=t, q=rows[0], p=rows[1]))

    def clock(self, id: str, steps: int) -> Callable[[], float]:
        """Return a function that times a run of ``steps`` steps by the method ``id`` and returns seconds.

        A short run is repeated, and the mean is returned.
        """
        run = partial(self.runs[id], self.h(steps), steps)
        repeats = 1 + int(LONG / clock(run)())
        often = clock(lambda: [run() for _ in range(repeats)])
        return lambda: often() / repeats


def prepare_model(ladder: Ladder, rung: Rung, full: Problem) -> Model:
    """Build the problem of a model and prepare runs of it by each of `METHODS`.

    ``ladder`` is the scene, ``rung`` the model in it, and ``full`` the full problem.
    """
    made = rung.make()
    runs = {id: prepare(made, id) for id in METHODS}
    return Model(ladder, rung, full, quantity_of(full, ladder.quantity), made, runs)


def reference(model: Model) -> tuple[np.ndarray, float]:
    """Run a model at its finest step, and return (values of the quantity, their uncertainty).

    Raises
    ------
    RuntimeError
        If the run fails.
    """
    finest = 2 * model.steps[-1]
    one, other = (model.values(METHODS[-1], n) for n in (finest, finest // 2))
    if one is None or other is None:
        raise RuntimeError(f"{METHODS[-1]} fails on the model {model.rung.name!r} with {finest} steps or half of them")
    rounding = 4 * np.finfo(float).eps * float(np.abs(one).max())
    return one, SAFETY * distance(model.quantity, one, other) + rounding


def models_of(scene: str) -> dict[str, list[dict]]:
    """All models of a scene: in `MODELS` a row for each with its modelling error, in `RUNS` one for each timed run."""
    ladder = BY_ID[scene]
    full = ladder.rungs[-1].make()
    true = truth(full, quantity_of(full, ladder.quantity), ladder.t_end)
    rows, runs, work = [], [], {}
    for k, rung in enumerate(ladder.rungs):
        model = prepare_model(ladder, rung, full)
        own, uncertainty = reference(model)
        off, is_full = distance(model.quantity, own, true.values), rung is ladder.rungs[-1]
        rows.append(
            {
                "scene": scene,
                "rung": k,
                "model": rung.name,
                "full": is_full,
                "d": model.made.system.d,
                "modelling error": 0.0 if is_full else off,
                "integration": off if is_full else uncertainty,
                "uncertainty": true.uncertainty,
                "source": true.source,
            }
        )
        for name in METHODS:
            for n in model.steps:
                found = model.values(name, n)
                if found is None:
                    continue
                error = distance(model.quantity, found, true.values if is_full else own)
                noise = true.uncertainty if is_full else uncertainty
                runs.append({"scene": scene, "rung": k, "method": name, "steps": n, "error": max(error, noise)})
                work[len(runs) - 1] = model.clock(name, n)
    for i, seconds in in_turns(work, ROUNDS).items():
        runs[i] |= columns("seconds", median(seconds))
    return {MODELS: rows, RUNS: runs}
