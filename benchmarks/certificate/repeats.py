"""What a step keeps between calls, asked last, of the same object: calls of all measures are made once more.

A sample of the calls, drawn at random over the whole of the measures, is repeated in another order: where nothing is
kept each returns what it returned.  Beside their states, where it was never called, the map goes on as it is there: of
what remembers its answers it is another.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import Any

import mpmath
import numpy as np

from phasebench.integrators.engine.codegen import precision

from .stepping import StepFailed, told
from .subject import Subject

#: So many calls are kept at most, and the first of them all.
MOST, FIRST = 800, 24
#: Of about so many calls one is kept, at first.
EVERY = 12
#: Repeated calls are moved by this part of themselves, so many times; so many of them.
MOVED, TIMES, BESIDE = 1e-9, 3, 120
#: A map that is another beside a state: it moves by more than this part of the state, by less of what it moved there.
ELSEWHERE, ALIKE = 1e-5, 0.1
#: A step that moves a state by more than this part of it, close to a singularity, may do so.
WILD = 0.5


@dataclass(frozen=True)
class Call:
    """A call of a step: what it was handed, what it returned, in how many digits mpmath worked."""

    system: Any
    q: np.ndarray
    p: np.ndarray
    h: Any
    end: np.ndarray
    digits: int


@dataclass
class Calls:
    """A step that keeps a sample of its calls: drawn by a seed, the rarer the more there were."""

    step: Any
    seed: int
    kept: list[Call] = field(default_factory=list)
    count: int = 0
    listening: bool = True

    def __post_init__(self):
        self._rng, self._every, self._next = np.random.default_rng([5, self.seed]), EVERY, 0

    def __call__(self, system, q, p, h):
        """What the step returns."""
        self.count += 1
        if self.count < self._next or not self.listening:
            return self.step(system, q, p, h)
        self._next = self.count + (1 if self.count < FIRST else int(self._rng.integers(1, 2 * self._every)))
        q_, p_ = np.array(q), np.array(p)
        pair = self.step(system, q, p, h)
        with contextlib.suppress(TypeError, ValueError):
            end = np.concatenate([np.array(pair[0]), np.array(pair[1])])
            self.kept.append(Call(system, q_, p_, h, end, mpmath.mp.dps))
        if len(self.kept) > MOST:
            left = np.sort(self._rng.permutation(np.arange(FIRST, len(self.kept)))[: MOST // 2])
            self.kept = self.kept[:FIRST] + [self.kept[i] for i in left]
            self._every *= 2
        return pair


def listening(subject: Subject, seed: int) -> tuple[Subject, Calls]:
    """The subject with a step that keeps a sample of its calls, and that step."""
    calls = Calls(subject.own.step, seed)
    return replace(subject, own=replace(subject.own, step=calls)), calls


def unheard(subject: Subject) -> Subject:
    """The subject whose calls are not kept: states next to a jump, where the map is no other for what was kept."""
    step = subject.own.step
    return replace(subject, own=replace(subject.own, step=step.step)) if isinstance(step, Calls) else subject


def repeated(subject: Subject, calls: Calls) -> list[dict]:
    """Rows of what changes when calls are made once more, and beside the states of some of them; see above."""
    calls.listening = False
    rng, kept = np.random.default_rng([6, calls.seed]), calls.kept
    worst = {"on": "all systems", "what": f"{len(kept)} of {calls.count} calls once more, last", "value": 0.0}
    for i in rng.permutation(len(kept)):
        away = _apart(_again(subject, kept[i], 0.0, rng), kept[i].end)
        if away > worst["value"]:
            worst |= {"value": away}
    doubles = [c for c in kept if c.end.dtype == float and _tame(c)]
    beside = {"on": "all systems", "what": "calls beside the states of others", "value": 0.0}
    for i in rng.permutation(len(doubles))[:BESIDE]:
        beside["value"] = max(beside["value"], _beside(subject, doubles[i], rng))
    return [worst, beside]


def _again(subject: Subject, call: Call, moved: float, rng) -> np.ndarray:
    """What the step returns for a call, its state moved by a part of itself."""
    q, p = call.q.copy(), call.p.copy()
    if moved:
        q, p = (x * (1 + moved * rng.uniform(0.5, 1.0, len(x)) * rng.choice([-1, 1], len(x))) for x in (q, p))
    with precision(call.digits), told(subject, "a call that was made once more"):
        pair = subject.own.step(call.system, q, p, call.h)
    try:
        return np.concatenate([np.array(pair[0]), np.array(pair[1])])
    except (TypeError, ValueError, IndexError) as error:
        raise StepFailed(f"a call that was made once more returned no state: {error}") from None


def _tame(call: Call) -> bool:
    """Whether the step moved the state by little, and by more than round-off."""
    state = np.concatenate([call.q, call.p])
    away = np.abs(call.end - state).max()
    return bool(np.isfinite(away) and away < WILD * np.abs(state).max())


def _beside(subject: Subject, call: Call, rng) -> float:
    """By how much the map beside a call's state is another than at it; 0 where it goes on."""
    size = np.abs(np.concatenate([call.q, call.p])).max()
    ends = []
    for _ in range(TIMES):
        end = _again(subject, call, MOVED, rng)
        ends.append(end)
        if not np.abs(end - call.end).max() > ELSEWHERE * size:
            return 0.0
    near, far = max(np.abs(e - ends[0]).max() for e in ends), min(np.abs(e - call.end).max() for e in ends)
    return float(far / size) if near < ALIKE * far else 0.0


def _apart(x, y) -> float:
    """The largest difference; infinite where one of them alone is no number."""
    if len(x) != len(y):
        return float("inf")
    if np.array_equal(x, y):
        return 0.0
    with np.errstate(all="ignore"):
        away = np.abs((x - y).astype(float))
    both = np.array([(a != a) and (b != b) for a, b in zip(x, y, strict=True)])
    return float(np.nan_to_num(np.where(both | (x == y), 0.0, away), nan=np.inf).max())
