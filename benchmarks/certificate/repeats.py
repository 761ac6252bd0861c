"""Whether a step keeps something between calls: earlier calls are repeated at the end, on the same step object.

A random sample of the calls of all measures is repeated in another order: a step without memory returns the same each
time.  The step is also called at states close to the sampled ones, at which it was never called: a true step map is
continuous there, while a step that replays remembered answers gives something else.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import Any

import mpmath
import numpy as np

from phasebench.benchmarks.measure.own_step import System
from phasebench.integrators.compile.codegen import precision
from phasebench.integrators.values.kinds import Number

from .stepping import Exact, StepFailed, report_failures
from .subject import Subject

#: The most calls recorded, and how many of the first calls are always recorded.
MOST, FIRST = 800, 24
#: At first, about one in this many calls is recorded.
EVERY = 12
#: Calls close to a state: their relative displacement, how many for each state, and for how many states.
MOVED, TIMES, BESIDE = 1e-9, 3, 120
#: The map jumps beside a state if its values there differ from that at the state by more than the share ELSEWHERE of
#: it, and from each other by less than the share ALIKE of this difference.
ELSEWHERE, ALIKE = 1e-5, 0.1
#: Steps that move the state by more than this share of it (close to a singularity) may jump.
WILD = 0.5


@dataclass(frozen=True)
class Call:
    """A recorded call of a step: its arguments, the state it returned, mpmath's digits at the time."""

    system: Any
    q: np.ndarray
    p: np.ndarray
    h: Any
    end: np.ndarray
    digits: int


@dataclass
class Calls:
    """A wrapper of a step that records a random sample of its calls, a smaller share of them the more there are."""

    step: Any
    seed: int
    kept: list[Call] = field(default_factory=list)
    count: int = 0
    listening: bool = True

    def __post_init__(self) -> None:
        self._rng, self._every, self._next = np.random.default_rng([5, self.seed]), EVERY, 0

    def __call__(self, system: System | Exact, q: np.ndarray, p: np.ndarray, h: Number) -> Any:
        """Call the step and return what it returns; record some of the calls."""
        self.count += 1
        if self.count < self._next or not self.listening:
            return self.step(system, q, p, h)
        self._next = self.count + (1 if self.count < FIRST else int(self._rng.integers(1, 2 * self._every)))
        q_, p_ = np.array(q), np.array(p)
        pair = self.step(system, q, p, h)
        with contextlib.suppress(TypeError, ValueError, LookupError):
            end = np.concatenate([np.array(pair[0]), np.array(pair[1])])
            self.kept.append(Call(system, q_, p_, h, end, mpmath.mp.dps))
        if len(self.kept) > MOST:
            left = np.sort(self._rng.permutation(np.arange(FIRST, len(self.kept)))[: MOST // 2])
            self.kept = self.kept[:FIRST] + [self.kept[i] for i in left]
            self._every *= 2
        return pair


def listening(subject: Subject, seed: int) -> tuple[Subject, Calls]:
    """The subject with its step wrapped in a recorder of calls, and the recorder."""
    calls = Calls(subject.own.step, seed)
    return replace(subject, own=replace(subject.own, step=calls)), calls


def unheard(subject: Subject) -> Subject:
    """The subject with its step not recorded: next to a jump of the map a recorded call would look like memory."""
    step = subject.own.step
    return replace(subject, own=replace(subject.own, step=step.step)) if isinstance(step, Calls) else subject


def repeat_calls(subject: Subject, calls: Calls) -> list[dict]:
    """Repeat the recorded calls in another order, and beside their states: two rows whose ``value`` should be 0."""
    calls.listening = False
    rng, kept = np.random.default_rng([6, calls.seed]), calls.kept
    worst = {"on": "all systems", "what": f"{len(kept)} of {calls.count} calls once more, last", "value": 0.0}
    for i in rng.permutation(len(kept)):
        away = _distance(_repeat_call(subject, kept[i], 0.0, rng), kept[i].end)
        if away > worst["value"]:
            worst |= {"value": away}
    doubles = [c for c in kept if c.end.dtype == float and _tame(c)]
    beside = {"on": "all systems", "what": "calls beside the states of others", "value": 0.0}
    for i in rng.permutation(len(doubles))[:BESIDE]:
        beside["value"] = max(beside["value"], _beside(subject, doubles[i], rng))
    return [worst, beside]


def _repeat_call(subject: Subject, call: Call, moved: float, rng: np.random.Generator) -> np.ndarray:
    q, p = call.q.copy(), call.p.copy()
    if moved:
        q, p = (x * (1 + moved * rng.uniform(0.5, 1.0, len(x)) * rng.choice([-1, 1], len(x))) for x in (q, p))
    with precision(call.digits), report_failures(subject, "a call that was made once more"):
        pair = subject.own.step(call.system, q, p, call.h)
    try:
        return np.concatenate([np.array(pair[0]), np.array(pair[1])])
    except (TypeError, ValueError, IndexError) as error:
        raise StepFailed(f"a call that was made once more returned no state: {error}") from None


def _tame(call: Call) -> bool:
    state = np.concatenate([call.q, call.p])
    away = np.abs(call.end - state).max()
    return bool(np.isfinite(away) and away < WILD * np.abs(state).max())


def _beside(subject: Subject, call: Call, rng: np.random.Generator) -> float:
    """Size of the jump between a recorded call's result and results from states close by; 0 if there is none."""
    size = np.abs(np.concatenate([call.q, call.p])).max()
    ends = []
    for _ in range(TIMES):
        end = _repeat_call(subject, call, MOVED, rng)
        ends.append(end)
        if not np.abs(end - call.end).max() > ELSEWHERE * size:
            return 0.0
    near, far = max(np.abs(e - ends[0]).max() for e in ends), min(np.abs(e - call.end).max() for e in ends)
    return float(far / size) if near < ALIKE * far else 0.0


def _distance(x: np.ndarray, y: np.ndarray) -> float:
    """The largest difference of two states; infinite if only one of two components is NaN."""
    if len(x) != len(y):
        return float("inf")
    if np.array_equal(x, y):
        return 0.0
    with np.errstate(all="ignore"):
        away = np.abs((x - y).astype(float))
    both = np.array([(a != a) and (b != b) for a, b in zip(x, y, strict=True)])
    return float(np.nan_to_num(np.where(both | (x == y), 0.0, away), nan=np.inf).max())
