"""Sudden changes of a series: a jump to another level, or a slope that sets in at some time."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .drift import MODELS, MODES, OVERLAP, SAMPLES, average, drift, fitted, split, window

if TYPE_CHECKING:
    from .metrics import Slope

JUMP, ONSET = "jump", "onset"
#: The most changes that are looked for, and the share of the series at each end in which none is:
#: what begins there may be a burst that the series does not hold in full.
MOST, EDGE = 5, 0.08
#: A change is seen if noise makes one as large with a smaller probability, at a given time.
RARE = 1e-5
#: It must also be so many standard errors of white noise: a burst, after which the level returns, is no jump.
LASTS = 6.0
#: And it must be this share of the series' range: fitted lines leave a little of an oscillation.
VISIBLE = 0.1


class Change(NamedTuple):
    """A jump by ``size`` at a time, or an onset: from that time on the slope is larger by ``size``."""

    kind: str
    time: float
    size: float


def changes(t: np.ndarray, error: np.ndarray) -> tuple[list[Change], Slope]:
    """Return the sudden changes of a series ``error`` at equidistant times t, arrays (n,), and the slope besides them.

    The oscillation is fitted and subtracted as in `drift.drift`; without a change the slope is the one found there.
    """
    whole, apart, visible = (t, error), len(t) // SAMPLES, VISIBLE * float(np.ptp(error))
    if not visible > 0:
        return [], drift(t, error)
    t, error = average(t, error)
    n = len(t)
    places = np.unique(np.linspace(EDGE * n, (1 - EDGE) * n, 4 * MODES).astype(int))
    candidates = [(kind, int(place)) for kind in (JUMP, ONSET) for place in places]
    found: list[tuple[str, int]] = []
    sizes = np.empty(0)
    while True:
        shapes = _shapes(t, found, apart)
        rest, lines = split(t, error - shapes @ sizes)
        rest = rest + shapes @ sizes
        base = np.column_stack([lines, t, shapes])
        kind, place = _strongest(rest, base, t, candidates, apart, visible) if len(found) < MOST else (None, 0)
        if kind is None:
            break
        near = range(max(places[0], place - n // MODES), min(places[-1], place + n // MODES) + 1)
        if kind == ONSET:
            place = _strongest(rest, base, t, [(kind, i) for i in near], apart, visible)[1]
        else:
            place = _edge(rest - shapes @ sizes, near)
        found.append((kind, place))
        candidates = [(k, i) for k, i in candidates if i not in near]
        sizes = _sizes(rest, np.column_stack([lines, t]), _shapes(t, found, apart), apart)
    slope = fitted(rest, np.hstack([lines, shapes]), t[:, None], apart).slope()
    named = []
    for (kind, i), size in zip(found, sizes, strict=True):
        if kind == ONSET:
            named.append(Change(kind, float(t[i]), float(size / _reach(t, i))))
        else:
            named.append(Change(kind, _time(*whole, t[i], size, apart), float(size)))
    return sorted(named, key=lambda change: change.time), slope


def _time(t: np.ndarray, error: np.ndarray, about: float, size: float, apart: int) -> float:
    """Return the time of a jump by ``size`` in a whole series: of its largest step ``about`` that time, if it shows."""
    if apart < 2:
        return float(about)
    place = int(np.searchsorted(t, about))
    start = max(0, place - OVERLAP * apart)
    steps = np.diff(error[start : place + OVERLAP * apart]) / size
    return float(t[start + 1 + np.argmax(steps)] if steps.max() > 0.5 else about)


def _shapes(t: np.ndarray, found: list[tuple[str, int]], apart: int) -> np.ndarray:
    """Return a column (n,) over times t (n,) for each (kind, place): a jump by 1, or a bend.

    A bend is 1 away from the line between its ends.
    It is smoothed as the series is, of whose means neighbours are ``apart`` points from each other.
    """
    columns = np.array(
        [t >= t[i] if kind == JUMP else np.maximum(t - t[i], 0) / _reach(t, i) for kind, i in found], float
    )
    if len(found) and apart > 1:
        steps = np.apply_along_axis(np.convolve, 1, np.diff(columns, axis=1), window(OVERLAP), "same")
        columns[:, 1:] = columns[:, :1] + np.cumsum(steps, axis=1)
    return columns.reshape(-1, len(t)).T


def _reach(t: np.ndarray, i: int) -> float:
    """Return how far a series of slope 0 before t[i], and 1 from there on, is from the line between its ends."""
    return float((t[i] - t[0]) * (t[-1] - t[i]) / (t[-1] - t[0]))


def _strongest(
    rest: np.ndarray, base: np.ndarray, t: np.ndarray, candidates: list[tuple[str, int]], apart: int, visible: float
) -> tuple[str | None, int]:
    """Return the one of some ``candidates`` (kind, place) that is most surely a change; (None, 0) if none is.

    A change of the series ``rest`` (n,) by less than ``visible`` is none.
    """
    fit = fitted(rest, base, _shapes(t, candidates, apart), apart)
    size = np.abs(fit.values / fit.errors)
    below = fit.below(0.0)
    seen = (2 * np.minimum(below, 1 - below) < RARE) & (size[MODELS.index(0.0)] > LASTS)
    seen &= np.abs((fit.weights * fit.values).sum(axis=0)) >= visible
    if not seen.any():
        return None, 0
    return candidates[int(np.argmax(np.where(seen, (fit.weights * size).sum(axis=0), 0.0)))]


def _edge(rest: np.ndarray, near: range) -> int:
    """Return the first point of the other level of a series (n,) that jumps ``near`` some place."""
    a, b = max(0, near.start - len(near) // 2), min(len(rest), near.stop + len(near) // 2)
    y = rest[a:b] - rest[a:b].mean()
    before = np.arange(1, len(y))
    return a + 1 + int(np.argmax(np.cumsum(y)[:-1] ** 2 / (before * before[::-1])))


def _sizes(rest: np.ndarray, base: np.ndarray, shapes: np.ndarray, apart: int) -> np.ndarray:
    """Return the coefficients of ``shapes`` (n, k), fitted together to a series ``rest`` (n,): array (k,)."""
    out = []
    for i in range(shapes.shape[1]):
        fit = fitted(rest, np.hstack([base, np.delete(shapes, i, axis=1)]), shapes[:, [i]], apart)
        out.append(float((fit.weights * fit.values).sum()))
    return np.array(out)
