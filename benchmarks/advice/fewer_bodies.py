"""Which bodies of a planetary system may be left out, or made test particles, at an accuracy: tried by running.

For the others, a body that is left out is one without mass, so that all models are runs of one compiled system with
other masses (`reference.solvers.attracting`); each starts about its own barycentre, as the table without that body
does.  What a model is off by is the error of the quantity against what is true of the full system.  First each body is
tried alone, then together, the least important first, as long as the model's error is at most half of the accuracy; the
chosen integrator runs the model with the step that holds the rest, beside the full system in turns.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.measure import quantities
from phasebench.benchmarks.measure.body_quantities import SPACE
from phasebench.benchmarks.measure.quantities import Quantity, Truth
from phasebench.benchmarks.measure.timing import in_turns, median
from phasebench.benchmarks.problems.bodies import Bodies
from phasebench.reference.solvers.attracting import Attracting
from phasebench.reference.solvers.taylor import ReferenceFailed

from .ask import Ask
from .hunt import Candidate
from .search import search
from .trial import Trial

#: A model may be off by this share of the accuracy; its runs may round to this share of that.
SHARE, ROUNDING = 0.5, 0.2
#: Seconds that all runs of models may take, judged by one over such a part of the span; of a timing, and its rounds.
LONGEST, PART, ROUNDS = 20.0, 1 / 20, 5
#: A model that takes this share of the full one's time or more saves nothing.
NOTHING = 0.95


class Model(NamedTuple):
    """Bodies that are left out, bodies that are test particles."""

    left_out: tuple[str, ...] = ()
    light: tuple[str, ...] = ()

    def of(self, bodies: Bodies) -> Bodies:
        """The full table of bodies as this model has it: those left out are test particles in it."""
        return bodies.massless((*self.left_out, *self.light))

    def with_(self, other: Model) -> Model:
        """Both together."""
        return Model((*self.left_out, *other.left_out), (*self.light, *other.light))

    def __str__(self) -> str:
        parts = [f"without {', '.join(self.left_out)}"] if self.left_out else []
        parts += [f"{', '.join(self.light)} as test particle{'s' * (len(self.light) > 1)}"] if self.light else []
        return "; ".join(parts) or "all bodies"


class Models:
    """The models of an ask, run on one compiled system."""

    def __init__(self, ask: Ask, true: Truth):
        self.ask, self.true, self.bodies = ask, true, ask.problem.bodies
        self.flow = Attracting(len(self.bodies.members), self.bodies.units.G)
        rows = ask.quantity.rows
        self.times = ask.t_end / rows * np.arange(rows + 1)

    def seconds(self) -> float:
        """What a run takes, from one over a part of the span."""
        x, v = map(np.ravel, self.bodies.start())
        return self.flow.rows(self._masses(Model()), x, v, np.array([0.0, PART * self.ask.t_end]))[2] / PART

    def _masses(self, model: Model) -> list[float]:
        return [b.mass if b.massive else 0.0 for b in model.of(self.bodies).members]

    def rows(self, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of all bodies along a model's run."""
        x, v = map(np.ravel, model.of(self.bodies).start())
        return self.flow.rows(self._masses(model), x, v, self.times)[:2]

    def off(self, model: Model) -> float:
        """The error of the quantity in a model; infinite where it needs a body that the model leaves out."""
        x, v = (row.copy() for row in self.rows(model))
        for k, name in enumerate(self.bodies.names):
            if name in model.left_out:
                x[:, SPACE * k : SPACE * (k + 1)] = np.nan
        solution = _solution(self.times, x, v, self.bodies)
        with np.errstate(invalid="ignore"):
            return quantities.error(self.ask.problem, self.ask.quantity, solution, self.true)


def _solution(t, x, v, bodies: Bodies) -> SimpleNamespace:
    """Rows with momenta of the bodies' masses."""
    return SimpleNamespace(t=t, q=x, p=v * np.repeat(bodies.masses, SPACE))


def chosen(models: Models, allowed: float) -> tuple[Model, dict[str, dict[str, float]]]:
    """The model of the fewest bodies whose error is at most ``allowed``; and what each body's absence makes alone.

    Of each body it is tried without it, and as a test particle where the quantity needs it.
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
    """The model of the fewest bodies that would do at the accuracy; None of a problem without bodies, or for a budget.

    Returns
    -------
    dict
        ``model`` in words, or None where none does, or where that cannot be told, with ``why``; ``left_out`` and
        ``test_particles``, names; ``off``, what it (else the ``nearest``) is off by at ``t_end``; ``saves``, the full
        system's time over its own with the same integrator; ``alone``, body -> what leaving it out, or taking its mass,
        makes alone
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
        best, alone = chosen(models, allowed)
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
    """The full system's time over the model's, of the same integrator, each at a step that holds its accuracy."""
    problem = ask.problem
    if model.light:
        problem = problem.massless(*model.light)
    if model.left_out:
        problem = problem.without(*model.left_out)
    wanted = quantities.quantity(problem, ask.quantity.name)
    asked = replace(ask, problem=problem, quantity=wanted, accuracy=accuracy)
    trial = Trial(full.integrator, asked, _truth(models, model, problem, wanted), max(10 * full.seconds, 0.05))
    found = search(trial, accuracy, next(iter(full.point.size.values())), inf)
    if found.point is None:
        return None
    fewer = Candidate(trial, found.point)
    times = {c: median(s).value for c, s in in_turns({full: full, fewer: fewer}, ROUNDS).items()}
    return times[full] / times[fewer]


def _truth(models: Models, model: Model, problem, wanted: Quantity) -> Truth:
    """What is true of the quantity in a model, by the run that judged it."""
    if wanted.kept:
        return models.true
    x, v = models.rows(model)
    keep = np.repeat([name in problem.bodies.names for name in models.bodies.names], SPACE)
    solution = _solution(models.times, x[:, keep], v[:, keep], problem.bodies)
    return Truth(quantities.values(problem, wanted, solution), models.true.uncertainty, "double")


def said(found: dict[str, Any]) -> str:
    """What `lower` found, in words."""
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
