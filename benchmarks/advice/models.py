"""The cheapest simplified model of a problem that meets an accuracy, from stored measurements.

A scene is a problem with a span and a quantity.  `models.csv` has, for each scene whose problem has simplified models,
each model's error in the quantity, and the errors and times of integrations of the model (only runs that no cheaper run
beats).  `build` computes the file from the tables of the report page on models.  A scene is found by its Hamiltonian
and initial state (`fingerprint`), whatever the problem is called.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from itertools import groupby
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from phasebench.benchmarks.problems.base import Problem
from phasebench.benchmarks.problems.models.ladders import BY_ID
from phasebench.benchmarks.store.shipped import ShippedTable

from . import fewer_bodies, words
from .ask import Ask

if TYPE_CHECKING:
    import pandas as pd

#: Spans are equal up to this relative difference.
SAME = 1e-9


class Rung(NamedTuple):
    """A model of a problem, simplified or the full problem itself, and its measured integrations (error, seconds).

    ``off`` bounds the error that the simplification causes in the quantity.
    """

    model: str
    full: bool
    off: float
    runs: tuple[tuple[float, float], ...]

    def cost(self, accuracy: float) -> float:
        """Least seconds for which modelling plus integration error is within an accuracy; infinite if it never is."""
        return min((s for error, s in self.runs if error + self.off <= accuracy), default=inf)


class Scene(NamedTuple):
    """The models of a problem for one span and quantity, the full one last; ``key`` is the problem's `fingerprint`."""

    key: str
    d: int
    t_end: float
    quantity: str
    rungs: tuple[Rung, ...]


def fingerprint(problem: Problem) -> str:
    """Hash of a canonical problem's H and initial state, independent of the names of its variables."""
    return hashlib.sha256(" ".join(words.formula(problem)).encode()).hexdigest()[:16]


def _scene(lines: list[dict[str, str]]) -> Scene:
    first, rungs = lines[0], []
    for model, members in groupby(lines, key=lambda line: line["model"]):
        own = list(members)
        runs = tuple((float(line["error"]), float(line["seconds"])) for line in own)
        rungs.append(Rung(model, own[0]["full"] == "True", float(own[0]["off"]), runs))
    return Scene(first["key"], int(first["d"]), float(first["t_end"]), first["quantity"], tuple(rungs))


def scene_of(ask: Ask) -> Scene | None:
    """The stored simplified models of a question's problem, measured for its quantity; None if there are none.

    Of several stored spans, the shortest one that covers the span of the question is taken; its scenes are joined.
    """
    problem, name = ask.problem, ask.quantity.name
    near = [
        s for s in TABLE.load() if s.quantity == name and s.d == problem.system.d and s.t_end * (1 + SAME) >= ask.t_end
    ]
    if not near or not problem.system.canonical:
        return None
    key = fingerprint(problem)
    own = sorted((s for s in near if s.key == key), key=lambda s: s.t_end)
    if not own:
        return None
    rungs = [r for s in own if s.t_end == own[0].t_end for r in s.rungs]
    return own[0]._replace(rungs=tuple(sorted(rungs, key=lambda r: r.full)))


def lower(ask: Ask) -> dict[str, Any] | None:
    """Find the cheapest simplified model that meets the accuracy; None without stored models or an accuracy.

    ``off`` is the error at the stored ``t_end`` of the model or, if none meets the accuracy, of the ``nearest`` one;
    ``saves`` the full problem's time over the model's.
    """
    scene = None if ask.accuracy is None or ask.t_end < 0 else scene_of(ask)
    if scene is None:
        return None
    below, full = [r for r in scene.rungs if not r.full], next(r for r in scene.rungs if r.full)
    best = min(below, key=lambda r: r.cost(ask.accuracy))
    seconds = best.cost(ask.accuracy)
    if not isfinite(seconds):
        nearest = min(below, key=lambda r: r.off)
        return {"model": None, "nearest": nearest.model, "off": nearest.off, "t_end": scene.t_end}
    saves = full.cost(ask.accuracy) / seconds
    return {
        "model": best.model,
        "off": best.off,
        "t_end": scene.t_end,
        "saves": saves if isfinite(saves) else None,
    }


def summarize(found: dict[str, Any]) -> str:
    """A sentence on the simplified model found by `lower` or `fewer_bodies.lower`: its error, and the time it saves."""
    if "alone" in found:
        return fewer_bodies.summarize(found)
    if found["model"] is None:
        return f"no lower model would do: the nearest ({found['nearest']}) is off by {_off(found)}"
    text = f"a lower model would do: {found['model']}, off by {_off(found)}"
    if found["saves"] is None:
        return f"{text}; the full one was not integrated to that accuracy there"
    but = ", but it saves no time: the" if found["saves"] <= 1 else ", where the"
    return f"{text}{but} full one takes {found['saves']:.2g} times as long"


def _off(found: dict[str, Any]) -> str:
    return f"{found['off']:.2g} at t = {found['t_end']:g}"


# -- the stored lines --------------------------------------------------------------------------------------------------


def build(models: pd.DataFrame, runs: pd.DataFrame) -> Iterator[dict[str, object]]:
    """Yield the lines of `models.csv` from the tables of modelling errors and of runs of integrators on each model."""
    for id, rungs in models.groupby("scene", sort=False):
        ladder = BY_ID[id]
        full = ladder.rungs[-1].make()
        head = {"scene": id, "key": fingerprint(full), "d": full.system.d, "t_end": ladder.t_end}
        for m in rungs.sort_values("rung").to_dict("records"):
            whole = str(m["full"]) == "True"
            off = 0.0 if whole else m["modelling error"] + m["integration"] + m["uncertainty"]
            own = runs[(runs["scene"] == id) & (runs["rung"] == m["rung"])].sort_values("seconds")
            least = inf
            for error, seconds in zip(own["error"], own["seconds"], strict=True):
                if error < least:
                    least = error
                    line = {"quantity": ladder.quantity, "model": m["model"], "full": whole, "off": f"{off:.4g}"}
                    yield head | line | {"error": f"{error:.4g}", "seconds": f"{seconds:.4g}"}


def parse(lines: list[dict[str, str]]) -> tuple[Scene, ...]:
    """The `Scene` objects (a problem's models) read from the lines of `models.csv`."""
    return tuple(_scene(list(members)) for _, members in groupby(lines, key=lambda line: line["scene"]))


TABLE = ShippedTable(Path(__file__).with_name("models.csv"), build, parse)
