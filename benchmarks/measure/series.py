"""The drift of a stored series, such as the energy along a run of any program, at even or uneven times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phasebench.integrators.errors import InvalidInput

from . import drift as estimator
from .changes import JUMP, Change, changes
from .metrics import CONFIDENCE
from .tabular import TabularResult

if TYPE_CHECKING:
    import pandas as pd

#: Numbers in order: a list, an array, a column of a data frame.
Numbers = Sequence[float] | NDArray[Any]

#: Steps of time that differ by less than this share of their mean are even: what printing with few digits leaves.
EVEN = 1e-3


@dataclass(frozen=True, repr=False)
class Drift(TabularResult):
    """The secular slope of a series, with its interval, and its sudden changes; it prints as a table.

    Attributes
    ----------
    slope : the drift, a change of the series for a unit of time, besides the sudden changes
    interval : (low, high), which holds the true slope with a probability of 95 %
    oscillation : half the range of the series once drift and changes are subtracted
    method : how the slope and its interval were found
    changes : `Change`s (kind, time, size): a "jump" by ``size``, or an "onset": the slope is larger by it from then on
    """

    slope: float
    interval: tuple[float, float]
    oscillation: float
    method: str
    changes: tuple[Change, ...] = ()

    @property
    def holds_zero(self) -> bool:
        """True if the interval contains 0: no steady drift is seen."""
        return self.interval[0] <= 0.0 <= self.interval[1]

    @property
    def seen(self) -> bool:
        """True if the series drifts: steadily, by a jump, or from some time on."""
        return bool(self.changes) or not self.holds_zero

    @property
    def seen_above(self) -> float | None:
        """The size of a drift above which the same series with it would not hold 0; None if a drift is seen."""
        return None if self.seen else max(-self.interval[0], self.interval[1])

    def verdicts(self) -> list[str]:
        """Return what is seen, a line each: every change, and a steady drift or up to which size there is none."""
        lines = [
            f"a jump by {c.size:+.3g} at t = {c.time:.6g}"
            if c.kind == JUMP
            else f"an onset at t = {c.time:.6g}: from then on {c.size:+.3g} in a unit of time"
            for c in self.changes
        ]
        if not self.holds_zero:
            return [*lines, "it drifts: the interval excludes 0"]
        return lines or [f"none is seen; a drift above {self.seen_above:.3g} in a unit of time would have been"]

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame of one row: slope, low, high, oscillation, method."""
        import pandas as pd

        low, high = self.interval
        row = {"slope": self.slope, "low": low, "high": high, "oscillation": self.oscillation, "method": self.method}
        return pd.DataFrame([row])

    def as_dict(self) -> dict[str, Any]:
        """Return the result as a dict for JSON: slope, interval [low, high], and the other attributes."""
        return {
            "slope": self.slope,
            "interval": list(self.interval),
            "oscillation": self.oscillation,
            "method": self.method,
            "changes": [change._asdict() for change in self.changes],
            "seen_above": self.seen_above,
        }

    def _heading(self) -> list[str]:
        return [*self.verdicts(), self.method]

    def _printed(self) -> pd.DataFrame:
        import pandas as pd

        numbers = {"slope": self.slope, "low": self.interval[0], "high": self.interval[1]}
        return pd.DataFrame([{k: f"{x:+.3e}" for k, x in numbers.items()} | {"oscillation": f"{self.oscillation:.3e}"}])


def drift(t: Numbers, series: Numbers) -> Drift:
    """Estimate the drift (secular slope) of an oscillating series over times, with a 95 % interval.

    A straight line through an oscillation has a slope of its own, and an interval that is far too narrow; here the
    oscillation is averaged and fitted first, and the noise that is left may be white or a random walk.

    Parameters
    ----------
    t : n times, rising or falling, n at least 48; they may be uneven, with several of them to every oscillation
    series : n numbers, such as the energy at those times

    Returns
    -------
    Drift

    Raises
    ------
    InvalidInput
        For fewer numbers, numbers that are not finite, or times that do not rise or fall all the way.

    Notes
    -----
    An oscillation of fewer than 1.5 periods in the whole series looks like a drift.  Uneven times are replaced by even
    ones, between which Akima's cubic interpolates.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 100.0, 2001)
    >>> drift(t, 1e-3 * np.sin(t)).holds_zero
    True
    >>> drift(t, 1e-3 * np.sin(t) + 1e-6 * t).holds_zero
    False
    """
    times, values = _numbers("t", t), _numbers("series", series)
    if len(times) != len(values):
        raise InvalidInput(f"there are {len(times)} times and {len(values)} values; give one value for each time")
    if len(times) < estimator.POINTS:
        raise InvalidInput(f"{len(times)} points are too few to tell a drift; give at least {estimator.POINTS}")
    if times[-1] < times[0]:
        times, values = times[::-1], values[::-1]
    steps = np.diff(times)
    if not (steps > 0).all():
        at = int(np.argmax(steps <= 0))
        raise InvalidInput(
            f"the times must rise or fall all the way; after t = {times[at]:.10g} is {times[at + 1]:.10g}"
        )
    error = values - values[0]
    method = f"generalized least squares, noise white or a random walk, {CONFIDENCE:.0%} interval"
    if np.ptp(steps) > EVEN * steps.mean():
        times, error = _even(times, error)
        method += f"; uneven times, interpolated at {len(times)} even ones"
    sudden, found = changes(times, error)
    rest = error - found.value * (times - times[0])
    for change in sudden:
        later = times >= change.time
        rest = rest - change.size * (later if change.kind == JUMP else later * (times - change.time))
    interval = (found.low, found.high)
    return Drift(found.value, interval, float(np.ptp(rest)) / 2, method, tuple(sudden))


def _numbers(name: str, given: Numbers) -> NDArray[np.float64]:
    """Return a list of numbers as an array (n,); raise InvalidInput, naming ``name``, unless all are finite numbers."""
    try:
        values = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(f"{name} must be a list of numbers") from None
    if values.ndim != 1:
        raise InvalidInput(f"{name} must be a list of numbers; its shape is {values.shape}")
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InvalidInput(f"{name} has {values[bad[0]]} at position {bad[0]}; every number must be finite")
    return values


def _even(t: NDArray[np.float64], error: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Interpolate a series, arrays (n,), to n equidistant times by Akima's cubic; return (times, values)."""
    from scipy.interpolate import Akima1DInterpolator

    times = np.linspace(t[0], t[-1], len(t))
    return times, np.asarray(Akima1DInterpolator(t, error)(times), dtype=float)
