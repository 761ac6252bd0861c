"""Jumps of a step map: a discontinuous map is not symplectic, even if each of its pieces is.

A step whose number of sub-steps, or whose formula, depends on the state jumps where that choice changes.  The step is
taken from states along a path.  Where the map is smooth, the sixth differences of its values vary little from place to
place; at a jump they stand out.  The path is shortened round such a place again and again: the differences of a smooth
map fall to round-off, a jump stays.  All of it is in doubles, in which thousands of steps take little time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasebench.benchmarks.judge.evidence import EPS

from .battery import Entry, time_unit
from .stepping import Stepper, numerical_failures
from .structure import DISPLACEMENT, ROUNDED
from .subject import Subject

#: Points of a path, and of a shortened one; the fewest from which the step must succeed.
POINTS, FEWER, LEAST = 64, 14, 24
#: The order of the differences, and its largest binomial coefficient: the difference that a jump of 1 makes.
ORDER, PEAK = 6, 20.0
#: A difference stands out if it is this many times those beside it.
STANDS_OUT = 20.0
#: The most places of a path that are examined, and the spacing at which shortening ends.
PLACES, SHORT = 2, 1e-13
#: Steps of the two paths: near the start, in the entry's unit of time; from small to large states, in the largest's.
NEAR, FAR = 0.5, 0.5
#: The second path lies between these multiples of the start.
SMALLEST, LARGEST = 0.02, 8.0


def jumps(subject: Subject, entry: Entry, seed: int, noise: float) -> dict:
    """Search for discontinuities of the step map: a row with the largest jump along two paths of states, and its floor.

    ``noise`` is the floor of the symplecticity defect if that was measured in doubles, else 0.
    """
    stepper, y = Stepper(subject, entry), entry.start(seed)
    way = 0.4 * np.random.default_rng([3, seed, *entry.name.encode()]).uniform(-1, 1, len(y)) * entry.sizes
    paths: list[tuple[float, Callable]] = [(NEAR * entry.unit, lambda t: y + (t - 0.5) * way)]
    if not entry.share:
        far = FAR * time_unit(entry.system, y * LARGEST, entry.sizes * LARGEST)
        paths.append((far, lambda t: y * SMALLEST * (LARGEST / SMALLEST) ** t))
    floor = max(ROUNDED, noise * DISPLACEMENT, 10 * subject.eps)
    found = [(_largest(stepper, path, h, floor), h) for h, path in paths]
    value, h = max(found)
    return {"on": entry.name, "h": h, "value": value, "floor": floor}


def _largest(stepper: Stepper, path: Callable, h: float, floor: float) -> float:
    """The largest jump of the step map along ``path``, in units of the state's size; 0 below the floor."""
    values = _images(stepper, path, np.linspace(0, 1, POINTS), h)
    if len(values) < LEAST:
        return 0.0
    size = _differences(values)
    beside = np.minimum(np.roll(size, ORDER + 1), np.roll(size, -ORDER - 1))
    beside[: ORDER + 1], beside[-ORDER - 1 :] = size[ORDER + 1 : 2 * ORDER + 2], size[-2 * ORDER - 2 : -ORDER - 1]
    rises = size / np.maximum(beside, EPS * PEAK)
    places = [k for k in np.argsort(-rises) if rises[k] > STANDS_OUT]
    largest, looked = 0.0, []
    for k in places:
        if all(abs(k - other) > ORDER for other in looked) and len(looked) < PLACES:
            k = int(max(range(max(0, k - 3), min(len(size), k + 4)), key=lambda j: size[j]))
            looked.append(k)
            largest = max(largest, _jump(stepper, path, (k + ORDER / 2) / (POINTS - 1), 1 / (POINTS - 1), h, floor))
    return largest


def _jump(stepper: Stepper, path: Callable, middle: float, cell: float, h: float, floor: float) -> float:
    """The jump near t = ``middle``, found by narrowing an interval about it, at first of 4 ``cell``; 0 if none."""
    while True:
        t = middle + cell * np.linspace(-2, 2, FEWER)
        values = _images(stepper, path, t, h)
        if len(values) < FEWER:
            return 0.0
        size = _differences(values)
        if size.max() < PEAK * floor / 2:
            return 0.0
        cell *= 4 / (FEWER - 1)
        if cell < SHORT:
            return float(np.abs(np.diff(values, axis=0)).max())
        middle = t[0] + (int(np.argmax(size)) + ORDER / 2) * (t[1] - t[0])


def _differences(values: np.ndarray) -> np.ndarray:
    return np.abs(np.diff(values, ORDER, axis=0)).max(axis=1)


def _images(stepper: Stepper, path: Callable, t: np.ndarray, h: float) -> np.ndarray:
    """States after a step h from path(t) for each t, in units of their sizes, up to the first step that fails."""
    rows = []
    for x in t:
        end = np.nan
        with numerical_failures():
            end = stepper(path(x), h)
        if not np.isfinite(end).all():
            break
        rows.append(end / stepper.entry.sizes)
    return np.array(rows)
