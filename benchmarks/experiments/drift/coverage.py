r"""How often the interval of a drift covers the drift, on series whose drift is known.

A series is

.. math::
    e_n = A\,(\cos(\omega t_n + \phi) + 0.3 \cos(2\omega t_n + 2\phi)) + w_n + r_n + s\,t_n, \qquad t_n = n h,

with the amplitude A between `AMPLITUDES`, whatever phase, a period that no step fits, white noise w of `WHITE`, a
random walk r of `WALK` a step (the round-off of Brouwer's law) and a drift s.  As many are drawn, with a seed, as the
coverage is to be told from.  Beside it stands what the line through all points has, neighbours being taken for
independent.
"""

from __future__ import annotations

import zlib

import numpy as np

from phasebench.benchmarks.measure import metrics
from phasebench.benchmarks.measure.drift import drift
from phasebench.benchmarks.rows.cells import Cell, Rows, content

#: Logarithms of the least and the greatest amplitude; the noise of a point, the walk's of a step; the drift, the step.
AMPLITUDES = (-9, -3)
WHITE, WALK, SLOPE, STEP = 1e-12, 1e-15, 1e-14, 0.1
#: Kind of a series -> (white noise, random walk, drift).
KINDS = {
    "oscillation": (0.0, 0.0, 0.0),
    "with white noise": (WHITE, 0.0, 0.0),
    "with a random walk": (0.0, WALK, 0.0),
    "with both and a drift": (WHITE, WALK, SLOPE),
    "with a drift alone": (0.0, 0.0, SLOPE),
}
#: Points of a series, periods in its whole time (as many as points allow), and how many series are drawn.
LENGTHS, PERIODS, DRAWN = (400, 5000), (0.5, 1, 2, 4, 10, 25, 70, 190), 400
#: A period has at least so many points.
SAMPLED = 4


def series(kind: str, periods: float, points: int, generator: np.random.Generator):
    """(t, e, the drift) of one series; t, e arrays (points,)."""
    white, walk, slope = KINDS[kind]
    t = np.arange(points) * STEP
    angle = 2 * np.pi * (periods * generator.uniform(0.95, 1.05) * t / t[-1] + generator.random())
    oscillation = 10 ** generator.uniform(*AMPLITUDES) * (np.cos(angle) + 0.3 * np.cos(2 * angle))
    noise = white * generator.standard_normal(points) + walk * np.cumsum(generator.standard_normal(points))
    e = oscillation + noise + slope * t
    return t, e - e[0], slope


def covered(kind: str, periods: float, points: int, drawn: int = DRAWN) -> dict:
    """A row: the shares of intervals that cover the drift, and the median of their half-widths."""
    generator = np.random.default_rng(zlib.crc32(f"{kind} {periods} {points}".encode()))
    ours, lines = [], []
    for _ in range(drawn):
        t, e, slope = series(kind, periods, points, generator)
        for found, estimate in ((ours, drift), (lines, metrics.slope)):
            s = estimate(t, e)
            found.append((s.low <= slope <= s.high, (s.high - s.low) / 2))
    row = {"kind": kind, "points": points, "periods": periods, "drawn": drawn}
    for suffix, found in (("", ours), (" by the line", lines)):
        row[f"covered{suffix}"] = float(np.mean([hit for hit, _ in found]))
        row[f"half-width{suffix}"] = float(np.median([width for _, width in found]))
    return row


def cells(quick: bool = False) -> list[Cell]:
    """A cell for each kind, length and number of periods; none of the quick tier."""
    found = [(k, p, n) for k in KINDS for n in LENGTHS for p in PERIODS if n >= SAMPLED * p]
    return [] if quick else [_cell(*of) for of in found]


def _cell(kind: str, periods: float, points: int) -> Cell:
    return Cell(
        "drift",
        ("drift_coverage",),
        {"kind": kind, "periods": periods, "points": points},
        measured,
        (kind, periods, points),
        content("drift", kind, periods, points, code=[__name__]),
        frozenset(),
    )


def measured(kind: str, periods: float, points: int) -> Rows:
    """The row of a kind of series."""
    return {"drift_coverage": [covered(kind, periods, points)]}
