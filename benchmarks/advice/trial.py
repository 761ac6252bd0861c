"""A candidate's runs: at a number of steps or a tolerance, with the error against what is true and the time."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from phasebench.benchmarks.measure import clock, quantities
from phasebench.benchmarks.measure.integrator import Integrator
from phasebench.benchmarks.measure.quantities import Truth
from phasebench.integrators.driver import DIVERGED, INVALID, OK
from phasebench.integrators.errors import InvalidInput

from .ask import Ask

#: A run shorter than this is timed by the clock; a longer one as it tells.
SHORT = 0.05
#: A run that may take long is first made over such a part of the span.
PART = 1 / 50
#: The same run in another process rounds otherwise where its kernel was compiled otherwise: an error moves by less
#: than this share of itself and so much of the quantity's size.
SLACK, ROUND_OFF = 0.02, 8 * float(np.finfo(float).eps)
#: The most steps of any run.
MOST = 10_000_000


class Point(NamedTuple):
    """A run: its ``size`` (steps, or tol), error, seconds without output, and how it ended."""

    size: dict[str, Any]
    error: float
    seconds: float
    steps: int
    status: str = OK
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether it came to the end."""
        return self.status == OK


@dataclass
class Trial:
    """An integrator on trial for an ask.

    Attributes
    ----------
    integrator, ask, true : who, on what, and what is true
    longest : seconds after which a run tells nothing more; a method of this project is stopped
    points : of its runs so far, by size
    prepared : its prepared runs by tolerance (None of a fixed step), once they were timed
    sharing : how often other processes shared the core while it was timed
    """

    integrator: Integrator
    ask: Ask
    true: Truth
    longest: float
    points: dict[float, Point] = field(default_factory=dict)
    prepared: dict[float | None, Any] = field(default_factory=dict)
    sharing: clock.Sharing = field(default_factory=clock.Sharing)

    def at(self, size: float) -> Point:
        """The run with so many steps, or at that tolerance."""
        if not self.integrator.adaptive:
            size = self.ask.quantity.steps(size)
        if size not in self.points:
            self.points[size] = self._run({"tol": size} if self.integrator.adaptive else {"steps": int(size)})
        return self.points[size]

    def _run(self, size: dict[str, Any]) -> Point:
        try:
            bare = self.run(size, bare=True)
            seconds = bare.seconds
            if bare.status == OK and seconds < SHORT:
                seconds = self.seconds(size)
            found = self.run(size) if bare.status == OK and self.ask.quantity.rows > 1 else bare
        except InvalidInput as error:
            return Point(size, inf, inf, 0, INVALID, str(error))
        if found.status != OK:
            return Point(size, inf, bare.seconds, bare.counts["steps"], found.status, found.reason)
        error = quantities.error(self.ask.problem, self.ask.quantity, found, self.true)
        return Point(size, error, seconds, bare.counts["steps"])

    def seconds(self, size: dict[str, Any]) -> float:
        """The seconds of a warm run at a size, without output, by `measure.clock`; of one not prepared as it tells."""
        tol = size.get("tol")
        if not self.integrator.preparable:
            return self.run(size, bare=True).seconds
        if tol not in self.prepared:
            with warnings.catch_warnings():  # Numba calls functions in tuples experimental
                warnings.simplefilter("ignore")
                self.prepared[tol] = self.integrator.prepare(self.ask.problem, tol=tol)
        timed = clock.clock(
            self.integrator,
            self.ask.problem,
            t_end=self.ask.t_end,
            steps=size.get("steps"),
            tol=tol,
            run=self.prepared[tol],
            sharing=self.sharing,
        )
        return timed()

    def meets(self, point: Point, accuracy: float) -> bool:
        """Whether a run meets an accuracy, with a margin for what is uncertain and for another's last digits."""
        size = float(np.abs(self.true.values).max()) if len(self.true.values) else 0.0
        slack = self.true.uncertainty + ROUND_OFF * max(size, 1.0 if self.ask.quantity.kept else 0.0)
        return point.ok and (1 + SLACK) * point.error + slack <= accuracy

    def run(self, size: dict[str, Any], bare: bool = False):
        """The solution at a size: with the quantity's rows, or without output where it is ``bare``."""
        rows = {**size, "save_every": 0} if bare else self.ask.quantity.grid(**size)
        stop = {"timeout": self.longest} if self.integrator.stoppable and isfinite(self.longest) else {}
        return self.integrator.run(self.ask.problem, t_end=self.ask.t_end, **rows, **stop)

    def error(self, size: float) -> float:
        """The error of a further run at a size."""
        found = self.run({"tol": size} if self.integrator.adaptive else {"steps": int(size)})
        return quantities.error(self.ask.problem, self.ask.quantity, found, self.true)

    def pilot(self, size: float) -> float:
        """The seconds that a run of a size will take, from one over a part of the span; 0 where it can be stopped."""
        if self.integrator.stoppable:
            return 0.0
        part = {"tol": size} if self.integrator.adaptive else {"steps": max(1, round(size * PART))}
        try:
            done = self.integrator.run(self.ask.problem, t_end=self.ask.t_end * PART, **part, save_every=0)
        except InvalidInput:
            return 0.0
        return done.seconds / PART if done.status == OK else 0.0

    def failure(self) -> str:
        """How the run of the most steps, or of the tightest tolerance, ended."""
        if not self.points:
            return DIVERGED
        size = (min if self.integrator.adaptive else max)(self.points)
        point = self.points[size]
        return f"{point.status}: {point.reason}" if point.reason else point.status
