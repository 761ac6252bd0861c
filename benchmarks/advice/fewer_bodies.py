"""Which bodies of a planetary system may be left out, or made test particles, at an accuracy: found by running.

A model is the system with some bodies left out or made massless.  The other bodies move alike in both cases, so that
all models run on one compiled system with different masses (`reference.solvers.attracting`), each about its own
barycentre.  A model's error is that of the quantity against its true value in the full system.  First each body alone
is left out or made massless.  Where the error is small enough, such changes are then combined, the least important
first, as long as the model's error is at most half of the accuracy.  The chosen integrator then runs the model at the
step that meets the rest of the accuracy, timed in turns with the full system.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.ladder.rung import Task
from phasebench.benchmarks.ladder.search import search
from phasebench.benchmarks.ladder.trial import Trial
from phasebench.benchmarks.measure import named_quantities, quantities
from phasebench.benchmarks.measure.body_quantities import SPACE
from phasebench.benchmarks.measure.quantities import Quantity, Truth
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.problems.bodies import Bodies
from phasebench.benchmarks.problems.planetary import PlanetarySystem
from phasebench.reference.solvers.attracting import Attracting
from phasebench.reference.solvers.taylor import ReferenceFailed

from .ask import Ask
from .hunt import Candidate

#: A model's error may be this share of the accuracy; the round-off of its runs this share of that.
SHARE, ROUNDING = 0.5, 0.2
#: Most seconds for all runs of models, estimated from one run over the part PART of the span; rounds of a timing.
LONGEST, PART, ROUNDS = 20.0, 1 / 20, 5
#: A model that takes at least this share of the full system's time saves nothing.
NOTHING = 0.95


class Model(NamedTuple):
    """A planetary model: the names of the bodies left out, and of those made test particles."""

    left_out: tuple[str, ...] = ()
    light: tuple[str, ...] = ()

    def of(self, bodies: Bodies) -> Bodies:
        """The full table ``bodies`` with this model's masses: bodies left out, too, are test particles in it."""
        return bodies.massless((*self.left_out, *self.light))

    def with_(self, other: Model) -> Model:
        """The model that leaves out, and makes massless, the bodies of both models."""
        return Model((*self.left_out, *other.left_out), (*self.light, *other.light))

    def __str__(self) -> str:
        parts = [f"without {', '.join(self.left_out)}"] if self.left_out else []
        parts += [f"{', '.join(self.light)} as test particle{'s' * (len(self.light) > 1)}"] if self.light else []
        return "; ".join(parts) or "all bodies"


class Models:
    """Runs the planetary models of a question (bodies left out or made massless) on one compiled system."""

    def __init__(self, ask: Ask, true: Truth) -> None:
        self.ask, self.true, self.bodies = ask, true, ask.problem.bodies
        self.flow = Attracting(len(self.bodies.members), self.bodies.units.G)
        rows = ask.quantity.rows
        self.times = ask.t_end / rows * np.arange(rows + 1)

    def seconds(self) -> float:
        """Estimated seconds of a run of the full system, extrapolated from one over a part of the span."""
        x, v = map(np.ravel, self.bodies.start())
        return self.flow.rows(self._masses(Model()), x, v, np.array([0.0, PART * self.ask.t_end]))[2] / PART

    def _masses(self, model: Model) -> list[float]:
        return [b.mass if b.massive else 0.0 for b in model.of(self.bodies).members]

    def rows(self, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of all bodies along a model's run, arrays (rows, 3 N)."""
        x, v = map(np.ravel, model.of(self.bodies).start())
        return self.flow.rows(self._masses(model), x, v, self.times)[:2]

    def off(self, model: Model) -> float:
        """The error of the question's quantity in a model; infinite if a body that the quantity needs is left out."""
        x, v = (row.copy() for row in self.rows(model))
        for k, name in enumerate(self.bodies.names):
            if name in model.left_out:
                x[:, SPACE * k : SPACE * (k + 1)] = np.nan
        solution = _solution(self.times, x, v, self.bodies)
        with np.errstate(invalid="ignore"):
            return quantities.error(self.ask.problem, self.ask.quantity, solution, self.true)


def _solution(t: np.ndarray, x: np.ndarray, v: np.ndarray, bodies: Bodies) -> SimpleNamespace:
    return SimpleNamespace(t=t, q=x, p=v * np.repeat(bodies.masses, SPACE))


def smallest_model(models: Models, allowed: float) -> tuple[Model, dict[str, dict[str, float]]]:
    """Find the model of the fewest bodies whose error is at most ``allowed``; leaving a body out is preferred.

    Returns (the model, body -> the errors of leaving out this body alone and of making it a test particle).
    """
    bodies, alone, hopeful = models.bodies, {}, []
    for body in bodies.names[1:]:
        kinds = {"left_out": Model(left_out=(body,))}
        kinds |= {} if body in bodies.particles else {"test_particle": Model(light=(body,))}
        alone[body] = found = {kind: models.off(model) for kind, model in kinds.items()}
        fits = next((kind for kind in kinds if found[kind] <= allowed), None)
        if fits:
            hopeful.append((found[fits], kinds[fits]))
    best = Model()
    for _, model in sorted(hopeful, key=lambda x: x[0]):
        wider = best.with_(model)
        if len(wider.left_out) < len(bodies.members) - 1 and models.off(wider) <= allowed:
            best = wider
    return best, alone


def lower(ask: Ask, true: Truth, candidate: Candidate) -> dict[str, Any] | None:
    """Find the planetary model of the fewest bodies that meets the accuracy, and how much time it saves.

    None for a problem without bodies, a statistical quantity, and a question with a time budget.  ``off`` is the error
    of the model or, if none meets the accuracy, of the ``nearest`` one tried; ``saves`` the full system's time over the
    model's with the integrator of ``candidate``; ``alone`` as of `smallest_model`.
    """
    bodies = getattr(ask.problem, "bodies", None)
    if ask.accuracy is None or bodies is None or ask.quantity.statistical:
        return None
    if not np.array_equal(np.ravel(bodies.start()[0]), ask.problem.q0):
        return _untold(ask, "the initial state is not the table's")
    ask.progress("which bodies may be left out")
    try:
        models = Models(ask, true)
        runs = 2 * len(models.bodies.members)
        seconds = models.seconds() * runs
        if seconds > LONGEST:
            return _untold(ask, f"the runs that tell would take {seconds:.2g} s")
        allowed = SHARE * ask.accuracy
        rounding = models.off(Model())
        if not rounding <= ROUNDING * allowed:
            return _untold(ask, f"runs in doubles that tell are off by {rounding:.2g} themselves")
        best, alone = smallest_model(models, allowed)
        if best == Model():
            return _none(ask, alone)
        off = models.off(best)
        saves = _saves(ask, models, best, candidate, ask.accuracy - off)
    except ReferenceFailed as error:
        return _untold(ask, str(error))
    return {
        "model": str(best),
        "left_out": list(best.left_out),
        "test_particles": list(best.light),
        "off": off,
        "t_end": ask.t_end,
        "saves": saves,
        "alone": alone,
    }


def _untold(ask: Ask, why: str) -> dict[str, Any]:
    empty: dict[str, Any] = {"model": None, "left_out": [], "test_particles": [], "off": None, "alone": {}}
    return empty | {"t_end": ask.t_end, "why": why}


def _none(ask: Ask, alone: dict[str, dict[str, float]]) -> dict[str, Any]:
    kinds = {"left_out": lambda body: Model(left_out=(body,)), "test_particle": lambda body: Model(light=(body,))}
    tried = [(off, str(kinds[kind](body))) for body, found in alone.items() for kind, off in found.items()]
    off, nearest = min(tried, key=lambda x: x[0])
    return {
        "model": None,
        "left_out": [],
        "test_particles": [],
        "nearest": nearest,
        "off": off,
        "t_end": ask.t_end,
        "alone": alone,
    }


def _saves(ask: Ask, models: Models, model: Model, full: Candidate, accuracy: float) -> float | None:
    """The full system's time over the model's with the same integrator, each at a step that meets its accuracy."""
    problem = ask.problem
    if model.light:
        problem = problem.massless(*model.light)
    if model.left_out:
        problem = problem.without(*model.left_out)
    wanted = named_quantities.quantity(problem, ask.quantity.name)
    task = Task(problem, ask.t_end, wanted, _truth(models, model, problem, wanted))
    trial = Trial(full.integrator, task, max(10 * full.seconds, 0.05))
    found = search(trial, accuracy, full.rung.number)
    if found.rung is None:
        return None
    fewer = Candidate(trial, found.rung)
    times = {c: median(s).value for c, s in in_turns({full: full, fewer: fewer}, ROUNDS).items()}
    return times[full] / times[fewer]


def _truth(models: Models, model: Model, problem: PlanetarySystem, wanted: Quantity) -> Truth:
    """The true value of the quantity in the model's own dynamics, from a reference run of the model in doubles."""
    if wanted.kept:
        return models.true
    x, v = models.rows(model)
    keep = np.repeat([name in problem.bodies.names for name in models.bodies.names], SPACE)
    solution = _solution(models.times, x[:, keep], v[:, keep], problem.bodies)
    return Truth(quantities.values(problem, wanted, solution), models.true.uncertainty, "double")


def summarize(found: dict[str, Any]) -> str:
    """A sentence on which bodies may be left out or made massless, and what that saves."""
    if found["off"] is None:
        return f"which bodies may be left out is not known: {found['why']}"
    off = f"{found['off']:.2g} at t = {found['t_end']:g}"
    if found["model"] is None:
        return f"no body may be left out or made a test particle: the nearest ({found['nearest']}) is off by {off}"
    text = f"a system of fewer bodies would do: {found['model']}, off by {off}"
    if found["saves"] is None:
        return f"{text}; how much time it saves could not be measured"
    if found["saves"] * NOTHING <= 1:
        return f"{text}, but it saves no time"
    return f"{text}; the full one takes {found['saves']:.2g} times as long"
